"""A check: cases are made, diagnosed by processes that do not know the truth, measured on held-out motion, and only
then scored against their labels."""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hdagen.blind import label_seal
from hdagen.blind.confidence_intervals import finite_or_none
from hdagen.blind.realities.cases import Case, Robot, draw_cases
from hdagen.blind.scores import Row, score_case
from hdagen.blind.subprocesses import ChildError, request_log, run_command
from hdagen.log.data_table import LogError
from hdagen.log.measured_log import read
from hdagen.support.atomic_write import is_partial_file, write_atomically
from hdagen.support.input_file import InputFileError, read_json
from hdagen.support.version import __version__

HDAGEN_COMMAND = (sys.executable, "-P", "-m", "hdagen")
LONGEST_DIAGNOSIS = 600.0  # of a diagnosis
_LARGEST_JSON = 10_000_000  # bytes of a JSON file
_TRUE_FILE = "true.json"  # the truth, beside a case whose diagnosis has ended
_SMALLEST_ERROR = 1e-3  # multiple of the noise; a smaller error counts as this, as in docs/method/prediction.md


class BlindError(Exception):
    """A check cannot be run; the message is a sentence."""


@dataclass(frozen=True)
class Check:
    """The request for a check. ``seconds``: length of each log; ``out``: folder of the results; ``keep``: logs and
    pages of the cases stay there; ``program``: command that runs as ``hdagen`` (tests give another one)."""

    kind: str
    count: int
    seed: str
    jobs: int
    seconds: float
    out: Path
    keep: bool = False
    program: tuple[str, ...] = HDAGEN_COMMAND


def run_check(asked: Check, said: Callable[[str], None]) -> tuple[list[Row], label_seal.Seal]:
    """Run a check; finished cases stay in ``out``/cases and are not run again with the same seed.

    Args:
        asked: the request.
        said: called with a sentence about the progress.

    Returns:
        The scored rows in the order of the cases, and the seal that was verified.

    Raises:
        BlindError: the folder holds another check, or a result cannot be read.
        ChildError: a case could not be simulated.
        seal.SealError: the labels changed between sealing and scoring.

    """
    drawn = draw_cases(asked.seed, asked.kind, asked.count)
    labels = {case.name: case.label() for case in drawn}
    closed = label_seal.seal_labels(labels, asked.seed)
    _claim_folder(asked, closed)
    said(f"sealed: {closed.count} labels, SHA-256 {closed.digest}")
    told: dict[str, dict[str, Any]] = {}
    for done, (name, answer) in enumerate(_run_all(asked, drawn, said), 1):
        told[name] = answer
        assert done <= asked.count
    label_seal.verify_seal(labels, asked.seed, closed)
    said(f"opened: the {closed.count} labels are those that were sealed; the seed was {asked.seed}")
    return [_score_case(asked, case, labels[case.name], told[case.name]) for case in drawn], closed


def _claim_folder(asked: Check, closed: label_seal.Seal) -> None:
    """Make the folder this check's; raise BlindError where it holds anything else."""
    asked.out.mkdir(parents=True, exist_ok=True)
    path = asked.out / "seal.json"
    mine = {
        "seal": closed.digest,
        "kind": asked.kind,
        "cases": asked.count,
        "seconds": asked.seconds,
        "version": __version__,
    }
    if path.exists():
        try:
            found = read_json(path, _LARGEST_JSON, "name another folder")
        except InputFileError:
            found = None
        if found != mine:
            raise BlindError(
                f"{asked.out}: holds another check (other seed, kind, number or length of cases, or version); "
                "name another folder with --out, or give the seed it was started with to go on."
            )
        return
    if not all(map(is_partial_file, asked.out.iterdir())):
        raise BlindError(f"{asked.out}: is not empty and holds no check; name another folder with --out.")
    write_atomically(path, json.dumps(mine, indent=1).encode())


