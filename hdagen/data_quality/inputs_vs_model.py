"""Checks of a log against the model of its robot file: another robot's file, another unit, swapped joints.

The model's inverse dynamics along the measured motion is fitted to the input, friction and springs left free, and to
the torsion. No effect of a real joint changes its inertia severalfold, or makes a joint twist as its neighbour should;
a wrong file, unit or assignment does.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from hdagen.arm.compiled_arm import Arm
from hdagen.data_quality.finding import Finding, RobotFacts, Severity, format_repair
from hdagen.data_quality.input_check_settings import INPUT_CHECK
from hdagen.data_quality.input_lags import INPUT_QUANTITIES
from hdagen.data_quality.log_profile import LogProfile, SmoothedMotion
from hdagen.data_quality.rank_check import is_determined
from hdagen.data_quality.relations import both_encoders_move
from hdagen.log.channel_statistics import ChannelStatistics
from hdagen.log.column_map import is_command_channel


def check_inertia(profile: LogProfile, robot: RobotFacts, model: Arm) -> list[Finding]:
    """Check the inertia that each input implies: not several times larger or smaller than the robot file's.

    A command that asks for another inertia than the input that was measured at its joint is one that the drive does not
    follow, as a saturated one: a sign or a unit of its own is still found.

    Args:
        profile: of the log, with a position of every joint.
        robot: its facts.
        model: the robot file's.

    Returns:
        The findings.

    """
    moving, torque, findings = _smooth_whole_motion(profile, model), _compute_torque(profile, model), []
    for one, joint in enumerate(moving.joints):
        ratio, rotor = model.parameters[f"ratio_{joint}"], model.parameters[f"motor_inertia_{joint}"]
        inertial = torque[:, joint - 1] / ratio + rotor * ratio * moving.acceleration[one]
        names = _list_varying_inputs(profile, joint)
        judged = {name: _judge_inertia(profile, model, name, one, inertial) for name in names}
        is_right = any(not judged[name] for name in judged if not is_command_channel(name))
        for name, found in judged.items():
            findings += [f for f in found if not (is_right and is_command_channel(name) and f.name == "inertia")]
    return findings


def _list_varying_inputs(profile: LogProfile, joint: int) -> list[str]:
    """The inputs of a joint that the log has, without those that stay at one value."""
    channels, names = profile.channels, [f"{base}_{joint}" for base in INPUT_QUANTITIES]
    return [name for name in names if name in channels and not channels[name].is_constant]


def _judge_inertia(profile: LogProfile, model: Arm, name: str, one: int, inertial: np.ndarray) -> list[Finding]:
    """The finding on the inertia that an input implies, if it cannot be that of its joint, number ``one`` of those that
    move; ``inertial`` is the model's torque at its motor, N m."""
    moving = _smooth_whole_motion(profile, model)
    joint = moving.joints[one]
    values = _torque_per_input(model, name, joint) * profile.sample_channel(name)
    low, high = _bound_coefficient(_stack_friction_terms(moving, one, inertial), values)
    has_rotor = bool(model.parameters[f"motor_inertia_{joint}"])
    if not has_rotor and low > INPUT_CHECK.most_inertia_ratio and _is_rotor_missing(moving, one, inertial, values):
        return []
    if low > INPUT_CHECK.most_inertia_ratio or high < 1 / INPUT_CHECK.most_inertia_ratio:
        times = math.copysign(math.sqrt(low * high), high)
        return [_explain_inertia(name, joint, times, profile.channels[name])]
    return []


