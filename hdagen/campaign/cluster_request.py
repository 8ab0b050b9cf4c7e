"""Where tasks run: in this process, on workers of this machine, or on a cluster at an address."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from hdagen.arm.build_loader import PlantError
from hdagen.support.input_file import InputFileError, read_json
from hdagen.support.messages import show_path, show_value

_ADDRESS_PATTERN = re.compile(r"(tls|tcp)://(\[[0-9a-fA-F:]+\]|[\w.-]+):\d{1,5}")
_MEMORY_PATTERN = re.compile(r"(\d+(?:\.\d+)?) ?([kMGT]i?B)")
_MOST_SCHEDULER_FILE_BYTES = 10_000_000
_BYTE_UNITS = {"k": 1, "M": 2, "G": 3, "T": 4}


@dataclass(frozen=True)
class ClusterRequest:
    """Where tasks run.

    Attributes:
        jobs: Worker processes on this machine; 1 means this process.
        scheduler: Address of a cluster's scheduler.
        scheduler_file: File that such a scheduler wrote.
        tls_ca: Certificate of the authority that signed all others.
        tls_cert: Certificate of this client.
        tls_key: Key of this client.
        is_insecure: Whether an address without encryption is taken.
        memory: Memory that one task may take, such as "2 GB".

    """

    jobs: int = 1
    scheduler: str | None = None
    scheduler_file: Path | None = None
    tls_ca: Path | None = None
    tls_cert: Path | None = None
    tls_key: Path | None = None
    is_insecure: bool = False
    memory: str | None = None

    @property
    def is_remote(self) -> bool:
        """Whether a cluster is named."""
        return self.scheduler is not None or self.scheduler_file is not None

    def list_problems(self) -> Iterator[str]:
        """List what cannot be used, before anything is started.

        Yields:
            A sentence for each problem.

        """
        if self.jobs < 1:
            yield f"--jobs {self.jobs}: possible is a whole number from 1 on."
        if self.memory is not None and not _MEMORY_PATTERN.fullmatch(self.memory):
            yield f"--memory {show_value(self.memory)}: possible is a size such as '2 GB' or 500MB."
        certificates = {"--tls-ca": self.tls_ca, "--tls-cert": self.tls_cert, "--tls-key": self.tls_key}
        given = [name for name, path in certificates.items() if path is not None]
        if not self.is_remote:
            for name in [*given, *(["--insecure"] if self.is_insecure else [])]:
                yield f"{name}: goes with --scheduler or --scheduler-file only."
            return
        if self.scheduler is not None and self.scheduler_file is not None:
            yield "--scheduler and --scheduler-file: give one of them."
            return
        if self.memory is not None:
            yield "--memory: a cluster's workers have their own limit; start them with --memory-limit."
        yield from (
            f"{name} {show_path(path)}: there is no such file; give the certificate that the cluster was made with."
            for name, path in certificates.items()
            if path is not None and not path.is_file()
        )
        yield from self._list_address_problems(len(given))

    def _list_address_problems(self, certificate_count: int) -> Iterator[str]:
        try:
            address = self.find_address()
        except PlantError as error:
            yield str(error)
            return
        if address.startswith("tcp://"):
            if not self.is_insecure:
                yield (
                    f"{address}: whoever reaches such a scheduler runs programs on its workers; use tls:// with "
                    "--tls-ca, --tls-cert and --tls-key, or say --insecure on a network that you trust."
                )
        elif certificate_count < 3:
            yield f"{address}: give --tls-ca, --tls-cert and --tls-key, which prove both sides to each other."

    def find_address(self) -> str:
        """Find the scheduler's address.

        Returns:
            The address.

        Raises:
            PlantError: It is no address, or the scheduler file cannot be read.

        """
        address, place = self.scheduler, "--scheduler"
        if self.scheduler_file is not None:
            place = f"--scheduler-file {show_path(self.scheduler_file)}"
            try:
                content = read_json(self.scheduler_file, _MOST_SCHEDULER_FILE_BYTES, "give the scheduler's own file")
            except InputFileError as error:
                raise PlantError(error) from None
            address = content.get("address") if isinstance(content, dict) else None
        if not isinstance(address, str) or not _ADDRESS_PATTERN.fullmatch(address):
            raise PlantError(
                f"{place}: found {show_value(address)}, possible is an address such as tls://10.0.0.1:8786."
            )
        return address

    def count_memory_bytes(self) -> int | None:
        """Count the bytes of memory that a task may take.

        Returns:
            The bytes; None where nothing is said.

        """
        found = _MEMORY_PATTERN.fullmatch(self.memory or "")
        if not found:
            return None
        base = 1000
        if "i" in found[2]:
            base = 1024
        return int(float(found[1]) * base ** _BYTE_UNITS[found[2][0]])


def format_bytes(count: float) -> str:
    """Write a size of memory.

    Args:
        count: Bytes.

    Returns:
        The size with its unit.

    """
    for unit in ("B", "kB", "MB", "GB"):
        if count < 1000 or unit == "GB":
            return f"{count:.3g} {unit}"
        count /= 1000
    return ""
