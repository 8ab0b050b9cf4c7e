"""Results of a run: a folder and a file for each task, one Parquet table of all; whole, and taken up again."""

from __future__ import annotations

import fcntl
import json
import math
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from hdagen.arm.build_loader import PlantError
from hdagen.campaign.task import Outcome, Status, Task
from hdagen.support.atomic_write import open_atomically, write_atomically
from hdagen.support.input_file import InputFileError, read_json

TASK_FILE, TABLE_FILE = "task.json", "results.parquet"
_MOST_TASK_BYTES = 10_000_000  # bytes of a task.json
_FILE_PATTERN = re.compile(r"[\w][\w.-]*(/[\w][\w.-]*)*")
_FINISHED = {status.value: status for status in (Status.DONE, Status.REFUSED)}


class ResultStore:
    """The folder of a run. A task is finished when its task.json, written last, has the hash of its inputs."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @contextmanager
    def hold_lock(self) -> Iterator[None]:
        """Hold the folder for this run alone.

        Yields:
            Nothing.

        Raises:
            PlantError: Another run holds it.
            OSError: It cannot be opened.

        """
        handle = os.open(self.folder, os.O_RDONLY)  # a lock on the folder itself leaves no file behind
        try:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise PlantError(
                    f"{self.folder}: another run works in this folder; wait for its end, or name another with --out."
                ) from None
            yield
        finally:
            os.close(handle)

    def find_finished(self, task: Task) -> Outcome | None:
        """Find the outcome of an earlier run with the same inputs.

        Args:
            task: The task.

        Returns:
            The outcome without the content of its files, or None where the task has to be done.

        """
        folder = self.folder / task.name
        try:
            found = read_json(folder / TASK_FILE, _MOST_TASK_BYTES, "it is made again")
            if found["inputs"] != task.hash_inputs() or not all((folder / name).is_file() for name in found["files"]):
                return None
            if not all(math.isfinite(found[name]) for name in ("seconds", "processor_seconds")):
                return None
            status, row = _FINISHED[found["status"]], dict(found["row"])
            if status is Status.DONE and not task.accepts_row(row):
                return None
            return Outcome(
                status=status,
                row=row,
                messages=tuple(map(str, found["messages"])),
                seconds=float(found["seconds"]),
                processor_seconds=float(found["processor_seconds"]),
                is_reused=True,
            )
        except (InputFileError, OSError, ValueError, KeyError, TypeError, AttributeError, OverflowError):
            return None

    def keep_outcome(self, task: Task, inputs: str, outcome: Outcome) -> None:
        """Keep what came of a task: its files, then its task.json; one that failed leaves no task.json.

        Args:
            task: The task.
            inputs: Hash of its inputs, taken before it ran.
            outcome: How it ended.

        Raises:
            OSError: It cannot be written; no task.json says that it is finished.

        """
        folder = self.folder / task.name
        folder.mkdir(parents=True, exist_ok=True)
        with suppress(FileNotFoundError):
            earlier = self._list_files(folder)
            (folder / TASK_FILE).unlink()
            for name in earlier:
                (folder / name).unlink(missing_ok=True)
        if outcome.status not in _FINISHED.values():
            return
        for name, content in outcome.files.items():
            if not _FILE_PATTERN.fullmatch(name):
                raise OSError(22, "a task left a file whose name cannot be kept", name)
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            write_atomically(folder / name, content)
        said = {
            "inputs": inputs,
            "status": outcome.status.value,
            "seconds": outcome.seconds,
            "processor_seconds": outcome.processor_seconds,
            "messages": list(outcome.messages),
            "files": sorted(outcome.files),
            "row": dict(outcome.row),
        }
        write_atomically(folder / TASK_FILE, (json.dumps(said, indent=1, allow_nan=False) + "\n").encode())

    def _list_files(self, folder: Path) -> list[str]:
        """The files that an earlier outcome left. Raises FileNotFoundError where there is none."""
        if not (folder / TASK_FILE).exists():
            raise FileNotFoundError
        try:
            named = read_json(folder / TASK_FILE, _MOST_TASK_BYTES, "it is made again")["files"]
            return [name for name in named if _FILE_PATTERN.fullmatch(name)]
        except (InputFileError, KeyError, TypeError):
            return []

    def is_table_broken(self) -> bool:
        """Tell whether the folder has a table that cannot be read, as a copy or a disk that broke off leaves it.

        Returns:
            Whether it has one.

        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        if not (self.folder / TABLE_FILE).is_file():
            return False
        try:
            pq.read_metadata(self.folder / TABLE_FILE)
        except (pa.ArrowException, OSError):
            return True
        return False

    def write_table(self, outcomes: Mapping[str, Outcome]) -> None:
        """Write the table of all outcomes, whole or not at all.

        Args:
            outcomes: By the tasks' names.

        Raises:
            OSError: It cannot be written.

        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        rows = [outcome.row for outcome in outcomes.values()]
        columns: dict[str, Any] = {
            "task": list(outcomes),
            "status": [one.status.value for one in outcomes.values()],
            "seconds": [one.seconds for one in outcomes.values()],
            "processor_seconds": [one.processor_seconds for one in outcomes.values()],
            "messages": pa.array([list(one.messages) for one in outcomes.values()], pa.list_(pa.string())),
        }
        for key in sorted({key for row in rows for key in row} - columns.keys()):
            columns[key] = _make_column([row.get(key) for row in rows])
        with open_atomically(self.folder / TABLE_FILE) as file:
            pq.write_table(pa.table(columns), file)


def _make_column(values: Sequence[Any]) -> list[Any]:
    """Numbers, Booleans or words as they are; everything else, and mixtures, as JSON text."""
    kinds = {type(value) for value in values if value is not None}
    if kinds <= {int, float}:
        return [None if value is None else float(value) for value in values]
    if len(kinds) == 1 and kinds <= {str, bool}:
        return list(values)
    return [None if value is None else json.dumps(value) for value in values]
