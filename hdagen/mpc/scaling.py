"""What a tick costs by its sizes: nodes of the horizon from 10 to 200, joints from 1 to 6; and the problem that only
the motors' torques limit.

Each size is a library of its own and a short closed loop, pushed hard. The cost of an iteration is that of the interior
point on the loop's problems: it factors and solves whatever is active, so that sizes compare.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from hdagen.mpc.comparison import CENTER, RADIUS, TURN, WALLS, default
from hdagen.mpc.configuration import Configuration
from hdagen.mpc.controller import MPC
from hdagen.mpc.trials import Trial, trial
from hdagen.plant import Arm, PlantError, load
from hdagen.reference import Reference, circle
from hdagen.simulation import Push, Sensors

NODES, JOINTS = (10, 20, 50, 100, 200), (1, 2, 3, 4, 5, 6)
SECONDS, SAMPLES = 0.6, 40
PUSHED = (Push(0.2, 0.4, (6.0, 3.0)),)
FAR = tuple(replace(wall, offset=10.0) for wall in WALLS)
LINEAR, CUBIC = 1.1, 3.0  # the largest exponents
DRIVE = (
    *("ratio", "motor_inertia", "torque_constant", "viscous_friction", "coulomb_friction", "torsional_damping"),
    *("flexspline_stiffness", "flexspline_stiffening", "wave_generator_stiffness", "wave_generator_stiffening"),
    "max_current",
)
BOX = 0.25  # N m at the motor: so low that many bounds are active


@dataclass(frozen=True)
class Size:
    """Medians, µs of thread time: the part before the measurement, an iteration of the interior point, a whole tick."""

    joints: int
    nodes: int
    before: float
    iteration: float
    tick: float


@dataclass(frozen=True)
class Scaling:
    """Sizes, and the exponents of what grows: of the iteration and of the part before, by nodes and by joints."""

    by_nodes: tuple[Size, ...]
    by_joints: tuple[Size, ...]
    exponents: Mapping[str, tuple[float, float]]


@dataclass(frozen=True)
class Box:
    """The problem with bounds on the torques alone: active bounds on average, µs of thread time: what is before the
    measurement, what is after it, their sum; the share of ticks that needed the interior point."""

    active: float
    before: float
    after: float
    both: float
    ninety_nine: float
    interior: float


def scaling(profile: str = "native", say: Callable[[str], None] = lambda _: None) -> Scaling:
    """Build and measure every size; builds are kept. Raises PlantError."""
    by_nodes = []
    for nodes in NODES:
        say(f"{nodes} nodes")
        c = default().changed(WALLS, mpc__nodes=nodes)
        by_nodes.append(_size(load("paper", profile, mpc=c), c))
    by_joints = []
    model = load("paper", profile, mpc=default()).robot
    c = default().changed(FAR, mpc__space="joint", limits__tip_speed=1.0)
    with tempfile.TemporaryDirectory() as folder:
        for joints in JOINTS:
            say(f"{joints} joints")
            path = Path(folder) / "robot.toml"
            path.write_text(chain(model, joints), encoding="utf-8")
            by_joints.append(_size(load(path, profile, mpc=c), c))
    exponents = {
        what: tuple(
            grown([getattr(s, by) for s in sizes], [getattr(s, what) for s in sizes])
            for by, sizes in (("nodes", by_nodes), ("joints", by_joints))
        )
        for what in ("iteration", "before")
    }
    return Scaling(tuple(by_nodes), tuple(by_joints), exponents)  # type: ignore[arg-type]


def grown(size: Sequence[float], cost: Sequence[float]) -> float:
    """The exponent p of cost = a size^p, by least squares of the logarithms."""
    return float(np.polyfit(np.log(size), np.log(cost), 1)[0])


def chain(robot: Mapping[str, Any], joints: int) -> str:
    """The robot.toml of an arm of so many joints, each the robot's last one, its links as heavy as what they bear."""
    last = robot["joints"][-1]
    lines = [f'name = "chain of {joints}"', "gravity = [0.0, 0.0]"]

    def stated(values: Mapping[str, Any], names: Sequence[str]) -> list[str]:
        found = {name: values[name] for name in names if values.get(name) is not None}
        numbers = {name: v["nominal"] if isinstance(v, Mapping) else v for name, v in found.items()}
        return [f"{name} = {value!r}" for name, value in numbers.items()]

    for _ in range(joints):
        lines += ["", "[[joint]]", *stated(last, ("length", "mass", "center_of_mass", "inertia"))]
        lines += ["[joint.drive]", *stated(last["drive"], DRIVE)]
        lines += ["[joint.limits]", *stated(last["limits"], ("position", "speed", "torque", "motor_torque_rate"))]
        lines += ["[joint.sensor]", *stated(last["sensor"], tuple(n for n in last["sensor"] if "encoder" in n))]
    return "\n".join(lines) + "\n"


