"""Which rows of a log the fit sees, and which are held out.

Where there is no hold-out log, blocks of time all over the log are held out. What happens once, a wall that is touched
or a current at its limit, then lies in what is seen as likely as anything else; and the blocks begin at uneven times,
so that no phase of a motion that repeats is hidden as a whole.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdagen.joined import joined
from hdagen.log import Log
from hdagen.plant import Array
from hdagen.stretches import stretches

SHARE = 0.2  # of a log that is held out
SPAN = 5.0  # s, of which one block is held out; a shorter log has SPANS of them
SPANS = 4
UNEVEN = (np.sqrt(5) - 1) / 2  # of a turn, from the place of a block in its span to that of the next

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Portion:
    """``rows`` (T) of ``log``."""

    log: Log
    rows: Mask

    @classmethod
    def whole(cls, log: Log) -> Portion:
        """All rows."""
        return cls(log, np.ones(len(log), bool))

    @property
    def spans(self) -> list[tuple[float, float]]:
        """Begin and end of each stretch of rows, s."""
        return [(float(self.log.time[a]), float(self.log.time[b - 1])) for a, b in stretches(self.rows)]

    def without(self, windows: Sequence[int], starts: NDArray[np.intp]) -> Portion:
        """The same but for the windows that begin in the rows ``windows``, of all ``starts`` (W); all of it where
        nothing would be left."""
        left, ends = self.rows.copy(), np.append(starts[1:], len(self.rows))
        for first, end in zip(starts, ends, strict=True):
            if first in windows:
                left[first:end] = False
        return Portion(self.log, left) if left.any() else self

    def at(self, time: Array) -> Mask:
        """Whether the rows nearest to instants (K,) are in it."""
        return self.rows[np.clip(np.searchsorted(self.log.time, time), 0, len(self.rows) - 1)]


def part(logs: Sequence[Log], hold_out: Sequence[Log], fresh: Sequence[Mask] = ()) -> tuple[Portion, Portion]:
    """Part logs into what is fitted and what no fit sees.

    Args:
        logs: of one machine.
        hold_out: other motions of it; else blocks of each log are kept from the fit.
        fresh: the rows (T) of each log, those that are held out after the others, that are counted; all if none is
            given.

    Returns:
        Both portions.

    """
    counted = list(fresh) or [np.ones(len(log), bool) for log in (*logs, *hold_out)]
    own, other = np.concatenate(counted[: len(logs)]), counted[len(logs) :]
    if hold_out:
        return Portion(joined(logs), own), Portion(joined(hold_out), np.concatenate(other))
    whole, held = joined(logs), np.concatenate([blocks(log.time) for log in logs])
    return Portion(whole, own & ~held), Portion(whole, own & held)


def halve(portion: Portion) -> tuple[Portion, Portion]:
    """Part motion that no fit saw into what decides and what is reported, so that no figure is chosen by itself.

    Args:
        portion: of logs that are held out.

    Returns:
        Every other second of it, and the rest; twice the whole where there are no two seconds.

    """
    seconds = np.floor(portion.log.time - portion.log.time[0]).astype(int)
    even = seconds % 2 == 0
    halves = Portion(portion.log, portion.rows & even), Portion(portion.log, portion.rows & ~even)
    return halves if all(half.rows.any() for half in halves) else (portion, portion)


def blocks(time: Array) -> Mask:
    """Which rows of a log at ``time`` (T), s, lie in blocks that are held out."""
    length = float(time[-1] - time[0])
    count = max(SPANS, round(length / SPAN))
    spans = (time - time[0]) / max(length, np.finfo(float).tiny) * count
    number = np.minimum(spans.astype(int), count - 1)
    begins = (number * UNEVEN % 1.0) * (1.0 - SHARE)
    within = spans - number
    return np.asarray((within >= begins) & (within < begins + SHARE))
