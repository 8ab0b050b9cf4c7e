"""The gap on held-out motion before and after a verdict, with a bootstrap interval over blocks of windows."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.diagnosis.data.data_settings import DATA
from hdagen.diagnosis.data.split import LogPortion
from hdagen.prediction.measurement_model import Rows
from hdagen.prediction.window_replay import Replay, combine_channel_errors


def evaluate_gap(before: Replay, after: Replay, held: LogPortion, flexible: Replay | None = None) -> dict[str, Any]:
    """Compute `gap` of diagnosis.json on held-out motion.

    A gap is the root mean square of the replay errors in multiples of each channel's noise, `combine_channel_errors`
    over the channels that the model can err in. The interval of the closed share comes from blocks of windows drawn
    with replacement, the same draws at each call.

    Args:
        before: the replay of the robot file's model.
        after: the replay with the verdict.
        held: the held-out rows (T,) of the log.
        flexible: the replay of the nonparametric baseline, if there is one.

    Returns:
        The gap ``before``, ``after``, with the ``flexible`` correction, and the least of them, ``achievable``; the
        share of the gap above the noise that is closed, ``shrink``, with its ``interval``; and the errors by channel.

    Source: Efron, Tibshirani, An Introduction to the Bootstrap (1993), 8.6.

    """
    replays = [before, after]
    if flexible is not None:
        replays.append(flexible)
    squares, rows, names = _sum_window_errors(before, replays, held)
    each = np.sqrt(squares.sum(1) / rows.sum())
    left = combine_channel_errors(each)
    of_flexible = None
    if flexible is not None:
        of_flexible = float(left[2])
    return {
        "before": float(left[0]),
        "after": float(left[1]),
        "floor": 1.0,
        "flexible": of_flexible,
        "achievable": float(left.min()),
        "shrink": _compute_shrink(left),
        "interval": _compute_interval(
            s for s in map(_compute_shrink, _draw_blocks(squares[:2], rows)) if s is not None
        ),
        "by_channel": _describe_channels(each, names, before),
    }


def choose_closest_replay(seen: Sequence[Replay], held: LogPortion) -> Replay:
    """Choose the replay with the smallest gap.

    Args:
        seen: replays of one log, the first one of the robot file's model.
        held: the held-out rows (T,) of the log.

    Returns:
        One of them.

    """
    squares, rows, _ = _sum_window_errors(seen[0], seen, held)
    return seen[int(np.argmin(combine_channel_errors(np.sqrt(squares.sum(1) / rows.sum()))))]


def compute_gap_bounds(
    told: Mapping[str, Any], rungs: Sequence[Mapping[str, Any]], tolerated: Sequence[Mapping[str, Any]]
) -> dict[str, float]:
    """Bound the gap by everything that was fitted.

    The flexible correction may use the base parameters as they are refitted without an effect, so it leaves no more
    than these do. No model leaves less than the achievable gap.

    Args:
        told: `evaluate_gap` of diagnosis.json.
        rungs: `ranking` of diagnosis.json.
        tolerated: `nuisance_effects` of diagnosis.json.

    Returns:
        The bounded ``flexible`` and ``achievable``, in multiples of the noise.

    """
    flexible = min([told["flexible"], *(one["gap"] for one in rungs if not one["effects"])])
    every = [flexible, told["achievable"], *(one["gap"] for one in (*rungs, *tolerated))]
    return {"flexible": flexible, "achievable": min(every)}


def measure_channel_errors(before: Replay, after: Replay, held: LogPortion) -> dict[str, dict[str, float]]:
    """Measure the replay error of each channel.

    Args:
        before: the replay of the robot file's model.
        after: the replay with the verdict.
        held: the held-out rows (T,) of the log.

    Returns:
        By channel the root mean square error ``before`` and ``after``, in multiples of its ``noise``, and that in SI.

    """
    squares, rows, names = _sum_window_errors(before, (before, after), held)
    return _describe_channels(np.sqrt(squares.sum(1) / rows.sum()), names, before)


def _describe_channels(each: Array, names: list[str], before: Replay) -> dict[str, dict[str, float]]:
    """The errors of channels ``each`` (replays, channels) by name; the first two replays are before and after."""
    return {
        name: {"before": float(each[0, k]), "after": float(each[1, k]), "noise": before.noise[name]}
        for k, name in enumerate(names)
    }


def bootstrap_gaps(before: Replay, seen: Sequence[Replay], held: LogPortion) -> list[tuple[float, list[float] | None]]:
    """Bootstrap the gaps of several replays, with the same draws as `evaluate_gap`.

    Args:
        before: the replay of the robot file's model.
        seen: replays of the same log.
        held: the held-out rows (T,) of the log.

    Returns:
        For each replay its gap, in multiples of the noise, and the interval of it, None from too little motion.

    Source: Efron, Tibshirani, An Introduction to the Bootstrap (1993), 8.6.

    """
    squares, rows, _ = _sum_window_errors(before, seen, held)
    left, drawn = combine_channel_errors(np.sqrt(squares.sum(1) / rows.sum())), _draw_blocks(squares, rows)
    gaps = []
    for k, value in enumerate(left):
        gaps.append((float(value), _compute_interval(draw[k] for draw in drawn)))
    return gaps


def measure_block_errors(seen: Sequence[Replay], portion: LogPortion) -> Array:
    """Measure the errors of replays in each block of a second.

    Args:
        seen: replays of one log (R).
        portion: the rows (T,) of the log that count.

    Returns:
        Root mean squares in multiples of the noise, `combine_channel_errors` over the channels (R, blocks).

    """
    squares, rows, _ = _sum_window_errors(seen[0], seen, portion)
    begins = np.arange(0, len(rows), DATA.block_windows)
    counts = np.add.reduceat(rows, begins)
    return combine_channel_errors(np.sqrt(np.add.reduceat(squares, begins, axis=1) / counts[:, None]))


def _sum_window_errors(before: Replay, seen: Sequence[Replay], held: LogPortion) -> tuple[Array, Rows, list[str]]:
    """Sums of squared errors in the channels' noise (replays, windows, channels), rows of each window, channels."""
    names = before.counted_channels
    counts = np.add.reduceat(held.rows.astype(int), before.starts)
    squares = np.stack([_sum_squared_errors(one, held, names, before.starts) for one in seen])
    return squares[:, counts > 0], counts[counts > 0], names


