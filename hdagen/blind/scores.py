"""Scores of diagnoses against the truth, case by case and together."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hdagen.blind.confidence_intervals import Figure, estimate_mean, estimate_median, estimate_rate
from hdagen.blind.realities.effect_sizes import EFFECT_SIZES

EQUIVALENT_EFFECTS = {"asymmetric_friction": "current_bias"}  # they differ near standstill only: either name counts
CONFIDENCE_BINS = 10  # of confidence, between 0 and 1
GAP_KEYS = ("before", "after", "after_true")
_VISIBLE_GAP, _WORSE_GAP_RATIO = (
    1.5,
    1.02,
)  # smallest gap that can be closed, in noise; ratio from which a gap has grown
SIZE_TOLERANCE = 0.15  # largest error of a found size, as a share of the true size
LARGEST_GAP_RATIO = 1.3  # largest ratio of the gap after the diagnosis to the gap that the true parameters leave
_SINGLE_KINDS = ("single", "background", "task", "unknown+one")  # kinds with one effect that has a name
_LEAST_CLOSABLE_GAP = 0.5  # multiples of the noise: a flexible correction that closes less is no measure


@dataclass(frozen=True)
class Row:
    """One case of a ``kind`` with its truth and its diagnosis.

    ``truth``, ``optional`` (neither required nor wrong), ``verdict``, ``remainder``, ``ranked`` and ``confounded`` hold
    name@joint, with one name for equivalent effects. ``remainder``: unknown effects that the diagnosis states beside
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
        """Whether the verdict names the only true effect and nothing else."""
        return self.named_effects == (self.true_effect,)

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
        return self.true_effect in EFFECT_SIZES and self.place == EFFECT_SIZES[self.true_effect].place


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
    optional = tuple(label.get("optional", ()))
    known: dict[str, Any] = {
        "name": name,
        "kind": label["kind"],
        "truth": truth,
        "optional": optional,
        "sizes": tuple(label["sizes"]),
        "background": label["background"],
        "snr": told["snr"],
        "parameters": {merge_equivalent(one): told["parameters"][one] for one in (*label["verdict"], *optional)},
        "seconds": result.get("seconds", math.nan),
    }
    if said is None or result.get("failed"):
        return Row(**known, failed=result.get("failed") or "there is no diagnosis.json")
    try:
        read = _read_diagnosis(split_unknown(truth)[0], optional, said)
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
        return Row(**known, failed=f"diagnosis.json is not as diagnosis_json.md says: {type(error).__name__} {error}")
    gaps = {key: result[key] for key in GAP_KEYS if result.get(key) is not None}
    return Row(**known | read | gaps)


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
        confounded += [merge_equivalent(one) for one in said.get("unseen", [])]
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
        "p_stated": _check_probability(said.get("method", {}).get("uncalibrated", leading)),
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


def _f1_score(row: Row) -> float:
    return 2 * len(set(row.verdict) & set(row.truth)) / max(len(row.verdict) + len(row.truth), 1)


def closed_share(row: Row) -> float:
    """Compute the share of the gap that the verdict closes.

    Returns:
        1 where only the sensors' noise is left, 0 where the gap is as before, below 0 where it has grown.

    """
    return (row.before - row.after) / max(row.before - 1.0, 0.1)


def select_single(rows: Sequence[Row]) -> list[Row]:
    """Select the cases with a single effect that has a name.

    Returns:
        The selected cases, in the same order.

    """
    return [row for row in rows if row.kind in _SINGLE_KINDS]