def _run_all(
    asked: Check, drawn: tuple[Case, ...], said: Callable[[str], None]
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield name and truth of every case as it ends; at most ``jobs`` run at once."""
    stop, start = threading.Event(), time.monotonic()
    pool = ThreadPoolExecutor(asked.jobs)
    waiting: dict[Future[dict[str, Any]], str] = {
        pool.submit(_run_case, asked, index, case, stop): case.name for index, case in enumerate(drawn)
    }
    try:
        while waiting:
            ended, _ = wait(waiting, 0.1, FIRST_COMPLETED)  # short: an interrupt just before it is heard after it
            for future in ended:
                yield waiting.pop(future), future.result()
            if not ended:
                continue
            done = asked.count - len(waiting)
            left = (time.monotonic() - start) / done * len(waiting)
            said(f"{done} of {asked.count} cases, about {_format_duration(left)} left")
    finally:
        stop.set()
        pool.shutdown(wait=True, cancel_futures=True)


def _format_duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min"


def _run_case(asked: Check, index: int, case: Case, stop: threading.Event) -> dict[str, Any]:
    """Make a case, have it diagnosed, and measure its gap; return its truth, which no file holds."""
    folder, builds = asked.out / "cases" / case.name, asked.out / "builds"
    if "HDAGEN_BUILD" in os.environ:
        builds = Path(os.environ["HDAGEN_BUILD"])
    folder.mkdir(parents=True, exist_ok=True)
    request = {"seed": asked.seed, "kind": case.kind, "index": index, "seconds": asked.seconds}
    log, held, true = folder / "log.parquet", folder / "hold_out.parquet", folder / _TRUE_FILE
    true.unlink(missing_ok=True)  # a killed check may have left it
    truth = request_log({**request, "motion": "log", "out": str(log.absolute())}, builds, stop)
    if not (folder / "result.json").exists():
        write_atomically(folder / "robot.toml", case.robot.toml().encode())
        result: dict[str, Any]
        try:
            result = _diagnose_case(asked, folder, builds, stop)
            known = {"motion": "hold_out", "out": str(held.absolute()), "truth": truth["parameters"]}
            request_log({**request, **known}, builds, stop)
            result |= _measure_gaps(asked, folder, case, builds, stop)
        except ChildError as error:
            if stop.is_set():
                raise
            result = {"failed": str(error)}
        write_atomically(folder / "result.json", json.dumps(result, indent=1).encode())
    if not asked.keep:
        for path in [*folder.glob("*.parquet"), *(folder / "out").glob("*.html")]:
            path.unlink()
    return truth


def _diagnose_case(asked: Check, folder: Path, builds: Path, stop: threading.Event) -> dict[str, Any]:
    """Diagnose a case; return duration and exit code. Raises ChildError where no diagnosis.json is left."""
    command = [*asked.program, "diagnose", "robot.toml", "log.parquet", "--out", "out"]
    ended = run_command(command, folder, builds, stop, LONGEST_DIAGNOSIS)
    if not (folder / "out" / "diagnosis.json").is_file():
        raise ChildError(f"diagnose left no diagnosis.json (exit code {ended.code}): {ended.words}")
    return {"seconds": ended.seconds, "code": ended.code}


def _measure_gaps(asked: Check, folder: Path, case: Case, builds: Path, stop: threading.Event) -> dict[str, Any]:
    """The replay's gap on the hold-out before and after the diagnosis, and with the truth where a file can state it."""
    found: dict[str, Any] = {}
    options = {"before": [], "after": ["--with", "out/diagnosis.json"]}
    if (true := case.true_diagnosis()) is not None:
        write_atomically(folder / _TRUE_FILE, json.dumps(true).encode())
        options["after_true"] = ["--with", _TRUE_FILE]
    try:
        for name, more in options.items():
            command = [*asked.program, "replay", "robot.toml", "hold_out.parquet", *more, "--out", f"{name}.parquet"]
            ended = run_command(command, folder, builds, stop, LONGEST_DIAGNOSIS)
            if ended.code:
                raise ChildError(f"replay {' '.join(more)} ended with exit code {ended.code}: {ended.words}")
            try:
                value = measure_replay_gap(folder / f"{name}.parquet", folder / "hold_out.parquet", case.robot)
            except (LogError, KeyError) as error:
                raise ChildError(f"what replay wrote cannot be read: {error}") from None
            found[name] = finite_or_none(value)
    finally:
        (folder / _TRUE_FILE).unlink(missing_ok=True)
    return found


def measure_replay_gap(predicted: Path, measured: Path, robot: Robot) -> float:
    """Measure the gap between a replay and its log.

    Args:
        predicted: the log that `hdagen replay` wrote.
        measured: the log of the same motion.
        robot: states the noise of each channel that counts.

    Returns:
        The rms error of each channel in multiples of its noise, as a geometric mean over the channels.

    Raises:
        LogError: one of the logs cannot be read.
        KeyError: a channel is missing.

    """
    a, b = read(predicted), read(measured)
    rows = min(len(a), len(b))
    errors = [
        float(np.sqrt(np.mean((a[name][:rows] - b[name][:rows]) ** 2))) / sd for name, sd in robot.noise().items()
    ]
    return float(np.exp(np.mean(np.log(np.maximum(errors, _SMALLEST_ERROR)))))


def _score_case(asked: Check, case: Case, label: Mapping[str, Any], told: Mapping[str, Any]) -> Row:
    folder = asked.out / "cases" / case.name
    try:
        result, said = read_json(folder / "result.json", _LARGEST_JSON, "remove it, and check again"), None
    except InputFileError as error:
        raise BlindError(str(error)) from None
    with suppress(InputFileError):
        said = read_json(folder / "out" / "diagnosis.json", _LARGEST_JSON, "check again")
    return score_case(case.name, label, told, result, said)
