"""The decision: posterior probabilities of the hypotheses, and the verdict.

The likelihood counts as its root of order T, a temperature. No model of ours is true and its residuals are not
independent, so a better model would gain as much evidence from them. The prior counts as it is. The probability of the
leading hypothesis is calibrated (`hdagen.diagnosis.decision.calibration`).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType

import numpy as np

from hdagen.arm.effect_catalogue import EffectTraits
from hdagen.diagnosis.decision import calibration
from hdagen.diagnosis.decision.decision_settings import DECISION
from hdagen.diagnosis.decision.effect_presence import relate_to_least_sizes
from hdagen.diagnosis.decision.file_trust import find_strained_numbers
from hdagen.diagnosis.decision.number_combinations import combine_numbers
from hdagen.diagnosis.inference.candidate_settings import CANDIDATES
from hdagen.diagnosis.inference.local_fit import Fit
from hdagen.diagnosis.search.fit_ranking import choose_stated_fits
from hdagen.diagnosis.search.hypothesis_search import SearchResult

SMALLEST_POSITIVE = 1e-12
PLACES_BETWEEN_ENCODERS = ("transmission", "link", "sensor")


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A set of effects (name@joint, sorted; none: empty) with its probability, and its ``fit`` where it has one."""

    names: tuple[str, ...]
    probability: float
    fit: Fit | None

    @property
    def is_unknown(self) -> bool:
        """Whether its effect is something that no known effect explains."""
        return any(name.startswith("unknown@") for name in self.names)


@dataclass(frozen=True, eq=False)
class Decision:
    """The hypotheses, the most probable first, and the verdict.

    ``verdict`` has the effects as diagnosis.json does, ``probability`` is the calibrated one and
    ``uncalibrated_probability`` the one before calibration; ``best`` is the fit that the verdict stands on.
    ``combinations`` has, by the name that stands for them, all numbers of the robot file that the motion cannot part.
    ``direct_evidence`` has the effects of the verdict with direct evidence that no fit has, by name@joint, with their
    parameters. ``undetectable`` is set where the verdict comes from long windows: the effects that these would not show
    in their usual size.
    """

    hypotheses: tuple[Hypothesis, ...]
    verdict: tuple[str, ...]
    probability: float
    uncalibrated_probability: float
    best: Fit
    direct_evidence: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    undetectable: tuple[str, ...] | None = None
    combinations: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def is_sure(self) -> bool:
        """Whether the other hypotheses together hold at most a tenth of the probability, and no effect may stand in for
        numbers that the robot file claims to know too well."""
        if self.is_unknown or 1.0 - self.probability > DECISION.sure_below:
            return False
        return not self.strained_numbers or all(name in self.numbers for name in self.verdict)

    @property
    def numbers(self) -> frozenset[str]:
        """All candidates that are numbers of the robot file."""
        return frozenset(atom.name for atom in self.best.sensitivities.candidates.members if atom.is_number)

    @cached_property
    def strained_numbers(self) -> tuple[str, ...]:
        """The parameters that strain against what the robot file claims."""
        return find_strained_numbers(self.best)

    @property
    def is_long_horizon(self) -> bool:
        """Whether the verdict comes from long windows."""
        return self.undetectable is not None

    @property
    def is_unknown(self) -> bool:
        """Whether the verdict names something that no known effect explains."""
        return any("unknown" in v for v in self.verdict)

    def marginal_probability(self, name: str) -> float:
        """Compute the probability that an effect is present, alone or with others.

        Args:
            name: the effect, name@joint.

        Returns:
            The sum over all hypotheses that have it (1).

        """
        return min(1.0, sum(h.probability for h in self.hypotheses if name in h.names))


