"""The gap on held-out motion before and after, with an interval from blocks of windows."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from hdagen.diagnosis.portion import Portion
from hdagen.plant import Array
from hdagen.readings import Rows
from hdagen.replay import Replay, joined

DRAWS = 500
BLOCK = 4  # windows of a block: what is one second of motion, so that neighbours that err alike stay together
LEVEL = 0.95
ABOVE = 10.0  # multiples of the noise, from which on what is left counts


def gap(before: Replay, after: Replay, held: Portion, flexible: Replay | None = None) -> dict[str, Any]:
    """`gap` of diagnosis.json in what is ``held`` out.

    Root mean squares of the replay errors in multiples of each channel's noise, `joined` over the channels that the
    model can err in. The interval of the share that is closed: blocks of windows drawn with replacement (Efron,
    Tibshirani, An Introduction to the Bootstrap (1993), 8.6), the same draws at each call. ``flexible`` is what the
    replay of a correction without structure leaves, ``achievable`` the least of all.
    """
    seen = (before, after) if flexible is None else (before, after, flexible)
    squares, rows, names = _compared(before, seen, held)
    each = np.sqrt(squares.sum(1) / rows.sum())
    left = joined(each)
    return {
        "before": float(left[0]),
        "after": float(left[1]),
        "floor": 1.0,
        "flexible": None if flexible is None else float(left[2]),
        "achievable": float(left.min()),
        "shrink": _shrink(left),
        "interval": _middle(s for s in map(_shrink, _draws(squares[:2], rows)) if s is not None),
        "by_channel": _by_channel(each, names, before),
    }


def least(seen: Sequence[Replay], held: Portion) -> Replay:
    """Of several replays, the first of them the robot file's, the one that leaves the least in what is ``held`` out."""
    squares, rows, _ = _compared(seen[0], seen, held)
    return seen[int(np.argmin(joined(np.sqrt(squares.sum(1) / rows.sum()))))]


def bounds(
    told: Mapping[str, Any], rungs: Sequence[Mapping[str, Any]], tolerated: Sequence[Mapping[str, Any]]
) -> dict[str, float]:
    """``flexible`` and ``achievable`` of a gap as `gap` ``told`` them, in view of all else that was fitted: a flexible
    correction has the base parameters as they are refitted with no effect, and nothing closes more than what is
    achievable. ``rungs`` and what is ``tolerated`` are those of diagnosis.json."""
    flexible = min([told["flexible"], *(one["gap"] for one in rungs if not one["effects"])])
    every = [flexible, told["achievable"], *(one["gap"] for one in (*rungs, *tolerated))]
    return {"flexible": flexible, "achievable": min(every)}


def by_channel(before: Replay, after: Replay, held: Portion) -> dict[str, dict[str, float]]:
    """What each channel errs by before and after, as a root mean square in multiples of its noise, and that noise."""
    squares, rows, names = _compared(before, (before, after), held)
    return _by_channel(np.sqrt(squares.sum(1) / rows.sum()), names, before)


def _by_channel(each: Array, names: list[str], before: Replay) -> dict[str, dict[str, float]]:
    """The same of errors (replays, channels), the first two being before and after."""
    return {
        name: {"before": float(each[0, k]), "after": float(each[1, k]), "noise": before.noise[name]}
        for k, name in enumerate(names)
    }


def spread(before: Replay, seen: Sequence[Replay], held: Portion) -> list[tuple[float, list[float] | None]]:
    """What each of the replays ``seen`` leaves of the gap, as `gap` counts it, with its interval: the same draws."""
    squares, rows, _ = _compared(before, seen, held)
    left, drawn = joined(np.sqrt(squares.sum(1) / rows.sum())), _draws(squares, rows)
    return [(float(value), _middle(draw[k] for draw in drawn)) for k, value in enumerate(left)]


def block_errors(seen: Sequence[Replay], portion: Portion) -> Array:
    """What replays (R) err by in each block of a second of a ``portion`` (R, blocks): root mean squares in multiples of
    the noise, `joined` over the channels."""
    squares, rows, _ = _compared(seen[0], seen, portion)
    begins = np.arange(0, len(rows), BLOCK)
    counts = np.add.reduceat(rows, begins)
    return joined(np.sqrt(np.add.reduceat(squares, begins, axis=1) / counts[:, None]))


def _compared(before: Replay, seen: Sequence[Replay], held: Portion) -> tuple[Array, Rows, list[str]]:
    """Sums of squared errors in the channels' noise (replays, windows, channels), rows of each window, channels."""
    names = before.channels
    counts = np.add.reduceat(held.rows.astype(int), before.starts)
    squares = np.stack([_squares(one, held, names, before.starts) for one in seen])
    return squares[:, counts > 0], counts[counts > 0], names


def _squares(seen: Replay, held: Portion, names: list[str], starts: Rows) -> Array:
    """Sum of the squared errors of each window and channel, in the channel's noise (windows, channels)."""
    errors = np.stack([(seen.columns[name] - held.log[name]) / seen.noise[name] for name in names], 1)
    return np.asarray(np.add.reduceat(errors**2 * held.rows[:, None], starts, axis=0))


def _shrink(left: Array) -> float | None:
    """The share of the gap above the noise that is closed; None where there is none."""
    span = float(left[0]) - 1.0
    return (float(left[0]) - float(left[1])) / span if span > 0.1 else None


def _draws(squares: Array, rows: Rows) -> list[Array]:
    """What the replays (R,) leave in each draw of blocks of windows; none from fewer than two blocks."""
    begins = np.arange(0, len(rows), BLOCK)
    if len(begins) < 2:
        return []
    blocks, lengths = np.add.reduceat(squares, begins, axis=1), np.add.reduceat(rows, begins)
    drawn = np.random.default_rng(0).integers(len(begins), size=(DRAWS, len(begins)))
    return [joined(np.sqrt(blocks[:, draw].sum(1) / lengths[draw].sum())) for draw in drawn]


def _middle(drawn: Iterable[float]) -> list[float] | None:
    """Low and high between which ``LEVEL`` of what was drawn lies; None from fewer than half of the draws."""
    values = list(drawn)
    if len(values) < DRAWS / 2:
        return None
    return [float(np.quantile(values, (1 - LEVEL) / 2)), float(np.quantile(values, (1 + LEVEL) / 2))]
