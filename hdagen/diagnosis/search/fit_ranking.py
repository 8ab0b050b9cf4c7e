"""The order of fits: by the evidence reached in the end, by the evidence promised on the way.

A fit keeps its columns only while it may lead: they fill the memory.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

from hdagen.diagnosis.inference.local_fit import Fit
from hdagen.diagnosis.search.search_settings import SEARCH


def charge_effects(evidence: float, fit: Fit, excess: float) -> float:
    """Subtract the prior's penalty for a fit's effects from its log evidence.

    Args:
        evidence: the log evidence.
        fit: the fit, which has the effects.
        excess: temperature, in multiples of the least.

    Returns:
        The log evidence less the penalty.

    """
    return evidence - SEARCH.effect_penalty * excess * len(fit.effects)


def leaves_much(lead: Fit, fitted: Sequence[Fit]) -> bool:
    """Tell whether the best fit leaves much of the null model's misfit.

    Args:
        lead: the best fit.
        fitted: all fits.

    """
    none = next((f for f in fitted if not f.effects), lead)
    return lead.misfit > SEARCH.large_misfit_share * none.misfit


def is_beyond_known_effects(fitted: Sequence[Fit]) -> bool:
    """Tell whether known effects explain little of a large misfit: then no two of them will explain it, either.

    Args:
        fitted: all fits.

    """
    best = sort_by_evidence(fitted)[0]
    none = next((f for f in fitted if not f.effects), best)
    return best.misfit > max(SEARCH.unexplained_misfit_share * none.misfit, SEARCH.unexplained_misfit)


def can_gain(lead: Fit) -> bool:
    """Tell whether any further effect can become more probable than the best fit: what that leaves bounds what an
    effect gains, and the prior takes a part.

    Args:
        lead: the best fit.

    """
    return lead.misfit > (SEARCH.effect_penalty + SEARCH.least_lead) * lead.misfit_temperature


def first_with_columns(fits: Sequence[Fit]) -> Fit:
    """Return the best fit that still has its columns; a fit may become better after losing them.

    Args:
        fits: fits, the best first.

    """
    return next(fit for fit in fits if fit.has_columns)


def drop_columns(fits: Sequence[Fit]) -> list[Fit]:
    """Drop the columns of all fits but the best one that has some.

    Args:
        fits: fits, the best first.

    Returns:
        The fits in the same order.

    """
    best = first_with_columns(fits)
    return [fit if fit is best else fit.without_columns() for fit in fits]


def sort_by_promise(fits: Sequence[Fit]) -> list[Fit]:
    """Sort fits on their way by the evidence that the next step may reach.

    Args:
        fits: fits in any order.

    Returns:
        The fits, the most promising first.

    """
    return sorted(fits, key=lambda f: -f.score.evidence)


def sort_by_evidence(fits: Sequence[Fit]) -> list[Fit]:
    """Sort fits in the end by the evidence they have reached.

    Args:
        fits: fits in any order.

    Returns:
        The fits, the best first.

    """
    return sorted(fits, key=lambda f: -f.evidence_here)


def choose_stated_fits(fits: Sequence[Fit]) -> dict[tuple[str, ...], Fit]:
    """Choose the fit that states each set: the best one, on the model with the fewest springs where the set names none.
    A replay of such a set has no springs, and numbers that were fitted beside springs are not those of a rigid drive.

    Args:
        fits: fits in any order.

    Returns:
        A fit by the names of each set.

    """
    chosen: dict[tuple[str, ...], Fit] = {}
    for fit in sorted(sort_by_evidence(fits), key=_count_unnamed_springs):
        chosen.setdefault(fit.names, fit)
    return chosen


def _count_unnamed_springs(fit: Fit) -> int:
    """Count the springs of a fit's model, none where one of them is named."""
    members = fit.sensitivities.candidates.members
    if any(members[k].traits.series_spring for k in fit.effects):
        return 0
    return len(fit.sensitivities.shooting.arm.manifest["flexible"])


def keep_best_starts(fits: list[Fit]) -> tuple[list[Fit], list[Fit]]:
    """Keep the first fit of each set, of several starts.

    Args:
        fits: fits, the best first.

    Returns:
        These fits, and the others without their columns.

    """
    first: dict[tuple[str, ...], Fit] = {}
    for fit in fits:
        first.setdefault(fit.names, fit)
    return list(first.values()), [fit.without_columns() for fit in fits if first[fit.names] is not fit]


def drop_hopeless_starts(starts: Sequence[Fit]) -> list[Fit]:
    """Drop the starts of one set that promise far less than the best of them.

    Args:
        starts: fits before their first step.

    Returns:
        The others in the same order.

    """
    best = max(starts, key=lambda fit: fit.score.evidence, default=None)
    if best is None:
        return []
    least = best.score.evidence - SEARCH.hopeless_margin * best.misfit_temperature
    return [fit for fit in starts if fit.score.evidence >= least]


def place_by_size(fits: Sequence[Fit]) -> Iterator[tuple[Fit, int]]:
    """Count for each fit the better ones with as many effects, the null model counting as one effect. So a set takes no
    place from a single effect.

    Args:
        fits: fits, the best first.

    Yields:
        Each fit with its place, from 0.

    """
    before: Counter[int] = Counter()
    for fit in fits:
        yield fit, before[max(len(fit.effects), 1)]
        before[max(len(fit.effects), 1)] += 1


def drop_undeserved(fits: list[Fit]) -> list[Fit]:
    """Drop the columns, and so the lead, of fits that have more effects than another one without the evidence to pay
    for them.

    Args:
        fits: the fits, at least one of them with columns.

    Returns:
        The fits in the same order.

    """
    fewest = min((len(fit.effects) for fit in fits if fit.effects), default=0)
    if all(len(fit.effects) in (0, fewest) for fit in fits):
        return fits
    excess = sort_by_evidence(fits)[0].misfit_temperature
    lead = max(
        (fit for fit in fits if fit.has_columns), key=lambda fit: charge_effects(fit.score.evidence, fit, excess)
    )
    return [fit if fit is lead or len(fit.effects) <= fewest else fit.without_columns() for fit in fits]
