"""The worker's side of a task: files in, the action, files out. It knows the payload alone."""

from __future__ import annotations

import errno
import hashlib
import resource
import tempfile
import time
import traceback
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hdagen.arm.build_loader import MissingCompilerError, PlantError
from hdagen.campaign.build_transport import unpack_build
from hdagen.campaign.file_transport import ReceivedFiles
from hdagen.campaign.task import Status, TaskFolder, TaskRefusedError

DISK_ERRNOS = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO)  # the worker's fault, not the task's
ENDED, NEEDS_BUILD, NEEDS_FILES, UNFIT_WORKER = "ended", "needs build", "needs files", "unfit worker"  # of a reply
_KEPT_FILES_FOLDER = "hdagen-received"
_MOST_MESSAGES = 50
_received: dict[str, ReceivedFiles] = {}  # by the folder of a worker: a test may have several in one process


def execute_payload(payload: Mapping[str, Any], scratch: str | None = None) -> dict[str, Any]:
    """Execute a task.

    Args:
        payload: What `Task.make_payload` made.
        scratch: Folder for the task's own folder; None: the system's.

    Returns:
        The reply, of plain values: the outcome, a request for a build that this machine cannot compile, or the reason
        why this worker can do no task.

    """
    from threadpoolctl import threadpool_limits  # changes the environment when it is imported

    begun, used = time.perf_counter(), measure_processor_seconds()
    try:
        with tempfile.TemporaryDirectory(prefix="hdagen-task-", dir=scratch) as place, threadpool_limits(1):
            reply = _execute_in_folder(payload, Path(place))
    except OSError as error:
        reply = _report_unfit_worker(error)
    return reply | {
        "seconds": time.perf_counter() - begun,
        "processor_seconds": measure_processor_seconds() - used,
    }


def execute_on_worker(payload: Mapping[str, Any]) -> dict[str, Any]:
    """Execute a task in a folder that the worker's supervisor removes even after a kill.

    Args:
        payload: What `Task.make_payload` made, without the contents that this worker keeps.

    Returns:
        The reply, as `execute_payload` gives it, or a request for contents that this worker lacks; with its address.

    """
    from distributed import get_worker

    worker = get_worker()
    place = worker.local_directory
    received = _received.setdefault(place, ReceivedFiles(Path(place) / _KEPT_FILES_FOLDER))
    try:
        files, lacking = received.fill_in_kept(payload["files"])
    except OSError as error:
        return _report_unfit_worker(error) | {"worker": worker.address}
    if lacking:
        return {"kind": NEEDS_FILES, "lacking": lacking, "worker": worker.address}
    return execute_payload({**payload, "files": files}, place) | {"worker": worker.address}


def measure_processor_seconds() -> float:
    """Measure the time of the processors that this process took, with its children that have ended.

    Returns:
        s, to the microsecond; `os.times` counts in hundredths.

    """
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + ended.ru_utime + ended.ru_stime


def _report_unfit_worker(error: OSError) -> dict[str, Any]:
    """The reply of a worker whose disk takes no files."""
    return {"kind": UNFIT_WORKER, "messages": [f"{error.filename}: {error.strerror}"]}


def _execute_in_folder(payload: Mapping[str, Any], place: Path) -> dict[str, Any]:
    """Run the action in ``place``. Raises OSError where the folder cannot be filled."""
    inputs, out = _write_inputs(payload["files"], place), place / "out"
    out.mkdir()
    folder = TaskFolder(inputs, {name: file["label"] for name, file in payload["files"].items()}, out)
    messages: list[str] = []
    row: Mapping[str, Any] = {}
    try:
        for build in payload["builds"]:
            unpack_build(build)
        row, status = payload["action"](folder, payload["parameters"]), Status.DONE
    except MissingCompilerError as error:
        return {"kind": NEEDS_BUILD, "wanted": error.wanted.describe_robot(), "messages": [str(error)]}
    except TaskRefusedError as error:
        messages, status = str(error).splitlines(), Status.REFUSED
    except OSError as error:
        if error.errno in DISK_ERRNOS:
            raise
        messages, status = [f"{error.filename}: {error.strerror}"], Status.FAILED
    except PlantError as error:
        messages, status = str(error).splitlines(), Status.FAILED
    except MemoryError:
        messages, status = ["there was not enough memory for it."], Status.FAILED
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        said = f"{type(error).__name__}: {error} ({Path(where.filename).name}, line {where.lineno})"
        messages, status = [said], Status.FAILED
    return {
        "kind": ENDED,
        "status": status.value,
        "row": dict(row),
        "messages": [_name_files_as_sent(line, folder) for line in messages[:_MOST_MESSAGES]],
        "files": {
            path.relative_to(out).as_posix(): path.read_bytes()
            for path in sorted(out.rglob("*"))
            if path.is_file() and status is Status.DONE
        },
    }


def _write_inputs(files: Mapping[str, Mapping[str, Any]], place: Path) -> dict[str, Path]:
    """Write the task's files, each checked against its hash. Raises OSError."""
    inputs = {}
    for name, file in files.items():
        if Path(name).name != name or hashlib.sha256(file["content"]).hexdigest() != file["sha256"]:
            raise OSError(errno.EBADMSG, "the file did not arrive as it was sent", file["label"])
        inputs[name] = place / name
        inputs[name].write_bytes(file["content"])
    return inputs


def _name_files_as_sent(line: str, folder: TaskFolder) -> str:
    for name, path in folder.inputs.items():
        line = line.replace(str(path), folder.labels[name])
    return line
