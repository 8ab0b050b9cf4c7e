"""The decision of a case with each rule off, as a task: robot file, log, searches and diagnosis in, decisions out."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hdagen.arm.build_loader import PlantError
from hdagen.arm.joint_names import read_joint_names
from hdagen.blind.ablation_table import AS_IT_IS
from hdagen.blind.decision_rules import RULES
from hdagen.campaign.installation import describe_installation
from hdagen.campaign.task import Task, TaskFile, TaskFolder, TaskRefusedError
from hdagen.diagnosis.search.stored_searches import SEARCHES_FILE
from hdagen.diagnosis.stored_diagnosis import StoredDiagnosis, read_diagnosis
from hdagen.log.data_table import LogError
from hdagen.log.measured_log import read
from hdagen.support.input_file import InputFileError, read_json

DECISIONS_FILE = "decisions.json"
DECIDED_KEYS = ("verdict", "sure", "hypotheses")
_ROBOT_FILE, _LOG, _DIAGNOSIS = "robot.toml", "log.parquet", "diagnosis.json"
_LARGEST_DIAGNOSIS_BYTES = 50_000_000


def make_ablation_task(case: Path) -> Task:
    """Make the task that decides a case as it is, and with each rule off.

    Args:
        case: folder of the case, with its robot file, log, searches and diagnosis.

    Returns:
        The task, which has the name of the case; no label is among its files.

    """
    places = [case / _ROBOT_FILE, case / _LOG, case / "out" / SEARCHES_FILE, case / "out" / _DIAGNOSIS]
    files = {path.name: TaskFile(path, str(path)) for path in places}
    parameters = {"rules": [rule.name for rule in RULES], "code": describe_installation()["code"]}
    return Task(case.name, decide_without_rules, parameters, files)


def decide_without_rules(folder: TaskFolder, parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Decide a case as it is, and with each rule off.

    Args:
        folder: holds robot file, log, searches and diagnosis; takes decisions.json, which has by the rule's name what
            was decided, as `StoredDiagnosis.decide_again` tells it, and null where there is no decision.
        parameters: names of the rules.

    Returns:
        The verdict as it is, and the counts of ``decisions`` and of those that ``differ`` from it.

    Raises:
        TaskRefusedError: the case is not decided as it was, or a file of it cannot be read.
        PlantError: the robot cannot be built.

    """
    robot = folder.inputs[_ROBOT_FILE]
    try:
        log = read(folder.inputs[_LOG], holes=True, names=read_joint_names(robot))
        stored = read_diagnosis(robot, [log], folder.inputs[SEARCHES_FILE])
        said = read_json(folder.inputs[_DIAGNOSIS], _LARGEST_DIAGNOSIS_BYTES, "check again")
    except (InputFileError, LogError) as error:
        raise TaskRefusedError(str(error)) from None
    usual = _decide(stored)
    if usual is None or any(usual[key] != said[key] for key in DECIDED_KEYS):
        raise TaskRefusedError(
            f"{folder.inputs[_DIAGNOSIS]}: the case is not decided as it says; check again with this version."
        )
    found: dict[str, dict[str, Any] | None] = {AS_IT_IS: usual}
    for rule in RULES:
        if rule.name in parameters["rules"]:
            with rule.switch_off():
                found[rule.name] = _decide(stored)
    (folder.out / DECISIONS_FILE).write_text(json.dumps(found), encoding="utf-8")
    differ = sum(is_other_decision(one, usual) for one in found.values())
    return {"verdict": list(usual["verdict"]), "decisions": len(found), "differ": differ}


def is_other_decision(said: Mapping[str, Any] | None, usual: Mapping[str, Any] | None) -> bool:
    """Tell whether a decision is another one, be it by a probability alone.

    Args:
        said: a decision; None where there is none.
        usual: the other.

    Returns:
        Whether they differ.

    """
    if said is None or usual is None:
        return said is not usual
    return any(said[key] != usual[key] for key in DECIDED_KEYS)


def _decide(stored: StoredDiagnosis) -> dict[str, Any] | None:
    try:
        return stored.decide_again()
    except (LogError, PlantError):
        return None
