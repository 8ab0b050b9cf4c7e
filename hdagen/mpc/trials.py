"""Closed loops of any controller against the compiled arm, with walls in the world: what limits were broken, how far
the
tip was from the ideal admittance motion, what it pressed.

The ideal motion is M ẍ + B ẋ + K x = F about the commanded path, driven by the true force of the world on the tip,
walls
included. A wall pushes with its stiffness times the depth, and damps what enters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hdagen.control import Controller
from hdagen.mpc.configuration import Configuration, Wall
from hdagen.mpc.controller import MPC, Report
from hdagen.plant import Arm, Array
from hdagen.reference import Reference
from hdagen.simulation import Push, Sensors, Simulation, ideal, run

DAMPING = 0.02  # s: damping of a wall per stiffness


@dataclass(frozen=True)
class Trial:
    """A run: the simulation, the force of the walls (T, 2, N), reports of a predictive controller, and the time of its
    ticks (T, 2, s of thread time: preparation, tick)."""

    simulation: Simulation
    wall_force: Array
    reports: tuple[Report, ...]
    times: Array
    problems: tuple[tuple[Array, Array], ...] = ()


@dataclass(frozen=True)
class Outcome:
    """A run in numbers. ``violated``: largest excess of each limit by its family's name, SI, 0 where it held."""

    distance: float  # median distance of the tip from the ideal motion, m
    largest: float  # m
    free_distance: float  # median of it over ticks in which no limit was near, m
    contact: float  # largest contact force, N
    released: float  # root mean square distance from the path after the last push, m
    refused: int  # ticks
    violated: dict[str, float] = field(default_factory=dict)


@dataclass
class World:
    """Walls that push: the force on the tip at every tick."""

    walls: Sequence[Wall]
    forces: list[Array] = field(default_factory=list)

    def __call__(self, tip: Array, velocity: Array) -> Array:
        """Force of the walls on the tip, N (2)."""
        total = np.zeros(2)
        for wall in self.walls:
            normal = np.array(wall.normal)
            depth = float(normal @ tip) - wall.offset
            if wall.stiffness is not None and depth > 0:
                push = wall.stiffness * (depth + DAMPING * max(float(normal @ velocity), 0.0))
                total -= push * normal
        self.forces.append(total)
        return total


@dataclass
class Recorder:
    """Runs a predictive controller's tick in parts: preparation, tick, report."""

    controller: MPC
    keep: bool
    reports: list[Report] = field(default_factory=list)
    times: list[tuple[float, float]] = field(default_factory=list)
    problems: list[tuple[Array, Array]] = field(default_factory=list)

    def run(self) -> None:
        """One tick, timed."""
        from time import thread_time

        begun = thread_time()
        self.controller.prepare()
        ready = thread_time()
        self.controller.step()
        self.times.append((ready - begun, thread_time() - ready))
        self.reports.append(self.controller.report())
        if self.keep:
            self.problems.append(self.controller.problem())


def trial(
    arm: Arm,
    controller: Controller,
    path: Reference,
    pushes: Sequence[Push] = (),
    sensors: Sensors | None = None,
    walls: Sequence[Wall] = (),
    seed: int = 0,
    start: Array | None = None,
    keep: bool = False,
) -> Trial:
    """Run ``controller`` on ``arm`` (the plant, which may differ from the controller's) along ``path``. ``keep``: the
    problems of a predictive controller too. Raises PlantError."""
    world = World([wall for wall in walls if wall.stiffness is not None])
    recorder = Recorder(controller, keep) if isinstance(controller, MPC) else None
    if isinstance(controller, MPC) and recorder is not None:
        controller.through(recorder.run)
    try:
        done = run(arm, controller, path, pushes, sensors, seed, start, world=world if world.walls else None)
    finally:
        if isinstance(controller, MPC):
            controller.through(None)
    forces = np.array(world.forces[: len(path.position)]) if world.walls else np.zeros_like(done.push)
    if recorder is None:
        return Trial(done, forces, (), np.empty((0, 2)))
    return Trial(done, forces, tuple(recorder.reports), np.array(recorder.times), tuple(recorder.problems))


