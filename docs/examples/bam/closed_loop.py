"""BAM's XL330 pendulum in closed loop: the servo's law drives the model from the logged goals.

    python docs/examples/bam/closed_loop.py [--with diagnosis.json] [--supply measured] LOG.json …

prints the mean absolute error of the position of each log, rad, and their mean, which is BAM's own score. `hdagen
replay --closed-loop` knows neither back-EMF beside a limited voltage nor a motor that is disconnected on the way, so
this script closes the loop, over the same compiled model.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from xl330 import OFFSET, RATIO, SUPPLY, Recording, read, torque

from hdagen.adoption import verdict
from hdagen.arm import Arm, load

ROBOT = Path(__file__).with_name("robot.toml")
STEP = 1e-3  # s, about the period of the servo's own loop


def simulate(arm: Arm, log: Recording, measured_supply: bool = False) -> np.ndarray:
    """Positions (T,) of the pendulum, rad from hanging down, from the first row's state and all goals."""
    x, u = arm.rest([log.position[0] + OFFSET - np.pi / 2]), np.zeros(arm.nu)
    q, v = arm.index("joint_position_1"), arm.index("joint_velocity_1")
    x[v] = log.speed
    positions = np.empty(len(log.time))
    for k, held in enumerate(np.diff(log.time, append=log.time[-1])):
        positions[k] = x[q] - OFFSET + np.pi / 2
        volts = log.supply[k] if measured_supply else SUPPLY
        parts = int(np.ceil(held / STEP))
        for _ in range(parts):
            error = log.goal[k] - (x[q] - OFFSET + np.pi / 2)
            u[0] = torque(np.clip(log.gain * error, -1, 1), volts, x[v], log.on[k]) / RATIO
            x = arm.step(x, u, held / parts, exact=True)
    return positions


def model(diagnosis: Path | None) -> Arm:
    """The pendulum of robot.toml, with the effects and parameters of a diagnosis in it."""
    if diagnosis is None:
        return load(ROBOT)
    stated = verdict.read_verdict(diagnosis)
    return verdict.apply_verdict(verdict.load_with_effects(ROBOT, "portable", stated), stated)[0]


def main() -> None:
    """Every log's error, and the mean."""
    parser = argparse.ArgumentParser(description="BAM's XL330 pendulum in closed loop.")
    parser.add_argument("logs", nargs="+", type=Path, metavar="LOG.json")
    parser.add_argument("--with", dest="diagnosis", type=Path, metavar="diagnosis.json")
    parser.add_argument("--supply", choices=("nominal", "measured"), default="nominal")
    options = parser.parse_args()
    arm = model(options.diagnosis)
    errors = []
    for path in options.logs:
        log = read(path)
        errors.append(np.abs(simulate(arm, log, options.supply == "measured") - log.position).mean())
        print(f"{path.name}  {errors[-1]:.4f}")
    print(f"mean  {np.mean(errors):.4f}")


if __name__ == "__main__":
    main()
