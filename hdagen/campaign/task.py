"""A task: a pure function of files, which are known by the hash of their content, and of JSON parameters."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Any

from hdagen.support.version import __version__


class TaskRefusedError(Exception):
    """A task's inputs cannot be worked on, now or later; one line a reason."""


class Status(Enum):
    """How a task ended."""

    DONE = "done"
    REFUSED = "refused"  # its inputs can never do, or it killed its workers
    FAILED = "failed"  # it broke; the next run tries it again
    NOT_RUN = "not run"  # the run ended before it


@dataclass(frozen=True)
class TaskFolder:
    """What an action may touch.

    Attributes:
        inputs: Paths of the task's files by their names.
        labels: By name, how sentences and results name a file.
        out: Folder of the files that the action leaves as its result.

    """

    inputs: Mapping[str, Path]
    labels: Mapping[str, str]
    out: Path


Action = Callable[[TaskFolder, Mapping[str, Any]], Mapping[str, Any]]


def accept_any_row(row: Mapping[str, Any]) -> bool:
    """Tell that a row of an earlier run will do, whatever it holds.

    Args:
        row: The row as it was read from its file.

    Returns:
        True.

    """
    return True


@dataclass(frozen=True)
class TaskFile:
    """A file that a task reads.

    Attributes:
        path: Where it lies here.
        label: How the task's sentences and results name it, wherever it is worked on.

    """

    path: Path
    label: str

    def hash_content(self) -> str:
        """Hash the content.

        Returns:
            SHA-256, hexadecimal.

        Raises:
            OSError: The file cannot be read.

        """
        with self.path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()


@dataclass(frozen=True)
class Task:
    """A function of files and parameters.

    Attributes:
        name: Name of its folder and of its row; it never leaves this process.
        action: A function at the top of a module, which every worker can import.
        parameters: What JSON can hold.
        files: The files by their names in the task's folder.
        longest_seconds: Time after which its worker is stopped, s.
        accepts_row: Tells whether the row of an earlier run, read from its file, is whole.

    """

    name: str
    action: Action
    parameters: Mapping[str, Any] = field(default_factory=dict)
    files: Mapping[str, TaskFile] = field(default_factory=dict)
    longest_seconds: float = math.inf
    accepts_row: Callable[[Mapping[str, Any]], bool] = accept_any_row

    def hash_inputs(self) -> str:
        """Hash what decides the result: action, parameters, content of the files wherever they lie, version.

        Returns:
            SHA-256, hexadecimal.

        Raises:
            OSError: A file cannot be read.

        """
        parts = {
            "version": __version__,
            "action": f"{self.action.__module__}:{self.action.__qualname__}",
            "parameters": dict(self.parameters),
            "files": {name: file.hash_content() for name, file in self.files.items()},
        }
        return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()

    def make_payload(self, builds: tuple[Mapping[str, Any], ...] = ()) -> dict[str, Any]:
        """Make all that a worker gets to know of the task.

        Args:
            builds: Packed builds for a worker without a compiler.

        Returns:
            Action, parameters, and each file with label, hash and content.

        Raises:
            OSError: A file cannot be read.

        """
        files = {}
        for name, file in self.files.items():
            content = file.path.read_bytes()
            files[name] = {"label": file.label, "sha256": hashlib.sha256(content).hexdigest(), "content": content}
        return {"action": self.action, "parameters": dict(self.parameters), "files": files, "builds": list(builds)}


@dataclass(frozen=True)
class Outcome:
    """How a task ended.

    Attributes:
        status: How.
        row: The action's result, which JSON can hold.
        messages: Sentences on a task that is not done.
        files: Content of the files that the action left, by name.
        seconds: Time that the task took, s.
        processor_seconds: Time of the processors that it took, with its child processes, s.
        is_reused: Whether an earlier run made it.

    """

    status: Status
    row: Mapping[str, Any] = field(default_factory=dict)
    messages: tuple[str, ...] = ()
    files: Mapping[str, bytes] = field(default_factory=dict)
    seconds: float = 0.0
    processor_seconds: float = 0.0
    is_reused: bool = False
