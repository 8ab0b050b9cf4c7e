"""Clusters of separate processes, each with a folder, a cache and a home of its own, as on machines without a common
disk."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from distributed import Security

from hdagen.campaign.cluster_request import ClusterRequest

ROOT = Path(__file__).parents[2]
SUPPORT = Path(__file__).parent


@dataclass
class Site:
    """A scheduler and its workers; ``folder`` holds a folder for each of them, and the certificates."""

    folder: Path
    address: str = ""
    processes: dict[str, subprocess.Popen[bytes]] = field(default_factory=dict)

    @property
    def certificates(self) -> dict[str, Path]:
        """The files of the certificates, by the names of their options."""
        return {
            "tls_ca": self.folder / "cert.pem",
            "tls_cert": self.folder / "cert.pem",
            "tls_key": self.folder / "key.pem",
        }

    def ask(self, **changes: object) -> ClusterRequest:
        """A request for this cluster."""
        return ClusterRequest(**({"scheduler": self.address} | self.certificates | changes))  # type: ignore[arg-type]

    def options(self) -> list[str]:
        """The options of a command that runs on this cluster."""
        words = ["--scheduler", self.address]
        for name, path in self.certificates.items():
            words += [f"--{name.replace('_', '-')}", str(path)]
        return words

    def start(self, name: str, module: str, *arguments: str, **environment: str) -> Path:
        """Starts a process of Dask with its own folder, home, cache and place for temporary files."""
        place = self.folder / name
        for part in ("home", "tmp", "work"):
            (place / part).mkdir(parents=True, exist_ok=True)
        own = {
            "HOME": str(place / "home"),
            "XDG_CACHE_HOME": str(place / "home" / "cache"),
            "TMPDIR": str(place / "tmp"),
            "PATH": os.environ["PATH"],
            "PYTHONPATH": os.pathsep.join((str(ROOT), str(SUPPORT))),
            "OMP_NUM_THREADS": "1",
            "DASK_DISTRIBUTED__WORKER__DAEMON": "False",
        }
        secured = []
        for option, path in self.certificates.items():
            secured += [f"--{option.replace('_ca', '-ca-file').replace('_', '-')}", str(path)]
        with (place / "log").open("ab") as log:
            self.processes[name] = subprocess.Popen(
                [sys.executable, "-m", module, *arguments, *secured],
                cwd=place / "work",
                env=own | environment,
                stdout=log,
                stderr=log,
                stdin=subprocess.DEVNULL,
                start_new_session=True,
            )
        return place

    def start_scheduler(self, port: int = 0) -> None:
        """Starts the scheduler and waits for its address."""
        told = self.folder / "scheduler.json"
        told.unlink(missing_ok=True)
        where = ["--host", "127.0.0.1", "--port", str(port), "--protocol", "tls", "--no-dashboard"]
        self.start("scheduler", "distributed.cli.dask_scheduler", *where, "--scheduler-file", str(told))
        await_true(lambda: told.exists() and told.stat().st_size > 10)
        time.sleep(0.1)
        import json

        self.address = json.loads(told.read_text())["address"]

    def start_worker(self, name: str, *more: str, **environment: str) -> Path:
        """Starts a worker under a nanny, which starts it again when it dies."""
        where = [self.address, "--host", "127.0.0.1", "--nthreads", "1", "--no-dashboard", *more]
        return self.start(name, "distributed.cli.dask_worker", *where, **environment)

    def kill(self, name: str) -> None:
        """kill -9 of a process and of all that it started."""
        process = self.processes.pop(name)
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()

    def log(self, name: str) -> str:
        """What a process said."""
        return (self.folder / name / "log").read_text()


def await_true(is_so: object, seconds: float = 60.0) -> None:
    """Waits until something holds."""
    until = time.monotonic() + seconds
    while not is_so():  # type: ignore[operator]
        assert time.monotonic() < until, "it never came true"
        time.sleep(0.02)


def write_certificates(folder: Path) -> None:
    """A certificate that signs itself, and its key."""
    made = Security.temporary().get_tls_config_for_role("client")
    (folder / "cert.pem").write_text(made["cert"])
    (folder / "key.pem").write_text(made["key"])


@contextmanager
def open_site(folder: Path, workers: Sequence[str] = ()) -> Iterator[Site]:
    """A scheduler with these workers; all of them end with the block."""
    folder.mkdir(parents=True, exist_ok=True)
    write_certificates(folder)
    site = Site(folder)
    try:
        site.start_scheduler()
        for name in workers:
            site.start_worker(name)
        yield site
    finally:
        for name in list(site.processes):
            site.kill(name)
