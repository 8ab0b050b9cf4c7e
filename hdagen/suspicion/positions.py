"""Mistakes that positions give away: an encoder that wraps, units, signs, the gear's wrong side, swapped joints."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from hdagen.channels import Channel, even, relation
from hdagen.columns import split_name
from hdagen.log import Log, gaps
from hdagen.suspicion.finding import Finding, Machine, Severity

_DEGREE = 180 / math.pi
_TURNS = 25.0  # rad; a joint that spans more turns like a wheel, or is logged in degrees


def jumps(log: Log, channels: Mapping[str, Channel]) -> list[Finding]:
    """Measured positions that jump by more than half their range in one row: a wrapped encoder, or a glitch."""
    findings = []
    after_gap = np.zeros(len(log) - 1, bool)
    after_gap[gaps(log.time)[0]] = True
    for name, channel in channels.items():
        base, joint = split_name(name) or ("", 0)
        if base not in ("motor_position", "joint_position") or not channel.moves or len(log) < 10:
            continue
        moves = np.diff(log[name])
        padded = np.pad(moves, 2, mode="edge")
        usual = np.median(np.lib.stride_tricks.sliding_window_view(padded, 5), axis=1)
        jumps = moves - usual
        rows = np.flatnonzero((np.abs(jumps) > 0.5 * (channel.high - channel.low)) & ~after_gap)
        if not len(rows):
            continue
        size, row = float(np.median(np.abs(jumps[rows]))), int(rows[0])
        where = (
            f"{name} jumps by {size:.5g} in one row, {len(rows)} time(s), first after row {row + 1} "
            f"({log.time[row]:.6g} s)"
        )
        period = next((p for p in _periods() if abs(size / p - 1) < 0.03), None)
        if period is not None:
            unit = {360.0: ' and unit = "deg"', 1.0: ' and unit = "turn"'}.get(period, "")
            wrap = "6.283185307179586" if period == 2 * math.pi else f"{period:g}"
            repair = f"set wrap = {wrap}{unit} under [{name}] in columns.toml"
            sentence = f"{where}: an encoder that wraps at {period:.5g}; {repair}."
            findings.append(Finding(Severity.REFUSE, "wrapped", joint, sentence))
        elif len(rows) > 1 and np.all(np.diff(rows)[::2] == 1):
            sentence = (
                f"{where} and back: readings that are wrong; cut these rows, or leave the cells empty and fill them."
            )
            findings.append(Finding(Severity.WARN, "glitch", joint, sentence))
        else:
            sentence = f"{where}: the encoder was set anew, or two recordings were joined; cut the log there."
            findings.append(Finding(Severity.REFUSE, "jump", joint, sentence))
    return findings


def _periods() -> Iterator[float]:
    """At what encoders wrap: a turn in rad, deg and turns, powers of two in counts."""
    yield from (2 * math.pi, 360.0, 1.0)
    yield from (2.0**k for k in range(8, 33))


def spans(channels: Mapping[str, Channel], machine: Machine, sound: list[int]) -> list[Finding]:
    """Joints in ``sound`` that span more than a joint can: degrees."""
    findings = []
    for joint, (prismatic, limits) in enumerate(zip(machine.prismatic, machine.position_limits, strict=True), start=1):
        name = f"joint_position_{joint}"
        if joint not in sound or name not in channels or prismatic:
            continue
        channel = channels[name]
        reach, span = max(abs(channel.low), abs(channel.high)), channel.high - channel.low
        repair = f'set unit = "deg" under [{name}] in columns.toml'
        if limits is not None:
            allowed = max(abs(limits[0]), abs(limits[1]))
            if reach > 2 * allowed + 0.1:
                sentence = (
                    f"{name} reaches {reach:.4g} where the robot file allows {allowed:.4g} rad: degrees? Then {repair}."
                )
                findings.append(Finding(Severity.REFUSE, "degrees", joint, sentence))
            elif channel.low < limits[0] or channel.high > limits[1]:
                sentence = (
                    f"{name} leaves its limits ({channel.low:.4g} to {channel.high:.4g} rad, limits {limits[0]:.4g} to "
                    f"{limits[1]:.4g}): check the zero (offset under [{name}] in columns.toml) or the robot file."
                )
                findings.append(Finding(Severity.WARN, "limits", joint, sentence))
        elif span > _TURNS:
            sentence = (
                f"{name} spans {span:.4g} rad, {span / (2 * math.pi):.3g} turns: degrees? Then {repair}; if it really "
                "turns, state limits.position in the robot file."
            )
            findings.append(Finding(Severity.REFUSE, "degrees", joint, sentence))
    return findings


def steps(channels: Mapping[str, Channel], machine: Machine) -> list[Finding]:
    """The quantisation seen against the resolution that the robot file states."""
    findings = []
    for name, stated in machine.resolutions.items():
        if name not in channels or not channels[name].step or not stated:
            continue
        seen, joint = channels[name].step, int(name.rpartition("_")[2])
        says = f"{name} moves in steps of {seen:.4g}, the robot file states {stated:.4g}"
        if abs(seen / stated / _DEGREE - 1) < 0.03:
            sentence = f'{says}: degrees; set unit = "deg" under [{name}] in columns.toml.'
            findings.append(Finding(Severity.REFUSE, "degrees", joint, sentence))
        elif not 0.6 < seen / stated < 1.6:
            sentence = f"{says}: the wrong robot file, the wrong unit, or a resolution to correct there."
            findings.append(Finding(Severity.WARN, "resolution", joint, sentence))
    return findings


def encoders(log: Log, channels: Mapping[str, Channel], machine: Machine, joint: int) -> list[Finding]:
    """Motor against joint position: their slope is the ratio, or it says what is wrong."""
    motor, link = f"motor_position_{joint}", f"joint_position_{joint}"
    if motor not in channels or link not in channels or not (channels[motor].moves and channels[link].moves):
        return []
    ratio = machine.ratios[joint - 1]
    slope, correlation = relation(log[link], log[motor])
    if abs(correlation) < 0.95:
        sentence = (
            f"{motor} and {link} hardly move together (correlation {correlation:.2f}): one of them belongs to another "
            "joint or another recording; correct 'from' in columns.toml."
        )
        return [Finding(Severity.REFUSE, "unrelated", joint, sentence)]
    if abs(slope / ratio - 1) < 0.1:
        return []
    for expected, name, what, repair in _explanations(ratio, motor, link, machine.prismatic[joint - 1]):
        if abs(slope / expected - 1) < 0.05:
            says = f"{motor} moves {slope:.4g} times as far as {link}, ratio {ratio:g}: {what}"
            return [Finding(Severity.REFUSE, name, joint, f"{says}; set {repair} in columns.toml.")]
    sentence = (
        f"{motor} moves {slope:.4g} times as far as {link}, and the robot file states the ratio {ratio:g}: the file of "
        "another robot, or a unit to give in columns.toml."
    )
    return [Finding(Severity.REFUSE, "ratio", joint, sentence)]


def _explanations(ratio: float, motor: str, link: str, prismatic: bool) -> Iterator[tuple[float, str, str, str]]:
    """Slopes of motor over joint position that a mistake gives: the slope, the finding, what it is, and its repair."""
    side = f"joint_side_ratio = {ratio:g}"
    yield -ratio, "reversed", "one of them is reversed", f"sign = -1 under [{motor}] or [{link}]"
    yield 1.0, "joint_scale", "the motor angle is logged at joint scale", f"{side} under [{motor}]"
    yield -1.0, "joint_scale", "the motor angle is at joint scale and reversed", f"{side} and sign = -1 under [{motor}]"
    yield ratio * _DEGREE, "degrees", "the motor angle is in degrees", f'unit = "deg" under [{motor}]'
    yield ratio / (2 * math.pi), "units", "the motor angle is in turns", f'unit = "turn" under [{motor}]'
    if prismatic:
        yield ratio / 1000, "units", "the joint position is in mm", f'unit = "mm" under [{link}]'
        return
    yield ratio / _DEGREE, "degrees", "the joint angle is in degrees", f'unit = "deg" under [{link}]'
    yield ratio * 2 * math.pi, "units", "the joint angle is in turns", f'unit = "turn" under [{link}]'
    both = f'unit = "deg" and {side} under [{motor}]'
    yield _DEGREE, "degrees", "the motor angle is in degrees and at joint scale", both
    both = f'{side} under [{motor}] and unit = "deg" under [{link}]'
    yield 1 / _DEGREE, "degrees", "the motor angle is at joint scale and the joint angle in degrees", both


def rates(log: Log, channels: Mapping[str, Channel], joint: int) -> list[Finding]:
    """Logged velocities against the derivative of the position of the same side."""
    findings: list[Finding] = []
    for side in ("motor", "joint"):
        position, velocity = f"{side}_position_{joint}", f"{side}_velocity_{joint}"
        if position not in channels or velocity not in channels or not channels[position].moves:
            continue
        grid = even(log.time)
        rate, logged = grid.rate(grid.smooth(log[position])), grid.smooth(log[velocity])
        if np.std(logged) > 0:
            findings += _same(rate, logged, velocity, position, "/s", joint)
    return findings


def reference(log: Log, channels: Mapping[str, Channel], joint: int) -> list[Finding]:
    """The reference against the joint's position."""
    position, reference = f"joint_position_{joint}", f"joint_position_reference_{joint}"
    if position not in channels or reference not in channels or not channels[position].moves:
        return []
    if not channels[reference].moves:
        return []
    return _same(log[position], log[reference], reference, position, "", joint)


