"""Checks of positions: an encoder that wraps, lost rows, units, signs, the gear's wrong side, swapped joints."""

from __future__ import annotations

import math

import numpy as np

from hdagen.arm.compiled_arm import Arm
from hdagen.data_quality.channel_check_settings import CHANNEL_CHECK
from hdagen.data_quality.finding import Finding, RobotFacts, Severity, format_repair
from hdagen.data_quality.log_profile import LogProfile
from hdagen.data_quality.outliers import PositionTrack, find_wrap_period
from hdagen.data_quality.rank_check import is_determined
from hdagen.data_quality.relations import (
    DEGREES_PER_RADIAN,
    both_encoders_move,
    check_derivative,
    compare_signals,
    explain_slopes,
)
from hdagen.log.channel_statistics import fit_slope_and_correlation
from hdagen.log.column_map import split_column_name

SPOILT_ENCODERS = ("wrapped", "jump", "swapped")  # findings after which a joint's encoders say nothing of each other
SPOILT_MOTION = (*SPOILT_ENCODERS, "degrees", "reversed", "joint_scale", "units")  # nor of small differences


def find_jumps(profile: LogProfile, robot: RobotFacts, model: Arm | None) -> list[Finding]:
    """Find positions that leap in one row and stay there: a wrapped encoder, or one that was set anew.

    Args:
        profile: of the log.
        robot: its facts.
        model: the robot file's, where there is one.

    Returns:
        The findings.

    """
    log, findings = profile.log, []
    for name, channel in profile.channels.items():
        base, joint = split_column_name(name) or ("", 0)
        if base not in ("motor_position", "joint_position") or not channel.is_moving or len(log) < 10:
            continue
        place = PositionTrack.measure(channel, log[name], profile.rows_after_gaps)
        if not len(place.leap_rows):
            continue
        rows, jumps = place.leap_rows - 1, place.deviation[1:]
        size, row = float(np.median(np.abs(jumps[rows]))), int(rows[0])
        where = (
            f"{name} jumps by {size:.5g} in one row, {len(rows)} time(s), first after row {row + 1} "
            f"({log.time[row]:.6g} s)"
        )
        period = find_wrap_period(size)
        if period is not None:
            unit = {360.0: {"unit": "deg"}, 1.0: {"unit": "turn"}}.get(period, {})
            repair = {name: {"wrap": period, **unit}}
            sentence = f"{where}: an encoder that wraps at {period:.5g}; set {format_repair(repair)} in columns.toml."
            findings.append(Finding(Severity.REFUSE, "wrapped", joint, sentence, repair))
        elif len(rows) > 1 and np.all(np.diff(rows)[::2] == 1):
            sentence = (
                f"{where} and back: readings that are wrong; cut these rows, or leave the cells empty and fill them."
            )
            findings.append(Finding(Severity.WARN, "glitch", joint, sentence))
        else:
            sentence = f"{where}: the encoder was set anew, or two recordings were joined; cut the log there."
            findings.append(Finding(Severity.REFUSE, "jump", joint, sentence))
    return findings


