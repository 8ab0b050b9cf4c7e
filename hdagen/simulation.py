"""A controller against the compiled arm, with its sensors: what a log of the machine would hold, and the truth beside
it.

The arm has set-valued friction; the controller sees encoders with their noise and resolution, a force sensor with
noise, and everything late by the delay. Row k of the log holds what was sampled at t_k and the command that was held
from t_k to the next row.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdagen.control import Controller
from hdagen.input_stage import InputStage
from hdagen.log import Log
from hdagen.plant import Arm, Array, PlantError
from hdagen.reference import Reference, fitting, posture
from hdagen.torques import torque_per_input

World = Callable[[Array, Array], Array]  # tip position and velocity (2 each) -> force on the tip (2), N


@dataclass(frozen=True)
class Push:
    """A force of the world on the tip, N in the base frame, from start to end, s."""

    start: float
    end: float
    force: tuple[float, float]


@dataclass(frozen=True)
class Sensors:
    """What sensors do to the truth; None: from the robot file. ``delay``: ticks from a sample to its use."""

    motor_resolution: tuple[float, ...] | None = None  # rad
    joint_resolution: tuple[float, ...] | None = None  # rad
    current_noise: tuple[float, ...] | None = None  # A, standard deviation
    force_noise: float | None = None  # N, standard deviation
    delay: int = 0
    motor_noise: tuple[float, ...] | None = None  # rad, standard deviation, before counting
    joint_noise: tuple[float, ...] | None = None  # rad

    @classmethod
    def exact(cls, n: int) -> Sensors:
        """Sensors without error, for n joints."""
        none = (0.0,) * n
        return cls(none, none, none, 0.0, 0, none, none)


@dataclass(frozen=True)
class Simulation:
    """The log, and the truth at the same rows: state (T, nx), tip (T, 2), joint_torque (T, n), torque (T, n, sent to
    the motors), push (T, 2), and the controller's status of each tick."""

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
    pushes: Sequence[Push] = (),
    sensors: Sensors | None = None,
    seed: int = 0,
    start: ArrayLike | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Log:
    """The log of ``controller`` driving ``arm`` along ``reference``; see `run` for the truth beside it."""
    return run(arm, controller, reference, pushes, sensors, seed, start, progress).log


def run(
    arm: Arm,
    controller: Controller,
    reference: Reference,
    pushes: Sequence[Push] = (),
    sensors: Sensors | None = None,
    seed: int = 0,
    start: ArrayLike | None = None,
    progress: Callable[[int, int], None] | None = None,
    world: World | None = None,
) -> Simulation:
    """Simulate. ``world`` gives a force on the tip at its position and velocity, held over a tick and felt by the force
    sensor. ``arm`` is the plant and may have other parameters than the controller's arm. ``start``: joint
    positions near which the motion begins (default: a bent arm); the arm begins at rest there, and the controller
    anew. The same seed gives the same log, to the bit.

    Raises PlantError where the reference is out of reach, or the period is not the controller's.
    """
    _fitting_sizes(arm, controller, reference)
    if reference.period != controller.guard.period:
        raise PlantError(
            f"the reference's period is {reference.period} s and the controller's {controller.guard.period} s; "
            "make them equal."
        )
    near = np.full(arm.n, 0.6) if start is None else np.asarray(start, float)
    q0 = posture(arm, reference.position[0], near) if reference.space == "tip" else reference.position[0]
    wanted = fitting(controller, reference, q0)
    rows, count = controller.rows(wanted), len(reference.position)
    push = forces(pushes, reference.time)
    scheme = errors(arm, sensors or Sensors())
    if not isinstance(seed, int) or seed < 0:
        raise PlantError(f"the seed is a whole number from 0, not {seed}.")
    random = np.random.default_rng(seed)
    noise = random.normal(size=(count, 2)) * scheme.force_noise
    felt = push + noise
    shaken = random.normal(size=(count, arm.n)) * np.asarray(scheme.current_noise)
    wobble = scheme.encoder_noise(count, seed)
    seen, state, torque, shown, status = _loop(
        arm, controller, rows, push, felt, wobble, shaken, q0, scheme, progress, world
    )
    commanded = torque / torque_per_input(arm)
    truth = arm.outputs(state, np.hstack([shown, push]))
    measured = shown + shaken
    columns: dict[str, Array] = {}
    for j in range(arm.n):
        kind = arm.input_names[j].rpartition("_")[0]
        columns[f"{kind}_command_{j + 1}"], columns[f"{kind}_{j + 1}"] = commanded[:, j], measured[:, j]
        columns[f"motor_position_{j + 1}"], columns[f"joint_position_{j + 1}"] = seen[:, j], seen[:, arm.n + j]
        if wanted.space == "joint":
            columns[f"joint_position_reference_{j + 1}"] = wanted.position[:, j]
    columns["tip_force_x"], columns["tip_force_y"] = felt.T
    columns = {name: np.ascontiguousarray(values) for name, values in columns.items()}
    log = Log(reference.time, columns, arm.n, f"simulated: {arm.robot['name']}, {controller.law}, seed {seed}")
    beyond = int(np.any(truth["beyond_law"] > 0, axis=1).sum())
    return Simulation(log, state, truth["tip"], truth["joint_torque"], torque, push, status, beyond)


