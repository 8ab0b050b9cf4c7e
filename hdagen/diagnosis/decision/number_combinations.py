"""Numbers of the robot file that a motion cannot part: one of them stands for all.

With the rotor of a joint, or the mass of one link, a motion may show nothing but a sum. Sets that differ in such a
number alone are then nearly as probable as each other, and none of them would be sure. Together they are one statement.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, MutableMapping

from hdagen.arm.effect_catalogue import EffectTraits
from hdagen.diagnosis.decision.decision_settings import DECISION
from hdagen.diagnosis.inference.candidate_priors import Candidate
from hdagen.diagnosis.inference.local_fit import Fit

EffectNames = tuple[str, ...]


def measure_change(fit: Fit, candidate: Candidate) -> float:
    """Measure how far a fit moves a number of the robot file.

    Args:
        fit: the fit.
        candidate: the number.

    Returns:
        The logarithm of the factor of a single number, infinite where it changes its sign; of one that is 0 in the
        file the logarithm of 1 and the multiple of its usual size; of a vector that of 1 and the share by which it
        moves.

    """
    parameters = fit.sensitivities.shooting.arm.parameters
    described = [parameters.described[name] for name in candidate.amplitudes]
    values = [float(fit.sensitivities.point.p[parameters.index(name)]) for name in candidate.amplitudes]
    if len(values) == 1 and not described[0].stated:
        return math.log1p(abs(values[0]) / (described[0].typical or math.inf))
    if len(values) == 1:
        factor = described[0].compute_factor(values[0])
        return abs(math.log(factor)) if factor > 0.0 else math.inf
    moved = math.dist(values, [q.nominal for q in described])
    return math.log1p(moved / math.hypot(*(q.nominal for q in described)))


def combine_numbers(
    weight: MutableMapping[EffectNames, float],
    fits: Mapping[EffectNames, Fit],
    numbers: frozenset[str],
    traits: Mapping[str, EffectTraits],
) -> dict[str, EffectNames]:
    """Give sets that differ in one number alone, which the motion cannot part, to the set whose number changes least.

    Args:
        weight: posterior weights of sets of effects, changed in place.
        fits: the sets' own fits, where they are done.
        numbers: all candidates that are numbers of the robot file, name@joint.
        traits: of every effect by name@joint.

    Returns:
        All members of each combination, by the name that stands for them.

    """
    lead = max(weight, key=lambda names: (weight[names], names))
    found: dict[str, EffectNames] = {}
    for name in [name for name in lead if name in numbers]:
        rest = tuple(other for other in lead if other != name)
        swapped = {name: lead} | {
            one: names
            for names in weight
            if weight[names] * DECISION.confusable_odds > weight[lead] and len(names) == len(lead)
            for one in set(names) - {*lead}
            if set(rest) < set(names) and _is_alternative(name, one, numbers, traits)
        }
        if len(swapped) == 1:
            continue
        first = _choose_least_change(swapped, fits, numbers)
        found[first] = tuple(sorted(swapped))
        for names in [names for names in weight if set(names) & {*swapped}]:
            least = tuple(sorted({first, *(one for one in names if one not in swapped)}))
            if least != names and least in weight:
                weight[least] += weight.pop(names)
        lead = swapped[first]
    return found


def _is_alternative(name: str, other: str, numbers: frozenset[str], traits: Mapping[str, EffectTraits]) -> bool:
    """Tell whether an effect can stand for a number: another number at any joint, an effect at the same joint."""
    effect, _, joint = other.partition("@")
    return effect in traits[name].alternatives and (other in numbers or joint == name.partition("@")[2])


def _choose_least_change(
    swapped: Mapping[str, EffectNames], fits: Mapping[EffectNames, Fit], numbers: frozenset[str]
) -> str:
    """Choose the member that changes least, of those whose sets are fitted; an effect among them stands first."""

    def change(name: str) -> float:
        fit = fits.get(swapped[name])
        if fit is None:
            return math.inf
        if name not in numbers:
            return -math.inf
        atom = next(a for k in fit.effects if (a := fit.sensitivities.candidates.members[k]).name == name)
        return measure_change(fit, atom)

    return min(swapped, key=lambda name: (change(name), name))
