"""How the verdict changes control, in simulation.

The model with the verdict stands in for the machine. Two controllers drive it: one knows the robot file, one knows the
verdict, as `hdagen adopt` and a build would give it. Both follow a swing within the log's range and speed; then joint 1
leads the tip into a stiff wall. The laws' disturbance observer compensates much of a model's error at the motor, so a
large gap in replay may change little here. The reader shall see that.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.arm.ratings import compute_torque_per_input
from hdagen.control.guard_limits import Guard, Safe
from hdagen.control.guarded_controller import Controller
from hdagen.control.reference_motion import Reference, compute_smooth_step
from hdagen.diagnosis.residuals.controller_impact_settings import CONTROLLER_IMPACT
from hdagen.log.measured_log import Log
from hdagen.prediction.measurement_model import read_joint_angles
from hdagen.simulation.simulator import EnvironmentForce, Simulation, run

CONTROL_LAW = "impedance_joint"


@dataclass(frozen=True)
class ControllerImpact:
    """Results with a controller that knows the robot file, and with one that knows the verdict: rms distance of the tip
    from its reference, m, and largest force at the wall, N."""

    tracking: tuple[float, float]
    force: tuple[float, float]

    @property
    def content(self) -> dict[str, Any]:
        """The results as diagnosis.json has them."""
        pairs = {"tracking": self.tracking, "contact_force": self.force}
        return {"law": CONTROL_LAW} | {
            name: dict(zip(("before", "after"), pair, strict=True)) for name, pair in pairs.items()
        }


def compare_controllers(plain: Arm, machine: Arm, log: Log) -> ControllerImpact:
    """Compare two controllers on a simulated machine.

    Args:
        plain: the robot file's arm.
        machine: the arm with the verdict.
        log: gives range and speed of the motion.

    Returns:
        Tracking errors and contact forces.

    Raises:
        PlantError: no controller can drive the arm, as without a limit of its torque.

    """
    low, high, fastest = _measure_motion(plain, log)
    most = np.array([slot["bound"] for slot in plain.manifest["input"][: plain.n]]) * compute_torque_per_input(plain)
    guard = Guard(
        Safe.DAMPING,
        torque_limit=tuple(most.tolist()),
        torque_rate=tuple((most / CONTROLLER_IMPACT.full_torque_time).tolist()),
        safe_damping=(CONTROLLER_IMPACT.safe_damping,) * plain.n,
    )
    tracking, force = [], []
    for model in (plain, machine):
        controller = Controller(model, CONTROL_LAW, guard)
        period = controller.guard.period
        swing = _make_swing(low, high, fastest, period)
        away = _run_controller(machine, controller, swing).tip - _tip_positions(machine, swing.position)
        tracking.append(float(np.sqrt(np.mean(np.sum(away**2, 1)))))
        pressed = _run_controller(machine, controller, *_lead_into_wall(machine, 0.5 * (low + high), period))
        force.append(float(np.linalg.norm(pressed.push, axis=1).max()))
    return ControllerImpact((tracking[0], tracking[1]), (force[0], force[1]))


def _run_controller(
    machine: Arm, controller: Controller, reference: Reference, world: EnvironmentForce | None = None
) -> Simulation:
    """Simulate a controller on the machine; a refusal is a PlantError."""
    found = run(machine, controller, reference, start=reference.position[0], world=world)
    refused = found.status[found.status < 0]
    if len(refused):
        raise PlantError(controller.sentence(int(refused[0])))
    return found


def _tip_positions(arm: Arm, q: Array) -> Array:
    """Return the tip's position (T, 2), or (T, 3) in space, m, at angles (T, n)."""
    return np.asarray(arm.evaluate("points", q=q)["points"][:, -arm.dimensions :])


def _measure_motion(arm: Arm, log: Log) -> tuple[Array, Array, Array]:
    """Return the ends of a swing (n each) and the joints' largest speeds (n) in the log."""
    angles = read_joint_angles(arm, log)
    rows = max(1, round(0.02 / log.period))  # noise does not count as speed
    speed = np.abs(angles[rows:] - angles[:-rows]) / (log.time[rows:] - log.time[:-rows])[:, None]
    low, high = np.quantile(angles, CONTROLLER_IMPACT.swing_quantiles, axis=0)
    return low, high, np.asarray(np.quantile(speed, 0.99, axis=0))


def _make_swing(low: Array, high: Array, fastest: Array, period: float) -> Reference:
    """Make a reference from ``low`` to ``high`` and back, no faster than the log."""
    span = high - low
    once = max(CONTROLLER_IMPACT.shortest_swing, float(np.max(np.pi * span / np.maximum(fastest, 1e-9), initial=0.0)))
    time, turn = np.arange(0.0, CONTROLLER_IMPACT.swing_count * once, period), 2 * np.pi / once
    share = 0.5 - 0.5 * np.cos(turn * time)
    rate, bend = 0.5 * turn * np.sin(turn * time), 0.5 * turn**2 * np.cos(turn * time)
    return Reference("joint", period, low + np.outer(share, span), np.outer(rate, span), np.outer(bend, span))


def _lead_into_wall(arm: Arm, q: Array, period: float) -> tuple[Reference, EnvironmentForce]:
    """Make a reference by which joint 1 leads the tip from ``q`` into a wall that begins there, and that wall."""
    nudge = np.zeros(arm.n)
    nudge[0] = 1e-6
    face = _tip_positions(arm, np.stack([q, q + nudge]))
    way = (face[1] - face[0]) / 1e-6  # of the tip, for joint 1
    reach = float(np.linalg.norm(way))
    if reach < 10 * CONTROLLER_IMPACT.press_depth:
        raise PlantError("joint 1 hardly moves the tip where the log's motion has its middle.")
    ahead = way / reach
    time = np.arange(0.0, CONTROLLER_IMPACT.rise_time + CONTROLLER_IMPACT.hold_time, period)
    share, rate, bend = compute_smooth_step(time / CONTROLLER_IMPACT.rise_time)
    rate, bend = rate / CONTROLLER_IMPACT.rise_time, bend / CONTROLLER_IMPACT.rise_time**2
    step = np.zeros(arm.n)
    step[0] = CONTROLLER_IMPACT.press_depth / reach

    def wall(tip: Array, velocity: Array) -> Array:
        touch = np.zeros(arm.nu - arm.n)
        touch[: ahead.size] = -CONTROLLER_IMPACT.wall_stiffness * max(float((tip - face[0]) @ ahead), 0.0) * ahead
        return touch

    rows = [np.outer(of, step) for of in (share, rate, bend)]
    return Reference("joint", period, q + rows[0], rows[1], rows[2]), wall
