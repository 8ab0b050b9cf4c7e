"""The null model: no effect is active. Every hypothesis starts there, and it shows how large nuisance effects are."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.data.windows import WindowedRecord
from hdagen.diagnosis.inference.candidate_priors import CandidateSet
from hdagen.diagnosis.inference.candidate_settings import CANDIDATES
from hdagen.diagnosis.inference.fit_steps import advance_fit
from hdagen.diagnosis.inference.linearization import compute_sensitivities
from hdagen.diagnosis.inference.local_fit import Fit, rescale_spikes, restore_columns, start_fit
from hdagen.diagnosis.inference.multiple_shooting import MultipleShooting
from hdagen.diagnosis.inference.sensitivities import OperatingPoint
from hdagen.diagnosis.initialization.candidate_list import build_candidates
from hdagen.diagnosis.initialization.initial_guess import guess_from_log
from hdagen.diagnosis.search.null_model_settings import NULL_MODEL
from hdagen.diagnosis.search.ripple_order import suggest_ripple_orders
from hdagen.diagnosis.stages.time_budget import TimeBudget


@dataclass(frozen=True, eq=False)
class NullModel:
    """The fitted null model, and the candidates as it prepares them.

    Attributes:
        shooting: the record and its model, which the search goes on with.
        candidates: all candidates with their initial guess, the orders of ripples, and the spike width: a small misfit
            of the null model leaves no room for large effects.
        fit: the base parameters alone, without the columns of the fit.

    """

    shooting: MultipleShooting
    candidates: CandidateSet
    fit: Fit


def fit_null_model(
    arm: Arm, record: WindowedRecord, budget: TimeBudget | None = None, *, with_numbers: bool = False
) -> NullModel:
    """Fit the null model, and prepare the candidates by it.

    Args:
        arm: the model with every effect.
        record: windows of the log.
        budget: the time of the diagnosis, for this fit and for all that are made with its simulator.
        with_numbers: whether numbers of the robot file are candidates.

    Returns:
        The fitted null model with the candidates.

    """
    shooting = MultipleShooting(arm, record, budget=budget or TimeBudget())
    hints = guess_from_log(arm, record)
    build = partial(build_candidates, arm, uncommanded=record.joints_without_command, with_numbers=with_numbers)
    fit = fit_without_effects(shooting, build(suggested=hints))
    candidates = build(suggested=suggest_ripple_orders(fit, hints))
    return NullModel(
        shooting, candidates.with_spike_scale(fit.sensitivities.candidates.spike_scale), fit.without_columns()
    )


def fit_without_effects(shooting: MultipleShooting, words: CandidateSet) -> Fit:
    """Fit the null model by a few steps, with its most probable spike width.

    Args:
        shooting: the record and its model.
        words: all candidates.

    Returns:
        The fit.

    """
    fit = start_fit(
        compute_sensitivities(shooting, words.columns_for(()), make_nominal_point(shooting, words)), words, (), 1.0
    )
    for _ in range(NULL_MODEL.fit_steps):
        fit = advance_fit(fit, words)
    return choose_spike_scale(restore_columns(fit, words))


def choose_spike_scale(fit: Fit) -> Fit:
    """Return a fit with the spike width that is most probable for it.

    Args:
        fit: the fit.

    """
    return max(
        (rescale_spikes(fit, share) for share in CANDIDATES.spike_scales), key=lambda one: one.score.posterior.evidence
    )


def make_nominal_point(shooting: MultipleShooting, words: CandidateSet) -> OperatingPoint:
    """Return the point where every hypothesis starts: the robot file's numbers with the initial guess, limited to
    nuisance sizes, and with walls and ripples where the log suggests them.

    Args:
        shooting: the record and its model.
        words: all candidates.

    """
    p = shooting.arm.p.copy()
    for atom in words.members:
        if atom.has_default_shapes:
            atom.apply_shapes(shooting.arm, p)
    for c in words.columns:
        if c.initial_guess:
            p[c.index] = c.initial_value
    p = shooting.arm.parameters.clip_to_bounds(p)
    return OperatingPoint(p, shooting.measured_initial_states(p))