def check_drives(profile: LogProfile, robot: RobotFacts, model: Arm) -> list[Finding]:
    """Check that inputs and encoders were read.

    A joint may move as only a drive can move it while its inputs stay at one value. Another one's encoders may stay at
    one value under an input that its friction could not hold.

    Args:
        profile: of the log, with a position of every joint.
        robot: its facts.
        model: the robot file's.

    Returns:
        The findings.

    """
    channels, moving, torque = profile.channels, _smooth_whole_motion(profile, model), _compute_torque(profile, model)
    findings = []
    for joint in range(1, model.n + 1):
        inputs = [name for base in INPUT_QUANTITIES if (name := f"{base}_{joint}") in channels]
        encoders = [name for side in ("motor", "joint") if (name := f"{side}_position_{joint}") in channels]
        if joint in moving.joints and inputs and all(channels[name].is_constant for name in inputs):
            times = _compare_own_torque(profile, model, moving, joint, torque)
            if times > INPUT_CHECK.driven_torque_ratio:
                sentence = (
                    f"{inputs[0]} stays at {channels[inputs[0]].low:.5g} while joint {joint} moves as only its drive "
                    f"can move it (its inertia takes {times:.3g} times what weight and the other joints give): the "
                    "input was not recorded; record the current or torque that drives it."
                )
                findings.append(Finding(Severity.REFUSE, "still", joint, sentence))
        elif encoders and all(channels[name].is_constant for name in encoders):
            findings += _find_unread_encoder(profile, model, joint, inputs, encoders[0], torque)
    return findings


def find_exchanged_joints(profile: LogProfile, robot: RobotFacts, model: Arm) -> list[Finding]:
    """Find pairs of joints whose torsions the model explains only once the two are exchanged.

    Args:
        profile: of the log, with a position of every joint.
        robot: its facts.
        model: the robot file's.

    Returns:
        The findings.

    """
    moving, torque = _smooth_whole_motion(profile, model), _compute_torque(profile, model)
    both = [j for j in model.manifest["flexible"] if both_encoders_move(profile.channels, j)]
    findings = []
    own = _measure_torsion_residuals(profile, model, moving, torque, {j: j for j in both})
    for i, j in ((i, j) for i in both for j in both if i < j):
        if not math.isclose(*(model.parameters[f"ratio_{k}"] for k in (i, j)), rel_tol=0.1):
            continue  # another check has compared the ratios
        exchanged = _exchange_motion(moving, i, j)
        torque = _joint_torque(profile, model, exchanged)
        other = _measure_torsion_residuals(profile, model, exchanged, torque, {i: j, j: i})
        better = math.sqrt(own[i] * own[j] / (other[i] * other[j]))
        if better > INPUT_CHECK.exchanged_fit_ratio:
            sentence = (
                f"joints {i} and {j} twist as the robot file has it of each other (exchanged they fit {better:.1f} "
                "times better): all columns of one are logged as the other's; exchange their 'from' in columns.toml, "
                "or the joints in the robot file."
            )
            findings += [Finding(Severity.REFUSE, "swapped", joint, sentence) for joint in (i, j)]
    return findings


MODEL_CHECKS = ((check_drives, find_exchanged_joints), (check_inertia,))  # each group of a log that nothing refuses yet


def _compare_own_torque(profile: LogProfile, arm: Arm, moving: SmoothedMotion, joint: int, torque: np.ndarray) -> float:
    """The torque that a joint's own acceleration takes, over that of its weight, the other joints and the tip force.

    It is at most 1 where nothing else moves the joint, as friction only brakes.
    """
    one, p = moving.joints.index(joint), arm.parameters
    ratio, still = p[f"ratio_{joint}"], np.zeros_like(moving.velocity)
    own = still.copy()
    own[one] = moving.acceleration[one]
    rotor = p[f"motor_inertia_{joint}"] * ratio * moving.acceleration[one]
    weight, inertia = (
        _joint_torque(profile, arm, replace(moving, velocity=still, acceleration=a))[:, joint - 1] / ratio
        for a in (still, own)
    )
    inertia += rotor - weight
    given = torque[:, joint - 1] / ratio + rotor - inertia
    return float(np.sqrt(np.mean(inertia**2)) / max(np.std(given), 1e-300))


def _find_unread_encoder(
    profile: LogProfile, arm: Arm, joint: int, inputs: list[str], encoder: str, torque: np.ndarray
) -> list[Finding]:
    """A finding where the input pushes a joint at rest by far more than its friction in the robot file."""
    log, channels = profile.log, profile.channels
    friction = arm.parameters[f"coulomb_friction_{joint}"]
    name = next((name for name in inputs if not channels[name].is_constant), None)
    if name is None or friction <= 0:
        return []
    unit = _torque_per_input(arm, name, joint)
    carried = np.interp(log.time, profile.grid.time, torque[:, joint - 1]) / arm.parameters[f"ratio_{joint}"]
    pushed = float(np.quantile(np.abs(unit * log[name] - carried), 0.95)) / friction
    if pushed < INPUT_CHECK.breakaway_ratio:
        return []
    sentence = (
        f"{encoder} stays at {channels[encoder].low:.5g} while {name} pushes the joint with {pushed:.2g} times the dry "
        "friction of the robot file: the encoder is not read, or a brake holds the joint; repair that, or take a robot "
        "file without the joint."
    )
    return [Finding(Severity.REFUSE, "still", joint, sentence)]


