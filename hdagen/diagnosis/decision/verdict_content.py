"""The part of diagnosis.json that a decision fills: verdict, causes, hypotheses, parameters; and the verdict that it
states, ready to be simulated."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from hdagen.adoption import verdict
from hdagen.adoption.diagnosis_schema import SCHEMA
from hdagen.diagnosis.decision.decision_settings import DECISION
from hdagen.diagnosis.decision.file_trust import describe_factor
from hdagen.diagnosis.decision.identifiability import Identifiability
from hdagen.diagnosis.decision.parameter_estimates import (
    describe_file_number,
    estimate_base_parameters,
    estimate_parameters,
)
from hdagen.diagnosis.decision.posterior import Decision
from hdagen.diagnosis.decision.separating_experiments import suggest_experiments
from hdagen.diagnosis.inference.candidate_priors import Candidate
from hdagen.diagnosis.inference.candidate_settings import CANDIDATES
from hdagen.diagnosis.inference.local_fit import Fit
from hdagen.diagnosis.search.fit_ranking import first_with_columns
from hdagen.diagnosis.search.hypothesis_search import SearchResult


def describe_decision(found: SearchResult, decision: Decision) -> dict[str, Any]:
    """Describe a decision as diagnosis.json has it.

    Args:
        found: the search, with all fits.
        decision: made from it.

    Returns:
        The content that follows from the fits; the callers add the gap, the robot and the data.

    """
    best = decision.best
    whole = best
    if not best.has_columns:
        whole = first_with_columns(found.fits)
    told = Identifiability(whole, found.fits[0].temperature)
    unseen: Sequence[str] | None = decision.undetectable
    if unseen is None:
        unseen = told.find_undetectable()
    choice, members = describe_choice(found, decision, told), _list_members(found)
    return {
        "schema": SCHEMA,
        "verdict": choice["verdict"],
        "sure": choice["sure"],
        "where": [_locate_entry(entry, members) for entry in decision.verdict],
        "causes": choice["causes"],
        "hypotheses": choice["hypotheses"],
        "parameters": estimate_base_parameters(best),
        "undetectable": [name for name in unseen if name not in decision.verdict],
        "tried": sorted(members),
        "method": choice["method"],
    }


def describe_choice(found: SearchResult, decision: Decision, told: Identifiability | None = None) -> dict[str, Any]:
    """Describe what a decision chose, as diagnosis.json has it.

    Args:
        found: the search, with all fits.
        decision: made from it.
        told: what the motion can identify; without it, a cause is confounded with what may take its place alone.

    Returns:
        ``verdict``, ``sure``, ``causes``, ``hypotheses`` and ``method``.

    """
    best = decision.best
    named = dict.fromkeys(n for h in decision.hypotheses for n in h.names if not n.startswith("unknown@"))
    likely = {name: decision.marginal_probability(name) for name in named}
    return {
        "verdict": list(decision.verdict),
        "sure": decision.is_sure,
        "causes": _describe_causes(decision, likely, told, _list_members(found)),
        "hypotheses": [{"effects": list(h.names), "probability": h.probability} for h in decision.hypotheses],
        "method": {
            "calibrated": not decision.is_long_horizon,  # sealed checks have too few such cases
            "uncalibrated_probability": decision.uncalibrated_probability,
            "present_size": CANDIDATES.present_size,
            "most_doubt": DECISION.sure_below,
            "strained": list(decision.strained_numbers),
            "nuisance_width": best.sensitivities.candidates.spike_scale,
            "unexplained_torque": best.score.posterior.s,
            "noise_scale": math.sqrt(best.score.posterior.noise_level),
        },
    }


def _list_members(found: SearchResult) -> dict[str, Candidate]:
    """All candidates of a search's fits, by name."""
    return {atom.name: atom for fit in found.fits for atom in fit.sensitivities.candidates.members}


def _describe_causes(
    decision: Decision, likely: Mapping[str, float], told: Identifiability | None, members: Mapping[str, Candidate]
) -> list[dict[str, Any]]:
    """All candidates that were tried, the most probable first."""
    arm = decision.best.sensitivities.shooting.arm
    causes = []
    for name in sorted(likely, key=lambda name: -likely[name]):
        others = [
            o
            for o in likely
            if _compute_alternative_probability(decision, name, o) > DECISION.least_mentioned_probability
        ]
        if told and name in decision.verdict and name in told.columns and not decision.is_long_horizon:
            others += told.find_confusable(name)
        same = {*decision.verdict, *decision.combinations.get(name, ())}
        others = [o for o in dict.fromkeys(others) if o not in same]
        experiments = suggest_experiments(arm.effects, name, others)
        parameters = _list_parameters(name, decision)
        cause = _describe_cause(name, likely[name], parameters, others, experiments)
        if name in members:
            cause["parameters"] |= describe_factor(members[name], arm.parameters.described, parameters)
        if name in decision.combinations:
            cause["combination"] = list(decision.combinations[name])
        causes.append(cause)
    return causes


