"""Scores of diagnoses against the truth, case by case and together."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hdagen.blind.confidence_intervals import Figure, mean, median, rate
from hdagen.blind.realities.effect_sizes import SIZES

SAME = {"asymmetric_friction": "current_bias"}  # they differ near standstill only: either name counts
BINS = 10  # of confidence, between 0 and 1
GAPS = ("before", "after", "after_true")
_VISIBLE_GAP, _WORSE = 1.5, 1.02  # smallest gap that can be closed, in noise; ratio from which a gap has grown
SIZE_WITHIN = 0.15  # largest error of a found size, as a share of the true size
AFTER_WITHIN = 1.3  # largest ratio of the gap after the diagnosis to the gap that the true parameters leave
_ONE = ("single", "background", "task", "unknown+one")  # kinds with one effect that has a name
_CLOSABLE = 0.5  # multiples of the noise: a flexible correction that closes less is no measure


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
    def to_name(self) -> tuple[str, ...]:
        """The truth without the unknown effect beside the named ones."""
        return parted(self.truth)[0]

    @property
    def effect(self) -> str:
        """Name of the only true effect."""
        return self.truth[0].split("@")[0]

    @property
    def named(self) -> tuple[str, ...]:
        """Names of the verdict."""
        return tuple(one.split("@")[0] for one in self.verdict)

    @property
    def effect_right(self) -> bool:
        """Whether the verdict names the only true effect and nothing else."""
        return self.named == (self.effect,)

    @property
    def joint_right(self) -> bool:
        """Whether the verdict's first effect is at the true joint; an effect of the whole arm has no joint to miss."""
        joint = self.truth[0].split("@")[1]
        return bool(self.verdict) and joint in ("0", self.verdict[0].split("@")[1])

    @property
    def right(self) -> bool:
        """Whether the verdict names all true effects at their joints and nothing else; a tilt has no joint."""
        tilted = len(self.to_name) == 1 and self.effect_right and self.effect == "gravity_tilt"
        return sorted(set(self.verdict) - set(self.optional)) == sorted(self.to_name) or tilted

    @property
    def unknown_right(self) -> bool:
        """Whether the diagnosis states the unknown effect at its joint, alone or beside named effects."""
        return set(self.truth) - set(self.to_name) <= {*self.verdict, *self.remainder}

    @property
    def sizes_right(self) -> bool:
        """Whether the sizes of all true frictions are found within `SIZE_WITHIN`."""
        for key in self.to_name:
            true = self.true_parameters(key)["size"]
            found = (self.found or {}).get(key, {}).get(key.partition("@")[0], {}).get("value", math.nan)
            if not abs(float(found) - true) <= SIZE_WITHIN * abs(true):
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
    def place_right(self) -> bool:
        """Whether the diagnosis places the gap where the effect acts."""
        return self.effect in SIZES and self.place == SIZES[self.effect].place


