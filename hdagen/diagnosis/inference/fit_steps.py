"""Steps of a local fit: Gauss-Newton steps, with the linear model computed again about each point."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hdagen.arm.build_loader import PlantError
from hdagen.diagnosis.inference.candidate_priors import CandidateSet
from hdagen.diagnosis.inference.gauss_newton import LEAST_EVIDENCE_STEP, descend_gauss_newton
from hdagen.diagnosis.inference.local_fit import LARGE_NOISE_LEVEL, STIFF_TORQUE_SHARE, Fit, start_fit_at


def advance_fit(fit: Fit, words: CandidateSet) -> Fit:
    """Take one step and linearize again there: about another point the columns of nuisance effects give a wrong
    likelihood. A fit has converged where the linear model predicts no gain, where no step improves on the evidence
    reached, and where a step fails, which is counted.

    Args:
        fit: the fit; returned as it is if it has converged.
        words: all candidates.

    Returns:
        The fit after the step.

    """
    if fit.has_converged:
        return fit
    try:
        return _advance_unconverged(fit, words)
    except (PlantError, np.linalg.LinAlgError):
        fit.sensitivities.shooting.count_failure()
        return replace(fit, has_converged=True)


def _advance_unconverged(fit: Fit, words: CandidateSet) -> Fit:
    """Take one step of a fit that has not converged."""
    if fit.predicted_gain < LEAST_EVIDENCE_STEP * fit.misfit_temperature:
        return replace(fit, has_converged=True)
    tried: list[Fit] = []
    shares = [STIFF_TORQUE_SHARE, 1.0]
    if fit.score.posterior.noise_level > LARGE_NOISE_LEVEL:
        shares.reverse()
    for share in shares:
        there = descend_gauss_newton(fit.sensitivities, fit.effects, fit.score, share)
        if there is not fit.sensitivities:
            there.cross_products.drop_caches()
            tried.append(
                start_fit_at(
                    there.shooting, words, fit.effects, there.point, fit.score.posterior.s, fit.noise_only_evidence
                )
            )
            if tried[-1].score.evidence >= fit.score.evidence + LEAST_EVIDENCE_STEP * fit.misfit_temperature:
                break
    best = max(tried, key=lambda one: one.score.evidence, default=fit)
    gain = best.score.evidence - fit.score.evidence
    if best is fit or best.score.evidence <= fit.evidence_here:
        fit.sensitivities.cross_products.drop_caches()
        return replace(fit, has_converged=True)
    return replace(best, has_converged=abs(gain) < LEAST_EVIDENCE_STEP * fit.misfit_temperature)
