"""Closed loops of any controller against the compiled arm, with walls in the world: the broken limits, the distance of
the tip from the ideal admittance motion, and its contact force.

The ideal motion is M ẍ + B ẋ + K x = F about the commanded path, driven by the true force of the world on the tip,
walls included. A wall pushes with its stiffness times the depth, and damps motion into it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.control.guarded_controller import Controller
from hdagen.control.reference_motion import Reference
from hdagen.mpc.compiled_settings import find_torque_limits
from hdagen.mpc.configuration import Configuration, list_admittance_gains, resolve_limits
from hdagen.mpc.predictive_controller import MPC, TickReport
from hdagen.mpc.wall import Wall
from hdagen.simulation.ideal_admittance import simulate_ideal_admittance
from hdagen.simulation.simulated_sensors import Sensors
from hdagen.simulation.simulator import Push, Simulation, SpacePush, run

WALL_DAMPING_SECONDS = 0.02  # s: damping of a wall per stiffness


@dataclass(frozen=True)
class Trial:
    """A run: the simulation, the force of the walls (T, 2, in space 6, N), reports of a predictive controller, and the
    time of its ticks (T, 2, s of thread time: preparation, tick)."""

    simulation: Simulation
    wall_force: Array
    reports: tuple[TickReport, ...]
    times: Array
    problems: tuple[tuple[Array, Array], ...] = ()


@dataclass(frozen=True)
class TrialOutcome:
    """A run in numbers. ``violated``: largest excess of each limit by its family's name, SI, 0 where it held."""

    distance: float  # median distance of the tip from the ideal motion, m
    largest: float  # m
    free_distance: float  # median of it over ticks in which no limit was near, m
    contact: float  # largest contact force, N
    released: float  # root mean square distance from the path after the last push, m
    refused: int  # ticks
    violated: dict[str, float] = field(default_factory=dict)


@dataclass
class WallWorld:
    """Walls that push: the force on the tip at every tick."""

    walls: Sequence[Wall]
    forces: list[Array] = field(default_factory=list)

    def __call__(self, tip: Array, velocity: Array) -> Array:
        """Force of the walls on the tip, N (2, or 3 in space)."""
        total = np.zeros(len(tip))
        for wall in self.walls:
            normal = np.array(wall.normal)
            depth = float(normal @ tip) - wall.offset
            if wall.stiffness is not None and depth > 0:
                into = float(normal @ velocity[: len(tip)])
                push = wall.stiffness * (depth + WALL_DAMPING_SECONDS * max(into, 0.0))
                total -= push * normal
        self.forces.append(total)
        return total


@dataclass
class TickRecorder:
    """Runs a predictive controller's tick in parts: preparation, tick, report."""

    controller: MPC
    keeps_problems: bool
    reports: list[TickReport] = field(default_factory=list)
    times: list[tuple[float, float]] = field(default_factory=list)
    problems: list[tuple[Array, Array]] = field(default_factory=list)

    def run(self) -> None:
        """Run one tick and time it."""
        from time import thread_time

        begun = thread_time()
        self.controller.prepare()
        ready = thread_time()
        self.controller.step()
        self.times.append((ready - begun, thread_time() - ready))
        self.reports.append(self.controller.report())
        if self.keeps_problems:
            self.problems.append(self.controller.quadratic_problem())


def run_trial(
    arm: Arm,
    controller: Controller,
    path: Reference,
    pushes: Sequence[Push | SpacePush] = (),
    sensors: Sensors | None = None,
    walls: Sequence[Wall] = (),
    seed: int = 0,
    start: Array | None = None,
    keep: bool = False,
) -> Trial:
    """Run a controller on an arm along a path.

    Args:
        arm: The plant, which may differ from the controller's arm.
        controller: The controller.
        path: The path to follow.
        pushes: Forces on the tip.
        sensors: The sensors; None: the robot file's.
        walls: Walls of the world; those without a stiffness push nothing.
        seed: Seed of the sensors' noise.
        start: Positions of the joints at the start, (n); None: on the path.
        keep: Whether the problems of a predictive controller are kept.

    Returns:
        The run.

    Raises:
        PlantError: The path, a push or the sensors are not possible.

    """
    world, pressed = None, [wall for wall in walls if wall.stiffness is not None]
    if pressed:
        world = WallWorld(pressed)
    if not isinstance(controller, MPC):
        done = run(arm, controller, path, pushes, sensors, seed, start, world=world)
        return Trial(done, _wall_forces(world, done), (), np.empty((0, 2)))
    recorder = TickRecorder(controller, keep)
    controller.wrap_tick(recorder.run)
    try:
        done = run(arm, controller, path, pushes, sensors, seed, start, world=world)
    finally:
        controller.wrap_tick(None)
    reports, times = tuple(recorder.reports), np.array(recorder.times)
    return Trial(done, _wall_forces(world, done), reports, times, tuple(recorder.problems))


