"""Split logs into rows that the fit uses and rows that are held out.

Without a hold-out log, blocks of time all over the log are held out. An event that happens once, such as a touched wall
or a saturated current, is then as likely in the fitted rows as any other moment. The blocks lie at uneven distances, so
that no phase of a periodic motion is held out completely.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdagen.arm.arrays import Array
from hdagen.diagnosis.data.data_settings import DATA
from hdagen.log.concatenation import concatenate_logs
from hdagen.log.measured_log import Log
from hdagen.support.row_runs import find_true_runs

GOLDEN_RATIO_STEP = (np.sqrt(5) - 1) / 2  # of a span, by which a block lies later than the one before it (golden ratio)

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class LogPortion:
    """A log with a mask of the ``rows`` (T) that belong to the portion."""

    log: Log
    rows: Mask

    @classmethod
    def all_rows(cls, log: Log) -> LogPortion:
        """Take all rows of a log.

        Args:
            log: the log.

        Returns:
            The portion that holds every row.

        """
        return cls(log, np.ones(len(log), bool))

    @property
    def spans(self) -> list[tuple[float, float]]:
        """First and last instant of each run of rows, s."""
        return [(float(self.log.time[a]), float(self.log.time[b - 1])) for a, b in find_true_runs(self.rows)]

    def without_windows(self, windows: Sequence[int], starts: NDArray[np.intp]) -> LogPortion:
        """Leave some windows out. Where no row would remain, nothing is left out.

        Args:
            windows: first rows of the windows to leave out.
            starts: first row of every window (W).

        Returns:
            The smaller portion.

        """
        left, ends = self.rows.copy(), np.append(starts[1:], len(self.rows))
        for first, end in zip(starts, ends, strict=True):
            if first in windows:
                left[first:end] = False
        if not left.any():
            return self
        return LogPortion(self.log, left)

    def covers(self, time: Array) -> Mask:
        """Tell which instants lie in the portion, each by its nearest row.

        Args:
            time: instants (K), s.

        Returns:
            A mask (K).

        """
        return self.rows[np.clip(np.searchsorted(self.log.time, time), 0, len(self.rows) - 1)]


def split_logs(
    logs: Sequence[Log], hold_out: Sequence[Log], fresh: Sequence[Mask] = ()
) -> tuple[LogPortion, LogPortion]:
    """Split logs into fitted and held-out rows.

    Args:
        logs: logs of one machine.
        hold_out: other motions of the same machine; without any, blocks of each log are held out.
        fresh: a mask (T) for each log and then for each hold-out, of the rows that count; without any, all rows count.

    Returns:
        The fitted portion and the held-out portion.

    """
    counted = list(fresh) or [np.ones(len(log), bool) for log in (*logs, *hold_out)]
    own, other = np.concatenate(counted[: len(logs)]), counted[len(logs) :]
    if hold_out:
        return LogPortion(concatenate_logs(logs), own), LogPortion(concatenate_logs(hold_out), np.concatenate(other))
    whole, held = concatenate_logs(logs), np.concatenate([mark_holdout_blocks(log.time) for log in logs])
    return LogPortion(whole, own & ~held), LogPortion(whole, own & held)


def split_in_halves(portion: LogPortion) -> tuple[LogPortion, LogPortion]:
    """Split held-out motion into a half for decisions and a half for reported figures, so that no figure selects
    itself.

    Args:
        portion: rows of held-out logs.

    Returns:
        The even seconds and the odd seconds; twice the whole portion where one of them would be empty.

    """
    seconds = np.floor(portion.log.time - portion.log.time[0]).astype(int)
    even = seconds % 2 == 0
    halves = LogPortion(portion.log, portion.rows & even), LogPortion(portion.log, portion.rows & ~even)
    if not all(half.rows.any() for half in halves):
        return portion, portion
    return halves


def mark_holdout_blocks(time: Array) -> Mask:
    """Choose the rows of a log that are held out.

    Args:
        time: instants of the rows (T), s.

    Returns:
        A mask (T) of the held-out blocks.

    """
    length = float(time[-1] - time[0])
    count = max(DATA.fewest_holdout_spans, round(length / DATA.holdout_span))
    spans = (time - time[0]) / max(length, np.finfo(float).tiny) * count
    number = np.minimum(spans.astype(int), count - 1)
    begins = (number * GOLDEN_RATIO_STEP % 1.0) * (1.0 - DATA.holdout_share)
    within = spans - number
    return np.asarray((within >= begins) & (within < begins + DATA.holdout_share))
