"""`hdagen.check`: the mistakes in a log that its own numbers or the robot give away, before anything is fitted."""

from __future__ import annotations

from dataclasses import dataclass

from hdagen.api.log_reading import ColumnSources, LogSource, read_log
from hdagen.api.robot_loading import RobotSource, load_robot, name_joints
from hdagen.data_quality.log_repair import repair_log
from hdagen.log.data_table import LogError
from hdagen.log.measured_log import Log
from hdagen.pages.result_table import ResultTable


@dataclass(frozen=True, eq=False)
class LogCheck:
    """What a diagnosis would make of a log before it fits anything.

    Attributes:
        log: The log as a diagnosis would take it, repaired; where it is refused, as it was.
        problems: Sentences on what only its owner can mend; the log is refused for them.
        repairs: Sentences on what a diagnosis repairs by itself.
        warnings: Sentences on what somebody should look at.
        notices: Sentences on what is good to know.

    """

    log: Log
    problems: tuple[str, ...]
    repairs: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    notices: tuple[str, ...] = ()

    @property
    def is_usable(self) -> bool:
        """Whether a diagnosis takes the log."""
        return not self.problems

    def table(self) -> ResultTable:
        """List all findings, the gravest first.

        Returns:
            The table, a row for each finding.

        """
        groups = {
            "refused": self.problems,
            "repaired": self.repairs,
            "warning": self.warnings,
            "notice": self.notices,
        }
        rows = [(severity, sentence) for severity, sentences in groups.items() for sentence in sentences]
        return ResultTable(
            f"Findings in {self.log.source}",
            {"severity": [severity for severity, _ in rows], "finding": [sentence for _, sentence in rows]},
        )

    def __str__(self) -> str:
        return str(self.table())

    def _repr_html_(self) -> str:
        """The table of findings as HTML, for notebooks."""
        return self.table()._repr_html_()


def check(robot: RobotSource, log: LogSource, *, columns: ColumnSources = None) -> LogCheck:
    """Check whether a log of a robot can carry a diagnosis, and what has to be repaired in it.

    Args:
        robot: A preset, the path of a robot.toml, or a robot that `hdagen.load_robot` loaded.
        log: A file, a `Log`, a data frame, an Arrow table, or a dict of arrays.
        columns: A columns.toml, or its tables as a dict, for a log with foreign names, units or signs.

    Returns:
        The findings; a log that is refused has its problems there.

    Raises:
        LogError: The log cannot be read at all.
        PlantError: The robot cannot be loaded.

    """
    measured = read_log(log, columns=columns, joints=name_joints(robot))
    arm = load_robot(robot)
    try:
        repaired, repairs, seen = repair_log(measured, arm)
    except LogError as error:
        return LogCheck(measured, tuple(error.problems))
    return LogCheck(repaired, (), tuple(one.sentence for one in repairs), seen.warnings, seen.notices)