def find_lost_rows(profile: LogProfile, robot: RobotFacts, model: Arm | None) -> list[Finding]:
    """Find rows that were lost before they were numbered.

    All moving positions go two or three times as far there as in the rows around, and farther than in either
    neighbour, while time runs on evenly.

    Args:
        profile: of the log.
        robot: its facts.
        model: the robot file's, where there is one.

    Returns:
        The findings.

    """
    log, ratios = profile.log, []
    whole = np.ones(len(log) - 1, bool)
    whole[profile.gaps[0]] = False
    leaps = np.ones(len(log) - 1, bool)
    for name, channel in profile.channels.items():
        base = (split_column_name(name) or ("", 0))[0]
        if base not in ("motor_position", "joint_position") or not channel.is_moving or len(log) < 100:
            continue
        moves = np.diff(log[name])
        usual = np.median(np.lib.stride_tricks.sliding_window_view(np.pad(moves, 3, mode="edge"), 7), axis=1)
        fast = (np.abs(usual) > 10 * channel.noise) & whole
        beside = np.pad(np.abs(moves), 1, mode="edge")
        smooth = np.abs(moves) < CHANNEL_CHECK.lost_row_ratios[0] * np.maximum(beside[:-2], beside[2:])
        ratios.append(np.where(fast, moves / np.where(fast, usual, 1.0), np.nan))
        leaps &= ~(smooth & fast)
    if not ratios:
        return []
    seen = np.isfinite(ratios).any(axis=0)
    low, high = (
        f(np.where(np.isfinite(ratios), ratios, default), axis=0) for f, default in ((np.min, 9.0), (np.max, -9.0))
    )
    double = leaps & seen & (low > CHANNEL_CHECK.lost_row_ratios[0]) & (high < CHANNEL_CHECK.lost_row_ratios[1])
    opposite = (
        seen & (low > -CHANNEL_CHECK.lost_row_ratios[1] + 2) & (high < 2 - CHANNEL_CHECK.lost_row_ratios[0])
    )  # as far off to the other side: shaky
    lost, shaky = np.count_nonzero(double), np.count_nonzero(opposite)
    if lost < 5 or lost < CHANNEL_CHECK.least_lost_share * np.count_nonzero(seen) or lost < 5 * shaky:
        return []
    share, row = 100 * lost / np.count_nonzero(seen), int(np.flatnonzero(double)[0])
    sentence = (
        f"all positions move twice as far as usual in {share:.2g} % of the rows, first after row {row + 1} "
        f"({log.time[row]:.6g} s), and time runs on evenly: rows were lost and not counted; record the time at which "
        "each row was sampled."
    )
    return [Finding(Severity.REFUSE, "dropped", 0, sentence)]


def check_spans(profile: LogProfile, robot: RobotFacts, model: Arm | None) -> list[Finding]:
    """Check that joints span no more than a joint can; otherwise they are in degrees.

    Args:
        profile: of the log.
        robot: its facts.
        model: the robot file's, where there is one.

    Returns:
        The findings.

    """
    channels, sound, findings = profile.channels, profile.list_sound_joints("wrapped", "jump"), []
    for joint, (prismatic, limits) in enumerate(zip(robot.prismatic, robot.position_limits, strict=True), start=1):
        name = f"joint_position_{joint}"
        if joint not in sound or name not in channels or prismatic:
            continue
        channel = channels[name]
        reach, span = max(abs(channel.low), abs(channel.high)), channel.high - channel.low
        degrees = {name: {"unit": "deg"}}
        repair = f"set {format_repair(degrees)} in columns.toml"
        if limits is not None:
            allowed = max(abs(limits[0]), abs(limits[1]))
            if reach > 2 * allowed + 0.1:
                sentence = (
                    f"{name} reaches {reach:.4g} where the robot file allows {allowed:.4g} rad: degrees? Then {repair}."
                )
                findings.append(Finding(Severity.REFUSE, "degrees", joint, sentence, degrees))
            elif channel.low < limits[0] or channel.high > limits[1]:
                sentence = (
                    f"{name} leaves its limits ({channel.low:.4g} to {channel.high:.4g} rad, limits {limits[0]:.4g} to "
                    f"{limits[1]:.4g}): check the zero (offset under [{name}] in columns.toml) or the robot file."
                )
                findings.append(Finding(Severity.WARN, "limits", joint, sentence))
        elif span > CHANNEL_CHECK.largest_span:
            sentence = (
                f"{name} spans {span:.4g} rad, {span / (2 * math.pi):.3g} turns: degrees? Then {repair}; if it really "
                "turns, state limits.position in the robot file."
            )
            findings.append(Finding(Severity.REFUSE, "degrees", joint, sentence, degrees))
    return findings


def check_resolutions(profile: LogProfile, robot: RobotFacts, model: Arm | None) -> list[Finding]:
    """Check the encoders' steps against the resolution that the robot file states.

    Args:
        profile: of the log.
        robot: its facts.
        model: the robot file's, where there is one.

    Returns:
        The findings.

    """
    channels, findings = profile.channels, []
    for name, stated in robot.resolutions.items():
        if name not in channels or not channels[name].step or not stated:
            continue
        seen, joint = channels[name].step, int(name.rpartition("_")[2])
        says = f"{name} moves in steps of {seen:.4g}, the robot file states {stated:.4g}"
        if abs(seen / stated / DEGREES_PER_RADIAN - 1) < 0.03:
            degrees = {name: {"unit": "deg"}}
            sentence = f"{says}: degrees; set {format_repair(degrees)} in columns.toml."
            findings.append(Finding(Severity.REFUSE, "degrees", joint, sentence, degrees))
        elif not 0.6 < seen / stated < 1.6:
            sentence = f"{says}: the wrong robot file, the wrong unit, or a resolution to correct there."
            findings.append(Finding(Severity.WARN, "resolution", joint, sentence))
    return findings