def _explain_inertia(name: str, joint: int, found: float, channel: ChannelStatistics) -> Finding:
    """The finding for an impossible inertia: another unit, a reversed sign or another robot."""
    times = f"{name} asks for {found:.3g} times the inertia of joint {joint} in the robot file"
    milli = {name: {"unit": "mA"}}
    if "current" in name and 1000 / INPUT_CHECK.milli_tolerance < found < 1000 * INPUT_CHECK.milli_tolerance:
        sentence = (
            f"{times} (it reaches {max(abs(channel.low), abs(channel.high)):.4g}): mA; set {format_repair(milli)} in "
        )
        return Finding(Severity.REFUSE, "milliamperes", joint, f"{sentence}columns.toml.", milli)
    if found < 0:
        sentence = f"{times}, which is below zero: a sign is reversed; set sign = -1 under [{name}] or the positions."
        return Finding(Severity.REFUSE, "reversed", joint, sentence)
    sentence = f"{times}: the file of another robot, or a unit of {name} or of the positions to give in columns.toml."
    return Finding(Severity.REFUSE, "inertia", joint, sentence)


def _smooth_whole_motion(profile: LogProfile, arm: Arm) -> SmoothedMotion:
    """The motion of all joints that move."""
    joints = range(1, arm.n + 1)
    return profile.smooth_motion([arm.parameters[f"ratio_{j}"] for j in joints], joints)


def _compute_torque(profile: LogProfile, arm: Arm) -> np.ndarray:
    """The model's torque of the joints along the log's motion (K, n), N m at the joint, without friction."""
    moving = _smooth_whole_motion(profile, arm)
    return profile.compute_once(("model's torque", arm), lambda: _joint_torque(profile, arm, moving))


def _torque_per_input(arm: Arm, name: str, joint: int) -> float:
    """Torque at the motor per unit of an input: the torque constant of a current, 1 of a torque."""
    constant = f"torque_constant_{joint}"
    if "current" in name and constant in arm.parameters:
        return arm.parameters[constant]
    return 1.0


def _joint_torque(profile: LogProfile, arm: Arm, moving: SmoothedMotion) -> np.ndarray:
    """The model's torque of the joints along a motion (K, n), N m at the joint, without friction."""
    log = profile.log
    q, v, a = (np.zeros((len(moving.grid.time), arm.n)) for _ in range(3))
    for one, joint in enumerate(moving.joints):
        q[:, joint - 1], v[:, joint - 1] = moving.position[one], moving.velocity[one]
        a[:, joint - 1] = moving.acceleration[one]
    for j in set(range(1, arm.n + 1)) - set(moving.joints):  # the joint is held somewhere
        position, ratio = f"joint_position_{j}", arm.parameters[f"ratio_{j}"]
        if position in log:
            q[:, j - 1] = np.mean(log[position])
        else:
            q[:, j - 1] = np.mean(log[f"motor_position_{j}"]) / ratio
    force = np.zeros((len(moving.grid.time), arm.nu - arm.n))
    for k, name in enumerate(arm.input_names[arm.n :]):
        if name in log:
            force[:, k] = profile.smooth_channel(name)
    return arm.evaluate("inverse_dynamics", q=q, v=v, a=a, tip_force=force)["joint_torque"]


def _stack_friction_terms(moving: SmoothedMotion, one: int, *first: np.ndarray) -> np.ndarray:
    """``first``, then viscous and dry friction, a constant and a spring: (rows, terms), one row a smoothing window."""
    velocity = moving.velocity[one]
    slow = max(0.05 * float(np.quantile(np.abs(velocity), 0.9)), 1e-12)
    rest = (velocity, np.tanh(velocity / slow), np.ones_like(velocity), moving.position[one])
    return np.stack([*first, *rest], 1)[:: moving.grid.window_rows]


