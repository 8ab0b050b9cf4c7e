"""The cost of a tick by its sizes: nodes of the horizon from 10 to 200, joints from 1 to 6; and the problem that only
the motors' torques limit.

Each size is a library of its own and a short closed loop, pushed hard. The cost of an iteration is that of the interior
point on the loop's problems, which does the same work whatever rows are active, so that sizes compare.
"""

from __future__ import annotations

import itertools
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm, load
from hdagen.control.reference_motion import Reference, circle
from hdagen.mpc.benchmark.law_comparison import (
    CIRCLE_CENTER,
    CIRCLE_RADIUS,
    COURSE_WALLS,
    SECONDS_PER_TURN,
    make_table_configuration,
)
from hdagen.mpc.closed_loop_trial import Trial, run_trial
from hdagen.mpc.configuration import Configuration
from hdagen.mpc.predictive_controller import MPC
from hdagen.simulation.simulated_sensors import Sensors
from hdagen.simulation.simulator import Push

NODE_COUNTS, JOINT_COUNTS = (10, 20, 50, 100, 200), (1, 2, 3, 4, 5, 6)
SCALING_SECONDS, SCALING_SAMPLES = 0.6, 40
SCALING_PUSHES = (Push(0.2, 0.4, (6.0, 3.0)),)
FAR_WALLS = tuple(replace(wall, offset=10.0) for wall in COURSE_WALLS)
MOST_NODE_EXPONENT, MOST_JOINT_EXPONENT = 1.1, 3.0  # the largest exponents
DRIVE_KEYS = (
    *("ratio", "motor_inertia", "torque_constant", "viscous_friction", "coulomb_friction", "torsional_damping"),
    *("flexspline_stiffness", "flexspline_stiffening", "wave_generator_stiffness", "wave_generator_stiffening"),
    "max_current",
)
BOX_TORQUE = 0.25  # N m at the motor: so low that many bounds are active


@dataclass(frozen=True)
class SizeTiming:
    """Medians, µs of thread time: the part before the measurement, an iteration of the interior point, a whole tick."""

    joints: int
    nodes: int
    before: float
    iteration: float
    tick: float


@dataclass(frozen=True)
class Scaling:
    """Sizes, and the exponents of what grows: of the iteration and of the part before, by nodes and by joints."""

    by_nodes: tuple[SizeTiming, ...]
    by_joints: tuple[SizeTiming, ...]
    exponents: Mapping[str, tuple[float, float]]


@dataclass(frozen=True)
class BoxTiming:
    """The problem with bounds on the torques alone: active bounds on average; µs of thread time before the measurement,
    after it, and in all; the share of ticks that needed the interior point."""

    active: float
    before: float
    after: float
    both: float
    ninety_nine: float
    interior: float


def measure_scaling(profile: str = "native", say: Callable[[str], None] = lambda _: None) -> Scaling:
    """Build and measure every size; builds are kept.

    Args:
        profile: Profile of the builds.
        say: Hears the name of each size as it begins.

    Returns:
        Times by size, and the exponents of their growth.

    Raises:
        PlantError: A build fails, or a closed loop is refused.

    """
    by_nodes = []
    for nodes in NODE_COUNTS:
        say(f"{nodes} nodes")
        c = make_table_configuration().with_changes(COURSE_WALLS, mpc__nodes=nodes)
        by_nodes.append(_time_size(load("paper", profile, mpc=c), c))
    by_joints = []
    model = load("paper", profile, mpc=make_table_configuration()).robot
    c = make_table_configuration().with_changes(FAR_WALLS, mpc__space="joint", limits__tip_speed=1.0)
    with tempfile.TemporaryDirectory() as folder:
        for joints in JOINT_COUNTS:
            say(f"{joints} joints")
            path = Path(folder) / "robot.toml"
            path.write_text(format_chain_robot(model, joints), encoding="utf-8")
            by_joints.append(_time_size(load(path, profile, mpc=c), c))
    node_counts, joint_counts = [s.nodes for s in by_nodes], [s.joints for s in by_joints]
    exponents = {}
    for what in ("iteration", "before"):
        of_nodes = fit_exponent(node_counts, [getattr(size, what) for size in by_nodes])
        of_joints = fit_exponent(joint_counts, [getattr(size, what) for size in by_joints])
        exponents[what] = (of_nodes, of_joints)
    return Scaling(tuple(by_nodes), tuple(by_joints), exponents)


def fit_exponent(size: Sequence[float], cost: Sequence[float]) -> float:
    """Fit the exponent p of cost = a size^p, by least squares of the logarithms.

    Args:
        size: Sizes.
        cost: Cost of each size.

    Returns:
        The exponent.

    """
    return float(np.polyfit(np.log(size), np.log(cost), 1)[0])


