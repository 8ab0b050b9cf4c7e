"""The numbers of `hdagen demo`: a diagnosis; the arm on a circle and pushed, under two laws; its torque estimate.

The arm of preset `paper`, dry friction set-valued, encoders and noise as its robot file says. The bar: pushed, the tip
moves as the ideal mass, damper and spring would, within a tenth of the largest ideal displacement.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm, load
from hdagen.control.guard_limits import Guard, Safe
from hdagen.control.guarded_controller import Controller
from hdagen.control.reference_motion import Reference, circle
from hdagen.demo.leg_diagnosis import LegDiagnosis, diagnose_leg, summarize_leg
from hdagen.simulation.ideal_admittance import simulate_ideal_admittance
from hdagen.simulation.simulator import Push, Simulation, run

ROBOT = "paper"
DEMO_LAWS = ("impedance_cartesian", "admittance_cartesian")
CIRCLE_RADIUS, CIRCLE_CENTER, SECONDS_PER_TURN, CIRCLE_SECONDS = (
    0.05,
    (0.2, 0.0),
    5.0,
    10.0,
)  # m, m, s, s: the circle of the paper, Fig. 11
DEMO_PUSHES = (
    Push(3.0, 4.0, (15.0, 0.0)),
    Push(6.0, 7.0, (0.0, 15.0)),
)  # as in Fig. 11; 15 N is enough to turn a drive at rest
SAFE_MOTOR_DAMPING = (0.002, 0.002)  # N m s/rad at the motors: after a fault they stop within J/d = 65 ms
LARGEST_GAP_SHARE = 0.10  # of the largest ideal displacement
SMOOTHING_SECONDS = 0.015  # s, of the cubic through the angles that gives the estimate its speed and acceleration


@dataclass(frozen=True)
class CircleRun:
    """One law on the circle. ``tip_displacement`` and ``ideal`` (T, 2, m): how far the tip is off the circle, and how
    far M ẍ + B ẋ + K x = F says; ``points`` (T, n + 1, 2, m): base, joints and tip; ``fault``: the sentence of the
    first refused tick, or nothing."""

    law: str
    gains: Mapping[str, float]
    reference: Reference
    simulation: Simulation
    tip_displacement: Array
    ideal_displacement: Array
    points: Array
    first_fault: str

    @property
    def gap(self) -> Array:
        """How far the tip is from where the ideal puts it, (T,) m."""
        return np.linalg.norm(self.tip_displacement - self.ideal_displacement, axis=1)

    @property
    def largest_ideal(self) -> float:
        """m."""
        return float(np.linalg.norm(self.ideal_displacement, axis=1).max())

    @property
    def gap_share(self) -> float:
        """The largest gap in parts of the largest ideal displacement."""
        return float(self.gap.max()) / self.largest_ideal

    @property
    def meets_bar(self) -> bool:
        """Whether the bar is met, with no tick refused."""
        return self.gap_share <= LARGEST_GAP_SHARE and not self.first_fault


@dataclass(frozen=True)
class TorqueEstimates:
    """Joint torques (T, n, N m): true, and estimated without a torque sensor."""

    true_torque: Array
    series_estimate: Array
    dynamic_estimate: Array

    def rms_error(self, estimate: Array) -> Array:
        """Compute the rms error of an estimate.

        Args:
            estimate: Joint torques, (T, n) N m.

        Returns:
            The error of each joint, (n,) N m.

        """
        return np.sqrt(np.mean((estimate - self.true_torque) ** 2, axis=0))


def follow_circle(arm: Arm, law: str, gains: Mapping[str, float] | None = None, seed: int = 0) -> CircleRun:
    """Drive the tip around the circle under one law, and push it.

    Args:
        arm: The arm.
        law: Name of the control law.
        gains: Its gains, SI; None: its own.
        seed: Seed of the sensors' noise.

    Returns:
        The run, beside the ideal motion.

    Raises:
        PlantError: The arm has no such law, or refuses the gains.

    """
    controller = Controller(arm, law, Guard(Safe.DAMPING, safe_damping=SAFE_MOTOR_DAMPING), gains)
    reference = circle(CIRCLE_RADIUS, CIRCLE_CENTER, SECONDS_PER_TURN, CIRCLE_SECONDS, controller.guard.period)
    result = run(arm, controller, reference, DEMO_PUSHES, seed=seed)
    joint = [arm.index(f"joint_position_{j}") for j in range(1, arm.n + 1)]
    points = arm.evaluate("points", q=result.state[:, joint])["points"].reshape(len(result.state), -1, 2)
    refused, fault = result.status[result.status < 0], ""
    if len(refused):
        fault = controller.sentence(int(refused[0]))
    return CircleRun(
        law,
        dict(controller.gains),
        reference,
        result,
        result.tip - reference.position,
        simulate_ideal_admittance(controller, result.push, reference.period),
        points,
        fault,
    )


def estimate_torques(arm: Arm, followed: CircleRun) -> TorqueEstimates:
    """Estimate the joint torques from a log: the encoders' angles and the measured currents, nothing of the truth.

    A cubic fitted around each row smooths the angles and gives speed and acceleration; it looks as far ahead as back,
    so this is for logs, not for a controller.

    Args:
        arm: The arm.
        followed: A run on the circle.

    Returns:
        The estimates beside the true torques.

    """
    from scipy.signal import savgol_filter

    log, period = followed.simulation.log, followed.reference.period
    rows = 2 * int(SMOOTHING_SECONDS / period / 2) + 1

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
    return TorqueEstimates(followed.simulation.joint_torque, found["series"], found["dynamic"])


@dataclass(frozen=True)
class DemoResult:
    """Everything on the page. ``torque_estimates`` are under the first law; ``uncompensated_run`` is that law with
    friction not observed, which shows what the bar asks and does not count."""

    leg: LegDiagnosis
    arm: Arm
    circle_runs: tuple[CircleRun, ...]
    uncompensated_run: CircleRun
    torque_estimates: TorqueEstimates

    @property
    def meets_bar(self) -> bool:
        """Whether the hidden effect was found and the tip stayed within the bar under every law."""
        return self.leg.meets_bar and all(followed.meets_bar for followed in self.circle_runs)


def run_demo(profile: str = "portable", seed: int = 0, stage: Callable[[str], None] | None = None) -> DemoResult:
    """Diagnose the leg's log, then build the arm, simulate and estimate.

    Args:
        profile: Profile of the builds, "portable" or "native".
        seed: Seed of the sensors' noise.
        stage: Hears the name of each stage as it begins; None: nobody.

    Returns:
        All results.

    Raises:
        PlantError: A build fails.

    """
    say = stage or (lambda _: None)
    leg = diagnose_leg(profile, say)
    say("building the arm")
    arm = load(ROBOT, profile)
    followed = []
    for law in DEMO_LAWS:
        say(f"simulating {law.partition('_')[0]} control")
        followed.append(follow_circle(arm, law, seed=seed))
    say("simulating without friction compensation")
    uncompensated = follow_circle(arm, DEMO_LAWS[0], {"observer_bandwidth": 0.0}, seed)
    say("estimating the joint torque")
    estimated = estimate_torques(arm, followed[0])
    return DemoResult(leg, arm, tuple(followed), uncompensated, estimated)


def summarize_demo(demo: DemoResult) -> dict[str, Any]:
    """Sum the demo up in figures.

    Args:
        demo: All results.

    Returns:
        Figures by name, SI, as JSON takes them.

    """
    followed = {
        one.law: {
            "largest_ideal_displacement": one.largest_ideal,
            "largest_gap": float(one.gap.max()),
            "largest_gap_share": one.gap_share,
            "rms_gap": float(np.sqrt(np.mean(one.gap**2))),
            "largest_gap_time": float(one.reference.time[one.gap.argmax()]),
            "ticks": len(one.simulation.status),
            "ticks_limited": int((one.simulation.status > 0).sum()),
            "ticks_refused": int((one.simulation.status < 0).sum()),
            "first_refusal": one.first_fault or None,
        }
        for one in demo.circle_runs
    }
    estimated = demo.torque_estimates
    return {
        "diagnosis": summarize_leg(demo.leg),
        "bar": LARGEST_GAP_SHARE,
        "holds": demo.meets_bar,
        "followed": followed,
        "largest_gap_share_without_friction_compensation": demo.uncompensated_run.gap_share,
        "torque_estimate_rms_error": {
            "series": estimated.rms_error(estimated.series_estimate).tolist(),
            "dynamic": estimated.rms_error(estimated.dynamic_estimate).tolist(),
        },
    }