def summarize_rows(rows: Sequence[Row]) -> dict[str, Figure]:
    """Compute every figure of a check. A failed case counts as wrong; it has no gap and raises no false alarm.

    Returns:
        Figures by the keys of `hdagen.blind.labels.FIGURE_LABELS`, without those that no case tells anything of.

    """
    kinds = ("pair", "none", "unknown", "unknown+one", "joint")
    pairs, none, unknown, both, joints = ([row for row in rows if row.kind == kind] for kind in kinds)
    one = select_single(rows)
    wrong = [row for row in one if not row.is_right]
    gaps = [row for row in rows if row.has_gap]
    known = [row for row in gaps if math.isfinite(row.after_true)]
    found = {
        "failed": estimate_rate([bool(row.failed) for row in rows]),
        "effect": estimate_rate([row.is_effect_right for row in one]),
        "effect_and_joint": estimate_rate([row.is_right for row in one]),
        "joint": estimate_rate([row.is_joint_right for row in one]),
        "place": estimate_rate([row.is_place_right for row in one if row.kind != "unknown+one"]),
        "top3": estimate_rate([row.truth[0] in row.ranked for row in one]),
        "p_truth": estimate_mean([row.p_truth for row in rows if row.kind not in ("none", "unknown")]),
        "brier": estimate_mean([row.brier for row in rows]),
        "calibration_error": calibration_error(one),
        "sure": estimate_rate([row.sure for row in [*one, *joints]]),
        "sure_and_wrong": estimate_rate([row.sure and not row.is_right for row in [*one, *joints]]),
        "confounded_where_wrong": estimate_rate([row.truth[0] in row.confounded for row in wrong]),
        "false_alarm": estimate_rate([bool(row.verdict) for row in none if not row.failed]),
        "unknown_found": estimate_rate([row.named_effects == ("unknown",) for row in unknown]),
        "unknown_found_at_joint": estimate_rate([row.verdict == row.truth for row in unknown]),
        "both_said": estimate_rate([row.is_right and row.is_unknown_right for row in both]),
        "unknown_said_at_joint": estimate_rate([row.is_unknown_right for row in both]),
        "named": estimate_rate([row.is_right for row in joints]),
        "sizes_within": estimate_rate([row.are_sizes_right for row in joints if row.is_right]),
        "after_within": estimate_rate([row.after <= LARGEST_GAP_RATIO * row.after_true for row in known]),
        "remainder": estimate_rate([bool(row.remainder) for row in rows if not row.failed]),
        "pair_f1": estimate_mean([_f1_score(row) for row in pairs]),
        "pair_both": estimate_rate([set(row.verdict) == set(row.truth) for row in pairs]),
        "closed": estimate_median([closed_share(row) for row in gaps if row.before > _VISIBLE_GAP and row.truth]),
        "achieved": estimate_median([row.achieved for row in rows if math.isfinite(row.achieved) and row.truth]),
        "worse": estimate_rate([row.after > _WORSE_GAP_RATIO * row.before for row in gaps]),
        "seconds": estimate_median([row.seconds for row in rows if math.isfinite(row.seconds)]),
    }
    return {name: figure for name, figure in found.items() if figure.count}


def bin_by_confidence(rows: Sequence[Row]) -> list[tuple[Figure, Figure]]:
    """Sort cases by the confidence of their verdict into tenths.

    Returns:
        For each tenth that occurs the mean stated probability, and the share of right verdicts.

    """
    found = []
    place = [min(int(row.p_top * CONFIDENCE_BINS), CONFIDENCE_BINS - 1) for row in rows]
    for at in range(CONFIDENCE_BINS):
        inside = [row for row, bin_ in zip(rows, place, strict=True) if bin_ == at]
        if inside:
            found.append(
                (estimate_mean([row.p_top for row in inside]), estimate_rate([row.is_right for row in inside]))
            )
    return found


def calibration_error(rows: Sequence[Row]) -> Figure:
    """Compute the expected calibration error over the bins of confidence.

    Returns:
        The error, between 0 and 1; its interval follows from the standard errors of the shares.

    """
    if not rows:
        return estimate_mean([])
    parts = bin_by_confidence(rows)
    error = sum(abs(said.value - right.value) * right.count for said, right in parts) / len(rows)
    spread = math.sqrt(sum(right.value * (1 - right.value) * right.count for _, right in parts)) / len(rows)
    return Figure(error, len(rows), max(error - 1.96 * spread, 0.0), error + 1.96 * spread)


def accuracy_by_coverage(rows: Sequence[Row]) -> tuple[np.ndarray, np.ndarray]:
    """Compute the accuracy of the surest cases, for every number of them.

    Returns:
        The share of cases that are answered (cases,), and the share of right verdicts among them (cases,).

    """
    ordered = sorted(rows, key=lambda row: -row.p_top)
    right = np.cumsum([row.is_right for row in ordered], dtype=float)
    count = np.arange(1.0, len(ordered) + 1.0)
    return count / max(len(ordered), 1), right / count


def count_confusions(rows: Sequence[Row]) -> dict[str, dict[str, int]]:
    """Count cases by true effect and by verdict; pairs and real joints are left out.

    Returns:
        Counts by true effect, then by the verdict's effect: "none" without one, "several" with more than one, "failed"
        without a diagnosis.

    """
    found: dict[str, dict[str, int]] = {}
    for row in rows:
        if row.kind in ("pair", "joint"):
            continue
        true = row.true_effect if row.truth else "none"
        line, said = found.setdefault(true, {}), _verdict_word(row)
        line[said] = line.get(said, 0) + 1
    return found


def _verdict_word(row: Row) -> str:
    """The verdict as the confusion table names it."""
    if row.failed:
        return "failed"
    if len(row.verdict) > 1:
        return "several"
    return (row.named_effects or ("none",))[0]