def format_chain_robot(robot: Mapping[str, Any], joints: int) -> str:
    """Write the robot.toml of a chain of equal joints.

    Args:
        robot: Description of a robot, whose last joint is repeated.
        joints: Count of joints.

    Returns:
        TOML text.

    """
    last = robot["joints"][-1]
    lines = [f'name = "chain of {joints}"', "gravity = [0.0, 0.0]"]

    def stated(values: Mapping[str, Any], names: Sequence[str]) -> list[str]:
        found = []
        for name in names:
            value = values.get(name)
            if isinstance(value, Mapping):
                value = value["nominal"]
            if value is not None:
                found.append(f"{name} = {value!r}")
        return found

    for _ in range(joints):
        lines += ["", "[[joint]]", *stated(last, ("length", "mass", "center_of_mass", "inertia"))]
        lines += ["[joint.drive]", *stated(last["drive"], DRIVE_KEYS)]
        lines += ["[joint.limits]", *stated(last["limits"], ("position", "speed", "torque", "motor_torque_rate"))]
        lines += ["[joint.sensor]", *stated(last["sensor"], tuple(n for n in last["sensor"] if "encoder" in n))]
    return "\n".join(lines) + "\n"


def _make_path(arm: Arm, space: str, seconds: float, period: float) -> Reference:
    if space == "tip":
        return circle(CIRCLE_RADIUS, CIRCLE_CENTER, SECONDS_PER_TURN, seconds, period)
    time = np.arange(round(seconds / period)) * period
    turn = 2 * np.pi / SECONDS_PER_TURN
    swing = 0.1 / arm.n * np.ones(arm.n)
    way = [np.outer(wave, swing) for wave in (1 - np.cos(turn * time), turn * np.sin(turn * time))]
    return Reference("joint", period, 0.5 + way[0], way[1], np.outer(turn**2 * np.cos(turn * time), swing))


def _time_size(arm: Arm, c: Configuration) -> SizeTiming:
    from hdagen.mpc.benchmark.solver_timing import INTERIOR, Solver

    found = _run_loop(arm, c, SCALING_SECONDS, SCALING_PUSHES)
    solver, taken = Solver(arm), []
    chosen = np.linspace(50, len(found.problems) - 1, SCALING_SAMPLES).astype(int)
    for k in np.repeat(chosen, 3):
        solver.solve(found.problems[k][0], INTERIOR)
        taken.append(solver.elapsed_ns / 1e3 / max(1.0, solver.solution[-2]))
    times = 1e6 * np.median(found.times[50:], axis=0)
    return SizeTiming(arm.n, len(c.grid), float(times[0]), float(np.median(taken)), float(times.sum()))


def _run_loop(arm: Arm, c: Configuration, seconds: float, pushes: Sequence[Push]) -> Trial:
    path = _make_path(arm, str(c["mpc.space"]), seconds, float(c["mpc.period"]))
    found = run_trial(arm, MPC(arm, c), path, pushes, Sensors(), (), seed=1, keep=True)
    if (found.simulation.status < 0).any():
        raise PlantError(f"the loop of {arm.n} joints and {len(c.grid)} nodes was refused; its times say nothing.")
    return found


def time_torque_box(profile: str = "native", seconds: float = 4.0) -> BoxTiming:
    """Time the same solver on a closed loop that only the motors' torques limit.

    Args:
        profile: Profile of the build.
        seconds: Length of the loop, s.

    Returns:
        Active bounds and times.

    Raises:
        PlantError: The build fails, or the closed loop is refused.

    """
    free = dict.fromkeys(("motor_speed", "joint_torque", "joint_high", "torque_rate"), 1e6)
    limits = {f"limits__{name}": value for name, value in free.items()}
    c = make_table_configuration().with_changes(
        FAR_WALLS, **limits, limits__joint_low=-1e6, limits__tip_speed=100.0, limits__motor_torque=BOX_TORQUE
    )
    arm = load("paper", profile, mpc=c)
    forces = itertools.cycle(((-25.0, 15.0), (25.0, 10.0)))
    pushes = [Push(t, t + 0.25, force) for t, force in zip(np.arange(0.5, seconds, 0.5), forces, strict=False)]
    found = _run_loop(arm, c, seconds, pushes)
    times = 1e6 * found.times[50:]
    active = float(np.mean([sum(r.active.values()) for r in found.reports[50:]]))
    inside = float(np.mean([r.interior > 0 for r in found.reports[50:]]))
    before, after = np.median(times, axis=0)
    both = times.sum(1)
    return BoxTiming(
        active, float(before), float(after), float(np.median(both)), float(np.quantile(both, 0.99)), inside
    )


def format_scaling(found: Scaling, boxed: BoxTiming) -> list[str]:
    """Format times and exponents for a terminal.

    Args:
        found: Times by size.
        boxed: Times of the problem that only torques limit.

    Returns:
        Lines of text.

    """
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
