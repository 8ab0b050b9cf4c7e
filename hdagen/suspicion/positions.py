"""Mistakes that positions give away: an encoder that wraps, units, signs, the gear's wrong side, swapped joints."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from hdagen.channels import Channel, even, relation
from hdagen.columns import split_name
from hdagen.determined import is_determined
from hdagen.log import Log, gaps
from hdagen.suspicion.finding import Finding, Machine, Severity, in_words
from hdagen.suspicion.misread import Place, after_gaps, wrapping

_DEGREE = 180 / math.pi
_TWICE = 1.7, 3.3  # times the usual move of a row where one or two rows before it were lost
_LOST = 0.003  # share of rows
_FOLLOWS = 0.95  # correlation from which a position follows a reference
_RELATED, _CLOSE = 0.7, 0.9  # correlation of a velocity with a derivative, from which it is its own; of a good one
_PLAIN = 10.0, 100.0, 1000.0, 60.0, 2 * math.pi, 30 / math.pi  # factors between units
_PLAINLY = 1.02  # times such a factor, that count as it
_TURNS = 25.0  # rad; a joint that spans more turns like a wheel, or is logged in degrees


def jumps(log: Log, channels: Mapping[str, Channel]) -> list[Finding]:
    """Measured positions that leap in one row, and stay where they are then: a wrapped encoder, or one set anew."""
    findings = []
    gap = after_gaps(log.time)
    for name, channel in channels.items():
        base, joint = split_name(name) or ("", 0)
        if base not in ("motor_position", "joint_position") or not channel.moves or len(log) < 10:
            continue
        place = Place.of(channel, log[name], gap)
        if not len(place.leaping):
            continue
        rows, jumps = place.leaping - 1, place.off[1:]
        size, row = float(np.median(np.abs(jumps[rows]))), int(rows[0])
        where = (
            f"{name} jumps by {size:.5g} in one row, {len(rows)} time(s), first after row {row + 1} "
            f"({log.time[row]:.6g} s)"
        )
        period = wrapping(size)
        if period is not None:
            unit = {360.0: {"unit": "deg"}, 1.0: {"unit": "turn"}}.get(period, {})
            repair = {name: {"wrap": period, **unit}}
            sentence = f"{where}: an encoder that wraps at {period:.5g}; set {in_words(repair)} in columns.toml."
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


def lost_rows(log: Log, channels: Mapping[str, Channel]) -> list[Finding]:
    """Rows in which all moving positions go two or three times as far as in the rows around, though time says nothing:
    rows were lost before they were numbered."""
    ratios = []
    whole = np.ones(len(log) - 1, bool)
    whole[gaps(log.time)[0]] = False
    for name, channel in channels.items():
        base = (split_name(name) or ("", 0))[0]
        if base not in ("motor_position", "joint_position") or not channel.moves or len(log) < 100:
            continue
        moves = np.diff(log[name])
        usual = np.median(np.lib.stride_tricks.sliding_window_view(np.pad(moves, 3, mode="edge"), 7), axis=1)
        fast = (np.abs(usual) > 10 * channel.noise) & whole
        ratios.append(np.where(fast, moves / np.where(fast, usual, 1.0), np.nan))
    if not ratios:
        return []
    seen = np.isfinite(ratios).any(axis=0)
    low, high = (
        f(np.where(np.isfinite(ratios), ratios, default), axis=0) for f, default in ((np.min, 9.0), (np.max, -9.0))
    )
    double = seen & (low > _TWICE[0]) & (high < _TWICE[1])
    opposite = seen & (low > -_TWICE[1] + 2) & (high < 2 - _TWICE[0])  # as far off to the other side: a shaky motion
    lost, shaky = np.count_nonzero(double), np.count_nonzero(opposite)
    if lost < 5 or lost < _LOST * np.count_nonzero(seen) or lost < 5 * shaky:
        return []
    share, row = 100 * lost / np.count_nonzero(seen), int(np.flatnonzero(double)[0])
    sentence = (
        f"all positions move twice as far as usual in {share:.2g} % of the rows, first after row {row + 1} "
        f"({log.time[row]:.6g} s), and time runs on evenly: rows were lost and not counted; record the time at which "
        "each row was sampled."
    )
    return [Finding(Severity.REFUSE, "dropped", 0, sentence)]


def spans(channels: Mapping[str, Channel], machine: Machine, sound: list[int]) -> list[Finding]:
    """Joints in ``sound`` that span more than a joint can: degrees."""
    findings = []
    for joint, (prismatic, limits) in enumerate(zip(machine.prismatic, machine.position_limits, strict=True), start=1):
        name = f"joint_position_{joint}"
        if joint not in sound or name not in channels or prismatic:
            continue
        channel = channels[name]
        reach, span = max(abs(channel.low), abs(channel.high)), channel.high - channel.low
        degrees = {name: {"unit": "deg"}}
        repair = f"set {in_words(degrees)} in columns.toml"
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
        elif span > _TURNS:
            sentence = (
                f"{name} spans {span:.4g} rad, {span / (2 * math.pi):.3g} turns: degrees? Then {repair}; if it really "
                "turns, state limits.position in the robot file."
            )
            findings.append(Finding(Severity.REFUSE, "degrees", joint, sentence, degrees))
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
            degrees = {name: {"unit": "deg"}}
            sentence = f"{says}: degrees; set {in_words(degrees)} in columns.toml."
            findings.append(Finding(Severity.REFUSE, "degrees", joint, sentence, degrees))
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
            does = in_words(repair) or f"sign = -1 under [{motor}] or [{link}]"
            return [Finding(Severity.REFUSE, name, joint, f"{says}; set {does} in columns.toml.", repair)]
    sentence = (
        f"{motor} moves {slope:.4g} times as far as {link}, and the robot file states the ratio {ratio:g}: the file of "
        "another robot, or a unit to give in columns.toml."
    )
    return [Finding(Severity.REFUSE, "ratio", joint, sentence)]


Explanation = tuple[float, str, str, dict[str, dict[str, Any]]]


def _explanations(ratio: float, motor: str, link: str, prismatic: bool) -> Iterator[Explanation]:
    """Slopes of motor over joint position that a mistake gives: the slope, the finding, what it is, and its repair."""
    side, degrees = {"joint_side_ratio": ratio}, {"unit": "deg"}
    yield -ratio, "reversed", "one of them is reversed", {}
    yield 1.0, "joint_scale", "the motor angle is logged at joint scale", {motor: side}
    yield -1.0, "joint_scale", "the motor angle is at joint scale and reversed", {motor: {**side, "sign": -1}}
    yield ratio * _DEGREE, "degrees", "the motor angle is in degrees", {motor: degrees}
    yield ratio / (2 * math.pi), "units", "the motor angle is in turns", {motor: {"unit": "turn"}}
    if prismatic:
        yield ratio / 1000, "units", "the joint position is in mm", {link: {"unit": "mm"}}
        return
    yield ratio / _DEGREE, "degrees", "the joint angle is in degrees", {link: degrees}
    yield ratio * 2 * math.pi, "units", "the joint angle is in turns", {link: {"unit": "turn"}}
    both = "the motor angle is in degrees and at joint scale"
    yield _DEGREE, "degrees", both, {motor: {**degrees, **side}}
    both = "the motor angle is at joint scale and the joint angle in degrees"
    yield 1 / _DEGREE, "degrees", both, {motor: side, link: degrees}


def rates(log: Log, channels: Mapping[str, Channel], machine: Machine, joint: int) -> list[Finding]:
    """Logged velocities against the derivative of the position of the same side: one that contradicts it is to be left
    out, or scaled where the factor is plain."""
    findings: list[Finding] = []
    for side in ("motor", "joint"):
        position, velocity = f"{side}_position_{joint}", f"{side}_velocity_{joint}"
        if position not in channels or velocity not in channels or not channels[position].moves:
            continue
        grid = even(log.time)
        rate, logged = grid.rate(grid.smooth(log[position])), grid.smooth(log[velocity])
        if np.std(logged) > 0:
            same = _same(rate, logged, velocity, position, "/s", joint)
            refused = [finding for finding in same if finding.severity is Severity.REFUSE]
            plain = (*_PLAIN, machine.ratios[joint - 1])
            findings += refused or _contradicted(relation(rate, logged), velocity, position, plain, joint)
    return findings


def _contradicted(
    related: tuple[float, float], velocity: str, position: str, plain: tuple[float, ...], joint: int
) -> list[Finding]:
    """A finding where a velocity is not the derivative of its position, ``related`` by slope and correlation. Noise of
    the derivative makes the slope smaller, by the square of the correlation at most."""
    slope, correlation = related
    most = 1.25 if correlation > _CLOSE else 2.0
    if correlation >= _RELATED and 1 / most < slope < most:
        return []
    factor = next((f for one in plain for f in (one, 1 / one) if 1 / _PLAINLY < slope / f < _PLAINLY), None)
    repair: dict[str, Any] = {"ignore": [velocity]}
    if factor is not None and correlation > _CLOSE:
        repair = {velocity: {"scale": float(f"{1 / factor:.9g}")}}
    sentence = (
        f"{velocity} contradicts {position}: it is {slope:.3g} times its derivative (correlation {correlation:.2f}); "
        f"set {in_words(repair)} in columns.toml."
    )
    return [Finding(Severity.WARN, "contradicted", joint, sentence, repair)]


def reference(log: Log, channels: Mapping[str, Channel], joint: int) -> list[Finding]:
    """The reference against the joint's position. A weak drive does not reach it, which is no mistake: only that
    another joint follows it is worth a warning."""
    position, reference = f"joint_position_{joint}", f"joint_position_reference_{joint}"
    if position not in channels or reference not in channels or not channels[position].moves:
        return []
    if not channels[reference].moves:
        return []
    others = {
        name: abs(relation(log[name], log[reference])[1])
        for j in range(1, log.n_joints + 1)
        if j != joint and (name := f"joint_position_{j}") in channels and channels[name].moves
    }
    findings = _same(log[position], log[reference], reference, position, "", joint)
    if any(finding.name == "unrelated" for finding in findings) and max(others.values(), default=0.0) > _FOLLOWS:
        other = max(others, key=lambda name: others[name])
        sentence = (
            f"{reference} hardly follows {position} and does follow {other} (correlation {others[other]:.2f}): that "
            "joint's? Then correct 'from' in columns.toml."
        )
        return [Finding(Severity.WARN, "unrelated", joint, sentence)]
    return [Finding(Severity.NOTE, f.name, f.joint, f.sentence) if f.severity is Severity.WARN else f for f in findings]


def _same(expected: np.ndarray, found: np.ndarray, name: str, position: str, per: str, joint: int) -> list[Finding]:
    """A finding where ``found`` follows ``expected``, from ``position``, but reversed or in degrees; or not at all."""
    slope, correlation = relation(expected, found)
    other = f"the derivative of {position}" if per else position
    if abs(correlation) < 0.7:
        sentence = (
            f"{name} hardly follows {other} (correlation {correlation:.2f}): another joint's, or a drive that does not "
            "reach it; if it is another's, correct 'from' in columns.toml."
        )
        return [Finding(Severity.WARN, "unrelated", joint, sentence)]
    mistakes: tuple[Explanation, ...] = (
        (-1.0, "reversed", "reversed", {name: {"sign": -1}}),
        (_DEGREE, "degrees", "in degrees", {name: {"unit": f"deg{per}"}}),
        (1 / _DEGREE, "degrees", "the position is in degrees", {position: {"unit": "deg"}}),
    )
    for factor, finding, what, repair in mistakes:
        if 0.5 < slope / factor < 2:  # a reference that is badly followed is larger, and no other mistake is near
            sentence = f"{name} is {slope:.3g} times {other}: {what}; set {in_words(repair)} in columns.toml."
            return [Finding(Severity.REFUSE, finding, joint, sentence, repair)]
    if not 0.5 < slope < 2:
        sentence = (
            f"{name} is {slope:.3g} times {other}: another unit, another joint's, or a drive that does not reach it; "
            "correct columns.toml in the first cases."
        )
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


def skews(log: Log, channels: Mapping[str, Channel], machine: Machine, joints: list[int]) -> list[Finding]:
    """How much later the joint's encoder reads than the motor's, from the part of their difference that goes with
    speed. No mistake by itself: the diagnosis has it among its candidates."""
    found = {}
    for joint in joints:
        motor, link = f"motor_position_{joint}", f"joint_position_{joint}"
        if motor not in channels or link not in channels or not (channels[motor].moves and channels[link].moves):
            continue
        grid = even(log.time)
        position = grid.smooth(log[link])
        speed = grid.rate(position)
        twist = grid.smooth(log[motor] / machine.ratios[joint - 1] - log[link])
        slow = max(0.05 * float(np.quantile(np.abs(speed), 0.9)), 1e-12)
        terms = [speed, grid.rate(speed), np.tanh(speed / slow), position, np.ones_like(speed)]
        matrix = np.stack(terms, 1)[:: grid.width]
        if not is_determined(matrix):
            continue
        matrix /= np.abs(matrix).max(0)
        delay = np.linalg.lstsq(matrix, twist[:: grid.width], rcond=1e-9)[0][0] / np.abs(speed[:: grid.width]).max()
        if abs(delay) > log.period:
            found[joint] = float(delay)
    equal = len(found) == len(joints) > 1 and np.ptp(list(found.values())) < 0.2 * abs(np.mean(list(found.values())))
    why = " alike on all joints: the encoders' clocks differ" if equal else " a late encoder, or a joint that bends so"
    return [
        Finding(
            Severity.NOTE,
            "skew",
            joint,
            f"joint_position_{joint} reads {1e3 * abs(delay):.3g} ms {'later' if delay > 0 else 'earlier'} than "
            f"motor_position_{joint},{why}.",
        )
        for joint, delay in found.items()
    ]
