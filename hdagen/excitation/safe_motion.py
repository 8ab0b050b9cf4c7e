"""Motions that keep an arm's limits: each is tried on the compiled arm under its position controller, and made smaller
until every limit is kept with a margin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.arm.ratings import compute_torque_per_input
from hdagen.control.guard_limits import Guard, Safe
from hdagen.control.guarded_controller import Controller
from hdagen.control.reference_motion import Reference
from hdagen.excitation.motion_limits import MotionLimits, name_tip_limits
from hdagen.excitation.motion_shapes import MotionShape
from hdagen.simulation.simulated_sensors import Sensors
from hdagen.simulation.simulator import Simulation, run

LIMIT_MARGIN = 0.9  # of a limit that the nominal arm may reach; an arm with an effect may reach all of it
DRAWN_SHARE = 0.8  # of a limit to which a motion is drawn before it is tried
MOST_TRIES = 8  # times that a motion is made smaller
SMALLEST_SCALE = 0.02  # of the first drawing below which a motion is given up
STOP_REASONS = {"simulation": "the simulated arm leaves all bounds", "controller": "the controller's guard stops it"}
TORQUE_RISE_SECONDS = 0.01  # s from no torque to all of it where no rate is stated
ENCODER_STEPS = 1.5e-5, 6e-6  # rad or m at the joint: of the motor's and the joint's encoder where none are stated
CURRENT_NOISE_SHARE = 1e-3  # of the largest current, standard deviation where none is stated


@dataclass(frozen=True, eq=False)
class SafeRun:
    """A motion that keeps the limits: its reference, the run on the nominal arm, the largest share of each limit that
    is reached by any arm that was tried, and by how much it was made smaller."""

    motion: MotionShape
    reference: Reference
    simulation: Simulation
    limit_shares: Mapping[str, float]
    scale: float


def scale_motion(
    arm: Arm, limits: MotionLimits, motion: MotionShape, center: Array, period: float, scale: float
) -> Reference:
    """Scale a shape to the largest reference that range, speed, and the inertia's torque and current admit.

    Args:
        arm: The arm.
        limits: Its limits.
        motion: The shape.
        center: The middle posture, (n,) rad or m.
        period: Time from row to row, s.
        scale: Factor on the largest size.

    Returns:
        The reference of the joints.

    """
    v, ratio = np.gradient(motion.shape, period, axis=0), [arm.parameters[f"ratio_{j}"] for j in range(1, arm.n + 1)]
    a = np.gradient(v, period, axis=0)
    mass = np.diag(arm.evaluate("mass_matrix", q=center)["M"].reshape(arm.n, arm.n))
    rotor = np.array([arm.parameters[f"motor_inertia_{j}"] for j in range(1, arm.n + 1)]) * np.square(ratio)
    room = np.minimum(center - limits.position[:, 0], limits.position[:, 1] - center)
    peak = [np.maximum(np.abs(x).max(0), 1e-12) for x in (motion.shape, v, a)]
    drive = np.abs(ratio) * compute_torque_per_input(arm) * limits.current
    sizes = DRAWN_SHARE * np.min(
        [room, limits.speed / peak[1], limits.torque / (mass * peak[2]), drive / ((mass + rotor) * peak[2])], axis=0
    )
    q = center + scale * sizes * motion.shape
    return Reference("joint", period, q, scale * sizes * v, scale * sizes * a)


def compute_limit_shares(arm: Arm, limits: MotionLimits, run: Simulation, current: Array) -> dict[str, float]:
    """Compute the largest share of each limit that a run reaches.

    Args:
        arm: The arm that ran.
        limits: Its limits.
        run: The run.
        current: Current, or the motors' own unit of input, (T, n).

    Returns:
        Shares by name of the limit; of a range, the distance from its middle, and of a wall on one side, the share of
        the way to it from where the run began. Where the controller or the simulation failed, "controller" is infinite.

    """
    if (run.status < 0).any() or not np.isfinite(run.state).all():
        return {"controller": np.inf}
    position = run.state[:, [arm.index(f"joint_position_{j}") for j in range(1, arm.n + 1)]]
    velocity = run.state[:, [arm.index(f"joint_velocity_{j}") for j in range(1, arm.n + 1)]]
    half = np.diff(limits.position)[:, 0] / 2
    reached = {
        "position": np.abs(position - limits.position.mean(1)) / half,
        "speed": np.abs(velocity) / limits.speed,
        "torque": np.abs(run.joint_torque) / limits.torque,
        "current": np.abs(current) / limits.current,
    }
    found = {f"{kind}_{j + 1}": float(share[:, j].max()) for kind, share in reached.items() for j in range(arm.n)}
    for name, bounds, tip in zip(name_tip_limits(arm), limits.tip, run.tip.T, strict=True):
        if np.isfinite(bounds).any():
            found[name] = float(_measure_tip_share(tip, bounds).max())
    return found


def _measure_tip_share(tip: Array, bounds: Array) -> Array:
    """The shares of a range, or of the way to a wall on one side, that a coordinate of the tip (T,) takes up."""
    if np.isfinite(bounds).all():
        return np.asarray(np.abs(tip - bounds.mean()) / (np.ptp(bounds) / 2))
    wall = bounds[np.isfinite(bounds)][0]
    return np.asarray((tip - tip[0]) / (wall - tip[0]))


def follow_reference(
    arm: Arm, plant: Arm, reference: Reference, limits: MotionLimits
) -> tuple[Simulation | None, dict[str, float]]:
    """Drive an arm along a reference by the position controller, with the robot file's sensors.

    Args:
        arm: The controller's arm.
        plant: The arm that moves.
        reference: The reference of the joints.
        limits: The limits.

    Returns:
        The run and the shares of the limits that it reaches; None in place of a run that leaves all bounds.

    """
    constants = compute_torque_per_input(arm)
    most = constants * limits.current
    rates = [joint["limits"]["motor_torque_rate"] for joint in arm.robot["joints"]]
    rate = tuple(float(r or m / TORQUE_RISE_SECONDS) for r, m in zip(rates, most, strict=True))
    guard = Guard(Safe.ZERO, reference.period, torque_limit=tuple(most.tolist()), torque_rate=rate)
    controller = Controller(arm, "position", guard)
    try:
        result = run(plant, controller, reference, sensors=_choose_sensors(arm), start=reference.position[0])
    except PlantError:  # the reference fits and the controller is configured, so a state is not finite
        return None, {"simulation": np.inf}
    return result, compute_limit_shares(plant, limits, result, result.torque / constants)


def _choose_sensors(arm: Arm) -> Sensors:
    """The robot file's, and usual ones where it states none."""
    sensor = [joint["sensor"] for joint in arm.robot["joints"]]
    largest = [arm.manifest["input"][j]["bound"] for j in range(arm.n)]
    ratio = [abs(arm.parameters[f"ratio_{j}"]) for j in range(1, arm.n + 1)]
    return Sensors(
        tuple(s["motor_encoder_resolution"] or ENCODER_STEPS[0] * k for s, k in zip(sensor, ratio, strict=True)),
        tuple(s["joint_encoder_resolution"] or ENCODER_STEPS[1] for s in sensor),
        tuple(s["current_noise"] or CURRENT_NOISE_SHARE * m for s, m in zip(sensor, largest, strict=True)),
        force_noise=0.0,  # nothing touches the arm
    )


