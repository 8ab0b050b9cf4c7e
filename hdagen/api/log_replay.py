"""`hdagen.replay`: a log of a robot, as callers have it, simulated again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hdagen.adoption import verdict
from hdagen.api.log_reading import ColumnSources, LogSource, read_log
from hdagen.api.robot_loading import RobotSource, load_diagnosed_robot, name_joints
from hdagen.data_quality.log_repair import repair_for_replay
from hdagen.diagnosis.report.diagnosis_summary import DiagnosisSummary
from hdagen.log.data_table import LogError
from hdagen.log.measured_log import Log
from hdagen.prediction import window_replay
from hdagen.prediction.window_replay import REPLAY_WINDOW, Replay

DiagnosisSource = DiagnosisSummary | str | Path | Mapping[str, Any]  # a diagnosis, its diagnosis.json, or its content


def replay(
    robot: RobotSource,
    log: LogSource,
    *,
    window: float = REPLAY_WINDOW,
    input: str = "command",
    diagnosis: DiagnosisSource | None = None,
    columns: ColumnSources = None,
) -> Replay:
    """Simulate a log again, window after window, from its commands and the forces on its tip.

    Args:
        robot: A preset, the path of a robot.toml, or a robot that `hdagen.load_robot` loaded.
        log: A file, a `Log`, a data frame, an Arrow table, or a dict of arrays.
        window: The length of a window, s; inf: the whole log.
        input: "command" or "measured", the current or torque that drives the model.
        diagnosis: A diagnosis, whose verdict is put into the model.
        columns: A columns.toml, or its tables as a dict, for a log with foreign names, units or signs.

    Returns:
        The replay: predicted columns, errors by channel, and the gap.

    Raises:
        LogError: The log does not fit the robot, or nothing right can be computed from it.
        PlantError: The robot cannot be loaded, or the diagnosis is of another one.

    """
    stated = None
    if diagnosis is not None:
        stated = verdict.read_verdict(get_content(diagnosis))
    measured = read_log(log, columns=columns, joints=name_joints(robot))
    arm = load_diagnosed_robot(robot, stated)
    window_replay.check_log_fits_arm(arm, measured)
    _refuse_missing_values(measured)
    repaired, repairs, seen = repair_for_replay(measured, arm)
    if seen.refusals:
        raise LogError([f"{repaired.source}: {sentence}" for sentence in seen.refusals])
    found = window_replay.replay(arm, repaired, window, input, stated)
    said = (*repaired.notes, *seen.warnings, *(one.sentence for one in repairs), *found.notes)
    return replace(found, notes=tuple(dict.fromkeys(said)))


def get_content(diagnosis: DiagnosisSource) -> str | Path | Mapping[str, Any]:
    """Get the content of a diagnosis.

    Args:
        diagnosis: A diagnosis, the path of its diagnosis.json, or its content.

    Returns:
        The content, or the path as it was given.

    """
    if isinstance(diagnosis, DiagnosisSummary):
        return diagnosis.content
    return diagnosis


def _refuse_missing_values(log: Log) -> None:
    """Refuse a log with missing values, over which nothing can be integrated. Raises LogError."""
    problems = [
        f"{log.source}: column {name} has no value in {np.count_nonzero(~np.isfinite(values))} row(s): cut them, or "
        f'fill them with columns.toml [{name}] fill = "linear" ("hold" for a command).'
        for name, values in log.columns.items()
        if not np.isfinite(values).all()
    ]
    if problems:
        raise LogError(problems)
