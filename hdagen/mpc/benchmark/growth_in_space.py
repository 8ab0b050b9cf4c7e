"""The cost of a tick in space by the number of joints: the first joints of an arm, its tip at the end of each.

Every size is a library of its own. A free run along a circle, with pushes, says how far the arm goes; in the timed runs
the limits of every family that it has lie within that, so that all of them hold somewhere.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm, load
from hdagen.control.pose_kinematics import choose_open_posture, find_tip_pose
from hdagen.control.reference_motion import Reference
from hdagen.control.tip_paths import make_tip_path
from hdagen.mpc.closed_loop_trial import Trial, run_trial
from hdagen.mpc.compiled_settings import LIMIT_FAMILIES
from hdagen.mpc.configuration import Configuration
from hdagen.mpc.predictive_controller import MPC
from hdagen.mpc.wall import Wall
from hdagen.simulation.simulated_sensors import Sensors
from hdagen.simulation.simulator import SpacePush

CIRCLE_SIZE, CIRCLE_TURN, GROWTH_SECONDS = 0.05, 1.5, 1.5  # m, s, s
GROWTH_PUSHES = (SpacePush(0.3, 0.7, (6.0, -4.0, 5.0)),)
GROWTH_RUNS, FIRST_TICKS = 5, 50  # timed runs of a size; ticks at the start that are not counted
DISTANT_WALLS = (Wall((1.0, 0.0, 0.0), 90.0), Wall((0.0, 0.0, 1.0), 90.0))
HELD_SHARE = 0.9  # of what the free run took, that the limits leave
LEAST_LIMIT = 1e-3  # of any limit, in its unit
NUMBERS = ("ratio", "motor_inertia", "torque_constant", "viscous_friction", "coulomb_friction", "max_current")
SPRING_NUMBERS = (
    *("torsional_damping", "flexspline_stiffness", "flexspline_stiffening"),
    *("wave_generator_stiffness", "wave_generator_stiffening"),
)


@dataclass(frozen=True)
class GrowthTiming:
    """A size: µs of thread time over all timed ticks, with the least and the largest median of a run; the library,
    bytes; the families of limits that held somewhere, and rows active on average."""

    joints: int
    before: float  # the part before the measurement, median
    tick: float  # the whole tick, median
    least: float
    largest: float
    ninety_nine: float
    library: int
    families: tuple[str, ...]
    active: float
    interior: float  # share of ticks that needed the interior point


def measure_growth(
    robot: str, profile: str = "native", say: Callable[[str], None] = lambda _: None
) -> tuple[GrowthTiming, ...]:
    """Build and measure the first joints of an arm in space, from one to all.

    Args:
        robot: A preset or the path of a robot.toml.
        profile: Profile of the builds.
        say: Hears the name of each size as it begins.

    Returns:
        Times by size.

    Raises:
        PlantError: The robot stands in a plane, a build fails, or a closed loop is refused.

    """
    described = load(robot, profile).robot
    if "tip" not in described:
        raise PlantError(f"{robot}: it moves in a plane, whose bars are of `paper`; name an arm in space, or none.")
    out = []
    with tempfile.TemporaryDirectory() as folder:
        for joints in range(1, len(described["joints"]) + 1):
            say(f"{joints} joints")
            path = Path(folder) / "robot.toml"
            path.write_text(format_first_joints(described, joints), encoding="utf-8")
            c = Configuration().with_changes(DISTANT_WALLS, limits__tip_speed=10.0)
            out.append(_time_size(load(path, profile, mpc=c), c))
    return tuple(out)


def format_first_joints(robot: Mapping[str, Any], joints: int) -> str:
    """Write the robot.toml of the first joints of an arm in space.

    Args:
        robot: Description of the robot, as the manifest of a build holds it.
        joints: Count of joints.

    Returns:
        TOML text.

    """
    lines = [f'name = "first {joints} joints"', f"gravity = {_list_nominal(robot['gravity'])}"]
    lines.append(f"step = {robot['step']!r}")
    for joint in robot["joints"][:joints]:
        drive, names = joint["drive"], NUMBERS if joint["drive"]["rigid"] else NUMBERS + SPRING_NUMBERS
        lines += ["", "[[joint]]", f'type = "{joint["kind"]}"', f"mass = {joint['mass']['nominal']!r}"]
        lines += [f"{name} = {joint[name]}" for name in ("origin", "rotation", "axis")]
        lines += [f"{name} = {_list_nominal(joint[name])}" for name in ("center_of_mass", "inertia")]
        lines += ["[joint.drive]", f"rigid = {str(drive['rigid']).lower()}"]
        for name in names:
            value = drive[name]
            if value is not None:
                lines.append(f"{name} = {value['nominal'] if isinstance(value, Mapping) else value!r}")
        lines += ["[joint.limits]", *(f"{name} = {value!r}" for name, value in joint["limits"].items() if value)]
    tip = robot["tip"]
    return "\n".join([*lines, "", "[tip]", f"origin = {tip['origin']}", f"rotation = {tip['rotation']}"]) + "\n"


def _list_nominal(values: Sequence[Mapping[str, float]]) -> list[float]:
    return [value["nominal"] for value in values]


def _time_size(arm: Arm, c: Configuration) -> GrowthTiming:
    start = choose_open_posture(arm)
    path = make_tip_path("circle", find_tip_pose(arm, start), CIRCLE_SIZE, CIRCLE_TURN, GROWTH_SECONDS)
    free = _run_loop(arm, MPC(arm, c), path, start, 0)
    limited = hold_within(arm, c, free, start)
    controller, medians, times, found = MPC(arm, limited), list[float](), list[Array](), list[Trial]()
    for seed in range(GROWTH_RUNS):
        found.append(_run_loop(arm, controller, path, start, seed))
        times.append(1e6 * found[-1].times[FIRST_TICKS:])
        medians.append(float(np.median(times[-1].sum(1))))
    reports, both = found[-1].reports, np.concatenate(times)
    held = tuple(name for name in LIMIT_FAMILIES if max(r.active[name] for r in reports))
    return GrowthTiming(
        arm.n,
        float(np.median(both[:, 0])),
        float(np.median(both.sum(1))),
        min(medians),
        max(medians),
        float(np.quantile(both.sum(1), 0.99)),
        sum(file.stat().st_size for file in arm.folder.glob("*.so")),
        held,
        float(np.mean([sum(r.active.values()) for r in reports])),
        float(np.mean([r.interior > 0 for r in reports])),
    )


def _run_loop(arm: Arm, controller: MPC, path: Reference, start: Array, seed: int) -> Trial:
    found = run_trial(arm, controller, path, GROWTH_PUSHES, Sensors(), (), seed, start)
    if (found.simulation.status < 0).any():
        raise PlantError(f"the loop of {arm.n} joints was refused; its times say nothing.")
    return found


def hold_within(arm: Arm, c: Configuration, free: Trial, start: Array) -> Configuration:
    """Set limits of every family within what a free run took, on the side to which the arm goes from its start.

    Args:
        arm: The arm.
        c: The configuration of the free run.
        free: The run.
        start: Where the joints began, (n).

    Returns:
        The configuration with walls, and with limits of speeds, torques and ranges.

    """
    s, joints = free.simulation, range(1, arm.n + 1)
    q, v = (s.state[:, [arm.index(f"joint_{what}_{j}") for j in joints]] for what in ("position", "velocity"))
    ratio = np.array([abs(joint["drive"]["ratio"]["nominal"]) for joint in arm.robot["joints"]])
    changed = np.abs(np.diff(s.torque, axis=0)).max(0) / float(c["mpc.period"])
    moved = np.linalg.norm(np.diff(s.tip, axis=0), axis=1).max() / float(c["mpc.period"])
    up, down = q.max(0) - start, start - q.min(0)
    walls = tuple(
        Wall(wall.normal, float(s.tip[0] @ normal + HELD_SHARE * np.max((s.tip - s.tip[0]) @ normal)))
        for wall in DISTANT_WALLS
        for normal in [np.array(wall.normal)]
    )
    hold = np.abs(arm.evaluate("gravity_torque", q=q)["g"]).max(0) / ratio
    limits: dict[str, Any] = {
        "motor_torque": _leave_share(np.abs(s.torque).max(0), hold),
        "torque_rate": _leave_share(changed),
        "motor_speed": _leave_share(np.abs(v).max(0) * ratio),
        "joint_low": start - np.where(down > up, HELD_SHARE, 1.1) * down - 1e-3,
        "joint_high": start + np.where(up >= down, HELD_SHARE, 1.1) * up + 1e-3,
        "joint_torque": _leave_share(np.abs(s.joint_torque).max(0), hold * ratio),
    }
    named = {f"limits__{name}": tuple(values.tolist()) for name, values in limits.items()}
    return c.with_changes(walls, **named, limits__tip_speed=float(_leave_share(moved)))


def _leave_share(taken: Array, hold: Array | float = 0.0) -> Array:
    """A limit within what was taken, that leaves a tenth more than what holds the arm; above 0 where nothing moved, as
    the first joint of many arms turns the tip alone."""
    return np.asarray(np.maximum(HELD_SHARE * taken, np.maximum(1.1 * np.asarray(hold), LEAST_LIMIT)))


def format_growth(found: Sequence[GrowthTiming]) -> list[str]:
    """Format times and sizes for a terminal.

    Args:
        found: Times by size.

    Returns:
        Lines of text.

    """
    out = [
        "µs of thread time by joints: before the measurement, a tick (medians of the runs), 99 % of ticks; library; "
        "rows active on average, ticks by the interior point"
    ]
    for s in found:
        spread = f"({s.least:.0f} to {s.largest:.0f})"
        out.append(
            f"  {s.joints:2} {s.before:8.1f} {s.tick:8.1f} {spread:>14} {s.ninety_nine:8.1f} "
            f"{s.library / 1e6:6.2f} MB {s.active:6.1f} {s.interior:5.0%}  {', '.join(s.families)}"
        )
    return out
