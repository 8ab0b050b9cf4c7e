"""Events that happen once: nearly all of a joint's remaining error lies within one second of the motion.

A wall that is touched once, or a current at its limit for an instant, lies in a few windows of a fit, or in none where
that second is held out. An effect is named by its repeated action, so such an event cannot be named. Where no effect is
named, an event makes that unsure.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.diagnosis.data.data_settings import DATA
from hdagen.diagnosis.data.held_out_rows import name_rows
from hdagen.diagnosis.data.split import LogPortion
from hdagen.diagnosis.holdout.holdout_check_settings import HOLDOUT_CHECK
from hdagen.log.measured_log import Log
from hdagen.prediction.measurement_model import Rows
from hdagen.prediction.window_replay import Replay


def find_single_moments(
    before: Replay, after: Replay, portion: LogPortion, logs: Sequence[Log]
) -> list[dict[str, Any]]:
    """Find the joints whose error lies in one second alone, by all of their encoders: `moments` of diagnosis.json. More
    than a third of the robot file's error in that second remains, and elsewhere, but for its neighbours, at most a
    third as much.

    Args:
        before: the replay of the robot file.
        after: the replay of the verdict.
        portion: all rows that count, those that a fit used among them.
        logs: the logs that are joined in it.

    Returns:
        For each joint: ``joint``, ``log``, ``span`` of that second, and ``noise``, the remaining error in it, in
        multiples of the noise of the encoder with the smaller error.

    """
    starts = before.starts[:: DATA.block_windows]
    found = []
    for j in range(1, portion.log.n_joints + 1):
        encoders = [name for name in before.counted_channels if name in (f"motor_position_{j}", f"joint_position_{j}")]
        errors = []
        for name in encoders:
            errors.append([_errors_by_second(one, name, portion, starts) for one in (before, after)])
        at = [_find_only_second(*one) for one in errors]
        if not at or None in at or len(set(at)) > 1:
            continue
        rows = portion.rows & (np.searchsorted(starts, np.arange(len(portion.rows)), side="right") - 1 == at[0])
        where = max(name_rows(LogPortion(portion.log, rows), logs), key=lambda one: int(one["rows"]))
        span = [where["spans"][0][0], where["spans"][-1][1]]
        noise = min(float(after_[at[0]]) for _, after_ in errors)
        found.append({"joint": j, "log": where["log"], "span": span, "noise": noise})
    return found


def _errors_by_second(seen: Replay, name: str, portion: LogPortion, starts: Rows) -> Array:
    """Compute a channel's error in each second that begins in the rows ``starts`` (S), in multiples of its noise."""
    squares = ((seen.columns[name] - portion.log[name]) / seen.noise[name]) ** 2
    counts = np.add.reduceat(portion.rows.astype(int), starts)
    return np.asarray(np.sqrt(np.add.reduceat(squares * portion.rows, starts) / np.maximum(counts, 1)))


def _find_only_second(before: Array, after: Array) -> int | None:
    """Find the second that, with its neighbours, holds the error ``after`` (S), compared with that ``before`` (S); None
    where none does."""
    k = int(np.argmax(after))
    elsewhere = after[np.abs(np.arange(len(after)) - k) > 1]
    left = after[k] > max(DATA.significant_noise_multiple, HOLDOUT_CHECK.named_remainder_share * before[k])
    if left and len(elsewhere) and elsewhere.max() <= HOLDOUT_CHECK.named_remainder_share * after[k]:
        return k
    return None
