"""Many logs of many machines: those of a fleet.toml, diagnosed by processes of their own, kept where finished.

A machine is diagnosed by `hdagen diagnose` as a user would start it, in a folder of its own. Its machine.json comes
last and holds the hash of all inputs: a machine with the same hash is finished and is not diagnosed again.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

from hdagen.adoption.diagnosis_file import MOST_DIAGNOSIS_BYTES, find_infinite
from hdagen.adoption.diagnosis_schema import SCHEMA as DIAGNOSIS_SCHEMA
from hdagen.adoption.diagnosis_schema import upgrade_content
from hdagen.arm.arrays import is_number
from hdagen.fleet.fleet_file import FleetMachine
from hdagen.support.atomic_write import write_atomically
from hdagen.support.child_processes import start_child_process
from hdagen.support.input_file import InputFileError, read_json
from hdagen.support.version import __version__

DIAGNOSE_COMMAND = (sys.executable, "-P", "-m", "hdagen", "diagnose")
FLEET_SCHEMA = 1
_MOST_MACHINE_BYTES = 1_000_000  # bytes of a machine.json
_PROGRESS_PATTERN = re.compile(r"\s*[\d.]+ s  |building ")  # lines that the command writes on its way
_UNUSABLE_EXIT_CODE = 3  # exit code of a log that is refused
_LONGEST_MACHINE_DIAGNOSIS = 3600.0  # s that one machine may take
_LOOK_INTERVAL = 0.05  # s between looks at whether to stop


class Status(Enum):
    """How a machine ended."""

    DIAGNOSED = "diagnosed"
    REFUSED = "refused"  # its log cannot carry a diagnosis
    FAILED = "failed"  # its robot file cannot be built, or the program broke; tried again the next time
    NOT_RUN = "not run"  # interrupted before it was finished


@dataclass(frozen=True)
class MachineResult:
    """How ``machine`` ended, in ``seconds``; ``kept`` from an earlier run.

    ``diagnosis`` is the content of diagnosis.json; where there is none, ``says`` has the program's sentences.
    """

    machine: FleetMachine
    status: Status
    seconds: float = 0.0
    is_reused: bool = False
    messages: tuple[str, ...] = ()
    diagnosis: Mapping[str, Any] | None = None

    @property
    def verdict_probability(self) -> float | None:
        """Probability of the verdict, if it was tried as one hypothesis."""
        if self.diagnosis is None:
            return None
        verdict = self.diagnosis["verdict"]
        return next((float(h["probability"]) for h in self.diagnosis["hypotheses"] if h["effects"] == verdict), None)


def diagnose_fleet(
    machines: Sequence[FleetMachine],
    out: Path,
    jobs: int,
    say: Callable[[str], None],
    command: Sequence[str] = DIAGNOSE_COMMAND,
) -> tuple[list[MachineResult], bool]:
    """Diagnose the machines that an earlier run has not finished.

    Args:
        machines: The machines.
        out: Folder of the results, a folder in it for each machine.
        jobs: Count of machines at the same time.
        say: Hears how far the work is.
        command: The command that diagnoses one machine, as `hdagen diagnose` does.

    Returns:
        Results in the order of the machines, and whether an interrupt stopped the work: finished machines are then
        complete, and the others are not run.

    """
    results = {m.name: MachineResult(m, Status.NOT_RUN) for m in machines}
    for machine in machines:
        if (kept := _find_earlier_result(machine, out / machine.name)) is not None:
            results[machine.name] = kept
            say(f"{machine.name}: {kept.status.value} before, kept")
    todo = [m for m in machines if results[m.name].status is Status.NOT_RUN]
    stop, begun, interrupted = threading.Event(), time.monotonic(), False
    pool = ThreadPoolExecutor(max(jobs, 1))
    futures = [pool.submit(_diagnose_unless_stopped, m, out / m.name, command, stop) for m in todo]
    waiting: set[Future[MachineResult]] = set(futures)
    try:
        while waiting:
            ended, waiting = wait(waiting, _LOOK_INTERVAL, FIRST_COMPLETED)  # an interrupt just before is heard after
            if not ended:
                continue
            done = len(todo) - len(waiting)
            left = (time.monotonic() - begun) / done * len(waiting)
            names = ", ".join(f"{f.result().machine.name}: {f.result().status.value}" for f in ended)
            say(f"{names}; {done} of {len(todo)}, about {left:.0f} s left")
    except KeyboardInterrupt:
        interrupted = True
    finally:
        stop.set()
        pool.shutdown(wait=True, cancel_futures=True)
    for future in futures:
        if not future.cancelled():
            results[future.result().machine.name] = future.result()
    return [results[m.name] for m in machines], interrupted


def _find_earlier_result(machine: FleetMachine, folder: Path) -> MachineResult | None:
    """The result of an earlier run on the same files, if it finished."""
    try:
        found = read_json(folder / "machine.json", _MOST_MACHINE_BYTES, "diagnose again")
        if found["inputs"] != machine.hash_inputs():
            return None
        status, diagnosis = {"diagnosed": Status.DIAGNOSED, "refused": Status.REFUSED}[found["status"]], None
        if status is Status.DIAGNOSED:
            diagnosis = _read_diagnosis(folder)
        return MachineResult(machine, status, float(found["seconds"]), True, tuple(map(str, found["says"])), diagnosis)
    except (InputFileError, OSError, ValueError, KeyError, TypeError, OverflowError):
        return None


def _read_diagnosis(folder: Path) -> dict[str, Any]:
    """Read the diagnosis.json of a machine.

    Args:
        folder: The machine's folder.

    Returns:
        The content.

    Raises:
        InputFileError: The file cannot be read.
        ValueError: It is no diagnosis of this schema.

    """
    path = folder / "diagnosis.json"
    found = read_json(path, MOST_DIAGNOSIS_BYTES, "diagnose again")
    content = dict(upgrade_content(found)) if isinstance(found, dict) else {}
    if content.get("schema") != DIAGNOSIS_SCHEMA or not _is_complete(content) or any(find_infinite(content)):
        raise ValueError(f"{path}: is no diagnosis of schema {DIAGNOSIS_SCHEMA}")
    return content


def _is_complete(found: Mapping[str, Any]) -> bool:
    """Whether a diagnosis has all parts that table and page show."""
    try:
        gaps = [found["gap"][when] for when in ("before", "after")]
        chances = [h["probability"] for h in found["hypotheses"] if h["effects"] is not None]
        chances += [cause["probability"] for cause in found["causes"] if cause["effect"] and cause["joint"] >= 0]
        data = found.get("data", {})
        says = [*found["verdict"], *(r["what"] for r in data.get("repaired", ())), *data.get("warnings", ())]
    except (LookupError, TypeError, AttributeError):
        return False
    numbers = [*chances, *(gap for gap in gaps if gap is not None)]
    return "sure" in found and all(isinstance(word, str) for word in says) and all(map(is_number, numbers))


def _diagnose_unless_stopped(
    machine: FleetMachine, folder: Path, command: Sequence[str], stop: threading.Event
) -> MachineResult:
    """Diagnose one machine by a process of its own, which ``stop`` ends."""
    if stop.is_set():
        return MachineResult(machine, Status.NOT_RUN)
    try:
        return _diagnose_machine(machine, folder, command, stop)
    except OSError as error:
        return MachineResult(machine, Status.FAILED, messages=(f"{error.filename}: {error.strerror}.",))


def _diagnose_machine(
    machine: FleetMachine, folder: Path, command: Sequence[str], stop: threading.Event
) -> MachineResult:
    inputs, begun = machine.hash_inputs(), time.monotonic()
    folder.mkdir(parents=True, exist_ok=True)
    for name in ("machine.json", "diagnosis.json", "report.html"):
        (folder / name).unlink(missing_ok=True)
    with (folder / "said.txt").open("w+", encoding="utf-8", errors="replace") as said:
        code = _wait_for_command([*command, *machine.command_arguments(folder)], said.fileno(), stop)
        said.seek(0)
        lines = [line.strip() for line in said if line.strip() and not _PROGRESS_PATTERN.match(line)]
    if code is None and stop.is_set():
        return MachineResult(machine, Status.NOT_RUN)
    seconds = time.monotonic() - begun
    status, says, diagnosis = _judge_exit(code, lines, folder)
    if status is not Status.FAILED:
        kept = {"inputs": inputs, "status": status.value, "seconds": seconds, "says": list(says)}
        write_json(folder / "machine.json", kept)
    return MachineResult(machine, status, seconds, False, says, diagnosis)


def _judge_exit(
    code: int | None, lines: list[str], folder: Path
) -> tuple[Status, tuple[str, ...], dict[str, Any] | None]:
    """Status, sentences and diagnosis of a process that ended with ``code``, None where it took too long."""
    if code is None:
        return Status.FAILED, (f"it was stopped after {_LONGEST_MACHINE_DIAGNOSIS:g} s.",), None
    if code == _UNUSABLE_EXIT_CODE:
        return Status.REFUSED, tuple(lines), None
    if code:
        return Status.FAILED, tuple(lines[-5:]) or (f"it ended with exit code {code} and without a word.",), None
    try:
        return Status.DIAGNOSED, (), _read_diagnosis(folder)
    except (InputFileError, ValueError) as error:
        return Status.FAILED, (f"it left no diagnosis.json that can be read ({error}).",), None


def _wait_for_command(command: Sequence[str], said: int, stop: threading.Event) -> int | None:
    """The exit code of ``command``, whose output goes to the file ``said``; None: it was stopped or took too long.

    An interrupt from the keyboard reaches it through ``stop`` only.
    """
    beside = os.pathsep.join(filter(None, (str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH"))))
    environment, begun = {**os.environ, "PYTHONPATH": beside}, time.monotonic()
    with start_child_process(command, stdin=subprocess.DEVNULL, stdout=said, stderr=said, env=environment) as child:
        while not stop.is_set() and time.monotonic() - begun < _LONGEST_MACHINE_DIAGNOSIS:
            try:
                return int(child.wait(_LOOK_INTERVAL))
            except subprocess.TimeoutExpired:
                continue
    return None


def summarize_fleet(results: Sequence[MachineResult]) -> dict[str, Any]:
    """Sum a fleet up as fleet.json holds it; the same results give the same content.

    Args:
        results: Results of all machines.

    Returns:
        Counts, effects with their machines, and a row for each machine.

    """
    effects: dict[str, list[str]] = {}
    for one in results:
        if one.diagnosis:
            for effect in one.diagnosis["verdict"]:
                effects.setdefault(effect, []).append(one.machine.name)
    ended = Counter(one.status for one in results)
    return {
        "schema": FLEET_SCHEMA,
        "version": __version__,
        "counts": {status.value: ended[status] for status in Status},
        "effects": dict(sorted(effects.items(), key=lambda item: (-len(item[1]), item[0]))),
        "machines": [_summarize_result(one) for one in results],
    }


def _summarize_result(one: MachineResult) -> dict[str, Any]:
    row: dict[str, Any] = {
        "name": one.machine.name,
        "robot": one.machine.robot,
        "log": str(one.machine.log),
        "status": one.status.value,
        "says": list(one.messages),
    }
    if one.diagnosis is None:
        return row
    return row | {
        "verdict": one.diagnosis["verdict"],
        "sure": one.diagnosis["sure"],
        "probability": one.verdict_probability,
        "gap": {when: one.diagnosis["gap"].get(when) for when in ("before", "after", "floor", "shrink")},
        "repaired": [repair["what"] for repair in one.diagnosis.get("data", {}).get("repaired", [])],
        "warnings": one.diagnosis.get("data", {}).get("warnings", []),
        "folder": one.machine.name,
    }


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write JSON, whole or not at all.

    Args:
        path: Where the file goes.
        content: The content, whose numbers are finite.

    Raises:
        OSError: The file cannot be written.

    """
    write_atomically(path, (json.dumps(content, indent=1, allow_nan=False) + "\n").encode())
