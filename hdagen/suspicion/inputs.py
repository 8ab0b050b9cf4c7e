"""Mistakes that currents and torques give away: milliamperes, a reversed sign, swapped joints, a shifted row."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hdagen.channels import Channel, even, moves, relation
from hdagen.log import Log
from hdagen.suspicion.finding import Finding, Machine, Severity

PAIRS = (("motor_current_command", "motor_current"), ("motor_torque_command", "motor_torque"))  # commanded, measured
INPUTS = tuple(base for pair in PAIRS for base in pair)
_LONGEST_LAG = 0.1  # s, searched between command and measurement
_EARLIEST = -5  # rows
_UNSTATED_CURRENT = 200.0  # A; above it, unless the robot file states such a drive, currents are in mA


@dataclass(frozen=True, eq=False)
class Motion:
    """How the joints move, smoothed, on an even grid: each (n, T); joints whose position is not usable are left out."""

    joints: tuple[int, ...]
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray


def current_sizes(channels: Mapping[str, Channel], machine: Machine) -> list[Finding]:
    """Currents beyond what the drive can give: milliamperes."""
    findings = []
    for joint, stated in enumerate(machine.max_currents, start=1):
        for name in (f"motor_current_command_{joint}", f"motor_current_{joint}"):
            if name not in channels:
                continue
            peak = max(abs(channels[name].low), abs(channels[name].high))
            if peak > (10 * stated if stated else _UNSTATED_CURRENT):
                known = (
                    f"the robot file states at most {stated:g} A" if stated else "the robot file states no max_current"
                )
                sentence = (
                    f'{name} reaches {peak:.4g}, {known}: mA? Then set unit = "mA" under [{name}] in columns.toml.'
                )
                findings.append(Finding(Severity.REFUSE, "milliamperes", joint, sentence))
    return findings


@dataclass(frozen=True)
class Lag:
    """A measured input against its command: the lag that fits best, in ``rows`` and, more finely, in ``seconds``.

    ``slope`` is measured over commanded there; ``misfit`` the share of variance that is not explained at that lag, and
    ``usual`` that at a lag of one row, which a drive without delay has.
    """

    rows: int
    seconds: float
    slope: float
    misfit: float
    usual: float


def lag(command: np.ndarray, measured: np.ndarray, period: float) -> Lag | None:
    """The lag between two channels (T,) of rows ``period`` s apart; None where they do not correlate or hardly vary."""
    latest = max(10, round(_LONGEST_LAG / period))
    if len(command) < 4 * latest or np.ptp(command) == 0 or np.ptp(measured) == 0:
        return None
    inner = command[-_EARLIEST : len(command) - latest]
    if np.ptp(inner) == 0:
        return None
    lags = range(_EARLIEST, latest + 1)
    slopes, misfits = [], []
    for rows in lags:
        later = measured[rows - _EARLIEST : rows - _EARLIEST + len(inner)]
        if np.ptp(later) == 0:
            return None
        slope, correlation = relation(inner, later)
        slopes.append(slope)
        misfits.append(max(0.0, 1 - correlation**2))
    best = int(np.argmin(misfits))
    if misfits[best] > 0.5:
        return None
    vertex = 0.0
    if 0 < best < len(misfits) - 1:
        left, middle, right = misfits[best - 1 : best + 2]
        vertex = 0.5 * (left - right) / (left - 2 * middle + right) if left + right > 2 * middle else 0.0
    return Lag(lags[best], (lags[best] + vertex) * period, slopes[best], misfits[best], misfits[1 - _EARLIEST])


def lags(log: Log) -> dict[str, Lag]:
    """The lag of each measured current or torque behind its command, by the measured channel's name."""
    found = {}
    for commanded, measured in PAIRS:
        for joint in range(1, log.n_joints + 1):
            names = f"{commanded}_{joint}", f"{measured}_{joint}"
            if all(name in log for name in names):
                one = lag(log[names[0]], log[names[1]], log.period)
                if one is not None:
                    found[names[1]] = one
    return found


