"""What a cluster does of a check: it diagnoses a case and measures its gaps, from robot file and logs alone.

Neither a seed nor a label is among the inputs. Logs are made, and compared with the truth, in the process that sealed
the labels.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hdagen.arm.build_loader import PlantError, find_or_build
from hdagen.blind.confidence_intervals import finite_or_none
from hdagen.blind.subprocesses import HDAGEN_COMMAND, ChildError, request_log, run_command
from hdagen.campaign.task import Task, TaskFile, TaskFolder, TaskRefusedError
from hdagen.diagnosis.data.models import BUILDS
from hdagen.log.data_table import LogError
from hdagen.log.measured_log import read

TIME_OF_DIAGNOSIS = 480.0  # s; after it, a diagnosis states the best until then, and is not sure
LONGEST_DIAGNOSIS = 600.0  # s; after it, a case is stopped
_SMALLEST_ERROR = 1e-3  # multiple of the noise; a smaller error counts as this, as in docs/method/prediction.md
_ROBOT_FILE, _LOG, _HOLD_OUT, _DIAGNOSIS = "robot.toml", "log.parquet", "hold_out.parquet", "diagnosis.json"


def make_diagnosis_task(folder: Path, name: str, program: Sequence[str], keep_searches: bool = False) -> Task:
    """Make the task that diagnoses a case.

    Args:
        folder: of the case, with its robot file and log.
        name: of the task.
        program: command that runs as ``hdagen``; none: the worker's own.
        keep_searches: whether it leaves its searches, too.

    Returns:
        The task.

    """
    files = {name: TaskFile(folder / name, name) for name in (_ROBOT_FILE, _LOG)}
    options = {"options": ["--keep-searches"]} if keep_searches else {}
    return Task(name, diagnose_case, {"program": list(program), **options}, files)


def make_gap_task(folder: Path, name: str, noise: Mapping[str, float], program: Sequence[str]) -> Task:
    """Make the task that measures the gaps of a diagnosed case.

    Args:
        folder: of the case, with its robot file, hold-out and diagnosis.
        name: of the task.
        noise: standard deviation of each channel that counts.
        program: command that runs as ``hdagen``; none: the worker's own.

    Returns:
        The task.

    """
    files = {name: TaskFile(folder / name, name) for name in (_ROBOT_FILE, _HOLD_OUT)}
    files[_DIAGNOSIS] = TaskFile(folder / "out" / _DIAGNOSIS, _DIAGNOSIS)
    return Task(name, measure_case, {"program": list(program), "noise": dict(noise)}, files)


def diagnose_case(folder: TaskFolder, parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Diagnose a case by `hdagen diagnose` in a process of its own, within `TIME_OF_DIAGNOSIS`.

    Args:
        folder: holds robot file and log, and takes what the command leaves.
        parameters: the program, and further options of the command.

    Returns:
        Duration in seconds, and exit code.

    Raises:
        TaskRefusedError: the command leaves no diagnosis.json, or takes too long.
        PlantError: the robot cannot be built.

    """
    place = folder.inputs[_ROBOT_FILE].parent
    _build_models(folder, parameters)
    command = [
        *_find_program(parameters),
        "diagnose",
        _ROBOT_FILE,
        _LOG,
        "--out",
        "out",
        "--within",
        f"{TIME_OF_DIAGNOSIS:g}",
        *parameters.get("options", ()),
    ]
    try:
        ended = run_command(command, place, LONGEST_DIAGNOSIS)
    except ChildError as error:
        raise TaskRefusedError(str(error)) from None
    if not (folder.out / _DIAGNOSIS).is_file():
        raise TaskRefusedError(f"diagnose left no diagnosis.json (exit code {ended.code}): {ended.words}")
    return {"seconds": ended.seconds, "code": ended.code}


def measure_case(folder: TaskFolder, parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Measure the replay's gap on the hold-out before and after the diagnosis.

    Args:
        folder: holds robot file, hold-out and diagnosis.
        parameters: the program, and the noise of each channel.

    Returns:
        The gaps ``before`` and ``after``.

    Raises:
        TaskRefusedError: a replay fails, or what it wrote cannot be read.
        PlantError: the robot cannot be built.

    """
    place = folder.inputs[_ROBOT_FILE].parent
    _build_models(folder, parameters)
    program = _find_program(parameters)
    found = {}
    try:
        for name, more in (("before", []), ("after", ["--with", _DIAGNOSIS])):
            found[name] = replay_gap(program, place, name, more, parameters["noise"])
    except ChildError as error:
        raise TaskRefusedError(str(error)) from None
    return found


def replay_gap(
    program: Sequence[str], place: Path, name: str, more: Sequence[str], noise: Mapping[str, float]
) -> float | None:
    """Replay the hold-out by `hdagen replay` and measure its gap.

    Args:
        program: command that runs as ``hdagen``.
        place: folder with the files.
        name: of the file that the replay writes.
        more: further arguments of `hdagen replay`.
        noise: standard deviation of each channel that counts.

    Returns:
        The gap; None where it is not finite.

    Raises:
        ChildError: the replay fails, takes too long, or what it wrote cannot be read.

    """
    command = [*program, "replay", _ROBOT_FILE, _HOLD_OUT, *more, "--out", f"{name}.parquet"]
    ended = run_command(command, place, LONGEST_DIAGNOSIS)
    if ended.code:
        raise ChildError(f"replay {' '.join(more)} ended with exit code {ended.code}: {ended.words}")
    try:
        return finite_or_none(measure_replay_gap(place / f"{name}.parquet", place / _HOLD_OUT, noise))
    except (LogError, KeyError) as error:
        raise ChildError(f"what replay wrote cannot be read: {error}") from None


def measure_replay_gap(predicted: Path, measured: Path, noise: Mapping[str, float]) -> float:
    """Measure the gap between a replay and its log.

    Args:
        predicted: the log that `hdagen replay` wrote.
        measured: the log of the same motion.
        noise: standard deviation of each channel that counts.

    Returns:
        The rms error of each channel in multiples of its noise, as a geometric mean over the channels.

    Raises:
        LogError: one of the logs cannot be read.
        KeyError: a channel is missing.

    """
    a, b = read(predicted), read(measured)
    rows = min(len(a), len(b))
    errors = [float(np.sqrt(np.mean((a[name][:rows] - b[name][:rows]) ** 2))) / sd for name, sd in noise.items()]
    return float(np.exp(np.mean(np.log(np.maximum(errors, _SMALLEST_ERROR)))))


def write_case(folder: TaskFolder, parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Make the logs of a case that is not sealed.

    Args:
        folder: takes log and hold-out.
        parameters: seed, population and index of the case, and seconds of each log.

    Returns:
        The truth, as `hdagen.blind.realities.log_maker` tells it.

    Raises:
        PlantError: the case cannot be simulated.

    """
    try:
        told = request_log({**parameters, "motion": "log", "out": str(folder.out / _LOG)})
        held = {"motion": "hold_out", "out": str(folder.out / _HOLD_OUT), "truth": told["parameters"]}
        request_log({**parameters, **held})
    except ChildError as error:
        raise PlantError(error) from None
    return told


def _find_program(parameters: Mapping[str, Any]) -> Sequence[str]:
    return parameters["program"] or HDAGEN_COMMAND


def _build_models(folder: TaskFolder, parameters: Mapping[str, Any]) -> None:
    """Have the models ready that the command will load: a build may have to come from elsewhere."""
    if not parameters["program"]:
        for build in BUILDS:
            find_or_build(folder.inputs[_ROBOT_FILE], *build, None)
