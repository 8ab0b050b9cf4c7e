"""A raw log of BAM's XL330 pendulum as a log that hdagen reads.

    python docs/examples/bam/convert.py LOG.json OUT.parquet

The motor's torque is not logged and follows from PWM duty, supply voltage and back-EMF. `motor_torque_command_1` is the
torque at the nominal 7.4 V, `motor_torque_1` the one at the voltage as measured: between the two lies the supply's sag.
The servo's own loop runs on between two rows, so what acts between them is the mean of both.

The logged speed is left out: it lags by 20 ms, most of what the friction would have to explain. The back-EMF's speed is
the slope of a parabola through the positions of the nearest 8 rows each way.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from xl330 import OFFSET, RATIO, SUPPLY, Recording, read, torque

from hdagen.log import write

REACH = 8  # rows each way of the parabola, about 40 ms


def slopes(time: np.ndarray, position: np.ndarray) -> np.ndarray:
    """rad/s (T,): of parabolas through the rows about each."""
    rates = np.empty(len(time))
    for k in range(len(time)):
        near = slice(max(k - REACH, 0), k + REACH + 1)
        rates[k] = np.polyfit(time[near] - time[k], position[near], 2)[1]
    return rates


def columns(log: Recording) -> dict[str, np.ndarray]:
    """The log by hdagen's names; the joint's angle counts from the horizontal, as robot.toml's gravity wants it."""
    speed = slopes(log.time, log.position)
    nominal, sagging = (torque(log.duty, volts, speed, log.on) / RATIO for volts in (SUPPLY, log.supply))
    after, before = np.append(nominal[1:], nominal[-1]), np.insert(sagging[:-1], 0, sagging[0])
    return {
        "time": log.time,
        "motor_torque_command_1": (nominal + after) / 2,
        "motor_torque_1": (sagging + before) / 2,
        "joint_position_1": log.position + OFFSET - np.pi / 2,
        "joint_position_reference_1": log.goal + OFFSET - np.pi / 2,
    }


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(f"usage: {Path(sys.argv[0]).name} LOG.json OUT.parquet")
    write(columns(read(Path(sys.argv[1]))), sys.argv[2])