def measured_against_command(log: Log, found: Mapping[str, Lag], machine: Machine) -> list[Finding]:
    """Scale of a measured channel against its command, and the row in which it shows it."""
    findings = []
    for commanded, measured in PAIRS:
        for joint in range(1, log.n_joints + 1):
            command, name = f"{commanded}_{joint}", f"{measured}_{joint}"
            if name in found:
                findings += _scale(found[name], command, name, machine.ratios[joint - 1], joint)
                findings += _row(log, found[name], command, name, joint)
    return findings


def _scale(one: Lag, command: str, name: str, ratio: float, joint: int) -> list[Finding]:
    says = f"{name} is {one.slope:.4g} times its command"
    for factor, what, who in ((1e3, "mA against A", name), (1e-3, "A against mA", command)):
        if 0.5 < one.slope / factor < 2 and "current" in name:
            sentence = f'{says}: {what}; set unit = "mA" under [{who}] in columns.toml.'
            return [Finding(Severity.REFUSE, "milliamperes", joint, sentence)]
    for factor, who in ((ratio, name), (1 / ratio, command)):
        if "torque" in name and ratio > 3 and 0.8 < one.slope / factor < 1.25:
            repair = f"joint_side_ratio = {ratio:g} under [{who}]"
            sentence = f"{says}, the ratio: one of them is at the joint; set {repair} in columns.toml."
            return [Finding(Severity.REFUSE, "joint_scale", joint, sentence)]
    if one.slope > 0 and not 0.3 < one.slope < 3:
        sentence = f"{says}: another unit, or a drive that does not follow; give the unit in columns.toml."
        return [Finding(Severity.WARN, "units", joint, sentence)]
    return []


def _row(log: Log, one: Lag, command: str, name: str, joint: int) -> list[Finding]:
    """A command is held from its row to the next: the measurement cannot show it before the next row."""
    if np.array_equal(log[command], log[name]):
        sentence = (
            f"{name} equals {command} in every row: the command under another name, not a measurement; leave it out, "
            f'ignore = ["{name}"] in columns.toml.'
        )
        return [Finding(Severity.REFUSE, "row_shift", joint, sentence)]
    if one.rows <= 0 and one.misfit < 0.9 * one.usual:
        early = 1 - one.rows
        sentence = (
            f"{name} shows in row k the command of row {f'k+{-one.rows}' if one.rows else 'k'}, before it acts: "
            f"shifted; set shift_rows = {-early} under [{command}] (logged late), or = {early} under [{name}] "
            "(logged early), in columns.toml."
        )
        return [Finding(Severity.REFUSE, "row_shift", joint, sentence)]
    if one.rows == 2 and one.misfit < 0.8 * one.usual:
        sentence = (
            f"{name} shows in row k the command of row k-2: the command is logged a row early, or the drive takes a "
            f"period more; if it is the log, set shift_rows = 1 under [{command}] in columns.toml."
        )
        return [Finding(Severity.WARN, "row_shift", joint, sentence)]
    return []


def motion(log: Log, channels: Mapping[str, Channel], ratios: tuple[float, ...], sound: list[int]) -> Motion:
    """Smoothed position, velocity and acceleration of the joints in ``sound`` that move."""
    grid = even(log.time)
    used, positions = [], []
    for joint in sound:
        for name, scale in ((f"joint_position_{joint}", 1.0), (f"motor_position_{joint}", 1 / ratios[joint - 1])):
            if name in channels and moves(channels[name]):
                used.append(joint)
                positions.append(scale * grid.smooth(log[name]))
                break
    velocities = [grid.rate(position) for position in positions]
    accelerations = [grid.rate(velocity) for velocity in velocities]
    return Motion(tuple(used), np.array(positions), np.array(velocities), np.array(accelerations))


