"""Motion that two logs share, row for row: one recording given twice, whole, cut, thinned or with other time stamps.

A fit that is judged by the rows it was made from looks better than it is, so rows that an earlier log holds count in no
later one. Two recordings of one motion differ in most rows in motion, even if only by a count of an encoder.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdagen.data_quality.log_repair_settings import LOG_REPAIR
from hdagen.log.column_map import split_column_name
from hdagen.log.measured_log import Log

POSITION_CHANNELS = ("motor_position", "joint_position")

Mask = NDArray[np.bool_]
Span = tuple[float, float]  # s


@dataclass(frozen=True)
class SharedSpan:
    """A motion that two logs share: its begin and end in the time of each, s."""

    one: Span
    other: Span

    @property
    def swapped_logs(self) -> SharedSpan:
        """The same motion, of the logs in the other order."""
        return SharedSpan(self.other, self.one)


def mask_unshared_rows(log: Log, shared: Sequence[SharedSpan]) -> Mask:
    """Find the rows of a log whose motion no other log holds.

    Args:
        log: The log, the second one in each of ``shared``.
        shared: The motions that it shares.

    Returns:
        (T), true in rows outside these motions.

    """
    fresh = np.ones(len(log), bool)
    for one in shared:
        fresh &= (log.time < one.other[0]) | (log.time > one.other[1])
    return fresh


@np.errstate(invalid="ignore")  # a log that is refused may hold anything
def find_shared_motion(one: Log, other: Log, noise: Mapping[str, float]) -> list[SharedSpan]:
    """Find where two logs hold the same recording.

    Stretches of the log with fewer rows a second are looked for in the other one: rows that have, after the same times,
    the same measured positions to a part of their ``noise``, whole turns apart. At rest counts can be equal, so only
    rows beside a change count. A stretch that is found is extended to both sides as far as rows are alike.

    Args:
        one: A log.
        other: Another log.
        noise: Standard deviation of the channels of ``one``, by name, in their units.

    Returns:
        The shared motions in the order of ``other``'s time; none where no motion is shared.

    """
    if one.period > other.period:
        return [found.swapped_logs for found in find_shared_motion(other, one, noise)]
    names = [
        name for name in one.columns if (split_column_name(name) or ("", 0))[0] in POSITION_CHANNELS and name in other
    ]
    if not names:
        return []
    pair = _LogPair.from_logs(one, other, names, noise)
    found: list[SharedSpan] = []
    for rows in pair.list_stretches():
        begin = other.time[rows[0]]
        if not any(known.other[0] <= begin <= known.other[1] for known in found):
            for at in pair.find_matches(rows):
                if not any(known.one[0] <= one.time[at] <= known.one[1] for known in found):
                    found.append(pair.extend_match(int(at), int(rows[0])))
    return found


@dataclass(frozen=True, eq=False)
class _LogPair:
    """A log and another one with no more rows a second.

    Attributes:
        log: The first log.
        other: The other log.
        ours: (M, T), the positions of the first log.
        theirs: (M, S), the same positions of the other log.
        near: (M, 1), the difference up to which positions are equal.
        between: (T − 1), the instants midway between the rows of the first log, s.

    """

    log: Log
    other: Log
    ours: np.ndarray
    theirs: np.ndarray
    tolerance: np.ndarray
    row_boundaries: np.ndarray

    @classmethod
    def from_logs(cls, log: Log, other: Log, names: Sequence[str], noise: Mapping[str, float]) -> _LogPair:
        ours = np.stack([log[name] for name in names])
        theirs = np.stack([other[name] for name in names])
        spread = np.array([[noise.get(name, 0.0)] for name in names])
        near = LOG_REPAIR.exact_noise_share * spread + 1e-9 * np.abs(ours).max(1, keepdims=True)
        return cls(log, other, ours, theirs, near, (log.time[1:] + log.time[:-1]) / 2)

    def list_stretches(self) -> Iterator[np.ndarray]:
        """Stretches of rows in motion, all over the other log."""
        changes = np.any(np.diff(self.theirs) != 0, axis=0)
        moving = np.flatnonzero(np.append(changes, False) | np.append(False, changes))
        last = max(len(moving) - LOG_REPAIR.stretch_rows, 0)
        at = np.linspace(0, last, LOG_REPAIR.most_compared_stretches).astype(int)
        return (moving[k : k + LOG_REPAIR.stretch_rows] for k in np.unique(at) if moving.size)

    def find_matches(self, rows: np.ndarray) -> np.ndarray:
        """The rows of the log at which the motion of the other log's ``rows`` begins."""
        first, found = rows[0], np.arange(len(self.log))
        for mine, sought, within in zip(self.ours, self.theirs[:, first], self.tolerance, strict=True):
            off = mine[found] - sought
            found = found[np.abs(off - math.tau * np.rint(off / math.tau)) <= within]
        for part in (rows[1::10], rows[1:]):  # the few first: they leave hardly any place
            found = found[
                np.mean(self.compare_rows(found[:, None], int(first), part), axis=1) > LOG_REPAIR.least_alike_share
            ]
        return found

    def compare_rows(self, at: np.ndarray, first: int, rows: np.ndarray) -> Mask:
        """Whether the other log has moved from its row ``first`` to each of ``rows`` (R) as the log has from its rows
        ``at`` (K, 1) on: (K, R)."""
        time = self.log.time[at] + (self.other.time[rows] - self.other.time[first])
        same = np.searchsorted(self.row_boundaries, time)
        off = self.ours[:, same] - self.ours[:, at] - (self.theirs[:, rows] - self.theirs[:, [first]])[:, None]
        return np.asarray(np.all(np.abs(off) <= self.tolerance[:, :, None], axis=0))

    def extend_match(self, at: int, first: int) -> SharedSpan:
        """The motion shared about row ``at`` of the log, which is row ``first`` of the other one.

        It reaches as far as most rows of each stretch are alike, within both logs.
        """
        late = self.log.time[at] - self.other.time[first]
        begin, end = np.searchsorted(self.other.time + late, self.log.time[[0, -1]])
        rows = np.arange(begin, min(end + 1, len(self.other)))
        same = np.append(0, np.cumsum(self.compare_rows(np.array([[at]]), first, rows)[0]))
        length = min(LOG_REPAIR.stretch_rows, len(rows))
        share = (same[length:] - same[:-length]) / length  # of the rows from each one on
        good, k = share > LOG_REPAIR.least_alike_share, min(first - begin, len(share) - 1)
        before, after = (int(np.argmin(np.append(side, False))) for side in (good[k::-1], good[k:]))
        low, high = (
            float(self.other.time[rows[min(max(row, 0), len(rows) - 1)]])
            for row in (k + 1 - before, k + after + length - 2)
        )
        return SharedSpan((low + late, high + late), (low, high))