def _path(arm: Arm, space: str, seconds: float, period: float) -> Reference:
    if space == "tip":
        return circle(RADIUS, CENTER, TURN, seconds, period)
    time = np.arange(round(seconds / period)) * period
    turn = 2 * np.pi / TURN
    swing = 0.1 / arm.n * np.ones(arm.n)
    way = [np.outer(wave, swing) for wave in (1 - np.cos(turn * time), turn * np.sin(turn * time))]
    return Reference("joint", period, 0.5 + way[0], way[1], np.outer(turn**2 * np.cos(turn * time), swing))


def _size(arm: Arm, c: Configuration) -> Size:
    from hdagen.mpc.timing import INTERIOR, Solver

    found = _loop(arm, c, SECONDS, PUSHED)
    solver, taken = Solver(arm), []
    chosen = np.linspace(50, len(found.problems) - 1, SAMPLES).astype(int)
    for k in np.repeat(chosen, 3):
        solver.solve(found.problems[k][0], INTERIOR)
        taken.append(solver.taken / 1e3 / max(1.0, solver.solution[-2]))
    times = 1e6 * np.median(found.times[50:], axis=0)
    return Size(arm.n, len(c.grid), float(times[0]), float(np.median(taken)), float(times.sum()))


def _loop(arm: Arm, c: Configuration, seconds: float, pushes: Sequence[Push]) -> Trial:
    path = _path(arm, str(c["mpc.space"]), seconds, float(c["mpc.period"]))
    found = trial(arm, MPC(arm, c), path, pushes, Sensors(), (), seed=1, keep=True)
    if (found.simulation.status < 0).any():
        raise PlantError(f"the loop of {arm.n} joints and {len(c.grid)} nodes was refused; its times say nothing.")
    return found


def box(profile: str = "native", seconds: float = 4.0) -> Box:
    """A closed loop that only the motors' torques limit, the same solver. Raises PlantError."""
    free = dict.fromkeys(("motor_speed", "joint_torque", "joint_high", "torque_rate"), 1e6)
    limits = {f"limits__{name}": value for name, value in free.items()}
    c = default().changed(FAR, **limits, limits__joint_low=-1e6, limits__tip_speed=100.0, limits__motor_torque=BOX)
    arm = load("paper", profile, mpc=c)
    pushes = [
        Push(t, t + 0.25, (25.0, 10.0) if k % 2 else (-25.0, 15.0)) for k, t in enumerate(np.arange(0.5, seconds, 0.5))
    ]
    found = _loop(arm, c, seconds, pushes)
    times = 1e6 * found.times[50:]
    active = float(np.mean([sum(r.active.values()) for r in found.reports[50:]]))
    inside = float(np.mean([r.interior > 0 for r in found.reports[50:]]))
    before, after = np.median(times, axis=0)
    both = times.sum(1)
    return Box(active, float(before), float(after), float(np.median(both)), float(np.quantile(both, 0.99)), inside)


def lines(found: Scaling, boxed: Box) -> list[str]:
    """What to print."""
    out = [
        "sizes, µs of thread time: joints, nodes, before the measurement, an iteration of the interior point, a tick"
    ]
    for s in (*found.by_nodes, *found.by_joints):
        out.append(f"  {s.joints:2} {s.nodes:4} {s.before:9.1f} {s.iteration:9.1f} {s.tick:9.1f}")
    for what, (nodes, joints) in found.exponents.items():
        out.append(f"  {what}: grows with nodes to the power {nodes:.2f}, with joints to the power {joints:.2f}")
    out.append(
        f"torques limited alone ({boxed.active:.1f} active): {boxed.before:.1f} before the measurement, "
        f"{boxed.after:.1f} after it, {boxed.both:.1f} in all, 99 %: {boxed.ninety_nine:.1f}; "
        f"interior point in {boxed.interior:.0%}"
    )
    return out
