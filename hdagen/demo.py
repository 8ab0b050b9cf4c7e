"""What `hdagen demo` shows, as numbers: the arm on a circle and pushed, under two laws; its torque estimate; replays of logs.

The arm of preset `paper`, dry friction set-valued, encoders and force sensor as its robot file says. The bar: pushed, the tip moves as
the ideal mass, damper and spring would, within a tenth of the largest ideal displacement.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from hdagen.control import Controller, Guard, Safe
from hdagen.plant import Arm, Array
from hdagen.reference import Reference, circle
from hdagen.simulate import Push, Simulation, ideal, run

ROBOT = "paper"
LAWS = ("impedance_cartesian", "admittance_cartesian")
RADIUS, CENTER, TURN, SECONDS = 0.05, (0.2, 0.0), 5.0, 10.0  # m, m, s, s: the circle of the paper, Fig. 11
PUSHES = (
    Push(3.0, 4.0, (15.0, 0.0)),
    Push(6.0, 7.0, (0.0, 15.0)),
)  # as in Fig. 11; 15 N is what it takes to turn a drive at rest
SAFE_DAMPING = (0.002, 0.002)  # N m s/rad at the motors: after a fault they stop within J/d = 65 ms
BAR = 0.10  # of the largest ideal displacement
SMOOTHING = 0.015  # s, of the cubic through the angles that gives the estimate its speed and acceleration


@dataclass(frozen=True)
class Followed:
    """One law on the circle. ``moved`` and ``ideal`` (T, 2, m): how far the tip is off the circle, and how far M ẍ + B ẋ + K x = F
    says; ``gap`` (T,) m between them; ``points`` (T, n + 1, 2) m of base, joints and tip."""

    law: str
    gains: Mapping[str, float]
    reference: Reference
    simulation: Simulation
    moved: Array
    ideal: Array
    points: Array
    sentence: str  # of the first tick that was refused, or empty

    @property
    def gap(self) -> Array:
        """m, (T,)."""
        return np.linalg.norm(self.moved - self.ideal, axis=1)

    @property
    def largest_ideal(self) -> float:
        """m."""
        return float(np.linalg.norm(self.ideal, axis=1).max())

    @property
    def share(self) -> float:
        """The largest gap in parts of the largest ideal displacement."""
        return float(self.gap.max()) / self.largest_ideal

    @property
    def holds(self) -> bool:
        """Whether the bar is met, with no tick refused."""
        return self.share <= BAR and not self.sentence


@dataclass(frozen=True)
class Estimated:
    """Joint torques (T, n, N m): true, and estimated without a torque sensor."""

    true: Array
    series: Array
    dynamic: Array

    def rms(self, estimate: Array) -> Array:
        """rms error of an estimate, (n,) N m."""
        return np.sqrt(np.mean((estimate - self.true) ** 2, axis=0))


def follow(
    arm: Arm,
    law: str,
    gains: Mapping[str, float] | None = None,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Followed:
    """``law`` with ``gains`` (default: its own) drives the tip around the circle, and the world pushes. PlantError as `run`."""
    controller = Controller(arm, law, Guard(Safe.DAMPING, safe_damping=SAFE_DAMPING), gains)
    reference = circle(RADIUS, CENTER, TURN, SECONDS, controller.guard.period)
    result = run(arm, controller, reference, PUSHES, seed=seed, progress=progress)
    joint = [arm.index(f"joint_position_{j}") for j in range(1, arm.n + 1)]
    points = arm.evaluate("points", q=result.state[:, joint])["points"].reshape(len(result.state), -1, 2)
    refused = result.status[result.status < 0]
    return Followed(
        law,
        dict(controller.gains),
        reference,
        result,
        result.tip - reference.position,
        ideal(arm, controller, result.push, reference.period),
        points,
        controller.sentence(int(refused[0])) if len(refused) else "",
    )


def estimate(arm: Arm, followed: Followed) -> Estimated:
    """The torque estimates from what the log holds: encoders' angles and measured currents, nothing of the truth.

    A cubic fitted around each row smooths the angles and gives speed and acceleration; it looks as far ahead as back, so this is for
    logs, not for a controller.
    """
    from scipy.signal import savgol_filter

    log, period = followed.simulation.log, followed.reference.period
    rows = 2 * int(SMOOTHING / period / 2) + 1

    def fitted(name: str, derivative: int = 0) -> Array:
        columns = np.stack([log[f"{name}_{j}"] for j in range(1, arm.n + 1)], axis=1)
        return savgol_filter(columns, rows, 3, deriv=derivative, delta=period, axis=0)

    constant = np.array([arm.parameters[f"torque_constant_{j}"] for j in range(1, arm.n + 1)])
    found = arm.evaluate(
        "torque_estimate",
        motor_position=fitted("motor_position"),
        joint_position=fitted("joint_position"),
        motor_velocity=fitted("motor_position", 1),
        motor_acceleration=fitted("motor_position", 2),
        motor_torque=constant * fitted("motor_current"),
    )
    return Estimated(followed.simulation.joint_torque, found["series"], found["dynamic"])
