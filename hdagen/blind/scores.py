"""Scores of diagnoses against the truth, case by case."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hdagen.blind.realities.effect_places import EFFECT_PLACES

EQUIVALENT_EFFECTS = {"asymmetric_friction": "current_bias"}  # they differ near standstill only: either name counts
GAP_KEYS = ("before", "after", "after_true")
FACTOR_TOLERANCE = 0.2  # largest error of the factor of a wrong number, as a share of the true factor
WIDEST_INTERVAL = 1.5  # largest ratio of the ends of an interval that says enough
_NORMAL_95 = 1.96  # standard deviations to either side of a 95 % interval
SIZE_TOLERANCE = 0.15  # largest error of a found size, as a share of the true size
_LEAST_CLOSABLE_GAP = 0.5  # multiples of the noise: a flexible correction that closes less is no measure


@dataclass(frozen=True)
class Row:
    """One case of a ``kind`` with its truth and its diagnosis.

    ``truth``, ``optional`` (neither required nor wrong), ``verdict``, ``remainder``, ``ranked`` and ``confounded`` hold
    name@joint, with one name for equivalent effects. ``numbers``: those of ``truth`` that are wrong numbers of the
    robot file. ``remainder``: unknown effects that the diagnosis states beside
    the named ones; they are no part of ``verdict``. ``p_truth``: probability of the truth; ``p_top``: of the first
    cause; ``p_stated``: of the leading hypothesis before calibration. ``brier``: score over the hypotheses. ``found``:
    parameters of the verdict's causes. ``before``, ``after``: gap on the hold-out; ``after_true``: gap with the true
    parameters. ``achieved``: the closed share of the gap that a flexible correction closes, by the diagnosis itself.
    ``failed``: the reason why there is no diagnosis, else empty.
    """

    name: str
    kind: str
    truth: tuple[str, ...]
    sizes: tuple[float, ...]
    background: float
    snr: float
    parameters: Mapping[str, Mapping[str, float]]
    optional: tuple[str, ...] = ()
    numbers: tuple[str, ...] = ()
    verdict: tuple[str, ...] = ()
    remainder: tuple[str, ...] = ()
    sure: bool = False
    p_truth: float = 0.0
    p_top: float = 0.0
    p_stated: float = 0.0
    brier: float = 2.0
    ranked: tuple[str, ...] = ()
    confounded: tuple[str, ...] = ()
    place: str = ""
    found: Mapping[str, Mapping[str, Mapping[str, float]]] | None = None
    seconds: float = math.nan
    before: float = math.nan
    after: float = math.nan
    after_true: float = math.nan
    achieved: float = math.nan
    failed: str = ""

    @property
    def has_gap(self) -> bool:
        """Whether the gap was measured before and after the diagnosis."""
        return math.isfinite(self.before) and math.isfinite(self.after)

    @property
    def truth_with_names(self) -> tuple[str, ...]:
        """The truth without the unknown effect beside the named ones."""
        return split_unknown(self.truth)[0]

    @property
    def true_effect(self) -> str:
        """Name of the only true effect."""
        return self.truth[0].split("@")[0]

    @property
    def named_effects(self) -> tuple[str, ...]:
        """Names of the verdict."""
        return tuple(one.split("@")[0] for one in self.verdict)

    @property
    def is_effect_right(self) -> bool:
        """Whether the verdict names the only true effect and nothing else that is wrong."""
        return tuple(one.split("@")[0] for one in self.verdict if one not in self.optional) == (self.true_effect,)

    @property
    def is_joint_right(self) -> bool:
        """Whether the verdict's first effect is at the true joint; an effect of the whole arm has no joint to miss."""
        joint = self.truth[0].split("@")[1]
        return bool(self.verdict) and joint in ("0", self.verdict[0].split("@")[1])

    @property
    def is_right(self) -> bool:
        """Whether the verdict names all true effects at their joints and nothing else; a tilt has no joint."""
        tilted = len(self.truth_with_names) == 1 and self.is_effect_right and self.true_effect == "gravity_tilt"
        return sorted(set(self.verdict) - set(self.optional)) == sorted(self.truth_with_names) or tilted

    @property
    def is_unknown_right(self) -> bool:
        """Whether the diagnosis states the unknown effect at its joint, alone or beside named effects."""
        return set(self.truth) - set(self.truth_with_names) <= {*self.verdict, *self.remainder}

    @property
    def right_numbers(self) -> tuple[str, ...]:
        """The wrong numbers of the robot file that the verdict names with their factor."""
        return tuple(
            one
            for one in self.numbers
            if one in self.verdict and is_factor_right((self.found or {}).get(one, {}), self.parameters[one]["factor"])
        )

    @property
    def is_effect_beside_right(self) -> bool:
        """Whether the verdict names the effects beside the wrong numbers."""
        return set(self.truth_with_names) - set(self.numbers) <= set(self.verdict)

    @property
    def are_sizes_right(self) -> bool:
        """Whether the sizes of all true frictions are found within `SIZE_TOLERANCE`."""
        for key in self.truth_with_names:
            true = self.true_parameters(key)["size"]
            found = (self.found or {}).get(key, {}).get(key.partition("@")[0], {}).get("value", math.nan)
            if not abs(float(found) - true) <= SIZE_TOLERANCE * abs(true):
                return False
        return True

    def true_parameters(self, key: str) -> Mapping[str, float]:
        """Look up the true parameters of an effect, name@joint.

        Returns:
            Parameters by name, SI. A term of a real joint's friction also has the ``size`` that fits it best: together
            with the joint's other term where the verdict names that too, else with the robot file's number for it.

        """
        own = self.parameters[key]
        if self.kind != "joint":
            return own
        both_named = any(one != key and one.endswith(key[key.index("@") :]) for one in self.verdict)
        return {**own, "size": own["level"] if both_named else own["alone"]}

    @property
    def is_place_right(self) -> bool:
        """Whether the diagnosis places the gap where the effect acts."""
        return self.place == EFFECT_PLACES.get(self.true_effect)