def compare_encoders(profile: LogProfile, robot: RobotFacts, model: Arm | None) -> list[Finding]:
    """Compare the motors' positions with the joints': another slope than the ratio shows the mistake.

    Args:
        profile: of the log.
        robot: its facts.
        model: the robot file's, where there is one.

    Returns:
        The findings.

    """
    joints = profile.list_sound_joints(*SPOILT_ENCODERS)
    return [finding for joint in joints for finding in _compare_encoders_of(profile, robot, joint)]


def _compare_encoders_of(profile: LogProfile, robot: RobotFacts, joint: int) -> list[Finding]:
    motor, link = f"motor_position_{joint}", f"joint_position_{joint}"
    if not both_encoders_move(profile.channels, joint):
        return []
    ratio = robot.ratios[joint - 1]
    slope, correlation = fit_slope_and_correlation(profile.log[link], profile.log[motor])
    if abs(correlation) < 0.95:
        sentence = (
            f"{motor} and {link} hardly move together (correlation {correlation:.2f}): one of them belongs to another "
            "joint or another recording; correct 'from' in columns.toml."
        )
        return [Finding(Severity.REFUSE, "unrelated", joint, sentence)]
    if abs(slope / ratio - 1) < 0.1:
        return []
    for expected, name, mistake, repair in explain_slopes(ratio, motor, link, robot.prismatic[joint - 1]):
        if abs(slope / expected - 1) < 0.05:
            says = f"{motor} moves {slope:.4g} times as far as {link}, ratio {ratio:g}: {mistake}"
            does = format_repair(repair) or f"sign = -1 under [{motor}] or [{link}]"
            return [Finding(Severity.REFUSE, name, joint, f"{says}; set {does} in columns.toml.", repair)]
    sentence = (
        f"{motor} moves {slope:.4g} times as far as {link}, and the robot file states the ratio {ratio:g}: the file of "
        "another robot, or a unit to give in columns.toml."
    )
    return [Finding(Severity.REFUSE, "ratio", joint, sentence)]


def check_velocities(profile: LogProfile, robot: RobotFacts, model: Arm | None) -> list[Finding]:
    """Check logged velocities against the derivative of the position of the same side.

    A velocity that contradicts its position is left out, or scaled where the factor is that of a unit.

    Args:
        profile: of the log.
        robot: its facts.
        model: the robot file's, where there is one.

    Returns:
        The findings.

    """
    joints = profile.list_sound_joints(*SPOILT_ENCODERS)
    return [finding for joint in joints for finding in _check_velocities_of(profile, robot.ratios[joint - 1], joint)]


def _check_velocities_of(profile: LogProfile, ratio: float, joint: int) -> list[Finding]:
    channels = profile.channels
    findings: list[Finding] = []
    for side in ("motor", "joint"):
        position, velocity = f"{side}_position_{joint}", f"{side}_velocity_{joint}"
        if position not in channels or velocity not in channels or not channels[position].is_moving:
            continue
        rate = profile.grid.differentiate(profile.smooth_channel(position))
        logged = profile.smooth_channel(velocity)
        if np.std(logged) > 0:
            same = compare_signals(rate, logged, velocity, position, "/s", joint)
            refused = [finding for finding in same if finding.severity is Severity.REFUSE]
            findings += refused or check_derivative(
                fit_slope_and_correlation(rate, logged), velocity, position, ratio, joint
            )
    return findings


def check_references(profile: LogProfile, robot: RobotFacts, model: Arm | None) -> list[Finding]:
    """Check the references against the joints' positions.

    A weak drive does not reach its reference, which is no mistake: only another joint that follows it is worth a
    warning.

    Args:
        profile: of the log.
        robot: its facts.
        model: the robot file's, where there is one.

    Returns:
        The findings.

    """
    joints = profile.list_sound_joints(*SPOILT_ENCODERS)
    return [finding for joint in joints for finding in _check_reference_of(profile, joint)]