def outcome(arm: Arm, c: Configuration, path: Reference, found: Trial, controller: Controller) -> Outcome:
    """The numbers of a run, against the limits and the admittance of ``c``."""
    s = found.simulation
    goal = path.position + ideal(arm, controller, s.push, path.period, gains_of(c))
    distance = np.linalg.norm(s.tip - goal, axis=1)
    broken, near = excess(arm, c, s)
    free = ~near
    last = np.flatnonzero(np.abs(s.push - found.wall_force).sum(1) > 1e-9)
    tail = slice(min(len(distance) - 1, last[-1] + 500) if len(last) else 0, None)
    return Outcome(
        float(np.median(distance)), float(distance.max()), float(np.median(distance[free])) if free.any() else 0.0,
        float(np.linalg.norm(found.wall_force, axis=1).max(initial=0.0)),
        float(np.sqrt(np.mean(np.sum((s.tip - path.position)[tail] ** 2, 1)))), int((s.status < 0).sum()), broken,
    )  # fmt: skip


def gains_of(c: Configuration) -> dict[str, float]:
    """The admittance as a Cartesian law names it."""
    out = dict[str, float]()
    for name in ("mass", "damping", "stiffness"):
        value = c[f"admittance.{name}"]
        values = value if isinstance(value, tuple) else (value, value)
        out |= {f"{name}_{axis}": float(v) for axis, v in zip("xy", values, strict=False)}
    return out


def excess(arm: Arm, c: Configuration, s: Simulation) -> tuple[dict[str, float], Any]:
    """How far each family of limits was broken, SI, and the ticks in which any was within 5 % of its bound."""
    from hdagen.mpc.fitting import limits_of
    from hdagen.mpc.layout import torque_limits

    limits, period = limits_of(arm.robot, c), float(c["mpc.period"])
    names = list(arm.state_names)

    def column(name: str) -> Array:
        rigid = [arm.parameters[f"ratio_{j}"] if f"motor_{name}_{j}" not in names else 1.0 for j in range(1, arm.n + 1)]
        found = [
            f"motor_{name}_{j}" if f"motor_{name}_{j}" in names else f"joint_{name}_{j}" for j in range(1, arm.n + 1)
        ]
        return s.state[:, [names.index(f) for f in found]] * np.array(rigid)

    q = s.state[:, [names.index(f"joint_position_{j}") for j in range(1, arm.n + 1)]]
    low, high = np.array(limits["joint_low"]), np.array(limits["joint_high"])
    speed = np.linalg.norm(np.gradient(s.tip, period, axis=0), axis=1)
    guard = torque_limits(arm, c)
    most = np.array(guard if guard is not None else [np.inf] * arm.n)
    shares = {
        "joint_position": (np.maximum(q - high, low - q).max(1), 0.05),
        "motor_speed": (
            (np.abs(column("velocity")) - np.array(limits["motor_speed"])).max(1),
            0.05 * max(limits["motor_speed"]),
        ),
        "joint_torque": (
            (np.abs(s.joint_torque) - np.array(limits["joint_torque"])).max(1),
            0.05 * max(limits["joint_torque"]),
        ),
        "tip_speed": (speed - c["limits.tip_speed"], 0.1 * c["limits.tip_speed"]),
    }
    for k, wall in enumerate(c.walls, 1):
        give = 0.0 if wall.stiffness is None or wall.force is None else wall.force / wall.stiffness
        shares[f"wall_{k}"] = (s.tip @ np.array(wall.normal) - wall.offset - give, 2e-3)
    near = np.any([over > -band for over, band in shares.values()], axis=0)
    near |= np.any(np.abs(s.torque) > 0.98 * most, axis=1)
    return {name: max(0.0, float(over.max())) for name, (over, _) in shares.items()}, near
