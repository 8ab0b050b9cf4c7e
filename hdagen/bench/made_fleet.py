"""Make a fleet of one-joint machines with logs: `python -m hdagen.bench.made_fleet FOLDER --robots 40 --logs 5`.

The machines are one-joint cases of the blind check, made by MuJoCo; each log of a robot has a motion and a date of its
own. `python -m hdagen.bench.campaign_overhead --fleet FOLDER/fleet.toml` measures on them.
"""

from __future__ import annotations

import argparse
import datetime
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from hdagen.blind.realities.joint_reality import make_joint_log
from hdagen.blind.realities.rigid_joints import LOG_RATES, JointCase, draw_joint_cases
from hdagen.log.measured_log import Log, write
from hdagen.support.atomic_write import write_atomically

FIRST_DATE = datetime.date(2026, 1, 5)
DAYS_BETWEEN_LOGS = 30


def write_fleet(
    folder: Path, robot_count: int, log_count: int, seconds: float, seed: str, rate: int | None = None
) -> Path:
    """Write robot files, logs, and the fleet.toml that names them.

    Args:
        folder: Of the files.
        robot_count: Count of robots.
        log_count: Logs of each robot.
        seconds: Length of a log, s.
        seed: Seed that robots and motions are drawn from.
        rate: Rate of all logs, Hz, one of LOG_RATES; None: the drawn ones.

    Returns:
        The fleet.toml.

    Raises:
        OSError: A file cannot be written.

    """
    folder.mkdir(parents=True, exist_ok=True)
    entries = []
    for number, drawn in enumerate(draw_one_joint_cases(seed, robot_count), 1):
        case = replace(drawn, rate=rate or drawn.rate)
        robot = f"robot_{number:03d}.toml"
        write_atomically(folder / robot, case.robot.toml().encode())
        for k in range(log_count):
            log, date = (
                f"robot_{number:03d}_log_{k + 1}.parquet",
                FIRST_DATE + datetime.timedelta(DAYS_BETWEEN_LOGS * k),
            )
            columns = make_joint_log(case, f"log {k}", seconds)
            time = columns.pop("time")
            write(Log(time, columns, 1, log), folder / log)
            entries.append(f'[[machine]]\nrobot = "{robot}"\nlog = "{log}"\ndate = {date.isoformat()}\n')
    write_atomically(folder / "fleet.toml", "\n".join(entries).encode())
    return folder / "fleet.toml"


def draw_one_joint_cases(seed: str, count: int) -> list[JointCase]:
    """Draw cases of the blind check that have one joint.

    Args:
        seed: Seed of the check.
        count: How many cases.

    Returns:
        The first ``count`` of them.

    """
    drawn, found = count, list[JointCase]()
    while len(found) < count:
        drawn *= 2
        found = [case for case in draw_joint_cases(seed, drawn) if len(case.robot.joints) == 1]
    return found[:count]


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the fleet and print its path.

    Args:
        arguments: Of the command line; None: those of the process.

    Returns:
        The exit code.

    """
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="where the files go")
    parser.add_argument("--robots", type=int, default=40, metavar="N", help="robots (default: 40)")
    parser.add_argument("--logs", type=int, default=5, metavar="N", help="logs of each robot (default: 5)")
    parser.add_argument("--seconds", type=float, default=2.0, metavar="T", help="length of a log, s (default: 2)")
    parser.add_argument("--rate", type=int, choices=LOG_RATES, help="of all logs, Hz (default: drawn for each robot)")
    parser.add_argument("--seed", default="made fleet", metavar="TEXT", help="any text")
    given = parser.parse_args(arguments)
    print(write_fleet(given.folder, given.robots, given.logs, given.seconds, given.seed, given.rate))
    return 0


if __name__ == "__main__":
    sys.exit(main())
