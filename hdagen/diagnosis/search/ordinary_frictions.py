"""Ordinary frictions: the frictions that a robot file states, in place of or beside those that a search has found.

Every drive has the frictions of the robot file. Where a file lacks several of them, one rarer friction may stand in
for a pair: one whose level goes with the angle fits a short log about as well. Short windows, each with a torque of
its own that no effect explains, do not tell them apart. So wherever a friction leads, the sets with the ordinary
frictions in place of all others are fitted as well. Motion that no fit saw then decides
(`hdagen.diagnosis.holdout.leading_set`).
"""

from __future__ import annotations

from collections.abc import Sequence

from hdagen.diagnosis.inference.candidate_priors import CandidateSet
from hdagen.diagnosis.inference.local_fit import Fit
from hdagen.diagnosis.inference.sensitivities import Sensitivities
from hdagen.diagnosis.initialization.torque_regression import TorqueRegression
from hdagen.diagnosis.search.fit_ranking import sort_by_evidence
from hdagen.diagnosis.search.regressed_starts import fit_regressed_set
from hdagen.diagnosis.search.search_settings import SEARCH
from hdagen.support.parallel import map_in_threads


def fit_ordinary_frictions(
    regression: TorqueRegression, at: Sensitivities, candidates: CandidateSet, fits: Sequence[Fit]
) -> list[Fit]:
    """Fit the sets that have ordinary frictions in place of the leader's, each from its regressed sizes.

    Args:
        regression: the regression of the record, with the same candidates.
        at: sensitivities about the robot file's numbers.
        candidates: all candidates.
        fits: the fits of the search.

    Returns:
        The fits of these sets and of their lesser sets, without columns, that were not fitted to their end before; none
        where no friction leads.

    """
    lead = sort_by_evidence(fits)[0]
    ended = {fit.names for fit in fits if fit.has_converged}
    near = lead.score.posterior.s
    candidates = candidates.with_spike_scale(lead.sensitivities.candidates.spike_scale)

    def fit_set(atoms: tuple[int, ...]) -> Fit:
        return fit_regressed_set(regression, at, candidates, atoms, near).without_columns()

    def fit_sets(some: Sequence[tuple[int, ...]]) -> list[Fit]:
        return map_in_threads(fit_set, [one for one in dict.fromkeys(some) if candidates.names_of(one) not in ended])

    sets = _list_sets(candidates, lead)
    found = fit_sets(sets)
    frictions = list_ordinary_frictions(candidates)
    whole = next((fit for fit in (*found, *fits) if sets and fit.names == candidates.names_of(sets[-1])), None)
    if whole is None or not _has_nearly_all(whole, frictions):
        return found
    lesser = [tuple(k for k in sets[-1] if k != one) for one in frictions]
    return [*found, *fit_sets([one for one in lesser if one not in sets])]


def _list_sets(candidates: CandidateSet, lead: Fit) -> list[tuple[int, ...]]:
    """List the sets by places of candidates: the ordinary frictions of every joint with a friction of the leader, and
    those of all joints, each alone and beside the leader's other effects."""
    known = [k for k in lead.effects if k < len(candidates.members)]
    beside = [k for k in known if not candidates.members[k].traits.is_friction]
    joints = {candidates.members[k].joint for k in known if candidates.members[k].traits.is_friction}
    if not joints:
        return []
    every = list_ordinary_frictions(candidates)
    at_joints = [k for k in every if candidates.members[k].joint in joints]
    return [tuple(sorted((*own, *frictions))) for frictions in (at_joints, every) for own in ((), beside)]


def _has_nearly_all(fit: Fit, frictions: Sequence[int]) -> bool:
    """Tell whether nearly all frictions of a fit count as present. Only then can the set without one of them, or
    without two, stand."""
    words = fit.sensitivities.candidates
    points = fit.posterior[0], words.to_theta(fit.sensitivities.point.p)
    sizes = {k: min(words.measure_size(k, one) for one in points) for k in frictions}
    absent = sum(size < words.presence_threshold(k) for k, size in sizes.items())
    return absent <= SEARCH.most_absent_frictions


def list_ordinary_frictions(candidates: CandidateSet) -> list[int]:
    """List the frictions that a robot file states.

    Args:
        candidates: all candidates.

    Returns:
        Places of the candidates that are frictions and whose amplitudes are all keys of the robot file.

    """
    stated = {c.candidate for c in candidates.columns if c.in_every_hypothesis}
    own = {c.candidate for c in candidates.columns if not c.in_every_hypothesis}
    return [k for k, one in enumerate(candidates.members) if one.traits.is_friction and k in stated - own]


def is_ordinary(fit: Fit) -> bool:
    """Tell whether every friction of a fit is one that a robot file states, and it has one.

    Args:
        fit: the fit.

    """
    candidates = fit.sensitivities.candidates
    frictions = {candidates.members[k].name for k in fit.effects if candidates.members[k].traits.is_friction}
    ordinary = {candidates.members[k].name for k in list_ordinary_frictions(candidates)}
    return bool(frictions) and frictions <= ordinary
