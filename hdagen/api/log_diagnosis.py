"""`hdagen.diagnose`: logs of a robot, as callers have them, to a diagnosis."""

from __future__ import annotations

from collections.abc import Iterable

from hdagen.api.log_reading import ColumnSources, LogSource, read_logs
from hdagen.api.robot_loading import RobotSource, find_robot_file, name_joints
from hdagen.diagnosis import pipeline
from hdagen.diagnosis.diagnosis import Diagnosis
from hdagen.diagnosis.stages.stage import StageListener
from hdagen.diagnosis.stages.time_budget import TimeBudget
from hdagen.log.data_table import LogError


def diagnose(
    robot: RobotSource,
    logs: LogSource | Iterable[LogSource],
    holdout: LogSource | Iterable[LogSource] = (),
    *,
    columns: ColumnSources = None,
    within: float | None = None,
    on_stage: StageListener | None = None,
) -> Diagnosis:
    """Diagnose which effects the model of a robot lacks, by logs of the robot.

    Args:
        robot: A preset, the path of a robot.toml, or a robot that `hdagen.load_robot` loaded.
        logs: One log or several of one machine: files, `Log` objects, data frames, Arrow tables, dicts of arrays.
        holdout: Other motions of the same machine. Without them a fifth of each log is held out.
        columns: A columns.toml, or its tables as a dict, for logs with foreign names, units or signs.
        within: Seconds that it may take; where they are up, the best until then is stated, is not sure, and `not_tried`
            of its content lists the rest.
        on_stage: Is called with each `Stage` as it begins, from any thread.

    Returns:
        The diagnosis.

    Raises:
        LogError: A log cannot carry a diagnosis; every problem is listed.
        PlantError: The model cannot be loaded, or the time was up before there was anything to state.

    """
    budget = TimeBudget(within)
    names = name_joints(robot)
    fitted, held = read_logs(logs, columns, names), read_logs(holdout, columns, names)
    if not fitted:
        raise LogError(["logs: found none, possible are one log or several; give a log of the robot."])
    return pipeline.diagnose(find_robot_file(robot), fitted, held, on_stage=on_stage, budget=budget)
