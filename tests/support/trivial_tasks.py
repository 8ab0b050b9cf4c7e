"""Actions that cost nothing, for tests of the engine, and one that stands in for the diagnosis of a machine."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import signal
import sys
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from hdagen.arm.build_loader import PlantError
from hdagen.campaign.task import Task, TaskFolder, TaskRefusedError
from hdagen.fleet.fleet_file import FleetMachine
from hdagen.fleet.machine_task import make_machine_task, summarize_diagnosis

Parameters = Mapping[str, Any]


def note_call(name: str) -> None:
    """One more line in the file that $CALLS names."""
    if "CALLS" in os.environ:
        append_line(os.environ["CALLS"], name)


def append_line(path: str, name: str) -> None:
    """One more line, which no other process tears apart."""
    with Path(path).open("a") as file:
        file.write(f"{name} {os.getpid()}\n")


def write_square(folder: TaskFolder, parameters: Parameters) -> dict[str, Any]:
    """Leaves the square of a number in a file, after a while; notes that it ran."""
    time.sleep(parameters.get("seconds", 0.0))
    square = parameters["number"] ** 2
    (folder.out / "square.txt").write_text(str(square))
    note_call(str(parameters["number"]))
    if "calls" in parameters:
        append_line(parameters["calls"], str(parameters["number"]))
    return {"square": square, "process": os.getpid()}


def copy_files(folder: TaskFolder, parameters: Parameters) -> dict[str, Any]:
    """Leaves what it was given, and tells the folders it works in."""
    for name, path in folder.inputs.items():
        (folder.out / name).write_bytes(path.read_bytes())
    return {"place": str(folder.out), "home": str(Path.cwd()), "process": os.getpid()}


def hash_files(folder: TaskFolder, parameters: Parameters) -> dict[str, Any]:
    """Tells hashes of what it was given, and the folder it works in."""
    hashes = {name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in folder.inputs.items()}
    return {"place": str(folder.out), "hashes": hashes}


def end_worker(folder: TaskFolder, parameters: Parameters) -> dict[str, Any]:
    """Kills the process that runs it."""
    note_call("killer")
    os.kill(os.getpid(), signal.SIGKILL)
    return {}


def take_memory(folder: TaskFolder, parameters: Parameters) -> dict[str, Any]:
    """Takes more memory than it is allowed, and keeps it for a while."""
    taken = bytearray(parameters["bytes"])
    taken[::4096] = b"x" * len(taken[::4096])
    time.sleep(60.0)
    return {"length": len(taken)}


def find_full_disk(folder: TaskFolder, parameters: Parameters) -> dict[str, Any]:
    """Finds the disk full on workers whose folder is named so."""
    if (Path.cwd() / "full").exists():
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(folder.out))
    return {"process": os.getpid()}


def break_down(folder: TaskFolder, parameters: Parameters) -> dict[str, Any]:
    """Breaks as its parameter says."""
    if parameters["how"] == "refused":
        raise TaskRefusedError("the log is empty; record one.")
    if parameters["how"] == "plant":
        raise PlantError(f"{folder.inputs['log.csv']}: cannot be built.")
    raise ValueError("nobody thought of this")


def load_robot(folder: TaskFolder, parameters: Parameters) -> dict[str, Any]:
    """Loads a robot, which is built where no build is there."""
    from hdagen.arm.compiled_arm import load

    arm = load(folder.inputs["robot.toml"])
    return {"joints": arm.n, "folder": str(arm.folder), "state": arm.rest([0.1] * arm.n).tolist()}


def drive_short_run(folder: TaskFolder, parameters: Parameters) -> dict[str, Any]:
    """A random run of the controllers' table whose path is cut to a short one."""
    from unittest.mock import patch

    from hdagen.control.reference_motion import circle
    from hdagen.mpc.benchmark import law_comparison
    from hdagen.mpc.benchmark.random_run_tasks import drive_run_task

    def shorten(radius: float, center: tuple[float, float], turn: float, _: float, period: float) -> Any:
        return circle(radius, center, turn, 0.6, period)

    with patch.object(law_comparison, "circle", shorten):
        return drive_run_task(folder, parameters)


# -- a machine of a fleet ---------------------------------------------------------------------------------------------


def make_stand_in(machine: FleetMachine) -> Task:
    """The task of a machine, whose log says what comes of it."""
    return replace(make_machine_task(machine), action=obey_log)


def obey_log(folder: TaskFolder, parameters: Parameters) -> dict[str, Any]:
    """Does what the log's first word says: find, refuse, fail, sleep."""
    label = folder.labels[parameters["log"]]
    note_call(Path(label).stem)
    word, *rest = folder.inputs[parameters["log"]].read_text().split()
    if word == "sleep":
        time.sleep(60)
    if word == "refuse":
        raise TaskRefusedError(f"{label}: motor_position_1 stays at 0; record it.")
    if word == "fail":
        raise PlantError("the build failed.")
    content = make_diagnosis(rest)
    (folder.out / "diagnosis.json").write_text(json.dumps(content))
    (folder.out / "report.html").write_text("<html>a report</html>")
    return summarize_diagnosis(content)


def make_diagnosis(verdict: list[str]) -> dict[str, Any]:
    """The content of a diagnosis.json, as far as a fleet reads it."""
    chance = 0.9 if verdict else 0.6
    return {
        "schema": 2,
        "verdict": verdict,
        "sure": bool(verdict),
        "gap": {"before": 8.0, "after": 1.5, "floor": 1.0, "shrink": 0.93}
        if verdict
        else {"before": 1.1, "after": 1.1, "floor": 1.0, "shrink": 0.0},
        "causes": [
            {"effect": "stribeck_friction", "joint": 2, "probability": chance if verdict else 0.01, "parameters": {}},
            {"effect": "payload", "joint": 2, "probability": 0.02, "parameters": {}},
        ],
        "hypotheses": [{"effects": verdict, "probability": chance}],
        "parameters": {"mass_1": {"value": 1.0, "std": 0.1, "unit": "kg"}},
        "robot": {"name": "an arm"},
        "data": {"repaired": [{"what": "read as mA"}], "warnings": []},
    }


def run_stand_in_fleet(arguments: list[str]) -> int:
    """Runs `hdagen diagnose` whose machines are diagnosed by `obey_log`."""
    from functools import partial

    from hdagen.__main__ import main
    from hdagen.fleet import fleet_diagnosis

    fleet_diagnosis.diagnose_fleet = partial(fleet_diagnosis.diagnose_fleet, make_task=make_stand_in)
    return main(arguments)


if __name__ == "__main__":
    from trivial_tasks import run_stand_in_fleet as run_here  # by the name that workers can import

    sys.exit(run_here(sys.argv[1:]))