@dataclass(frozen=True)
class Errors:
    """Every sensor's errors; ``delay`` in ticks."""

    resolution: Array  # of θ then q
    noise: Array  # of θ then q
    current_noise: Array
    force_noise: float
    delay: int

    def encoder_noise(self, rows: int, seed: int) -> Array:
        """What is added to θ then q before they are counted (T, 2n). Its numbers are its own: the same seed gives the
        same noise of current and force with and without it."""
        if not self.noise.any():
            return np.zeros((rows, len(self.noise)))
        return np.random.default_rng([seed, 1]).normal(size=(rows, len(self.noise))) * self.noise

    def read(self, angles: Array) -> Array:
        """Angles (..., 2n), noise on them, as the encoders count them."""
        counted: Array = np.rint(angles / self._step) * self._step
        return counted if self._all_count else np.where(self._counts, counted, angles)

    @cached_property
    def _counts(self) -> NDArray[np.bool_]:
        return self.resolution > 0

    @cached_property
    def _all_count(self) -> bool:
        return bool(self._counts.all())

    @cached_property
    def _step(self) -> Array:
        return np.where(self._counts, self.resolution, 1.0)


def errors(arm: Arm, sensors: Sensors) -> Errors:
    """What ``sensors`` do, each number taken from the robot file where it is not given. Raises PlantError."""
    joints = arm.robot["joints"]
    chosen = []
    for given, key in (
        (sensors.motor_resolution, "motor_encoder_resolution"),
        (sensors.joint_resolution, "joint_encoder_resolution"),
        (sensors.motor_noise, "motor_encoder_noise"),
        (sensors.joint_noise, "joint_encoder_noise"),
        (sensors.current_noise, "current_noise"),
    ):
        values = np.array([joint["sensor"][key] for joint in joints] if given is None else given, float)
        if values.shape != (arm.n,) or not (np.isfinite(values).all() and (values >= 0).all()):
            raise PlantError(f"{key} takes {arm.n} values, finite and not negative.")
        chosen.append(values)
    if not isinstance(sensors.delay, int) or sensors.delay < 0:
        raise PlantError(f"delay is a whole number of ticks from 0, not {sensors.delay}.")
    force_noise = arm.robot["force_noise"] if sensors.force_noise is None else sensors.force_noise
    if not 0 <= force_noise < np.inf:
        raise PlantError(f"force_noise must be finite and not negative, N, not {force_noise}.")
    angles = np.concatenate(chosen[:2]), np.concatenate(chosen[2:4])
    return Errors(*angles, chosen[4], float(force_noise), int(sensors.delay))