def _is_rotor_missing(moving: SmoothedMotion, one: int, inertial: np.ndarray, values: np.ndarray) -> bool:
    """Tell whether a rotor that the file lacks explains an input as well as several times the file's inertia does.

    Nobody can tell the two of a joint that carries the same inertia in every pose. No rotor makes the inertia about a
    thousandfold, as a wrong prefix of a unit does.
    """
    scaled = _fit_rest(_stack_friction_terms(moving, one, inertial), values)
    rotor = _fit_rest(
        _stack_friction_terms(moving, one, moving.acceleration[one]), values - inertial[:: moving.grid.window_rows]
    )
    is_milli = scaled.first > 1000 / INPUT_CHECK.milli_tolerance
    return not is_milli and rotor.first > 0 and rotor.size <= INPUT_CHECK.rotor_misfit_ratio * scaled.size


@dataclass(frozen=True)
class _Fit:
    """A least-squares fit: the coefficient of its first term, and the root mean square of the rest."""

    first: float
    size: float


def _fit_rest(terms: np.ndarray, values: np.ndarray) -> _Fit:
    """Fit ``values`` (rows,) by ``terms`` (rows, terms)."""
    sizes = np.maximum(np.abs(terms).max(0), 1e-300)
    found = np.linalg.lstsq(terms / sizes, values, rcond=1e-10)[0] / sizes
    return _Fit(float(found[0]), float(np.sqrt(np.mean((values - terms @ found) ** 2))))


def _bound_coefficient(terms: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    """Bounds of the first term's coefficient where both it and ``values`` have errors, the other terms being free.

    They are the coefficient of ``values`` over the term, and the inverse of that of the term over ``values``; NaN where
    the two hardly correlate.

    Source: Frisch, Statistical Confluence Analysis by Means of Complete Regression Systems (1934).
    """
    if not is_determined(terms):
        return math.nan, math.nan
    other = terms[:, 1:] / np.maximum(np.abs(terms[:, 1:]).max(0), 1e-300)
    x, y = (part - other @ np.linalg.lstsq(other, part, rcond=1e-10)[0] for part in (terms[:, 0], values))
    xx, xy, yy = float(x @ x), float(x @ y), float(y @ y)
    if xy == 0 or xy**2 < INPUT_CHECK.least_correlation**2 * xx * yy:
        return math.nan, math.nan
    return tuple(sorted((xy / xx, yy / xy)))  # type: ignore[return-value]


def _measure_torsion_residuals(
    profile: LogProfile, arm: Arm, moving: SmoothedMotion, torque: np.ndarray, logged_as: Mapping[int, int]
) -> dict[int, float]:
    """Root mean square residual of each joint's torsion, rad; NaN where the log is too short.

    The fit has the model's torque, a stiffening spring, friction, a time skew and an eccentric encoder. ``logged_as``
    has the joint whose columns are taken as those of each joint.
    """
    log, found = profile.log, {}
    for joint, column in logged_as.items():
        one = moving.joints.index(joint)
        twist = log[f"motor_position_{column}"] / arm.parameters[f"ratio_{joint}"] - log[f"joint_position_{column}"]
        carried, angle = torque[:, joint - 1], moving.position[one]
        bend = np.arctan(carried / max(float(np.std(carried)), 1e-12))
        terms = _stack_friction_terms(moving, one, carried, bend, np.sin(angle), np.cos(angle))
        size = np.maximum(np.abs(terms).max(0), 1e-300)
        values = moving.grid.smooth(twist)[:: moving.grid.window_rows]
        if not is_determined(terms):
            found[joint] = math.nan
            continue
        left = values - terms / size @ np.linalg.lstsq(terms / size, values, rcond=1e-9)[0]
        found[joint] = max(float(np.sqrt(np.mean(left**2))), 1e-300)
    return found


def _exchange_motion(moving: SmoothedMotion, i: int, j: int) -> SmoothedMotion:
    """The motion as if the columns of joints i and j were exchanged."""
    other = {i: j, j: i}
    places = [moving.joints.index(other.get(joint, joint)) for joint in moving.joints]
    return replace(
        moving,
        position=moving.position[places],
        velocity=moving.velocity[places],
        acceleration=moving.acceleration[places],
    )
