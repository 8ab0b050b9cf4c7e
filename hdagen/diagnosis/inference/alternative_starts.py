"""Alternative starts of a hypothesis: at the point that another fit has reached, or with its effects elsewhere.

From the robot file's numbers alone a hypothesis may not find its optimum: it lies near that of a related hypothesis.
"""

from __future__ import annotations

from hdagen.diagnosis.inference.candidate_priors import CandidateSet
from hdagen.diagnosis.inference.candidate_settings import CANDIDATES
from hdagen.diagnosis.inference.gauss_newton import move_to_theta
from hdagen.diagnosis.inference.local_fit import Fit, start_fit_at
from hdagen.diagnosis.inference.sensitivities import OperatingPoint


def refit_without(fit: Fit, words: CandidateSet, atoms: tuple[int, ...]) -> Fit:
    """Start a hypothesis with fewer effects at the point of a fit, with the others reduced to the largest nuisance
    size. From the robot file's numbers it may not have found this optimum.

    Args:
        fit: the fit of the larger hypothesis.
        words: all candidates.
        atoms: places of the smaller hypothesis' candidates.

    Returns:
        The fit before its first step.

    """
    p = fit.sensitivities.point.p.copy()
    for c in words.columns:
        if c.candidate in fit.effects and c.candidate not in atoms:
            most = CANDIDATES.nuisance_limit * c.spike_width * abs(c.unit)
            p[c.index] = min(max(p[c.index], c.center - most), c.center + most)
    point = OperatingPoint(
        fit.sensitivities.shooting.arm.parameters.clip_to_bounds(p), fit.sensitivities.point.initial_states
    )
    at, s = fit.sensitivities, fit.score.posterior.s
    return start_fit_at(at.shooting, words, atoms, point, s, fit.noise_only_evidence, at)


def refit_swapping(fit: Fit, words: CandidateSet, atoms: tuple[int, ...]) -> Fit:
    """Start a hypothesis where the linear model of a fit predicts its optimum. Look-alike effects have it there, and
    from the robot file's numbers the hypothesis may not have found it.

    Args:
        fit: the fit of another hypothesis.
        words: all candidates.
        atoms: places of the hypothesis' candidates.

    Returns:
        The fit before its first step.

    """
    at, arm, s = fit.sensitivities, fit.sensitivities.shooting.arm, fit.score.posterior.s
    point = move_to_theta(at, at.linear_model(), s, fit.optimum_with(atoms))
    for k in set(atoms) - set(fit.effects):
        words.members[k].apply_shapes(arm, point.p)
    return start_fit_at(at.shooting, words, atoms, point, s, fit.noise_only_evidence, at)


def refit_from_start(start: OperatingPoint, fit: Fit, words: CandidateSet, atoms: tuple[int, ...]) -> Fit:
    """Start the effects of a fit at the base parameters of another point. Before all effects were in the hypothesis,
    the base parameters moved in their place, and may be stuck behind a valley.

    Args:
        start: the point with the base parameters.
        fit: the fit with the effects' parameters.
        words: all candidates.
        atoms: places of the effects' candidates.

    Returns:
        The fit before its first step.

    """
    p, names = start.p.copy(), list(fit.sensitivities.shooting.arm.parameters.described)
    for k in atoms:
        for name in (*words.members[k].amplitudes, *words.members[k].shapes):
            p[names.index(name)] = fit.sensitivities.point.p[names.index(name)]
    point = OperatingPoint(p, fit.sensitivities.shooting.filtered_initial_states(p))
    return start_fit_at(fit.sensitivities.shooting, words, atoms, point, fit.score.posterior.s, fit.noise_only_evidence)
