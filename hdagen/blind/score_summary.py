"""Figures of a check from the rows of its cases: rates and means with intervals, calibration, confusions."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from hdagen.blind.confidence_intervals import Figure, estimate_mean, estimate_median, estimate_rate
from hdagen.blind.scores import Row

CONFIDENCE_BINS = 10  # of confidence, between 0 and 1
_VISIBLE_GAP, _WORSE_GAP_RATIO = (
    1.5,
    1.02,
)  # smallest gap that can be closed, in noise; ratio from which a gap has grown
LARGEST_GAP_RATIO = 1.3  # largest ratio of the gap after the diagnosis to the gap that the true parameters leave
_SINGLE_KINDS = ("single", "background", "task", "unknown+one")  # kinds with one effect that has a name


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
    kinds = ("pair", "none", "unknown", "unknown+one", "joint", "rough")
    pairs, none, unknown, both, joints, rough = ([row for row in rows if row.kind == kind] for kind in kinds)
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
        "sure": estimate_rate([row.sure for row in [*one, *joints, *rough]]),
        "sure_and_wrong": estimate_rate([row.sure and not row.is_right for row in [*one, *joints, *rough]]),
        "confounded_where_wrong": estimate_rate([row.truth[0] in row.confounded for row in wrong]),
        "false_alarm": estimate_rate([bool(row.verdict) for row in none if not row.failed]),
        "unknown_found": estimate_rate([row.named_effects == ("unknown",) for row in unknown]),
        "unknown_found_at_joint": estimate_rate([row.verdict == row.truth for row in unknown]),
        "both_said": estimate_rate([row.is_right and row.is_unknown_right for row in both]),
        "unknown_said_at_joint": estimate_rate([row.is_unknown_right for row in both]),
        "numbers_right": estimate_rate([set(row.right_numbers) == set(row.numbers) for row in rough]),
        "number_right": estimate_rate([number in row.right_numbers for row in rough for number in row.numbers]),
        "effect_beside": estimate_rate(
            [row.is_effect_beside_right for row in rough if len(row.truth) > len(row.numbers)]
        ),
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
    return _bin_outcomes([row.p_top for row in rows], [row.is_right for row in rows])


def _bin_outcomes(said: Sequence[float], right: Sequence[bool]) -> list[tuple[Figure, Figure]]:
    """For each tenth of the stated probabilities that occurs their mean, and the share that came out right."""
    found = []
    place = [min(int(p * CONFIDENCE_BINS), CONFIDENCE_BINS - 1) for p in said]
    for at in range(CONFIDENCE_BINS):
        inside = [k for k, bin_ in enumerate(place) if bin_ == at]
        if inside:
            found.append((estimate_mean([said[k] for k in inside]), estimate_rate([right[k] for k in inside])))
    return found


def calibration_error(rows: Sequence[Row]) -> Figure:
    """Compute the expected calibration error over the bins of confidence.

    Returns:
        The error, between 0 and 1; its interval follows from the standard errors of the shares.

    """
    return measure_calibration_error([row.p_top for row in rows], [row.is_right for row in rows])


def measure_calibration_error(said: Sequence[float], right: Sequence[bool]) -> Figure:
    """Measure the expected calibration error of stated probabilities.

    Args:
        said: the probability of each case.
        right: whether each case came out so.

    Returns:
        The error, between 0 and 1; its interval follows from the standard errors of the shares.

    """
    if not said:
        return estimate_mean([])
    parts = _bin_outcomes(said, right)
    error = sum(abs(mean.value - share.value) * share.count for mean, share in parts) / len(said)
    spread = math.sqrt(sum(share.value * (1 - share.value) * share.count for _, share in parts)) / len(said)
    return Figure(error, len(said), max(error - 1.96 * spread, 0.0), error + 1.96 * spread)


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
    """Count cases by true effect and by verdict; cases of several effects are left out.

    Returns:
        Counts by true effect, then by the verdict's effect: "none" without one, "several" with more than one, "failed"
        without a diagnosis.

    """
    found: dict[str, dict[str, int]] = {}
    for row in rows:
        if row.kind in ("pair", "joint", "rough"):
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
