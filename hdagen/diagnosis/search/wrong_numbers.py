"""Numbers of the robot file that are wrong: freed together beside a hypothesis, and dropped again one by one.

A robot file may be wrong in several numbers at once, and each of them alone leaves most of the misfit. The response of
a motion to such numbers is nearly linear, so the linear model of one fit chooses them all.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from hdagen.diagnosis.inference.alternative_starts import refit_without
from hdagen.diagnosis.inference.candidate_priors import CandidateSet
from hdagen.diagnosis.inference.fit_settings import FIT
from hdagen.diagnosis.inference.local_fit import Fit, restore_columns, start_fit_at
from hdagen.diagnosis.inference.marginal_likelihood import compute_posteriors, score_candidate_sets
from hdagen.diagnosis.search.hypothesis_race import advance_with_note, take_further_steps
from hdagen.diagnosis.search.search_settings import SEARCH


def count_effects(fit: Fit) -> int:
    """Count the effects of a fit that are no numbers of the robot file.

    Args:
        fit: the fit.

    """
    return len(fit.effects) - len(list_numbers(fit))


def may_grow(fit: Fit) -> bool:
    """Tell whether one more effect may be tried beside those of a fit.

    Args:
        fit: the fit.

    """
    return count_effects(fit) < SEARCH.most_effects_of_set and len(fit.effects) < SEARCH.most_members_of_set


def list_numbers(fit: Fit) -> tuple[int, ...]:
    """List the candidates of a fit that are numbers of the robot file.

    Args:
        fit: the fit.

    Returns:
        Their places.

    """
    return tuple(k for k in fit.effects if fit.sensitivities.candidates.members[k].is_number)


def choose_wrong_numbers(fit: Fit) -> tuple[int, ...]:
    """Choose the numbers that explain most of what a fit leaves, one after the other, in its linear model.

    Args:
        fit: the fit, with its columns.

    Returns:
        Places of the candidates; none where no number is worth its price.

    """
    at, words = fit.sensitivities, fit.sensitivities.candidates
    found = compute_posteriors(at.linear_model(), words.spike_widths)
    shown = sorted({c.candidate for c in words.columns} - {-1, *fit.effects})
    possible = [k for k in shown if words.members[k].is_number and words.members[k].name not in words.active]
    possible = [k for k in possible if words.is_compatible(at.shooting.arm, k, fit.effects)]
    misfit, chosen = fit.misfit, fit.effects
    first = here = score_candidate_sets(found, words, [chosen])[0].evidence
    while possible and len(chosen) < SEARCH.most_members_of_set:
        best = score_candidate_sets(found, words, [(*chosen, k) for k in possible])[0]
        temperature = max(1.0, (misfit - (best.evidence - first)) / FIT.misfit_of_temperature)
        if best.evidence < here + SEARCH.effect_penalty * temperature:
            break
        chosen, here = best.effects, best.evidence
        possible.remove(chosen[-1])
    return chosen[len(fit.effects) :]


def free_wrong_numbers(lead: Fit, words: CandidateSet) -> Fit | None:
    """Fit a hypothesis with the numbers that explain most of what it leaves.

    Args:
        lead: the fit of the hypothesis, with its columns.
        words: all candidates.

    Returns:
        The fit with these numbers; None where no number is worth its price.

    """
    fit = lead
    for number in range(1, SEARCH.number_rounds + 1):
        chosen = choose_wrong_numbers(fit)
        if not chosen or fit.sensitivities.shooting.budget.is_left_out("wrong numbers beside the leading set"):
            break
        at = fit.sensitivities
        begun = start_fit_at(
            at.shooting, words, (*fit.effects, *chosen), at.point, fit.score.posterior.s, fit.noise_only_evidence, at
        )
        moved = advance_with_note(words, f"wrong numbers, round {number}", begun)
        numbers = [k for k, one in enumerate(words.members) if one.is_number and k not in lead.effects]
        moved = take_further_steps(moved, words)
        fit = restore_columns(drop_unneeded(moved, words, numbers), words)
    if fit is lead or set(fit.effects) == set(lead.effects):
        return None
    return fit


def drop_unneeded(fit: Fit, words: CandidateSet, droppable: Collection[int]) -> Fit:
    """Drop effects that are not worth their price beside the others, the least first. The linear model proposes each,
    and the fit without it decides.

    Args:
        fit: the fit, with its columns.
        words: all candidates.
        droppable: places of the candidates that may go.

    Returns:
        The fit of the others.

    """
    while True:
        rests = [tuple(i for i in fit.effects if i != k) for k in fit.effects if k in droppable]
        predicted = [fit.predicted_evidence(rest) for rest in rests]
        least = fit.evidence_here - SEARCH.effect_penalty * fit.misfit_temperature
        if not rests or max(predicted) < least:
            return fit
        less = refit_without(fit, words, rests[int(np.argmax(predicted))])
        less = take_further_steps(less, words)
        if less.evidence_here < least:
            return fit
        fit = less
