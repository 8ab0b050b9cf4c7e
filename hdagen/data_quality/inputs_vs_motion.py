"""Checks of an input against the motion that it makes: a reversed sign, swapped joints.

A fit explains the input by the joints' accelerations, the joint's own friction, a spring and gravity. In any machine
the joint's own inertia has a positive share, and friction takes power.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hdagen.data_quality.finding import Finding, Severity
from hdagen.data_quality.inputs import INPUT_QUANTITIES, Lag
from hdagen.data_quality.rank_check import is_determined
from hdagen.log.channel_statistics import ChannelStatistics, UniformGrid, make_uniform_grid
from hdagen.log.measured_log import Log

# A sign is reversed where the inertia's share is this many standard deviations below zero and the power that friction
# takes this share of the largest possible, very clear in the one or clear in both, and the fit explains the input.
_SURE_INERTIA, _SURE_POWER = -20.0, -0.03
_LIKELY_INERTIA, _LIKELY_POWER = -5.0, -0.15
_LEAST_EXPLAINED = 0.8
_MOST_DELAY_ROWS = 12  # rows, searched between an input and the motion
_LEAST_ROWS_AHEAD = 4  # rows that the motion must be ahead of its input to be reported


@dataclass(frozen=True, eq=False)
class SmoothedMotion:
    """The smoothed motion of a log on an even grid; joints that do not move are left out.

    Position, velocity and acceleration are (n, T), in rad or m, and s.
    """

    grid: UniformGrid
    joints: tuple[int, ...]
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray

    def sample_column(self, log: Log, name: str) -> np.ndarray:
        """Sample a column as the terms of the fits are: smoothed, with one row a window.

        Args:
            log: with the column.
            name: of the column.

        Returns:
            Values (rows,) that are about independent.

        """
        return self.grid.smooth(log[name])[:: self.grid.window_rows]


def smooth_motion(
    log: Log, channels: Mapping[str, ChannelStatistics], ratios: tuple[float, ...], sound: list[int]
) -> SmoothedMotion:
    """Smooth the motion of joints, from the joint's encoder or, without one, the motor's.

    Args:
        log: with times in s.
        channels: statistics of its columns, by name.
        ratios: of the gears, one a joint.
        sound: numbers of the joints that count.

    Returns:
        The motion.

    """
    grid = make_uniform_grid(log.time)
    used, positions = [], []
    for joint in sound:
        for name, scale in ((f"joint_position_{joint}", 1.0), (f"motor_position_{joint}", 1 / ratios[joint - 1])):
            if name in channels and channels[name].is_moving:
                used.append(joint)
                positions.append(scale * grid.smooth(log[name]))
                break
    velocities = [grid.differentiate(position) for position in positions]
    accelerations = [grid.differentiate(velocity) for velocity in velocities]
    return SmoothedMotion(grid, tuple(used), np.array(positions), np.array(velocities), np.array(accelerations))


def find_swapped_inputs(log: Log, channels: Mapping[str, ChannelStatistics], moving: SmoothedMotion) -> list[Finding]:
    """Find pairs of joints whose current or torque is explained by the other one's motion, and not by their own.

    Args:
        log: to be checked.
        channels: statistics of its columns, by name.
        moving: its smoothed motion.

    Returns:
        The findings.

    """
    findings: list[Finding] = []
    for base in INPUT_QUANTITIES:
        driven = [j for j in moving.joints if f"{base}_{j}" in channels and not channels[f"{base}_{j}"].is_constant]
        left = {}  # share of the input of i that the motion of j does not explain
        for i in driven:
            values = moving.sample_column(log, f"{base}_{i}")
            for j in driven:
                one = moving.joints.index(j)
                terms = _stack_motion_terms(moving, one, [one])
                left[i, j] = 1.0
                if is_determined(terms):
                    left[i, j] = 1 - _fit_terms(terms, values).explained
        for i, j in left:
            crossed, own = (left[i, j], left[j, i]), (left[i, i], left[j, j])
            if i < j and max(crossed) < 0.3 and all(c < 0.35 * o for c, o in zip(crossed, own, strict=True)):
                shares = f"explains {100 - 100 * left[i, j]:.0f} %, that of joint {i} {100 - 100 * left[i, i]:.0f} %"
                sentence = (
                    f"{base}_{i} goes with the motion of joint {j} ({shares}) and {base}_{j} with that of joint {i}: "
                    "swapped; exchange their 'from' in columns.toml, or those of the encoders."
                )
                findings += [Finding(Severity.REFUSE, "swapped", joint, sentence) for joint in (i, j)]
    return findings


def find_reversed_inputs(
    log: Log, channels: Mapping[str, ChannelStatistics], moving: SmoothedMotion, lags: Mapping[str, Lag]
) -> list[Finding]:
    """Find reversed inputs: they accelerate their joint backwards and gain power from friction.

    Args:
        log: to be checked.
        channels: statistics of its columns, by name.
        moving: its smoothed motion.
        lags: of measured inputs behind their commands, by name.

    Returns:
        The findings.

    """
    findings = []
    for one, joint in enumerate(moving.joints):
        terms = _stack_motion_terms(moving, one, list(range(len(moving.joints))))
        for base in INPUT_QUANTITIES:
            name = f"{base}_{joint}"
            if name not in channels or channels[name].is_constant or not is_determined(terms):
                continue
            fit = _fit_terms(terms, moving.sample_column(log, name))
            inertia, power = fit.standardized(one), _measure_friction_power(fit, terms, moving, one)
            says = (
                f"{name} pushes against the motion (the inertia it sees is {-inertia:.0f} standard deviations below "
                f"zero, its friction gives {-100 * power:.0f} % of the largest possible power)"
            )
            repair = f"set sign = -1 under [{name}] in columns.toml, or under both positions of joint {joint}"
            sure = (inertia < _SURE_INERTIA and power < _SURE_POWER) or (
                inertia < _LIKELY_INERTIA and power < _LIKELY_POWER
            )
            if sure and fit.explained > _LEAST_EXPLAINED:
                findings.append(Finding(Severity.REFUSE, "reversed", joint, f"{says}: its sign is reversed; {repair}."))
            elif sure:
                sentence = f"{says}: a reversed sign, or a hand that moved the arm? If it is the sign, {repair}."
                findings.append(Finding(Severity.WARN, "reversed", joint, sentence))
    refused = {finding.joint for finding in findings if finding.severity is Severity.REFUSE}
    for name, lag in lags.items():
        joint = int(name.rpartition("_")[2])
        if lag.slope < 0 and joint not in refused:
            sentence = (
                f"{name} is {lag.slope:.3g} times its command: one of the two is reversed; set sign = -1 under it, "
                "whichever it is, in columns.toml."
            )
            findings.append(Finding(Severity.REFUSE, "reversed", joint, sentence))
    return findings


def measure_delay_rows(log: Log, channels: Mapping[str, ChannelStatistics], moving: SmoothedMotion) -> dict[str, float]:
    """Measure how many rows the motion is behind each input: the shift at which the fit explains the input best.

    It is about 0 for a measured input, and the drive's delay more for a command, within about two rows.

    Args:
        log: to be checked.
        channels: statistics of its columns, by name.
        moving: its smoothed motion.

    Returns:
        Rows by the input's name; inputs that the fit does not explain are left out.

    """
    found = {}
    for one, joint in enumerate(moving.joints):
        rows = np.arange(0, len(moving.grid.time), moving.grid.window_rows)
        kept = (rows >= _MOST_DELAY_ROWS) & (rows < len(moving.grid.time) - _MOST_DELAY_ROWS)
        terms = _stack_motion_terms(moving, one, list(range(len(moving.joints))))[kept]
        for name in (f"{base}_{joint}" for base in INPUT_QUANTITIES):
            if name not in channels or channels[name].is_constant or not is_determined(terms):
                continue
            smooth = moving.grid.smooth(log[name])
            misfits = [
                1 - _fit_terms(terms, smooth[rows[kept] - shift]).explained
                for shift in range(-_MOST_DELAY_ROWS, _MOST_DELAY_ROWS + 1)
            ]
            best = int(np.argmin(misfits))
            if misfits[best] < 1 - _LEAST_EXPLAINED and 0 < best < 2 * _MOST_DELAY_ROWS:
                found[name] = float(best - _MOST_DELAY_ROWS)
    return found


def find_input_skews(found: Mapping[str, float], period: float) -> list[Finding]:
    """Find inputs that lag the motion on every joint: their clock and that of the positions differ.

    One joint alone may have a wall or a spring that looks alike.

    Args:
        found: rows that the motion is behind each input, by name, as `measure_delay_rows` measures them.
        period: of the rows, s.

    Returns:
        The findings.

    """
    findings = []
    for base in INPUT_QUANTITIES:
        rows = {name: value for name, value in found.items() if name.rpartition("_")[0] == base}
        if rows and max(rows.values()) <= -_LEAST_ROWS_AHEAD:
            shift = round(sum(rows.values()) / len(rows))
            sentence = (
                f"the motion is {-1e3 * shift * period:.2g} ms ahead of {', '.join(rows)}, which cannot be: inputs and "
                f"positions are not of the same instant; if that is the log, set shift_rows = {shift} under each in "
                "columns.toml."
            )
            findings.append(Finding(Severity.NOTE, "skew", 0, sentence))
    return findings


def measure_unexplained_input(
    log: Log, moving: SmoothedMotion, one: int, name: str, held: np.ndarray
) -> tuple[float, float] | None:
    """Measure how much more than an input's reading the motion requires in some rows.

    Args:
        log: to be checked.
        moving: its smoothed motion.
        one: place of the joint in the motion.
        name: of the input.
        held: mask (T,) of the rows; the fit is made in the others.

    Returns:
        The median excess, away from 0, and the root mean square error of the fit, both in the input's unit. None where
        rows of either kind are too few.

    """
    terms = _stack_motion_terms(moving, one, list(range(len(moving.joints))))
    share = moving.grid.smooth(held.astype(float))[:: moving.grid.window_rows]
    values = moving.sample_column(log, name)
    inside, outside = share > 0.99, share < 0.01
    if np.count_nonzero(inside) < 3 or not is_determined(terms[outside]):
        return None
    fit = _fit_terms(terms[outside], values[outside])
    beyond = (terms[inside] @ fit.coefficients - values[inside]) * np.sign(values[inside])
    return float(np.median(beyond)), fit.size * math.sqrt(max(1 - fit.explained, 0.0))


def _stack_motion_terms(moving: SmoothedMotion, one: int, accelerating: list[int]) -> np.ndarray:
    """The terms that can explain the input of the joint at index ``one``, (rows, terms), each of unit size.

    The accelerations of ``accelerating`` first, then viscous and Coulomb friction, a constant, a spring, and gravity on
    the joint's own link and on those beyond.
    """
    velocity, position = moving.velocity[one], moving.position[one]
    slow = max(0.05 * float(np.quantile(np.abs(velocity), 0.9)), 1e-12)
    terms = [moving.acceleration[k] for k in accelerating]
    terms += [velocity, np.tanh(velocity / slow), np.ones_like(velocity), position]
    for angle in np.cumsum(moving.position, axis=0)[one:]:
        terms += [np.sin(angle), np.cos(angle)]
    matrix = np.array(terms).T[:: moving.grid.window_rows]
    return matrix / np.maximum(np.abs(matrix).max(axis=0), 1e-300)


@dataclass(frozen=True, eq=False)
class _LeastSquares:
    """A least-squares fit: the coefficients, their covariance, and the share of the variance that it explains."""

    coefficients: np.ndarray
    covariance: np.ndarray
    explained: float
    size: float  # standard deviation of the fitted values

    def standardized(self, term: int) -> float:
        """A coefficient in standard deviations of its own."""
        return float(self.coefficients[term] / math.sqrt(max(self.covariance[term, term], 1e-300)))


def _fit_terms(terms: np.ndarray, values: np.ndarray) -> _LeastSquares:
    """Fit ``values`` (rows,) by ``terms`` (rows, terms)."""
    coefficients = np.linalg.lstsq(terms, values, rcond=1e-8)[0]
    left, all_ = float(np.var(values - terms @ coefficients)), float(np.var(values))
    covariance = left * np.linalg.pinv(terms.T @ terms, rcond=1e-12)
    return _LeastSquares(coefficients, covariance, 1 - left / max(all_, 1e-300), math.sqrt(all_))


def _measure_friction_power(fit: _LeastSquares, terms: np.ndarray, moving: SmoothedMotion, one: int) -> float:
    """The mean power that the fitted friction takes, as a share of the largest possible."""
    friction = slice(len(moving.joints), len(moving.joints) + 2)
    velocity = moving.velocity[one][:: moving.grid.window_rows]
    taken = float(np.mean((terms[:, friction] @ fit.coefficients[friction]) * velocity))
    return taken / max(fit.size * float(np.std(velocity)), 1e-300)