def _fitting_sizes(arm: Arm, controller: Controller, reference: Reference) -> None:
    if arm.n != controller.arm.n:
        raise PlantError(f"the controller is of an arm with {controller.arm.n} joints and the plant has {arm.n}.")
    width = 2 if reference.space == "tip" else arm.n
    parts = (reference.position, reference.velocity, reference.acceleration)
    rows = len(reference.position)
    if not rows or any(part.shape != (rows, width) or not np.isfinite(part).all() for part in parts):
        raise PlantError(
            f"a {reference.space} motion takes finite position, velocity and acceleration ({width} entries a row each) "
            f"and at least one row, not the shapes {', '.join(str(part.shape) for part in parts)}."
        )


def forces(pushes: Sequence[Push], time: Array) -> Array:
    """The pushes together at each time (T, 2), N. Raises PlantError."""
    total = np.zeros((len(time), 2))
    for push in pushes:
        if not (np.isfinite([push.start, push.end, *push.force]).all() and push.start < push.end):
            raise PlantError(f"a push lasts from a time to a later one with a finite force, not {push}.")
        total[(time >= push.start) & (time < push.end)] += push.force
    return total


def _loop(
    arm: Arm,
    controller: Controller,
    rows: Array,
    push: Array,
    felt: Array,
    wobble: Array,
    shaken: Array,
    q0: Array,
    scheme: Errors,
    progress: Callable[[int, int], None] | None,
    world: World | None,
) -> tuple[Array, Array, Array, Array, NDArray[np.int32]]:
    """Tick by tick: what the encoders said (T, 2n), the states, the torques sent, what a current sensor reads of them
    (T, n), the statuses. What the world adds stands in ``push`` and ``felt`` afterwards."""
    n, count, period, delay = arm.n, len(rows), controller.guard.period, scheme.delay
    steps = arm.steps_in(period)
    x, u, h = arm.rest(q0), np.zeros(arm.nu), np.array([period / steps])
    plant = arm.module.bind("step_exact", x, u, arm.c, h, x)
    shapes = next(f["outputs"] for f in arm.manifest["functions"] if f["name"] == "outputs")
    outputs, angles = {name: np.empty(length) for name, length in shapes}, np.empty(2 * n)
    outputs |= {"motor_position": angles[:n], "joint_position": angles[n:]}
    look = arm.module.bind("outputs", x, u, arm.c, *outputs.values())
    unit, stage = torque_per_input(arm), InputStage(arm, np.zeros(n))
    tip, velocity = outputs["tip"], outputs["tip_velocity"]
    seen, state = np.empty((count, 2 * n)), np.empty((count, arm.nx))
    torque, shown, status = np.empty((count, n)), np.empty((count, n)), np.empty(count, np.int32)
    controller.restart()
    for k in range(count):
        look.run()
        seen[k] = scheme.read(angles + wobble[k])
        state[k], shown[k] = x, stage.end
        if world is not None:
            touch = world(tip, velocity)
            push[k] += touch
            felt[k] += touch
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


def ideal(
    arm: Arm, controller: Controller, push: Array, period: float, gains: Mapping[str, float] | None = None
) -> Array:
    """How far M ẍ + B ẋ + K x = F moves the tip (T, 2, m) under ``push`` (T, 2, N): what a Cartesian law is to do.
    ``gains``: another admittance than the controller's."""
    from scipy.linalg import expm

    names = controller.gains if gains is None else gains
    if "mass_x" not in names:
        raise PlantError(f"{controller.law} has no Cartesian mass, damping and stiffness.")
    moved = np.zeros_like(push)
    for axis, name in enumerate("xy"):
        M, B, K = (names[f"{what}_{name}"] for what in ("mass", "damping", "stiffness"))
        E = expm(np.array([[0, 1, 0], [-K / M, -B / M, 1 / M], [0, 0, 0]]) * period)
        z = np.zeros(2)
        for k in range(len(push)):
            moved[k, axis] = z[0]
            z = E[:2, :2] @ z + E[:2, 2] * push[k, axis]
    return moved
