"""What acts once: nearly all that a model leaves at a joint lies within one second of the motion.

A wall that is touched once, or a current at its limit for an instant, is in a few windows of a fit, or in none where
that second is held out. Other effects are named by what they do again and again, this one cannot be; and where no
effect is named, that is not sure.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hdagen.diagnosis.gap import ABOVE, BLOCK
from hdagen.diagnosis.held_out import name_rows
from hdagen.diagnosis.portion import Portion
from hdagen.diagnosis.remainder import SHARE
from hdagen.log import Log
from hdagen.plant import Array
from hdagen.readings import Rows
from hdagen.replay import Replay


def find_moments(before: Replay, after: Replay, portion: Portion, logs: Sequence[Log]) -> list[dict[str, Any]]:
    """`moments` of diagnosis.json.

    Args:
        before: the replay of the robot file.
        after: that of what is said.
        portion: all rows that count, those that a fit saw among them.
        logs: which are joined in it.

    Returns:
        For each joint that errs at one moment alone, by all of its encoders: ``joint``, ``log``, ``span``, the second
        of it, and ``noise``, what is left then, in multiples of that of the encoder that errs least. More than a third
        of what the robot file errs by then is left, and nowhere else but next to it a third as much.

    """
    starts = before.starts[::BLOCK]
    found = []
    for j in range(1, portion.log.n_joints + 1):
        encoders = [name for name in before.channels if name in (f"motor_position_{j}", f"joint_position_{j}")]
        errors = [[_seconds(one, name, portion, starts) for one in (before, after)] for name in encoders]
        at = [_single(*one) for one in errors]
        if not at or None in at or len(set(at)) > 1:
            continue
        rows = portion.rows & (np.searchsorted(starts, np.arange(len(portion.rows)), side="right") - 1 == at[0])
        where = max(name_rows(Portion(portion.log, rows), logs), key=lambda one: int(one["rows"]))
        span = [where["spans"][0][0], where["spans"][-1][1]]
        noise = min(float(after_[at[0]]) for _, after_ in errors)
        found.append({"joint": j, "log": where["log"], "span": span, "noise": noise})
    return found


def _seconds(seen: Replay, name: str, portion: Portion, starts: Rows) -> Array:
    """What a channel errs by in each second that begins in the rows ``starts`` (S,), in multiples of its noise."""
    squares = ((seen.columns[name] - portion.log[name]) / seen.noise[name]) ** 2
    counts = np.add.reduceat(portion.rows.astype(int), starts)
    return np.asarray(np.sqrt(np.add.reduceat(squares * portion.rows, starts) / np.maximum(counts, 1)))


def _single(before: Array, after: Array) -> int | None:
    """The second that, with its neighbours, holds what is left (S,) of what there was ``before`` (S,); None where none
    does."""
    k = int(np.argmax(after))
    elsewhere = after[np.abs(np.arange(len(after)) - k) > 1]
    left = after[k] > max(ABOVE, SHARE * before[k])
    return k if left and len(elsewhere) and elsewhere.max() <= SHARE * after[k] else None