def _wall_forces(world: WallWorld | None, done: Simulation) -> Array:
    """Force of the walls at every row."""
    if world is None:
        return np.zeros_like(done.push)
    forces = np.array(world.forces[: len(done.push)])
    return np.pad(forces, ((0, 0), (0, done.push.shape[1] - forces.shape[1])))


def evaluate_trial(arm: Arm, c: Configuration, path: Reference, found: Trial, controller: Controller) -> TrialOutcome:
    """Evaluate a run against the limits and the admittance of a configuration.

    Args:
        arm: The controlled arm.
        c: The configuration.
        path: The commanded path of the tip.
        found: The run.
        controller: The controller of the run.

    Returns:
        The numbers of the run.

    """
    s = found.simulation
    gains = list_admittance_gains(arm.robot, c)
    goal = path.position + simulate_ideal_admittance(controller, s.push, path.period, gains)
    distance = np.linalg.norm(s.tip - goal[:, : s.tip.shape[1]], axis=1)
    broken, near = measure_violations(arm, c, s)
    free = distance[~near]
    free_distance, start = 0.0, 0
    if len(free):
        free_distance = float(np.median(free))
    pushed = np.flatnonzero(np.abs(s.push - found.wall_force).sum(1) > 1e-9)
    if len(pushed):
        start = min(len(distance) - 1, pushed[-1] + 500)
    return TrialOutcome(
        distance=float(np.median(distance)),
        largest=float(distance.max()),
        free_distance=free_distance,
        contact=float(np.linalg.norm(found.wall_force, axis=1).max(initial=0.0)),
        released=float(np.sqrt(np.mean(np.sum((s.tip - path.position[:, : s.tip.shape[1]])[start:] ** 2, 1)))),
        refused=int((s.status < 0).sum()),
        violated=broken,
    )


def _motor_velocity(arm: Arm, s: Simulation) -> Array:
    """Motor velocities (T, n) rad/s; of a rigid drive, whose motor has no state, from its joint."""
    columns = []
    for j in range(1, arm.n + 1):
        if f"motor_velocity_{j}" in arm.state_names:
            columns.append(s.state[:, arm.index(f"motor_velocity_{j}")])
        else:
            columns.append(s.state[:, arm.index(f"joint_velocity_{j}")] * arm.parameters[f"ratio_{j}"])
    return np.stack(columns, 1)


def measure_violations(arm: Arm, c: Configuration, s: Simulation) -> tuple[dict[str, float], Any]:
    """How far each family of limits was broken, SI, and the ticks in which any was within 5 % of its bound."""
    limits, period = resolve_limits(arm.robot, c), float(c["mpc.period"])
    q = s.state[:, [arm.index(f"joint_position_{j}") for j in range(1, arm.n + 1)]]
    low, high = np.array(limits["joint_low"]), np.array(limits["joint_high"])
    speed = np.linalg.norm(np.gradient(s.tip, period, axis=0), axis=1)
    most = np.array(find_torque_limits(arm, c) or [np.inf] * arm.n)
    shares = {
        "joint_position": (np.maximum(q - high, low - q).max(1), 0.05),
        "motor_speed": (
            (np.abs(_motor_velocity(arm, s)) - np.array(limits["motor_speed"])).max(1),
            0.05 * max(limits["motor_speed"]),
        ),
        "joint_torque": (
            (np.abs(s.joint_torque) - np.array(limits["joint_torque"])).max(1),
            0.05 * max(limits["joint_torque"]),
        ),
        "tip_speed": (speed - c["limits.tip_speed"], 0.1 * c["limits.tip_speed"]),
    }
    for k, wall in enumerate(c.walls, 1):
        shares[f"wall_{k}"] = (s.tip @ np.array(wall.normal) - wall.offset - wall.give, 2e-3)
    near = np.any([over > -band for over, band in shares.values()], axis=0)
    near |= np.any(np.abs(s.torque) > 0.98 * most, axis=1)
    return {name: max(0.0, float(over.max())) for name, (over, _) in shares.items()}, near