def is_factor_right(found: Mapping[str, Mapping[str, Any]], true: float) -> bool:
    """Tell whether the factor of a wrong number was found.

    Args:
        found: estimates of the cause; empty where another number stands for it that the motion cannot part from it.
        true: the factor, truth over file.

    Returns:
        Whether the factor is within `FACTOR_TOLERANCE`, or its 95 % interval holds the truth and is no wider than
        `WIDEST_INTERVAL`.

    """
    if not found:
        return True
    estimate = _read_factor(found)
    if estimate is None:
        return False
    value, std = estimate
    low, high = value - _NORMAL_95 * std, value + _NORMAL_95 * std
    holds = low <= true <= high and 0.0 < high <= WIDEST_INTERVAL * low
    return abs(value / true - 1.0) <= FACTOR_TOLERANCE or holds


def _read_factor(found: Mapping[str, Mapping[str, Any]]) -> tuple[float, float] | None:
    """Factor and standard deviation: stated as such, as a level, or as a value beside the robot file's."""
    for name in ("factor", "stiffness_level", "torque_gain"):
        if name in found:
            return float(found[name]["value"]), float(found[name]["std"] or 0.0)
    known = [one for one in found.values() if one.get("file")]
    if len(known) != 1:
        return None
    return known[0]["value"] / known[0]["file"], (known[0]["std"] or 0.0) / abs(known[0]["file"])


