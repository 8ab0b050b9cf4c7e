"""Checks of an input against the motion that it makes: a reversed sign, swapped joints.

A fit explains the input by the joints' accelerations, the joint's own friction, a spring and gravity in the plane. In
any machine the joint's own inertia has a positive share, and friction takes power. In space, inertias and weights
change with the pose, which such a fit knows nothing of: there `inputs_vs_model` judges the sign.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hdagen.arm.compiled_arm import Arm
from hdagen.data_quality.finding import Finding, RobotFacts, Severity
from hdagen.data_quality.input_check_settings import INPUT_CHECK
from hdagen.data_quality.input_lags import INPUT_QUANTITIES
from hdagen.data_quality.log_profile import LogProfile, SmoothedMotion
from hdagen.data_quality.rank_check import is_determined


def smooth_sound_motion(profile: LogProfile, robot: RobotFacts) -> SmoothedMotion:
    """Smooth the motion of the joints whose encoders nothing speaks against.

    Args:
        profile: of the log.
        robot: its facts.

    Returns:
        The motion.

    """
    return profile.smooth_motion(robot.ratios, profile.list_sound_joints("wrapped", "jump", "swapped", "degrees"))


def find_swapped_inputs(profile: LogProfile, robot: RobotFacts, model: Arm | None) -> list[Finding]:
    """Find pairs of joints whose current or torque is explained by the other one's motion, and not by their own.

    Args:
        profile: of the log.
        robot: its facts.
        model: the robot file's, where there is one.

    Returns:
        The findings.

    """
    moving = smooth_sound_motion(profile, robot)
    return profile.compute_once(("swapped inputs", moving.joints), lambda: _find_swapped_pairs(profile, moving))


def _find_swapped_pairs(profile: LogProfile, moving: SmoothedMotion) -> list[Finding]:
    channels = profile.channels
    findings: list[Finding] = []
    for base in INPUT_QUANTITIES:
        driven = [j for j in moving.joints if f"{base}_{j}" in channels and not channels[f"{base}_{j}"].is_constant]
        left = {}  # share of the input of i that the motion of j does not explain
        for i in driven:
            values = profile.sample_channel(f"{base}_{i}")
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


def find_reversed_inputs(profile: LogProfile, robot: RobotFacts, model: Arm | None) -> list[Finding]:
    """Find reversed inputs: they accelerate their joint backwards and gain power from friction.

    Args:
        profile: of the log.
        robot: its facts.
        model: the robot file's, where there is one.

    Returns:
        The findings.

    """
    if find_swapped_inputs(profile, robot, model):
        return []
    findings = [] if robot.in_space else _find_backward_inputs(profile, smooth_sound_motion(profile, robot))
    refused = {finding.joint for finding in findings if finding.severity is Severity.REFUSE}
    for name, lag in profile.lags.items():
        joint = int(name.rpartition("_")[2])
        if lag.slope < 0 and joint not in refused:
            sentence = (
                f"{name} is {lag.slope:.3g} times its command: one of the two is reversed; set sign = -1 under it, "
                "whichever it is, in columns.toml."
            )
            findings.append(Finding(Severity.REFUSE, "reversed", joint, sentence))
    return findings


def _find_backward_inputs(profile: LogProfile, moving: SmoothedMotion) -> list[Finding]:
    """Inputs that push against the motion of an arm in the plane."""
    channels, findings = profile.channels, []
    for one, joint in enumerate(moving.joints):
        terms = _stack_motion_terms(moving, one, list(range(len(moving.joints))))
        for base in INPUT_QUANTITIES:
            name = f"{base}_{joint}"
            if name not in channels or channels[name].is_constant or not is_determined(terms):
                continue
            fit = _fit_terms(terms, profile.sample_channel(name))
            inertia, power = fit.standardized(one), _measure_friction_power(fit, terms, moving, one)
            says = (
                f"{name} pushes against the motion (the inertia it sees is {-inertia:.0f} standard deviations below "
                f"zero, its friction gives {-100 * power:.0f} % of the largest possible power)"
            )
            repair = f"set sign = -1 under [{name}] in columns.toml, or under both positions of joint {joint}"
            # reversed where inertia and friction's power are below zero, very clear in the one or clear in both
            sure = (inertia < INPUT_CHECK.sure_reversed_inertia and power < INPUT_CHECK.sure_reversed_power) or (
                inertia < INPUT_CHECK.likely_reversed_inertia and power < INPUT_CHECK.likely_reversed_power
            )
            if sure and fit.explained > INPUT_CHECK.least_explained:
                findings.append(Finding(Severity.REFUSE, "reversed", joint, f"{says}: its sign is reversed; {repair}."))
            elif sure:
                sentence = f"{says}: a reversed sign, or a hand that moved the arm? If it is the sign, {repair}."
                findings.append(Finding(Severity.WARN, "reversed", joint, sentence))
    return findings


def measure_delay_rows(profile: LogProfile, robot: RobotFacts) -> dict[str, float]:
    """Measure how many rows the motion is behind each input: the shift at which the fit explains the input best.

    It is about 0 for a measured input, and the drive's delay more for a command, within about two rows.

    Args:
        profile: of the log.
        robot: its facts.

    Returns:
        Rows by the input's name; inputs that the fit does not explain are left out.

    """
    moving = smooth_sound_motion(profile, robot)
    return profile.compute_once(("delay rows", moving.joints), lambda: _fit_delay_rows(profile, moving))


def _fit_delay_rows(profile: LogProfile, moving: SmoothedMotion) -> dict[str, float]:
    channels, found = profile.channels, {}
    for one, joint in enumerate(moving.joints):
        rows = np.arange(0, len(moving.grid.time), moving.grid.window_rows)
        kept = (rows >= INPUT_CHECK.most_delay_rows) & (rows < len(moving.grid.time) - INPUT_CHECK.most_delay_rows)
        terms = _stack_motion_terms(moving, one, list(range(len(moving.joints))))[kept]
        for name in (f"{base}_{joint}" for base in INPUT_QUANTITIES):
            if name not in channels or channels[name].is_constant or not is_determined(terms):
                continue
            smooth = profile.smooth_channel(name)
            misfits = [
                1 - _fit_terms(terms, smooth[rows[kept] - shift]).explained
                for shift in range(-INPUT_CHECK.most_delay_rows, INPUT_CHECK.most_delay_rows + 1)
            ]
            best = int(np.argmin(misfits))
            if misfits[best] < 1 - INPUT_CHECK.least_explained and 0 < best < 2 * INPUT_CHECK.most_delay_rows:
                found[name] = float(best - INPUT_CHECK.most_delay_rows)
    return found


def find_input_skews(profile: LogProfile, robot: RobotFacts, model: Arm | None) -> list[Finding]:
    """Find inputs that lag the motion on every joint: their clock and that of the positions differ.

    One joint alone may have a wall or a spring that looks alike.

    Args:
        profile: of the log.
        robot: its facts.
        model: the robot file's, where there is one.

    Returns:
        The findings.

    """
    found, findings = measure_delay_rows(profile, robot), []
    for base in INPUT_QUANTITIES:
        rows = {name: value for name, value in found.items() if name.rpartition("_")[0] == base}
        if rows and max(rows.values()) <= -INPUT_CHECK.least_rows_ahead:
            shift = round(sum(rows.values()) / len(rows))
            sentence = (
                f"the motion is {-1e3 * shift * profile.period:.2g} ms ahead of {', '.join(rows)}, which cannot be: "
                f"inputs and positions are not of the same instant; if that is the log, set shift_rows = {shift} under "
                "each in columns.toml."
            )
            findings.append(Finding(Severity.NOTE, "skew", 0, sentence))
    return findings


def measure_unexplained_input(
    profile: LogProfile, moving: SmoothedMotion, one: int, name: str, held: np.ndarray
) -> tuple[float, float] | None:
    """Measure how much more than an input's reading the motion requires in some rows.

    Args:
        profile: of the log.
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
    values = profile.sample_channel(name)
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
