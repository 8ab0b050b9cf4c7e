"""Gauss-Newton steps of a hypothesis with its sensitivities kept.

Source: Marquardt, J. Soc. Indust. Appl. Math. 11 (1963) 431 (steps limited to where the linear model holds).
Legend: θ parameters in typical sizes (P); s size of unexplained torque; W windows, m positions and velocities.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hdagen.arm.arrays import Array
from hdagen.diagnosis.inference.candidate_priors import Candidate, CandidateSet
from hdagen.diagnosis.inference.candidate_settings import CANDIDATES
from hdagen.diagnosis.inference.fit_settings import FIT
from hdagen.diagnosis.inference.linear_model import LinearModel
from hdagen.diagnosis.inference.marginal_likelihood import ScoredHypothesis, solve_with_scales
from hdagen.diagnosis.inference.parameter_scale import is_scale_free
from hdagen.diagnosis.inference.sensitivities import OperatingPoint, Sensitivities

TRUST_RADII = (np.inf, *FIT.trust_radii)


def descend_gauss_newton(
    at: Sensitivities, atoms: tuple[int, ...], lead: ScoredHypothesis, share: float
) -> Sensitivities:
    """Take Gauss-Newton steps towards the mode of a hypothesis, with the columns kept. A direction that the columns
    hardly determine is a valley along which a full step would go much too far, so the trust radius limits each step.

    Args:
        at: design with the hypothesis' columns.
        atoms: places of its candidates.
        lead: its score, with the size of unexplained torque.
        share: of that torque, that the steps allow.

    Returns:
        The design at the last point; ``at`` itself where no step helped.

    """
    candidates, s, prior = at.candidates, share * lead.posterior.s, compute_hypothesis_widths(at, atoms)
    at = _restart_bad_windows(at, s)
    bounds, linear = candidates.theta_bounds(at.shooting.arm), at.linear_model()
    cost = linear.cost(s, prior)
    for _ in range(FIT.most_chord_steps):
        best = cost, at, linear
        for reach in TRUST_RADII:
            theta = solve_with_scales(linear, prior, s, bounds, reach).mean
            promised = cost - linear.normal_equations(s).cost(theta, prior)
            trial, there = try_point(at, linear, s, move_to_theta(at, linear, s, theta))
            value = there.cost(s, prior)
            worse = best[0] <= value
            if not worse:
                best = value, trial, there
            if cost - value >= FIT.least_step_ratio * promised or (worse and best[1] is not at):
                break
        gain, (cost, at, linear) = cost - best[0], best
        if gain < FIT.least_evidence_step:
            break
    return at


def _restart_bad_windows(at: Sensitivities, s: float) -> Sensitivities:
    """Restart badly predicted windows from the measured states, where that is better. Small steps cannot move an
    initial state to the other side of a reversal or of backlash."""
    linear = at.linear_model()
    kept, left = at.shooting.record.selected_windows, linear.chi2(s)
    far = left > FIT.bad_window_ratio * linear.normal_equations(s).degrees_of_freedom
    if not far.any():
        return at
    begun, bad = at.point.initial_states.copy(), kept[far]
    begun[bad] = at.shooting.filtered_initial_states(at.point.p, bad)[bad]
    again = at.at_point(at.point.with_initial_states(begun)).linear_model()
    stays = again.chi2(s) > left - FIT.largest_chi2_rise
    begun[kept[stays]] = at.point.initial_states[kept[stays]]
    return at.at_point(at.point.with_initial_states(begun)) if (far & ~stays).any() else at


def move_to_theta(at: Sensitivities, linear: LinearModel, s: float, theta: Array) -> OperatingPoint:
    """Return the point at θ, with each window's initial state at its optimum for that θ.

    Args:
        at: design with its point.
        linear: its linear model.
        s: size of unexplained torque.
        theta: θ (P).

    """
    begun = at.point.initial_states.copy()
    begun[at.shooting.record.selected_windows] += linear.solve_inner(s, theta)[0]
    return place_theta(at, theta, begun)


def try_point(
    at: Sensitivities, linear: LinearModel, s: float, point: OperatingPoint
) -> tuple[Sensitivities, LinearModel]:
    """Simulate a point. A window that its new initial state makes worse keeps the old one: where a joint sticks, or the
    simulation diverges, the columns say little.

    Args:
        at: design about the old point.
        linear: its linear model.
        s: size of unexplained torque.
        point: the new point.

    Returns:
        The design at the new point, and its linear model.

    """
    trial = at.at_point(point)
    there = trial.linear_model()
    left = [one.chi2(s) for one in (linear, there)]
    worse = at.shooting.record.selected_windows[left[1] > left[0] + FIT.largest_chi2_rise]
    if not len(worse):
        return trial, there
    begun = point.initial_states.copy()
    begun[worse] = at.point.initial_states[worse]
    trial = at.at_point(trial.point.with_initial_states(begun))
    return trial, trial.linear_model()


def place_theta(at: Sensitivities, theta: Array, begun: Array) -> OperatingPoint:
    """Return the point at θ, within the parameters' bounds. Nuisance effects move, too: they may be far above the
    noise, where their columns are only approximate. They hardly change the effects' memory, which is kept where no
    other effect has one: with a known memory the windows do not depend on each other, and are simulated side by side.

    Args:
        at: design with its point.
        theta: θ (P).
        begun: initial states (W, m).

    """
    p = at.point.p.copy()
    for value, c in zip(theta, at.candidates.columns, strict=True):
        p[c.index] = c.center + float(value) * c.unit
    memory = None
    if _changes_memory_little(at):
        memory = at.point.memory
    return OperatingPoint(at.shooting.arm.parameters.clip_to_bounds(p), begun, memory)


def _changes_memory_little(at: Sensitivities) -> bool:
    """Tell whether effects remember the motion, and all of them are nuisance effects."""
    candidates, shooting = at.candidates, at.shooting
    own = [c.index for c in candidates.columns if not candidates.is_nuisance(c)]
    return bool(at.point.p[shooting.memory_amplitudes].any()) and not np.isin(own, shooting.memory_parameters).any()


def compute_hypothesis_widths(at: Sensitivities, atoms: tuple[int, ...]) -> Array:
    """Return the prior standard deviations of θ (P) with the effects of a hypothesis free.

    Args:
        at: design with its point.
        atoms: places of the hypothesis' candidates.

    """
    return compute_prior_widths(at, at.candidates.amplitude_columns(atoms), at.point)


def compute_prior_widths(at: Sensitivities, free: NDArray[np.intp], point: OperatingPoint) -> Array:
    """Return the prior standard deviations of θ (P) with some columns free. A parameter whose size spans orders of
    magnitude has a prior as wide as its present size, if that is more than typical.

    Args:
        at: design with the columns.
        free: places of the free columns.
        point: where the present sizes are taken.

    """
    prior = at.candidates.spike_widths
    described = list(at.shooting.arm.parameters.described.values())
    broad = np.array([is_scale_free(described[at.candidates.columns[k].index]) for k in free], bool)
    prior[free] = np.where(
        broad, np.maximum(np.abs(at.candidates.to_theta(point.p)[free]), CANDIDATES.slab_width), CANDIDATES.slab_width
    )
    return prior


def place_sizes(at: Sensitivities, words: CandidateSet, atoms: tuple[int, ...], theta: Array) -> OperatingPoint:
    """Return the point of ``at`` with some candidates in their shapes and at given sizes, within their bounds.

    Args:
        at: design with its point.
        words: all candidates.
        atoms: places of the candidates.
        theta: θ (P).

    """
    for k in atoms:
        values = {c.index: c.center + float(theta[i]) * c.unit for i, c in enumerate(words.columns) if c.candidate == k}
        at = replace(at, point=place_candidate(at, words.members[k], values))
    return at.point


def place_candidate(at: Sensitivities, atom: Candidate, values: Mapping[int, float]) -> OperatingPoint:
    """Return the point of ``at`` with a candidate's shapes and given parameters, within their bounds.

    Args:
        at: design with its point.
        atom: the candidate.
        values: parameters by their place in p.

    """
    p, begun = at.point.p.copy(), at.point.initial_states
    atom.apply_shapes(at.shooting.arm, p)
    for index, value in values.items():
        p[index] = value
    p = at.shooting.arm.parameters.clip_to_bounds(p)
    if atom.place == "sensor":  # the windows begin where the encoders say
        begun = begun + at.shooting.measured_initial_states(p) - at.shooting.measured_initial_states(at.point.p)
    return OperatingPoint(p, begun)