def split_unknown(names: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Split effects (name@joint) into named ones and the unknown ones beside them.

    Returns:
        The named effects, and the unknown ones; where none has a name, the unknown ones count as named.

    """
    unknown = tuple(one for one in names if one.startswith("unknown@"))
    named = tuple(one for one in names if one not in unknown)
    return (named, unknown) if named else (unknown, ())


def merge_equivalent(name: str) -> str:
    """Give equivalent effects (name@joint) one name.

    Returns:
        The same joint with the name that stands for all effects of `EQUIVALENT_EFFECTS`.

    """
    effect, _, joint = name.partition("@")
    return f"{EQUIVALENT_EFFECTS.get(effect, effect)}@{joint}"


def score_case(
    name: str,
    label: Mapping[str, Any],
    told: Mapping[str, Any],
    result: Mapping[str, Any],
    said: Mapping[str, Any] | None,
) -> Row:
    """Score the diagnosis of a case.

    Args:
        name: the case's name.
        label: the sealed label.
        told: the answer of `hdagen.blind.realities.log_maker`, the truth about the log.
        result: duration of the diagnosis, s, and gaps, or the reason why it ``failed``.
        said: content of diagnosis.json; None where there is none.

    Returns:
        The case's row; its ``failed`` says why a diagnosis could not be scored.

    """
    truth = tuple(merge_equivalent(one) for one in label["verdict"])
    optional, numbers = tuple(label.get("optional", ())), tuple(label.get("numbers", ()))
    known: dict[str, Any] = {
        "name": name,
        "kind": label["kind"],
        "truth": truth,
        "optional": optional,
        "numbers": numbers,
        "sizes": tuple(label["sizes"]),
        "background": label["background"],
        "snr": told["snr"],
        "parameters": {merge_equivalent(one): told["parameters"][one] for one in (*label["verdict"], *optional)},
        "seconds": result.get("seconds", math.nan),
    }
    if said is None or result.get("failed"):
        return Row(**known, failed=result.get("failed") or "there is no diagnosis.json")
    try:
        read = _read_diagnosis(split_unknown(truth)[0], optional, replace_stand_ins(said, truth, numbers))
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
        return Row(**known, failed=f"diagnosis.json is not as diagnosis_json.md says: {type(error).__name__} {error}")
    gaps = {key: result[key] for key in GAP_KEYS if result.get(key) is not None}
    return Row(**known | read | gaps)


def replace_stand_ins(said: Mapping[str, Any], truth: Sequence[str], numbers: Sequence[str]) -> Mapping[str, Any]:
    """Give causes that stand for a wrong number the number's name: of a combination that the motion cannot part any
    member counts, and a payload for the mass of the last link.

    Args:
        said: content of diagnosis.json.
        truth: all true effects and numbers, name@joint.
        numbers: those that are wrong numbers of the robot file.

    Returns:
        The content with the names of the truth; such a cause has no estimates.

    """
    renamed: dict[str, str] = {}
    for cause in said["causes"]:
        key = f"{cause['effect']}@{cause['joint']}"
        members = [*cause.get("combination", ())]
        if cause["effect"] == "payload":
            members.append(f"mass@{cause['joint']}")
        missed = [one for one in members if one in numbers and one not in {*said["verdict"], *renamed.values()}]
        if key in said["verdict"] and key not in truth and missed:
            renamed[key] = missed[0]
    if not renamed:
        return said

    def rename_cause(cause: Mapping[str, Any]) -> Mapping[str, Any]:
        key = f"{cause['effect']}@{cause['joint']}"
        if key not in renamed:
            return cause
        effect, _, joint = renamed[key].partition("@")
        return {**cause, "effect": effect, "joint": int(joint), "parameters": {}}

    def rename_all(names: Sequence[str]) -> list[str]:
        return [renamed.get(one, one) for one in names]

    left = [c for c in said["causes"] if f"{c['effect']}@{c['joint']}" not in renamed.values()]
    return {
        **said,
        "verdict": rename_all(said["verdict"]),
        "causes": [rename_cause(cause) for cause in left],
        "hypotheses": [{**one, "effects": rename_all(one["effects"])} for one in said["hypotheses"]],
    }


def _read_diagnosis(truth: tuple[str, ...], optional: tuple[str, ...], said: Mapping[str, Any]) -> dict[str, Any]:
    """Read the fields of a row from a diagnosis.json."""
    marginal: dict[str, float] = {}
    found: dict[str, dict[str, Any]] = {}
    confounded: list[str] = []
    verdict, remainder = split_unknown([merge_equivalent(one) for one in said["verdict"]])
    for cause in said["causes"]:
        key = merge_equivalent(f"{cause['effect']}@{cause['joint']}")
        marginal[key] = min(1.0, marginal.get(key, 0.0) + _check_probability(cause["probability"]))
        if key in verdict:
            found.setdefault(key, dict(cause.get("parameters", {})))
            confounded += [merge_equivalent(one) for one in cause.get("confounded_with", [])]
    if not any(one in marginal for one in verdict):  # no effect, or unknown: undetectable effects may be there
        confounded += [merge_equivalent(one) for one in said.get("undetectable", [])]
    causes = {f"{cause['effect']}@{cause['joint']}" for cause in said["causes"]}
    hypotheses: dict[frozenset[str], float] = {}
    for one in said["hypotheses"]:
        effects = _required_effects([merge_equivalent(effect) for effect in one["effects"]], optional)
        hypotheses[effects] = hypotheses.get(effects, 0.0) + _check_probability(one["probability"])
        for effect in effects:  # an unknown effect may stand among the hypotheses only
            if effect.startswith("unknown@") and effect not in causes:
                marginal[effect] = min(1.0, marginal.get(effect, 0.0) + _check_probability(one["probability"]))
    true = frozenset(truth)
    p_truth = float(np.mean([marginal.get(one, 0.0) for one in truth])) if truth else hypotheses.get(true, 0.0)
    brier = sum((p - (effects == true)) ** 2 for effects, p in hypotheses.items()) + (true not in hypotheses)
    places = [where["place"] for where in said["where"]]
    leading = hypotheses.get(_required_effects(verdict, optional), 0.0)
    return {
        "verdict": verdict,
        "remainder": remainder,
        "sure": bool(said["sure"]),
        "p_truth": p_truth,
        "p_top": max(marginal.values(), default=0.0),
        "p_stated": _check_probability(said.get("method", {}).get("uncalibrated_probability", leading)),
        "brier": float(brier),
        "ranked": tuple(sorted(marginal, key=lambda key: -marginal[key])[:3]),
        "confounded": tuple(dict.fromkeys(confounded)),
        "place": next(iter(places), ""),
        "found": found,
        "achieved": _achieved_share(said["gap"]),
    }


def _required_effects(names: Sequence[str], optional: Sequence[str]) -> frozenset[str]:
    """The named effects that are not optional."""
    return frozenset(split_unknown(names)[0]) - frozenset(optional)


def _achieved_share(gap: Mapping[str, Any]) -> float:
    """The closed share of the gap that a flexible correction closes, on the motion that the diagnosis held out; NaN
    where such a correction closes hardly anything."""
    before, after, flexible = gap["before"], gap["after"], gap["flexible"]
    if flexible is None or before - flexible <= _LEAST_CLOSABLE_GAP:
        return math.nan
    return float((before - after) / (before - flexible))


def _check_probability(value: Any) -> float:
    if not 0.0 <= float(value) <= 1.0:
        raise ValueError(f"a probability of {value}")
    return float(value)
