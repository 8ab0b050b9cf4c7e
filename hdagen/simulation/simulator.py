"""Simulation of a controller on the compiled arm, with its sensors: the log that a machine would write, and the truth.

The arm has set-valued friction; the controller sees encoders with their noise and resolution, a force sensor with
noise, and everything late by the delay. Row k of the log holds the samples of t_k and the command that was held from
t_k to the next row.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdagen.arm.arrays import Array
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.arm.input_stage import InputStage
from hdagen.arm.ratings import compute_torque_per_input
from hdagen.control.guarded_controller import Controller, convert_to_law_space
from hdagen.control.pose_kinematics import POSE_SIZE, choose_open_posture
from hdagen.control.reference_motion import Reference, solve_inverse_kinematics
from hdagen.log.measured_log import Log
from hdagen.simulation.simulated_sensors import SensorErrors, Sensors, resolve_sensor_errors

__all__ = [
    "EnvironmentForce",
    "Push",
    "Sensors",
    "Simulation",
    "SpacePush",
    "find_start",
    "run",
    "simulate",
    "sum_push_forces",
]

EnvironmentForce = Callable[[Array, Array], Array]  # tip position and velocity -> force on the tip, N


@dataclass(frozen=True)
class Push:
    """A force of the world on the tip, N in the base frame, from start to end, s."""

    start: float
    end: float
    force: tuple[float, float]


@dataclass(frozen=True)
class SpacePush:
    """The same on an arm in space: three components, N, and after them those of a moment, N m, or none."""

    start: float
    end: float
    force: tuple[float, ...]


@dataclass(frozen=True)
class Simulation:
    """A simulated log, and the truth at the same rows.

    Attributes:
        log: The log, as sensors read it.
        state: (T, nx).
        tip: (T, 2), or (T, 3) in space, m.
        joint_torque: (T, n), N m.
        torque: (T, n), sent to the motors, N m.
        push: (T, 2), or (T, 6) in space, the force of the world on the tip, N, and its moment, N m.
        status: (T), the controller's status of each tick.
        beyond_law: The number of rows in which a torsion lay beyond the spring law.

    """

    log: Log
    state: Array
    tip: Array
    joint_torque: Array
    torque: Array
    push: Array
    status: NDArray[np.int32]
    beyond_law: int


def simulate(
    arm: Arm,
    controller: Controller,
    reference: Reference,
    pushes: Sequence[Push | SpacePush] = (),
    sensors: Sensors | None = None,
    seed: int = 0,
    start: ArrayLike | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Log:
    """Simulate the log of a controller that drives an arm; see `run` for the truth beside it.

    Args:
        arm: The arm; it may have other parameters than the controller's.
        controller: The controller.
        reference: The motion that it follows.
        pushes: Forces on the tip.
        sensors: The sensors' errors; None: from the robot file.
        seed: The seed of all noise, from 0; one seed gives one log, to the bit.
        start: (n), joint positions near which the motion begins; None: a bent arm.
        progress: Called with the ticks done and all ticks, now and then.

    Returns:
        The log.

    Raises:
        PlantError: The motion is out of reach, or an argument does not fit the others.

    """
    return run(arm, controller, reference, pushes, sensors, seed, start, progress).log


def run(
    arm: Arm,
    controller: Controller,
    reference: Reference,
    pushes: Sequence[Push | SpacePush] = (),
    sensors: Sensors | None = None,
    seed: int = 0,
    start: ArrayLike | None = None,
    progress: Callable[[int, int], None] | None = None,
    world: EnvironmentForce | None = None,
) -> Simulation:
    """Simulate a controller that drives an arm.

    The arm begins at rest, and the controller as if just made.

    Args:
        arm: The arm; it may have other parameters than the controller's.
        controller: The controller.
        reference: The motion that it follows.
        pushes: Forces on the tip.
        sensors: The sensors' errors; None: from the robot file.
        seed: The seed of all noise, from 0; one seed gives one log, to the bit.
        start: (n), joint positions near which the motion begins; None: a bent arm.
        progress: Called with the ticks done and all ticks, now and then.
        world: Gives the force on the tip (N) at its position and velocity, held over a tick and felt by the sensor.

    Returns:
        The log, and the truth beside it.

    Raises:
        PlantError: The motion is out of reach, or an argument does not fit the others.

    """
    _check_sizes(arm, controller, reference)
    q0 = find_start(arm, reference, start)
    wanted = convert_to_law_space(controller, reference, q0)
    rows, count = controller.rows(wanted), len(reference.position)
    push = sum_push_forces(pushes, reference.time, arm.nu - arm.n)
    scheme = resolve_sensor_errors(arm, sensors or Sensors())
    if not isinstance(seed, int) or seed < 0:
        raise PlantError(f"the seed is a whole number from 0, not {seed}.")
    random = np.random.default_rng(seed)
    felt = push.copy()
    forces = min(push.shape[1], 3)  # a moment is measured without noise
    felt[:, :forces] += random.normal(size=(count, forces)) * scheme.force_noise
    shaken = random.normal(size=(count, arm.n)) * np.asarray(scheme.current_noise)
    wobble = scheme.draw_encoder_noise(count, seed)
    seen, state, torque, shown, status = _simulate_ticks(
        arm, controller, rows, push, felt, wobble, shaken, q0, scheme, progress, world
    )
    commanded = torque / compute_torque_per_input(arm)
    truth = arm.outputs(state, np.hstack([shown, push]))
    columns = _make_columns(arm, wanted, seen, commanded, shown + shaken)
    columns |= dict(zip(arm.input_names[arm.n :], np.ascontiguousarray(felt.T), strict=True))
    log = Log(reference.time, columns, arm.n, f"simulated: {arm.robot['name']}, {controller.law}, seed {seed}")
    beyond = int(np.any(truth["beyond_law"] > 0, axis=1).sum())
    return Simulation(log, state, truth["tip"], truth["joint_torque"], torque, push, status, beyond)


def _make_columns(arm: Arm, reference: Reference, seen: Array, commanded: Array, measured: Array) -> dict[str, Array]:
    """The columns of the joints, from encoder readings (T, 2n) and commanded and measured inputs (T, n)."""
    columns: dict[str, Array] = {}
    for j in range(arm.n):
        kind = arm.input_names[j].rpartition("_")[0]
        columns[f"{kind}_command_{j + 1}"], columns[f"{kind}_{j + 1}"] = commanded[:, j], measured[:, j]
        columns[f"motor_position_{j + 1}"], columns[f"joint_position_{j + 1}"] = seen[:, j], seen[:, arm.n + j]
        if reference.space == "joint":
            columns[f"joint_position_reference_{j + 1}"] = reference.position[:, j]
    return {name: np.ascontiguousarray(values) for name, values in columns.items()}


def find_start(arm: Arm, reference: Reference, start: ArrayLike | None) -> Array:
    """Find the joint positions at which a motion begins.

    Args:
        arm: The arm.
        reference: The motion.
        start: (n), joint positions next to them; None: a bent arm, in space one far from singular postures.

    Returns:
        (n), rad (m where prismatic).

    Raises:
        PlantError: The motion begins out of reach.

    """
    if reference.space != "tip":
        return reference.position[0]
    if start is not None:
        near = np.asarray(start, float)
    elif arm.moves_in_space:
        near = choose_open_posture(arm)
    else:
        near = np.full(arm.n, 0.6)
    return solve_inverse_kinematics(arm, reference.position[0], near)


def _check_sizes(arm: Arm, controller: Controller, reference: Reference) -> None:
    if arm.n != controller.arm.n:
        raise PlantError(f"the controller is of an arm with {controller.arm.n} joints and the plant has {arm.n}.")
    width = arm.n
    if reference.space == "tip":
        width = POSE_SIZE if arm.moves_in_space else 2
    parts = (reference.position, reference.velocity, reference.acceleration)
    rows = len(reference.position)
    if not rows or any(part.shape != (rows, width) or not np.isfinite(part).all() for part in parts):
        raise PlantError(
            f"a {reference.space} motion takes finite position, velocity and acceleration ({width} entries a row each) "
            f"and at least one row, not the shapes {', '.join(str(part.shape) for part in parts)}."
        )
    if reference.period != controller.guard.period:
        raise PlantError(
            f"the reference's period is {reference.period} s and the controller's {controller.guard.period} s; "
            "make them equal."
        )


def sum_push_forces(pushes: Sequence[Push | SpacePush], time: Array, size: int = 2) -> Array:
    """Add up pushes over time.

    Args:
        pushes: The pushes.
        time: (T), s.
        size: Numbers of a push: 2 in the plane, 6 in space, of which a push may give the first 3 alone.

    Returns:
        (T, size), the force on the tip, N, and in space its moment, N m.

    Raises:
        PlantError: A push does not end after its begin, is not finite, or has another number of components.

    """
    total = np.zeros((len(time), size))
    possible = {2: (2,), 6: (3, 6)}[size]
    for push in pushes:
        if len(push.force) not in possible:
            many = " or ".join(map(str, possible))
            raise PlantError(f"a push on this arm's tip has {many} components, not {len(push.force)}: {push}.")
        if not (np.isfinite([push.start, push.end, *push.force]).all() and push.start < push.end):
            raise PlantError(f"a push lasts from a time to a later one with a finite force, not {push}.")
        total[(time >= push.start) & (time < push.end), : len(push.force)] += push.force
    return total


def _simulate_ticks(
    arm: Arm,
    controller: Controller,
    rows: Array,
    push: Array,
    felt: Array,
    wobble: Array,
    shaken: Array,
    q0: Array,
    scheme: SensorErrors,
    progress: Callable[[int, int], None] | None,
    world: EnvironmentForce | None,
) -> tuple[Array, Array, Array, Array, NDArray[np.int32]]:
    """Simulate tick by tick.

    Returned are the encoders' readings (T, 2n), the states, the torques sent, the currents that act (T, n) and the
    statuses; the force of ``world`` is added to ``push`` and ``felt``.
    """
    n, count, period, delay = arm.n, len(rows), controller.guard.period, scheme.delay
    steps = arm.count_steps(period)
    x, u, h = arm.rest(q0), np.zeros(arm.nu), np.array([period / steps])
    plant = arm.module.bind("step_exact", x, u, arm.c, h, x)
    shapes = next(f["outputs"] for f in arm.manifest["functions"] if f["name"] == "outputs")
    outputs, angles = {name: np.empty(length) for name, length in shapes}, np.empty(2 * n)
    outputs |= {"motor_position": angles[:n], "joint_position": angles[n:]}
    look = arm.module.bind("outputs", x, u, arm.c, *outputs.values())
    unit, stage = compute_torque_per_input(arm), InputStage(arm, np.zeros(n))
    tip, velocity = outputs["tip"], outputs["tip_velocity"]
    seen, state = np.empty((count, 2 * n)), np.empty((count, arm.nx))
    torque, shown, status = np.empty((count, n)), np.empty((count, n)), np.empty(count, np.int32)
    controller.restart()
    for k in range(count):
        look.run()
        seen[k] = scheme.count_angles(angles + wobble[k])
        state[k], shown[k] = x, stage.end
        if world is not None:
            touch = world(tip, velocity)
            push[k, : len(touch)] += touch
            felt[k, : len(touch)] += touch
        late = max(0, k - delay)
        now, before = seen[late], seen[max(0, late - 1)]
        controller.motor_position[:], controller.joint_position[:] = now[:n], now[n:]
        controller.motor_velocity[:] = (now[:n] - before[:n]) / period
        controller.motor_torque[:], controller.tip_force[:] = (shown[late] + shaken[late]) * unit, felt[late]
        controller.reference[:] = rows[k]
        # before 0 the arm was at rest and sampled too
        status[k] = controller.tick(k * period, stamp=(k - delay) * period)
        torque[k] = controller.torque
        u[:n], u[n:] = stage.step(torque[k] / unit, period), push[k]
        for _ in range(steps):
            plant.run()
        if progress is not None and k % 500 == 0:
            progress(k, count)
    return seen, state, torque, shown, status