def score_hypotheses(
    search: SearchResult, predicted: Mapping[tuple[str, ...], float] = MappingProxyType({})
) -> Decision:
    """Compute the probabilities of no effect, of every effect on every joint and of the fitted sets, and the verdict.

    Args:
        search: all sets with their fits.
        predicted: change of the sets' log odds by prediction over long windows, as `weigh_predictions` has it; other
            sets change as the hypothesis of no effect does.

    Returns:
        The decision.

    """
    fits: dict[tuple[str, ...], Fit] = {}
    for fit in search.fits:
        fits.setdefault(fit.names, fit)
    lead = next((fit for fit in search.fits if not predicted.get(fit.names)), search.fits[0])
    evidence, stands, own = _collect_evidence(search, fits, lead.temperature)
    large = _add_screened(search, evidence, lead.misfit_temperature)
    weight = _weigh_hypotheses(evidence, large, predicted, frozenset(search.candidates.list_absent_numbers()))
    for names in sorted(fits, key=len):
        if (more := _add_shifted_base_parameters(fits[names])) != names and evidence.get(more, -np.inf) > evidence[
            names
        ] - DECISION.most_evidence_deficit:
            weight[more] += weight[names]
            weight[names] = 0.0
    members = [atom for fit in fits.values() for atom in fit.sensitivities.candidates.members]
    traits = {atom.name: atom.traits for atom in members}
    numbers = frozenset(atom.name for atom in members if atom.is_number)
    seen = {fit: relate_to_least_sizes(fit) for fit in set(stands.values())}
    for names in sorted(stands, key=len, reverse=True):
        less = _drop_negligible(names, seen[stands[names]], evidence, traits, numbers)
        if less not in weight:
            less = _find_fitted_set(less, names, own)
        if less != names:
            weight[less] += weight[names]
            weight[names] = 0.0
            if less and numbers:  # it stands for the larger set from here on
                evidence[less] = max(evidence[less], evidence[names])
    combinations = combine_numbers(weight, own, numbers, traits)
    total = sum(weight.values())
    order = sorted(weight, key=lambda names: (-weight[names], names))
    left = lead  # what even the best of all leaves
    # what is too small to count tells nothing of a gap: where that leads, none leaves what the best does
    strange = _compute_unknown_odds(left, fits[()] if order[0] else left)
    unknown = float(strange / (1.0 + strange)) if strange > DECISION.negligible_unknown_odds else 0.0
    stated = {names: fit for names, fit in choose_stated_fits(search.fits).items() if names in own}
    hypotheses = [Hypothesis(names, float((1 - unknown) * weight[names] / total), stated.get(names)) for names in order]
    joint = int(np.argmax(left.unexplained_torque)) + 1
    if unknown:
        hypotheses.append(Hypothesis((f"unknown@{joint}",), unknown, None))
    return replace(conclude_verdict(hypotheses, left), combinations=combinations)


def _collect_evidence(
    search: SearchResult, fits: Mapping[tuple[str, ...], Fit], temperature: float
) -> tuple[dict[tuple[str, ...], float], dict[tuple[str, ...], Fit], dict[tuple[str, ...], Fit]]:
    """The tempered log evidence of every set that a fit covers, the fit that each set stands in, and each set's own
    fit where that is done."""
    evidence: dict[tuple[str, ...], float] = {}
    stands: dict[tuple[str, ...], Fit] = {}  # each set in its own fit if that is done, else where it is worth most
    for fit in search.fits:
        for lesser in fit.subsets:
            names = fit.sensitivities.candidates.names_of(lesser)
            if (worth := fit.tempered_evidence(temperature, lesser)) > evidence.get(names, -np.inf):
                evidence[names], stands[names] = worth, fit
    # a fit that was left on the way tells nothing of its set, where that is worth more within another one
    own = {
        names: fit
        for names, fit in fits.items()
        if fit.tempered_evidence(temperature, fit.effects) > evidence[names] - DECISION.most_evidence_deficit
    }
    stands |= own
    return evidence, stands, own


def _add_screened(
    search: SearchResult, evidence: dict[tuple[str, ...], float], excess: float
) -> dict[tuple[str, ...], float]:
    """Add the evidence of the sets that were only screened, and return the probability that each is large."""
    linear = next(s.evidence for s in search.screened if not s.effects)
    large: dict[tuple[str, ...], float] = {}
    for s in search.screened:  # those that were not worth a fit, as far from none as in the linear model at most
        names = tuple(search.candidates.members[k].name for k in s.effects)
        if names not in evidence:
            evidence[names] = evidence[()] + min(s.evidence - linear, 0.0) / excess
            large[names] = s.presence_probability
    return large


def _weigh_hypotheses(
    evidence: Mapping[tuple[str, ...], float],
    large: Mapping[tuple[str, ...], float],
    predicted: Mapping[tuple[str, ...], float],
    absent: frozenset[str],
) -> dict[tuple[str, ...], float]:
    """Posterior weights of sets, from their log ``evidence``, the ``predicted`` log odds and the prior.

    Numbers that are ``absent`` in the robot file are as likely there as not: no motor is without a rotor. ``large`` has
    the share of a set's weight whose effects are as large as counts; the rest goes to no effect.
    """
    count = sum(len(names) == 1 for names in evidence)
    told = {names: e + predicted.get(names, predicted.get((), 0.0)) for names, e in evidence.items()}
    top = max(told.values())
    weight = {
        names: _compute_prior(len(set(names) - absent), count) * float(np.exp(value - top))
        for names, value in told.items()
    }
    for names, share in large.items():
        weight[()] += (1.0 - share) * weight[names]
        weight[names] *= share
    return weight


def conclude_verdict(hypotheses: list[Hypothesis], left: Fit) -> Decision:
    """Conclude the verdict from the hypotheses.

    It is the most probable hypothesis, or no effect where that is in doubt. Its probability is calibrated; the others
    share the rest in proportion.

    Args:
        hypotheses: with their posterior probabilities.
        left: the fit that the verdict stands on if its hypothesis has none.

    Returns:
        The decision.

    """
    known = [h for h in hypotheses if not h.is_unknown]
    said, none = max(known, key=lambda h: h.probability), next(h for h in known if not h.names)
    strange = next((h for h in hypotheses if h.is_unknown), None)
    named = sum(h.probability for h in known) - none.probability  # what takes each other's place makes nothing unknown
    if strange and strange.probability > max(named, none.probability):
        said = strange
    elif none.probability > DECISION.no_effect_threshold:
        said = none
    believed = calibration.read().calibrate(said.probability)
    others = [h for h in hypotheses if h is not said]
    rest = sum(h.probability for h in others)
    shares = [h.probability / rest if rest > 0.0 else 1.0 / len(others) for h in others]
    found = [replace(h, probability=(1.0 - believed) * share) for h, share in zip(others, shares, strict=True)]
    found = sorted([replace(said, probability=believed), *found], key=lambda h: -h.probability)
    return Decision(tuple(found), said.names, believed, said.probability, said.fit or left)