def parted(names: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Split effects (name@joint) into named ones and the unknown ones beside them.

    Returns:
        The named effects, and the unknown ones; where none has a name, the unknown ones count as named.

    """
    unknown = tuple(one for one in names if one.startswith("unknown@"))
    named = tuple(one for one in names if one not in unknown)
    return (named, unknown) if named else (unknown, ())


def alike(name: str) -> str:
    """Give equivalent effects (name@joint) one name.

    Returns:
        The same joint with the name that stands for all effects of `SAME`.

    """
    effect, _, joint = name.partition("@")
    return f"{SAME.get(effect, effect)}@{joint}"


def judged(
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
    truth = tuple(alike(one) for one in label["verdict"])
    optional = tuple(label.get("optional", ()))
    known: dict[str, Any] = {
        "name": name,
        "kind": label["kind"],
        "truth": truth,
        "optional": optional,
        "sizes": tuple(label["sizes"]),
        "background": label["background"],
        "snr": told["snr"],
        "parameters": {alike(one): told["parameters"][one] for one in (*label["verdict"], *optional)},
        "seconds": result.get("seconds", math.nan),
    }
    if said is None or result.get("failed"):
        return Row(**known, failed=result.get("failed") or "there is no diagnosis.json")
    try:
        read = _read(parted(truth)[0], optional, said)
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
        return Row(**known, failed=f"diagnosis.json is not as docs/diagnosis.md says: {type(error).__name__} {error}")
    gaps = {key: result[key] for key in GAPS if result.get(key) is not None}
    return Row(**known | read | gaps)


def _read(truth: tuple[str, ...], optional: tuple[str, ...], said: Mapping[str, Any]) -> dict[str, Any]:
    """Read the fields of a row from a diagnosis.json."""
    marginal: dict[str, float] = {}
    found: dict[str, dict[str, Any]] = {}
    confounded: list[str] = []
    verdict, remainder = parted([alike(one) for one in said["verdict"]])
    for cause in said["causes"]:
        key = alike(f"{cause['effect']}@{cause['joint']}")
        marginal[key] = min(1.0, marginal.get(key, 0.0) + _probability(cause["probability"]))
        if key in verdict:
            found.setdefault(key, dict(cause.get("parameters", {})))
            confounded += [alike(one) for one in cause.get("confounded_with", [])]
    if not any(one in marginal for one in verdict):  # no effect, or unknown: undetectable effects may be there
        confounded += [alike(one) for one in said.get("unseen", [])]
    causes = {f"{cause['effect']}@{cause['joint']}" for cause in said["causes"]}
    hypotheses: dict[frozenset[str], float] = {}
    for one in said["hypotheses"]:
        effects = _asked_for([alike(effect) for effect in one["effects"]], optional)
        hypotheses[effects] = hypotheses.get(effects, 0.0) + _probability(one["probability"])
        for effect in effects:  # an unknown effect may stand among the hypotheses only
            if effect.startswith("unknown@") and effect not in causes:
                marginal[effect] = min(1.0, marginal.get(effect, 0.0) + _probability(one["probability"]))
    true = frozenset(truth)
    p_truth = float(np.mean([marginal.get(one, 0.0) for one in truth])) if truth else hypotheses.get(true, 0.0)
    brier = sum((p - (effects == true)) ** 2 for effects, p in hypotheses.items()) + (true not in hypotheses)
    places = [where["place"] for where in said["where"]]
    leading = hypotheses.get(_asked_for(verdict, optional), 0.0)
    return {
        "verdict": verdict,
        "remainder": remainder,
        "sure": bool(said["sure"]),
        "p_truth": p_truth,
        "p_top": max(marginal.values(), default=0.0),
        "p_stated": _probability(said.get("method", {}).get("uncalibrated", leading)),
        "brier": float(brier),
        "ranked": tuple(sorted(marginal, key=lambda key: -marginal[key])[:3]),
        "confounded": tuple(dict.fromkeys(confounded)),
        "place": next(iter(places), ""),
        "found": found,
        "achieved": _achieved(said["gap"]),
    }


def _asked_for(names: Sequence[str], optional: Sequence[str]) -> frozenset[str]:
    """The named effects that are not optional."""
    return frozenset(parted(names)[0]) - frozenset(optional)


def _achieved(gap: Mapping[str, Any]) -> float:
    """The closed share of the gap that a flexible correction closes, on the motion that the diagnosis held out; NaN
    where such a correction closes hardly anything."""
    before, after, flexible = gap["before"], gap["after"], gap["flexible"]
    if flexible is None or before - flexible <= _CLOSABLE:
        return math.nan
    return float((before - after) / (before - flexible))


def _probability(value: Any) -> float:
    if not 0.0 <= float(value) <= 1.0:
        raise ValueError(f"a probability of {value}")
    return float(value)


def _f1(row: Row) -> float:
    return 2 * len(set(row.verdict) & set(row.truth)) / max(len(row.verdict) + len(row.truth), 1)


def closed(row: Row) -> float:
    """Compute the share of the gap that the verdict closes.

    Returns:
        1 where only the sensors' noise is left, 0 where the gap is as before, below 0 where it has grown.

    """
    return (row.before - row.after) / max(row.before - 1.0, 0.1)


def single(rows: Sequence[Row]) -> list[Row]:
    """Select the cases with a single effect that has a name.

    Returns:
        The selected cases, in the same order.

    """
    return [row for row in rows if row.kind in _ONE]


def summary(rows: Sequence[Row]) -> dict[str, Figure]:
    """Compute every figure of a check. A failed case counts as wrong; it has no gap and raises no false alarm.

    Returns:
        Figures by the keys of `hdagen.blind.labels.WORDS`, without those that no case tells anything of.

    """
    kinds = ("pair", "none", "unknown", "unknown+one", "joint")
    pairs, none, unknown, both, joints = ([row for row in rows if row.kind == kind] for kind in kinds)
    one = single(rows)
    wrong = [row for row in one if not row.right]
    gaps = [row for row in rows if row.has_gap]
    known = [row for row in gaps if math.isfinite(row.after_true)]
    found = {
        "failed": rate([bool(row.failed) for row in rows]),
        "effect": rate([row.effect_right for row in one]),
        "effect_and_joint": rate([row.right for row in one]),
        "joint": rate([row.joint_right for row in one]),
        "place": rate([row.place_right for row in one if row.kind != "unknown+one"]),
        "top3": rate([row.truth[0] in row.ranked for row in one]),
        "p_truth": mean([row.p_truth for row in rows if row.kind not in ("none", "unknown")]),
        "brier": mean([row.brier for row in rows]),
        "calibration_error": calibration_error(one),
        "sure": rate([row.sure for row in [*one, *joints]]),
        "sure_and_wrong": rate([row.sure and not row.right for row in [*one, *joints]]),
        "confounded_where_wrong": rate([row.truth[0] in row.confounded for row in wrong]),
        "false_alarm": rate([bool(row.verdict) for row in none if not row.failed]),
        "unknown_found": rate([row.named == ("unknown",) for row in unknown]),
        "unknown_found_at_joint": rate([row.verdict == row.truth for row in unknown]),
        "both_said": rate([row.right and row.unknown_right for row in both]),
        "unknown_said_at_joint": rate([row.unknown_right for row in both]),
        "named": rate([row.right for row in joints]),
        "sizes_within": rate([row.sizes_right for row in joints if row.right]),
        "after_within": rate([row.after <= AFTER_WITHIN * row.after_true for row in known]),
        "remainder": rate([bool(row.remainder) for row in rows if not row.failed]),
        "pair_f1": mean([_f1(row) for row in pairs]),
        "pair_both": rate([set(row.verdict) == set(row.truth) for row in pairs]),
        "closed": median([closed(row) for row in gaps if row.before > _VISIBLE_GAP and row.truth]),
        "achieved": median([row.achieved for row in rows if math.isfinite(row.achieved) and row.truth]),
        "worse": rate([row.after > _WORSE * row.before for row in gaps]),
        "seconds": median([row.seconds for row in rows if math.isfinite(row.seconds)]),
    }
    return {name: figure for name, figure in found.items() if figure.count}


def bins(rows: Sequence[Row]) -> list[tuple[Figure, Figure]]:
    """Sort cases by the confidence of their verdict into tenths.

    Returns:
        For each tenth that occurs the mean stated probability, and the share of right verdicts.

    """
    found = []
    place = [min(int(row.p_top * BINS), BINS - 1) for row in rows]
    for at in range(BINS):
        inside = [row for row, bin_ in zip(rows, place, strict=True) if bin_ == at]
        if inside:
            found.append((mean([row.p_top for row in inside]), rate([row.right for row in inside])))
    return found


def calibration_error(rows: Sequence[Row]) -> Figure:
    """Compute the expected calibration error over the bins of confidence.

    Returns:
        The error, between 0 and 1; its interval follows from the standard errors of the shares.

    """
    if not rows:
        return mean([])
    parts = bins(rows)
    error = sum(abs(said.value - right.value) * right.count for said, right in parts) / len(rows)
    spread = math.sqrt(sum(right.value * (1 - right.value) * right.count for _, right in parts)) / len(rows)
    return Figure(error, len(rows), max(error - 1.96 * spread, 0.0), error + 1.96 * spread)


def coverage(rows: Sequence[Row]) -> tuple[np.ndarray, np.ndarray]:
    """Compute the accuracy of the surest cases, for every number of them.

    Returns:
        The share of cases that are answered (cases,), and the share of right verdicts among them (cases,).

    """
    ordered = sorted(rows, key=lambda row: -row.p_top)
    right = np.cumsum([row.right for row in ordered], dtype=float)
    count = np.arange(1.0, len(ordered) + 1.0)
    return count / max(len(ordered), 1), right / count


def confusion(rows: Sequence[Row]) -> dict[str, dict[str, int]]:
    """Count cases by true effect and by verdict; pairs and real joints are left out.

    Returns:
        Counts by true effect, then by the verdict's effect: "none" without one, "several" with more than one, "failed"
        without a diagnosis.

    """
    found: dict[str, dict[str, int]] = {}
    for row in rows:
        if row.kind in ("pair", "joint"):
            continue
        true = row.effect if row.truth else "none"
        line, said = found.setdefault(true, {}), _verdict_word(row)
        line[said] = line.get(said, 0) + 1
    return found


def _verdict_word(row: Row) -> str:
    """The verdict as the confusion table names it."""
    if row.failed:
        return "failed"
    if len(row.verdict) > 1:
        return "several"
    return (row.named or ("none",))[0]
