"""Steps of a local fit: Gauss-Newton steps, with the linear model computed again about each point."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hdagen.arm.build_loader import PlantError
from hdagen.diagnosis.inference.candidate_priors import CandidateSet
from hdagen.diagnosis.inference.fit_settings import FIT
from hdagen.diagnosis.inference.gauss_newton import descend_gauss_newton
from hdagen.diagnosis.inference.local_fit import Fit, start_fit_at


def advance_fit(fit: Fit, words: CandidateSet) -> Fit:
    """Take one step and linearize again there; columns of nuisance effects that hardly change are kept. A fit has
    converged where the linear model predicts no gain, where no step improves on the evidence reached, and where a step
    fails, which is counted.

    Args:
        fit: the fit; returned as it is if it has converged, or if the time of the diagnosis is up.
        words: all candidates.

    Returns:
        The fit after the step.

    """
    if fit.has_converged or fit.sensitivities.shooting.budget.is_up:
        return fit
    try:
        return _advance_unconverged(fit, words)
    except (PlantError, np.linalg.LinAlgError):
        fit.sensitivities.shooting.count_failure()
        return replace(fit, has_converged=True)


def _advance_unconverged(fit: Fit, words: CandidateSet) -> Fit:
    """Take one step of a fit that has not converged."""
    if fit.predicted_gain < FIT.least_evidence_step * fit.misfit_temperature:
        return replace(fit, has_converged=True)
    tried: list[Fit] = []
    shares = [FIT.stiff_torque_share, 1.0]
    if fit.score.posterior.noise_level > FIT.large_noise_level:
        shares.reverse()
    for share in shares:
        there = descend_gauss_newton(fit.sensitivities, fit.effects, fit.score, share)
        if there is not fit.sensitivities:
            there.cross_products.drop_caches()
            tried.append(
                start_fit_at(
                    there.shooting,
                    words,
                    fit.effects,
                    there.point,
                    fit.score.posterior.s,
                    fit.noise_only_evidence,
                    fit.sensitivities,
                )
            )
            if tried[-1].score.evidence >= fit.score.evidence + FIT.least_evidence_step * fit.misfit_temperature:
                break
    best = max(tried, key=lambda one: one.score.evidence, default=fit)
    gain = best.score.evidence - fit.score.evidence
    if best is fit or best.score.evidence <= fit.evidence_here:
        fit.sensitivities.cross_products.drop_caches()
        return replace(fit, has_converged=True)
    return replace(best, has_converged=abs(gain) < FIT.least_evidence_step * fit.misfit_temperature)