def _compute_alternative_probability(decision: Decision, name: str, other: str) -> float:
    """The probability that another effect takes the place of this one.

    Hypotheses in which it stands for another effect of the verdict do not count. It is 0 for an effect with direct
    evidence.
    """
    if name == other or name in decision.direct_evidence:
        return 0.0
    rest: set[str] = set()
    if name in decision.verdict:
        rest = set(decision.verdict) - {name}
    return sum(
        h.probability for h in decision.hypotheses if other in h.names and (name not in h.names or rest <= set(h.names))
    )


def _locate_entry(entry: str, members: Mapping[str, Candidate]) -> dict[str, Any]:
    """Joint and place of an effect; its share, and when it acts, are filled in later."""
    place = "motor"
    if entry in members:
        place = members[entry].place
    return {"joint": int(entry.partition("@")[2]), "place": place, "share": None, "interval": None, "when": ""}


def _list_parameters(name: str, decision: Decision) -> dict[str, Any]:
    """Parameters of a candidate, from its fit or from direct evidence; the latter have no standard deviation."""
    fit = next((h.fit for h in decision.hypotheses if name in h.names and h.fit), None)
    if fit is None and name not in decision.direct_evidence:
        return {}
    if name not in decision.direct_evidence:
        assert fit
        return estimate_parameters(
            fit, next(k for k in fit.effects if fit.sensitivities.candidates.members[k].name == name)
        )
    arm = decision.best.sensitivities.shooting.arm
    described = arm.parameters.described
    return {
        key: {"value": value, "std": None, "unit": described[key].unit, "end": None}
        | {"file": describe_file_number(arm, described[key])}
        for key, value in decision.direct_evidence[name].items()
    }


def _describe_cause(
    name: str, probability: float, parameters: dict[str, Any], confounded: list[str], experiments: str
) -> dict[str, Any]:
    """A candidate that was tried, as an entry of `causes`."""
    effect, _, joint = name.partition("@")
    suffix = ""
    if joint != "0":
        suffix = f"_{joint}"
    return {
        "effect": effect,
        "joint": int(joint),
        "probability": probability,
        "parameters": {key.removesuffix(suffix): value for key, value in parameters.items()},
        "confounded_with": confounded,
        "separate_by": experiments,
    }


@dataclass(frozen=True, eq=False)
class StatedEffects:
    """The effects that a decision states, with the parameters that its fits give them.

    Attributes:
        names: of the effects, effect@joint, in the order of the verdict; `unknown@joint` has no parameters.
        causes: the known ones, as entries of `causes` of diagnosis.json.

    """

    names: tuple[str, ...]
    causes: tuple[Mapping[str, Any], ...]

    def build_verdict(self, base_parameters: Mapping[str, Any]) -> verdict.Verdict:
        """Build the verdict of these effects.

        Args:
            base_parameters: `parameters` of diagnosis.json.

        Returns:
            The verdict, ready to be applied to a model.

        """
        said = {
            "schema": SCHEMA,
            "verdict": list(self.names),
            "causes": list(self.causes),
            "parameters": base_parameters,
        }
        return verdict.read_verdict(said)


def state_effects(decision: Decision) -> StatedEffects:
    """List the effects of a decision's verdict with their parameters.

    Args:
        decision: the decision.

    Returns:
        The effects.

    """
    known = [name for name in decision.verdict if not name.startswith("unknown@")]
    causes = [_describe_cause(name, 1.0, _list_parameters(name, decision), [], "") for name in known]
    return StatedEffects(decision.verdict, tuple(causes))


def build_hypothetical_verdict(fit: Fit, names: Sequence[str]) -> verdict.Verdict:
    """Build the verdict that some effects would have at the parameters of a fit.

    Args:
        fit: whose parameters are taken.
        names: of the effects, effect@joint; those that the fit lacks are left out.

    Returns:
        The verdict, ready to be applied to a model.

    """
    there = [name for name in names if name in fit.names]
    atoms = {fit.sensitivities.candidates.members[k].name: k for k in fit.effects}
    causes = [_describe_cause(name, 1.0, estimate_parameters(fit, atoms[name]), [], "") for name in there]
    return StatedEffects(tuple(there), tuple(causes)).build_verdict(estimate_base_parameters(fit))
