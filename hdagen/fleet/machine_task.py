"""The diagnosis of one machine as a task: robot file and logs in, diagnosis.json and report.html out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from hdagen.arm.arrays import is_number
from hdagen.campaign.task import Task, TaskFile, TaskFolder, TaskRefusedError
from hdagen.fleet.fleet_file import FleetMachine

LONGEST_DIAGNOSIS_SECONDS = 3600.0
_LEAST_KEPT_PROBABILITY = 1e-3  # of a cause in the row
_COLUMNS_FILE = "columns.toml"


def make_machine_task(machine: FleetMachine) -> Task:
    """Make the task that diagnoses a machine.

    Args:
        machine: The machine.

    Returns:
        The task; its files are those that the diagnosis needs, and nothing else.

    """
    files: dict[str, TaskFile] = {}
    parameters: dict[str, Any] = {"robot": machine.robot, "log": f"log{machine.log.suffix}"}
    robot = Path(machine.robot)
    if robot.is_file():
        parameters["robot"] = f"robot{robot.suffix}"
        files[parameters["robot"]] = TaskFile(robot, machine.robot)
    files[parameters["log"]] = TaskFile(machine.log, str(machine.log))
    if machine.hold_out is not None:
        parameters["hold_out"] = f"hold_out{machine.hold_out.suffix}"
        files[parameters["hold_out"]] = TaskFile(machine.hold_out, str(machine.hold_out))
    if machine.columns is not None:
        files[_COLUMNS_FILE] = TaskFile(machine.columns, str(machine.columns))
    return Task(machine.name, diagnose_machine, parameters, files, LONGEST_DIAGNOSIS_SECONDS, is_machine_row)


def diagnose_machine(folder: TaskFolder, parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Diagnose a log, as `hdagen diagnose` does.

    Args:
        folder: Holds the files of `make_machine_task`, and takes diagnosis.json and report.html.
        parameters: Names of the robot file (or a preset), of the log, and of the hold-out where there is one.

    Returns:
        The row of the machine, as `summarize_diagnosis` makes it.

    Raises:
        TaskRefusedError: The log cannot carry a diagnosis.
        PlantError: The robot cannot be built or simulated, or the column map cannot be used.

    """
    from hdagen.arm.build_loader import PlantError
    from hdagen.arm.joint_names import read_joint_names
    from hdagen.diagnosis.pipeline import diagnose
    from hdagen.log.column_map import ColumnsError
    from hdagen.log.data_table import LogError
    from hdagen.log.measured_log import Log, read
    from hdagen.support.heap_memory import tune_malloc

    def read_as(name: str) -> Log:
        return replace(read(folder.inputs[name], columns=columns, holes=True, names=names), source=folder.labels[name])

    columns = folder.inputs.get(_COLUMNS_FILE)
    robot = folder.inputs.get(parameters["robot"], parameters["robot"])
    tune_malloc()
    names = read_joint_names(robot)
    try:
        held = [read_as(parameters[name]) for name in ("hold_out",) if name in parameters]
        found = diagnose(robot, [read_as(parameters["log"])], held)
    except LogError as error:
        raise TaskRefusedError(str(error)) from None
    except ColumnsError as error:
        raise PlantError(error) from None
    named = folder.labels.get(parameters["robot"], parameters["robot"])
    replace(found, robot=named).save(folder.out, folder.labels.get(_COLUMNS_FILE))
    return summarize_diagnosis(found.content)


def summarize_diagnosis(content: Mapping[str, Any]) -> dict[str, Any]:
    """Take from a diagnosis what table and page of a fleet show.

    Args:
        content: Content of diagnosis.json.

    Returns:
        Verdict with probability and whether it is sure, the gap, causes that are possible, estimated parameters as
        (value, standard deviation, unit), repairs and warnings.

    """
    verdict, data = content["verdict"], content.get("data", {})
    likely = (h["probability"] for h in content["hypotheses"] if h["effects"] == verdict)
    named = {
        f"{name} ({cause['effect']}@{cause['joint']})": estimate
        for cause in content["causes"]
        if f"{cause['effect']}@{cause['joint']}" in verdict
        for name, estimate in cause.get("parameters", {}).items()
    }
    return {
        "verdict": list(verdict),
        "sure": bool(content["sure"]),
        "probability": next(likely, None),
        "gap": {when: content["gap"].get(when) for when in ("before", "after", "floor", "shrink")},
        "robot_name": content.get("robot", {}).get("name"),
        "causes": [
            {key: cause[key] for key in ("effect", "joint", "probability")}
            for cause in content["causes"]
            if cause["probability"] >= _LEAST_KEPT_PROBABILITY
        ],
        "parameters": {
            name: [estimate["value"], estimate["std"], estimate["unit"]]
            for name, estimate in {**content.get("parameters", {}), **named}.items()
            if estimate.get("value") is not None and estimate.get("std") is not None
        },
        "repaired": [repair["what"] for repair in data.get("repaired", [])],
        "warnings": list(data.get("warnings", [])),
    }


def is_machine_row(row: Mapping[str, Any]) -> bool:
    """Tell whether a row, read from a file, has all that table and page of a fleet show.

    Args:
        row: The row.

    Returns:
        Whether it is as `summarize_diagnosis` makes it.

    """
    try:
        gaps = [row["gap"][when] for when in ("before", "after", "floor", "shrink")]
        chances = [row["probability"], *(cause["probability"] for cause in row["causes"])]
        places = [cause["joint"] for cause in row["causes"]]
        sizes = [size for value, std, _ in row["parameters"].values() for size in (value, std)]
        words = [*row["verdict"], *row["repaired"], *row["warnings"], *row["parameters"]]
        words += [*(unit for _, _, unit in row["parameters"].values()), *(cause["effect"] for cause in row["causes"])]
    except (LookupError, TypeError, ValueError, AttributeError):
        return False
    numbers = [one for one in (*gaps, *chances) if one is not None] + sizes
    lists = (row["verdict"], row["repaired"], row["warnings"], row["causes"])
    return (
        isinstance(row.get("sure"), bool)
        and isinstance(row.get("robot_name", 0), str | None)
        and all(isinstance(one, list) for one in lists)
        and all(isinstance(word, str) for word in words)
        and all(isinstance(place, int) and place >= 0 for place in places)
        and all(not isinstance(one, bool) and is_number(one) for one in numbers)
    )