def count_encoder_steps(arm: Arm, position: Array) -> Array:
    """Count by how many steps of its finer encoder each joint moves.

    Args:
        arm: The arm, with the robot file's sensors.
        position: Positions of the joints, (T, n) rad or m.

    Returns:
        Steps of each joint, (n,).

    """
    sensors, ratio = _choose_sensors(arm), [abs(arm.parameters[f"ratio_{j}"]) for j in range(1, arm.n + 1)]
    assert sensors.motor_resolution and sensors.joint_resolution
    step = np.minimum(np.divide(sensors.motor_resolution, ratio), sensors.joint_resolution)
    return np.asarray(np.ptp(position, axis=0) / step)


def shrink_to_limits(
    arm: Arm, others: Sequence[Arm], limits: MotionLimits, motion: MotionShape, center: Array, period: float
) -> SafeRun | str:
    """Make a motion smaller until every arm keeps the limits.

    Args:
        arm: The nominal arm, which keeps them with a margin.
        others: Arms with an effect.
        limits: The limits.
        motion: The shape.
        center: The middle posture, (n,) rad or m.
        period: Time from row to row, s.

    Returns:
        The motion with its run; a sentence where it was made too small.

    """
    scale, why = 1.0, ""
    for _ in range(MOST_TRIES):
        reference = scale_motion(arm, limits, motion, center, period, scale)
        result, reached = follow_reference(arm, arm, reference, limits)
        over = {name: share / LIMIT_MARGIN for name, share in reached.items()}
        if max(over.values()) <= 1:
            for other in others:
                for name, share in follow_reference(arm, other, reference, limits)[1].items():
                    reached[name], over[name] = max(reached.get(name, 0), share), max(over.get(name, 0), share)
            if result is not None and max(over.values()) <= 1:
                return SafeRun(motion, reference, result, reached, scale)
        name = max(over, key=lambda key: over[key])
        why = STOP_REASONS.get(name) or f"{name} at {100 * reached[name]:.0f} % of its limit"
        scale *= float(np.clip(0.97 / over[name], 0.3, 0.9))
        if scale < SMALLEST_SCALE:
            break
    return why


def with_parameters(arm: Arm, sizes: Mapping[str, float]) -> Arm:
    """Copy an arm with some parameters changed.

    Args:
        arm: The arm.
        sizes: Parameters by name, SI; each is kept within its bounds.

    Returns:
        A second arm of the same build.

    """
    other = arm.with_parameters(arm.p)
    described = other.parameters.described
    other.parameters.update({k: min(max(v, described[k].low), described[k].high) for k, v in sizes.items()})
    return other
