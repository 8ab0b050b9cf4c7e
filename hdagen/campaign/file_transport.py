"""Files of tasks on their way: a worker gets each content once, keeps it by its hash, and says which it lacks."""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

MOST_KEPT_BYTES = 256_000_000  # of all contents that a worker keeps; those that were used longest ago go first
Files = Mapping[str, Mapping[str, Any]]  # by name: label, SHA-256, and content or None


class KeptContents:
    """Which contents a worker keeps: the same list on both sides, as both note the same contents in the same order."""

    def __init__(self) -> None:
        self._sizes: OrderedDict[str, int] = OrderedDict()
        self._total = 0

    def __contains__(self, sha256: str) -> bool:
        return sha256 in self._sizes

    def note_use(self, sha256: str, size: int) -> list[str]:
        """Note that a content is used.

        Args:
            sha256: Its hash.
            size: Its length, bytes.

        Returns:
            Hashes of the contents that are kept no longer, this one among them where it is too long.

        """
        self.forget(sha256)
        if size > MOST_KEPT_BYTES:
            return [sha256]
        self._sizes[sha256] = size
        self._total += size
        gone = []
        while self._total > MOST_KEPT_BYTES:
            gone.append(next(iter(self._sizes)))
            self.forget(gone[-1])
        return gone

    def forget(self, sha256: str) -> None:
        """Note that a content is not kept.

        Args:
            sha256: Its hash.

        """
        self._total -= self._sizes.pop(sha256, 0)


class SentFiles:
    """What each worker keeps, as the client knows it; a worker that lacks a content after all asks for it."""

    def __init__(self) -> None:
        self._kept: dict[str, KeptContents] = {}

    def leave_out_kept(self, files: Files, worker: str) -> dict[str, Mapping[str, Any]]:
        """Leave out the contents that a worker keeps, and note that it gets the others.

        Args:
            files: The files of a payload, with their contents.
            worker: Address of the worker.

        Returns:
            The files; the content is None where the worker keeps it.

        """
        kept = self._kept.setdefault(worker, KeptContents())
        found: dict[str, Mapping[str, Any]] = {}
        for name, file in files.items():
            found[name] = file
            if file["sha256"] in kept:
                found[name] = {**file, "content": None}
            kept.note_use(file["sha256"], len(file["content"]))
        return found

    def forget_contents(self, worker: str, hashes: Iterable[str]) -> None:
        """Note that a worker lacks contents.

        Args:
            worker: Its address.
            hashes: SHA-256 of each content.

        """
        for sha256 in hashes:
            self._kept.setdefault(worker, KeptContents()).forget(sha256)

    def forget_worker(self, worker: str) -> None:
        """Note that a worker is lost.

        Args:
            worker: Its address.

        """
        self._kept.pop(worker, None)


class ReceivedFiles:
    """The contents that this worker keeps, in a folder.

    Args:
        folder: A folder that its supervisor removes, even after a kill.

    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._kept = KeptContents()

    def fill_in_kept(self, files: Files) -> tuple[dict[str, Mapping[str, Any]], list[str]]:
        """Keep the contents that came, and fill in those that did not.

        Args:
            files: The files of a payload, some without content.

        Returns:
            The files with their contents, and the hashes of the contents that this worker lacks.

        Raises:
            OSError: The folder cannot be written.

        """
        self._folder.mkdir(parents=True, exist_ok=True)
        found: dict[str, Mapping[str, Any]] = {}
        lacking: list[str] = []
        for name, file in files.items():
            sha256, content = file["sha256"], file["content"]
            if content is None:
                content = self._read_kept(sha256)
            elif sha256 not in self._kept:
                (self._folder / sha256).write_bytes(content)
            if content is None:
                lacking.append(sha256)
                self._kept.forget(sha256)
                continue
            found[name] = {**file, "content": content}
            for gone in self._kept.note_use(sha256, len(content)):
                (self._folder / gone).unlink(missing_ok=True)
        return found, lacking

    def _read_kept(self, sha256: str) -> bytes | None:
        """A content that is kept; None where there is none, or another one."""
        try:
            content = (self._folder / sha256).read_bytes()
        except OSError:
            return None
        if hashlib.sha256(content).hexdigest() != sha256:
            return None
        return content