def _sum_squared_errors(seen: Replay, held: LogPortion, names: list[str], starts: Rows) -> Array:
    """Sum of the squared errors of each window and channel, in the channel's noise (windows, channels)."""
    errors = np.stack([(seen.columns[name] - held.log[name]) / seen.noise[name] for name in names], 1)
    return np.asarray(np.add.reduceat(errors**2 * held.rows[:, None], starts, axis=0))


def _compute_shrink(left: Array) -> float | None:
    """The share of the gap above the noise that is closed; None where there is none."""
    span = float(left[0]) - 1.0
    if span <= 0.1:
        return None
    return (float(left[0]) - float(left[1])) / span


def _draw_blocks(squares: Array, rows: Rows) -> list[Array]:
    """The gaps of the replays (R,) in each draw of blocks of windows; no draws from fewer than two blocks."""
    begins = np.arange(0, len(rows), DATA.block_windows)
    if len(begins) < 2:
        return []
    blocks, lengths = np.add.reduceat(squares, begins, axis=1), np.add.reduceat(rows, begins)
    drawn = np.random.default_rng(0).integers(len(begins), size=(DATA.bootstrap_draws, len(begins)))
    return [combine_channel_errors(np.sqrt(blocks[:, draw].sum(1) / lengths[draw].sum())) for draw in drawn]


def _compute_interval(drawn: Iterable[float]) -> list[float] | None:
    """Low and high between which ``DATA.confidence_level`` of the drawn values lie; None from fewer than half of the
    draws."""
    values = list(drawn)
    if len(values) < DATA.bootstrap_draws / 2:
        return None
    return [
        float(np.quantile(values, (1 - DATA.confidence_level) / 2)),
        float(np.quantile(values, (1 + DATA.confidence_level) / 2)),
    ]