def _compute_unknown_odds(left: Fit, none: Fit) -> float:
    """Odds of an effect that is not among the candidates.

    They are large where much torque stays unexplained, and where the named effects explain little of the error that no
    effect leaves. That share is measured by evidence, which is logarithmic in a large error, and by torque, which says
    little of a saturation or an encoder. A real machine always leaves some torque.
    """
    lacks = [max(fit.misfit, SMALLEST_POSITIVE) for fit in (left, none)]
    torques = [max(float(np.linalg.norm(fit.unexplained_torque)), SMALLEST_POSITIVE) for fit in (left, none)]
    size = min(
        max(
            torques[0] / DECISION.unknown_midpoints[0],
            (left.score.posterior.noise_level - 1.0) / DECISION.unknown_midpoints[1],
        ),
        DECISION.largest_unknown_size,
    )
    share = min(lacks[0] / lacks[1], torques[0] / torques[1], 1.0)
    return (size**2 * share / DECISION.unknown_remaining_share) ** 2


def _add_shifted_base_parameters(fit: Fit) -> tuple[str, ...]:
    """The set with the base parameters that the fit has moved farther than all but one in a hundred would be."""
    words, (mean, covariance) = fit.sensitivities.candidates, fit.posterior
    beyond = {
        words.members[c.candidate].name
        for k, c in enumerate(words.columns)
        if c.in_every_hypothesis
        and c.candidate >= 0
        and abs(mean[k]) > max(CANDIDATES.present_size, DECISION.rare_parameter_deviation * c.spike_width)
        if np.sqrt(covariance[k, k]) < DECISION.informative_std_ratio * c.spike_width
    }
    return tuple(sorted(beyond.union(fit.names)))


def _drop_negligible(
    names: tuple[str, ...],
    size: Mapping[str, float],
    evidence: Mapping[tuple[str, ...], float],
    traits: Mapping[str, EffectTraits],
    numbers: frozenset[str] = frozenset(),
) -> tuple[str, ...]:
    """The set without effects too small to count, ``size`` being in multiples of the least that does.

    It also goes without an effect that only corrects the formula of others of its kind on the same joint. Two
    ``numbers`` of the robot file correct no formula of each other, and one that is off by its usual size corrects none.
    """
    large = tuple(name for name in names if size[name] >= 1.0)
    rests = {name: tuple(n for n in names if n != name) for name in large if large == names}
    order = list(rests.items())
    if numbers:  # the least missed first
        order.sort(key=lambda item: -evidence.get(item[1], -np.inf))
    for name, rest in order:
        far = {n for n in names if n in numbers and size[n] * CANDIDATES.present_size >= 1.0}
        pairs = [n for n in rest if _are_interchangeable(name, n, traits) and not {name, n} <= numbers]
        alike = [n for n in pairs if not {name, n} & far]
        without = tuple(n for n in rest if n not in alike)
        least = DECISION.form_correction_share * (evidence.get(rest, np.inf) - evidence.get(without, evidence[()]))
        if alike and evidence[names] - evidence.get(rest, -np.inf) < least:
            return rest
    return large


def _find_fitted_set(
    less: tuple[str, ...], names: tuple[str, ...], fitted: Collection[tuple[str, ...]]
) -> tuple[str, ...]:
    """The smallest fitted set between ``less`` and ``names``; ``names`` itself where there is none. ``less`` was not
    evaluated, so there is no fit to state it by."""
    between = [one for one in fitted if set(less) < set(one) < set(names)]
    return min(between, key=lambda one: (len(one), one), default=names)


def _are_interchangeable(one: str, other: str, traits: Mapping[str, EffectTraits]) -> bool:
    """Whether both effects act between the encoders of the same joint, or are friction of the same motor.

    No machine has exactly the formula of either. A wall acts beyond one angle alone, and corrects no gear's formula;
    nor does a mass or an inertia.
    """
    if one.partition("@")[2] != other.partition("@")[2]:
        return False
    both = (traits[one], traits[other])
    in_gear = all(
        effect.place in PLACES_BETWEEN_ENCODERS and not effect.walls and not effect.alternatives for effect in both
    )
    return in_gear or all(effect.is_friction for effect in both)


def _compute_prior(effects: int, count: int) -> float:
    """Prior probability of one set with so many ``effects``, of ``count`` candidates."""
    return (
        DECISION.prior_no_effect
        if not effects
        else (1 - DECISION.prior_no_effect) / count * (DECISION.prior_further_effect / count) ** (effects - 1)
    )