def _check_reference_of(profile: LogProfile, joint: int) -> list[Finding]:
    log, channels = profile.log, profile.channels
    position, reference = f"joint_position_{joint}", f"joint_position_reference_{joint}"
    if position not in channels or reference not in channels or not channels[position].is_moving:
        return []
    if not channels[reference].is_moving:
        return []
    others = {
        name: abs(fit_slope_and_correlation(log[name], log[reference])[1])
        for j in range(1, log.n_joints + 1)
        if j != joint and (name := f"joint_position_{j}") in channels and channels[name].is_moving
    }
    findings = compare_signals(log[position], log[reference], reference, position, "", joint)
    if (
        any(finding.name == "unrelated" for finding in findings)
        and max(others.values(), default=0.0) > CHANNEL_CHECK.following_correlation
    ):
        other = max(others, key=lambda name: others[name])
        sentence = (
            f"{reference} hardly follows {position} and does follow {other} (correlation {others[other]:.2f}): that "
            "joint's? Then correct 'from' in columns.toml."
        )
        return [Finding(Severity.WARN, "unrelated", joint, sentence)]
    noted = [Finding(Severity.NOTE, f.name, f.joint, f.sentence) for f in findings if f.severity is Severity.WARN]
    return [*noted, *(f for f in findings if f.severity is not Severity.WARN)]


def find_swapped_encoders(profile: LogProfile, robot: RobotFacts, model: Arm | None) -> list[Finding]:
    """Find pairs of joints whose motor encoders follow each other's joint encoders.

    Args:
        profile: of the log.
        robot: its facts.
        model: the robot file's, where there is one.

    Returns:
        The findings.

    """
    log, sound = profile.log, profile.list_sound_joints("wrapped", "jump")
    joints = [joint for joint in sound if both_encoders_move(profile.channels, joint)]
    follows = {
        (i, j): abs(fit_slope_and_correlation(log[f"joint_position_{j}"], log[f"motor_position_{i}"])[1])
        for i in joints
        for j in joints
    }
    findings = []
    for i, j in follows:
        if i < j and max(follows[i, i], follows[j, j]) < 0.98 and min(follows[i, j], follows[j, i]) > 0.999:
            sentence = (
                f"motor_position_{i} follows joint_position_{j} (correlation {follows[i, j]:.4f}) and "
                f"motor_position_{j} joint_position_{i}: swapped on one side; exchange their 'from' in columns.toml."
            )
            findings += [Finding(Severity.REFUSE, "swapped", joint, sentence) for joint in (i, j)]
    return findings


def find_encoder_skews(profile: LogProfile, robot: RobotFacts, model: Arm | None) -> list[Finding]:
    """Measure how much later the joint's encoder reads than the motor's, by the part of their difference that is
    proportional to speed.

    A skew is no mistake by itself: the diagnosis has it among its candidates.

    Args:
        profile: of the log.
        robot: its facts.
        model: the robot file's, where there is one.

    Returns:
        The findings.

    """
    log, grid, found = profile.log, profile.grid, {}
    joints = profile.list_sound_joints(*SPOILT_MOTION)
    for joint in joints:
        motor, link = f"motor_position_{joint}", f"joint_position_{joint}"
        if not both_encoders_move(profile.channels, joint):
            continue
        position = profile.smooth_channel(link)
        speed = grid.differentiate(position)
        twist = grid.smooth(log[motor] / robot.ratios[joint - 1] - log[link])
        slow = max(0.05 * float(np.quantile(np.abs(speed), 0.9)), 1e-12)
        terms = [speed, grid.differentiate(speed), np.tanh(speed / slow), position, np.ones_like(speed)]
        matrix = np.stack(terms, 1)[:: grid.window_rows]
        if not is_determined(matrix):
            continue
        matrix /= np.abs(matrix).max(0)
        delay = (
            np.linalg.lstsq(matrix, twist[:: grid.window_rows], rcond=1e-9)[0][0]
            / np.abs(speed[:: grid.window_rows]).max()
        )
        if abs(delay) > profile.period:
            found[joint] = float(delay)
    delays, why = list(found.values()), "a late encoder, or a joint that bends so"
    if len(found) == len(joints) > 1 and np.ptp(delays) < 0.2 * abs(np.mean(delays)):
        why = "alike on all joints: the encoders' clocks differ"
    findings = []
    for joint, delay in found.items():
        order = "earlier"
        if delay > 0:
            order = "later"
        sentence = f"joint_position_{joint} reads {1e3 * abs(delay):.3g} ms {order} than motor_position_{joint}, {why}."
        findings.append(Finding(Severity.NOTE, "skew", joint, sentence))
    return findings
