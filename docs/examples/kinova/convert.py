"""One joint of a Kinova Gen3 run as the log of a one-joint robot.

    python docs/examples/kinova/convert.py joint_4_trapez.csv 4 OUT.parquet

The runs turn one joint each, at constant speed and one way. `TorqueCur` is the current times a constant, at the joint's
side; behind the gear of 100 it is the motor's torque. Left out: `Torque` and `TorqueCmptd`, which are a model's and not
measured; `TorqueSm`, the torque sensor, which is 0 in these runs; and the velocities, which lead the positions by 1 to
2 ms. From the first row with a value beyond 1e6 on, which the robot never wrote, the run is cut: the end of joint 5.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from hdagen.log import write

RATIO = 100.0
LARGEST = 1e6  # of a number that the robot wrote


def columns(path: Path, joint: int) -> dict[str, np.ndarray]:
    """The columns of ``joint`` (1 to 7) by hdagen's names, of a robot that has no other; time is logged in ms."""
    with path.open(encoding="utf-8") as file:
        names = file.readline().strip().split(",")
        rows = np.loadtxt(file, delimiter=",", ndmin=2)
    rows = rows[np.logical_and.accumulate((np.abs(rows) < LARGEST).all(axis=1))]
    logged = dict(zip(names, rows.T, strict=True))
    return {
        "time": logged["Time"] * 1e-3,
        "motor_torque_1": logged[f"TorqueCur{joint}"] / RATIO,
        "joint_position_1": logged[f"Position{joint}"].copy(),
        "joint_position_reference_1": logged[f"PositionCmptd{joint}"].copy(),
        "motor_temperature_1": logged[f"Temp{joint}"] + 273.15,
    }


if __name__ == "__main__":
    if len(sys.argv) != 4 or sys.argv[2] not in "1234567":
        sys.exit(f"usage: {Path(sys.argv[0]).name} joint_4_trapez.csv JOINT OUT.parquet, where JOINT is 1 to 7.")
    write(columns(Path(sys.argv[1]), int(sys.argv[2])), sys.argv[3])