def _same(expected: np.ndarray, found: np.ndarray, name: str, position: str, per: str, joint: int) -> list[Finding]:
    """A finding where ``found`` follows ``expected``, from ``position``, but reversed or in degrees; or not at all."""
    slope, correlation = relation(expected, found)
    other = f"the derivative of {position}" if per else position
    if abs(correlation) < 0.7:
        sentence = (
            f"{name} hardly follows {other} (correlation {correlation:.2f}): another joint's? "
            "Then correct 'from' in columns.toml."
        )
        return [Finding(Severity.WARN, "unrelated", joint, sentence)]
    for factor, finding, what, repair in (
        (-1.0, "reversed", "reversed", f"sign = -1 under [{name}]"),
        (_DEGREE, "degrees", "in degrees", f'unit = "deg{per}" under [{name}]'),
        (1 / _DEGREE, "degrees", "the position is in degrees", f'unit = "deg" under [{position}]'),
    ):
        if abs(slope / factor - 1) < 0.25:
            sentence = f"{name} is {slope:.3g} times {other}: {what}; set {repair} in columns.toml."
            return [Finding(Severity.REFUSE, finding, joint, sentence)]
    if not 0.5 < slope < 2:
        sentence = f"{name} is {slope:.3g} times {other}: another unit or another joint's; correct columns.toml."
        return [Finding(Severity.WARN, "units", joint, sentence)]
    return []


def swapped_encoders(log: Log, channels: Mapping[str, Channel], sound: list[int]) -> list[Finding]:
    """Pairs of joints in ``sound`` whose motor encoder follows the other one's joint encoder."""
    joints = [
        j
        for j in sound
        if all(name in channels and channels[name].moves for name in (f"motor_position_{j}", f"joint_position_{j}"))
    ]
    follows = {
        (i, j): abs(relation(log[f"joint_position_{j}"], log[f"motor_position_{i}"])[1]) for i in joints for j in joints
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