def swapped_inputs(log: Log, channels: Mapping[str, Channel], moving: Motion) -> list[Finding]:
    """Pairs of joints whose current or torque is explained by the other one's motion, and not by their own."""
    findings: list[Finding] = []
    grid = even(log.time)
    for base in INPUTS:
        driven = [j for j in moving.joints if f"{base}_{j}" in channels and not channels[f"{base}_{j}"].constant]
        share = {}
        for i in driven:
            values = grid.smooth(log[f"{base}_{i}"])[:: grid.width]
            for j in driven:
                one = moving.joints.index(j)
                terms = _terms(moving, one, [one], grid.width)
                share[i, j] = 1 - np.var(values - terms @ _solve(terms, values)) / max(np.var(values), 1e-300)
        for i, j in share:
            crossed, own = (1 - share[i, j], 1 - share[j, i]), (1 - share[i, i], 1 - share[j, j])  # not explained
            if i < j and max(crossed) < 0.3 and all(c < 0.35 * o for c, o in zip(crossed, own, strict=True)):
                shares = f"explains {100 * share[i, j]:.0f} %, that of joint {i} {100 * share[i, i]:.0f} %"
                sentence = (
                    f"{base}_{i} goes with the motion of joint {j} ({shares}) and {base}_{j} with that of joint {i}: "
                    "swapped; exchange their 'from' in columns.toml, or those of the encoders."
                )
                findings += [Finding(Severity.REFUSE, "swapped", joint, sentence) for joint in (i, j)]
    return findings


def signs(log: Log, channels: Mapping[str, Channel], moving: Motion, found: Mapping[str, Lag]) -> list[Finding]:
    """Inputs that accelerate their joint backwards and take power out of a machine that only loses it: reversed."""
    findings = []
    grid = even(log.time)
    for one, joint in enumerate(moving.joints):
        terms = _terms(moving, one, list(range(len(moving.joints))), grid.width)
        velocity = moving.velocity[one][:: grid.width]
        for base in INPUTS:
            name = f"{base}_{joint}"
            if name not in channels or channels[name].constant or len(velocity) < 5 * terms.shape[1]:
                continue
            values = grid.smooth(log[name])[:: grid.width]
            inertia = _t_value(terms, values, one)
            power = float(np.mean(values * velocity) / max(np.std(values) * np.std(velocity), 1e-300))
            against = found[name].slope < 0 if name in found else False
            says = (
                f"{name} pushes against the motion (inertia {inertia:.0f} standard deviations below zero, mean power "
                f"{power:.2f} of the largest possible)"
            )
            repair = f"set sign = -1 under [{name}] in columns.toml, or under both positions of joint {joint}"
            if inertia < -5 and power < -0.03:
                findings.append(Finding(Severity.REFUSE, "reversed", joint, f"{says}: its sign is reversed; {repair}."))
            elif inertia < -5 and not against:
                sentence = f"{says}: is its sign reversed? If so, {repair}."
                findings.append(Finding(Severity.WARN, "reversed", joint, sentence))
    refused = {finding.joint for finding in findings if finding.severity is Severity.REFUSE}
    for name, pair in found.items():
        joint = int(name.rpartition("_")[2])
        if pair.slope < 0 and joint not in refused:
            sentence = (
                f"{name} is {pair.slope:.3g} times its command: one of the two is reversed; set sign = -1 under it, "
                "whichever it is, in columns.toml."
            )
            findings.append(Finding(Severity.REFUSE, "reversed", joint, sentence))
    return findings


def _terms(moving: Motion, one: int, accelerating: list[int], every: int) -> np.ndarray:
    """What the input of a joint is made of, (rows, terms), each of unit size.

    The accelerations of ``accelerating`` first, then viscous and Coulomb friction, a constant, a spring, and gravity on
    the joint and on the links beyond.
    """
    velocity, position = moving.velocity[one], moving.position[one]
    slow = max(0.05 * float(np.quantile(np.abs(velocity), 0.9)), 1e-12)
    terms = [moving.acceleration[k] for k in accelerating]
    terms += [velocity, np.tanh(velocity / slow), np.ones_like(velocity), position]
    for angle in np.cumsum(moving.position, axis=0)[one:]:
        terms += [np.sin(angle), np.cos(angle)]
    matrix = np.array(terms).T[::every]
    return matrix / np.maximum(np.abs(matrix).max(axis=0), 1e-300)


def _solve(terms: np.ndarray, values: np.ndarray) -> np.ndarray:
    return np.linalg.lstsq(terms, values, rcond=1e-8)[0]


def _t_value(terms: np.ndarray, values: np.ndarray, column: int) -> float:
    """A coefficient of the least-squares fit in standard deviations of its own."""
    coefficients = _solve(terms, values)
    variance = np.var(values - terms @ coefficients)
    spread = math.sqrt(max(variance * np.linalg.pinv(terms.T @ terms, rcond=1e-12)[column, column], 1e-300))
    return float(coefficients[column] / spread)
