"""What goes with the motor's angle in a run at constant speed: the current's torque, and the joint's angle.

    python docs/examples/kinova/cycles.py joint_7.toml log.parquet 12 14 24

For each number of cycles a motor turn: the amplitude of the current's torque at the joint, that of the joint's angle,
and the angle by which that torque alone would swing the model's inertia. Where the last two agree, the torque acts on
the joint as the model says, and makes up for nothing; where the angle is the smaller one, something takes the torque
up. Beside each amplitude the median of four numbers of cycles nearby, which are no whole ones.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from hdagen.arm import Arm, PlantError, load
from hdagen.log import Log, LogError, read

STEADY = 0.2  # of the speed's median, within which a row counts
EDGE = 200  # rows at either end of those that are left out
SMOOTH = 15  # degree of the polynomial that takes the slow part out
BESIDE = (-0.37, -0.23, 0.23, 0.37)  # of a cycle


def amplitudes(log: Log, ratio: float, orders: list[float]) -> tuple[np.ndarray, float]:
    """Complex amplitudes (orders, 2) of torque at the joint, N m, and of its angle, rad, and the speed, rad/s."""
    q, torque = log["joint_position_1"], ratio * log["motor_torque_1"]
    speed = np.gradient(q, log.time)
    steady = np.flatnonzero(np.abs(speed - np.median(speed)) < STEADY * abs(np.median(speed)))[EDGE:-EDGE]
    if len(steady) < EDGE:
        raise LogError([f"{log.source}: no stretch at constant speed; take a run that turns one joint one way."])
    rows = slice(steady[0], steady[-1])
    q, course = q[rows], np.linspace(-1.0, 1.0, steady[-1] - steady[0])
    weight = np.hanning(len(q)) / np.hanning(len(q)).sum()
    smooth = np.polynomial.Chebyshev.fit
    fast = [x - smooth(course, x, SMOOTH)(course) for x in (torque[rows], q)]
    turned = np.exp(-1j * ratio * np.outer(orders, q))
    return np.stack([2 * turned @ (weight * x) for x in fast], 1), float(np.median(speed[rows]))


def inertia(arm: Arm) -> float:
    """Of link and rotor about the joint's axis, kg m²."""
    p = arm.parameters
    link = p["inertia_1"] + p["mass_1"] * p["center_of_mass_1"] ** 2
    return float(link + p["ratio_1"] ** 2 * p["motor_inertia_1"])


def main(robot: str, path: str, cycles: list[float]) -> None:
    """Print a line for each number of cycles."""
    arm, log = load(robot), read(path)
    ratio = arm.parameters["ratio_1"]
    found, speed = amplitudes(log, ratio, cycles)
    print("cycles   Hz    torque N m (beside)    angle rad (beside)    angle by the torque alone rad")
    for k, (torque, angle) in zip(cycles, np.abs(found), strict=True):
        rate = k * ratio * abs(speed)
        near = np.median(np.abs(amplitudes(log, ratio, [k + d for d in BESIDE])[0]), axis=0)
        alone = torque / (inertia(arm) * rate**2)
        print(
            f"{k:6g} {rate / (2 * np.pi):6.1f} {torque:8.3f} ({near[0]:.3f})       {angle:.1e} ({near[1]:.1e})"
            f"        {alone:.1e}"
        )


if __name__ == "__main__":
    if len(sys.argv) < 4 or not all(k.replace(".", "", 1).isdigit() for k in sys.argv[3:]):
        sys.exit(f"usage: {Path(sys.argv[0]).name} ROBOT LOG CYCLES [CYCLES …], cycles a motor turn, as 12.")
    try:
        main(sys.argv[1], sys.argv[2], [float(k) for k in sys.argv[3:]])
    except KeyError as error:
        sys.exit(error.args[0])
    except (LogError, PlantError) as error:
        sys.exit(str(error))
