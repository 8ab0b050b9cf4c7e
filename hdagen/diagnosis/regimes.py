"""In which regime a missing quantity concentrates: speed, load, angle, time, … each with its share and a significance.

Two questions are asked of every regressor: how much of the quantity's variance the means of its bins explain, and how
much of its energy lies in one end bin; and of an angle, how much comes back with it, once a turn or more often.
Neighbouring samples are not independent, so the significance is that of
circular shifts: quantity and regressor keep their own course in time, only their match is taken apart. It is multiplied
by the number of regressors, among which the best is looked for.

Source: Theiler et al., Physica D 58 (1992) 77 (surrogates that keep the spectrum); Besag, Clifford, Biometrika 76
(1989) 633 (Monte Carlo significance).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdagen.determined import ROWS
from hdagen.plant import Array

BINS = 8  # of equally many samples each
SHIFTS = 999  # equally spaced; the smallest significance of one regressor is 1 in 1000
LEAST = 0.05  # significance from which a regime is not named
SAMPLES = 6000  # that are looked at, at most
NEAR = 50  # of which part of a series a shift is small
TURN = 2 * np.pi
WAVES = 2  # of an order: a sine and a cosine


@dataclass(frozen=True)
class Regressor:
    """``name`` as the sentence says it, ``unit``; ``values`` (K,). ``size``: only its magnitude has a meaning for where
    energy lies, as that of a speed."""

    name: str
    unit: str
    values: Array
    size: bool = False


@dataclass(frozen=True)
class Explained:
    """How much of a variance (0 to 1) the means of a regressor's bins explain, and how likely chance does that with any
    of those that were tried."""

    regressor: Regressor
    share: float
    p: float


@dataclass(frozen=True)
class Concentrated:
    """``share`` of an energy in an end bin of a regressor that holds ``part`` of the time; ``edge`` is that bin's
    bound, ``below`` or above which it lies."""

    regressor: Regressor
    share: float
    part: float
    edge: float
    below: bool
    p: float


def explained(quantity: Array, regressors: Sequence[Regressor]) -> list[Explained]:
    """Of ``quantity`` (K,), by each regressor, the most first; what is constant explains nothing and is left out."""
    rows = _rows(len(quantity))
    y = _about_mean(quantity[rows])
    total, found = float(y @ y), []
    for r in regressors if total > 0 else ():
        labels, count = _bins(r.values[rows])
        if count >= 2:
            sums = _sums(labels, count, y)
            shares = (sums**2 / np.bincount(labels)[:, None]).sum(0) / total
            found.append(Explained(r, float(shares[0]), _chance(shares, len(regressors))))
    return sorted(found, key=lambda e: -e.share)


@dataclass(frozen=True)
class Periodic:
    """How much of a variance (0 to 1) a sine and a cosine of ``order`` times an angle explain, and how likely chance
    does that with any of the orders that were tried."""

    order: int
    share: float
    p: float


def periodic(quantity: Array, angle: Array, orders: Sequence[int]) -> list[Periodic]:
    """Of ``quantity`` (K,), by each of the ``orders`` of which the angle (K,), rad, runs through two cycles or more,
    the most first."""
    rows = _rows(len(quantity))
    y, theta = _about_mean(quantity[rows]), angle[rows]
    total, found = float(y @ y), []
    for k in orders if total > 0 else ():
        if k * np.ptp(theta) < 2 * TURN or len(theta) < ROWS * (WAVES + 1):
            continue
        waves = np.stack([np.cos(k * theta), np.sin(k * theta)], 1)
        own = np.linalg.qr(waves - waves.mean(0))[0].T
        shares = (_shifted(own, y) ** 2).sum(0) / total
        others = shares[len(shares) // NEAR : -(len(shares) // NEAR) or None]  # a small shift is but another phase
        found.append(Periodic(k, float(shares[0]), _chance(np.append(shares[0], others), len(orders))))
    return sorted(found, key=lambda e: -e.share)


def concentrated(energy: Array, regressors: Sequence[Regressor]) -> list[Concentrated]:
    """Of ``energy`` (K,), which may be negative in places, the end bin of each regressor that holds most beyond its
    part; the strongest first. Nothing where there is no energy in all."""
    rows = _rows(len(energy))
    y = energy[rows]
    total, found = float(y.sum()), []
    for r in regressors if total > 0 else ():
        values = np.abs(r.values[rows]) if r.size else r.values[rows]
        labels, count = _bins(values)
        if count < 2:
            continue
        part = np.bincount(labels)[[0, -1]] / len(y)
        beyond = _sums(labels, count, y)[[0, -1]] / total - part[:, None]
        end = int(np.argmax(beyond[:, 0]))
        inside = values[labels == (count - 1 if end else 0)]
        edge = float(inside.min() if end else inside.max())
        share, chance = float(beyond[end, 0] + part[end]), _chance(beyond.max(0), len(regressors))
        found.append(Concentrated(r, share, float(part[end]), edge, not end, chance))
    return sorted(found, key=lambda c: c.part - c.share)


def _rows(count: int) -> np.ndarray:
    """Samples that are looked at, of ``count``."""
    return np.unique(np.linspace(0, count - 1, min(count, SAMPLES)).round().astype(int))


def _about_mean(values: Array) -> Array:
    """``values`` (K,) less their mean; none of none, as of a joint that never moves."""
    return values - values.mean() if len(values) else values


def _bins(values: Array) -> tuple[np.ndarray, int]:
    """The bin of each value, and how many bins there are: by quantiles, fewer where values are few or repeat."""
    most = min(BINS, max(len(values) // ROWS, 1))
    edges = np.unique(np.quantile(values, np.linspace(0, 1, most + 1)[1:-1]))
    labels = np.searchsorted(edges, values, side="left")
    kinds, labels = np.unique(labels, return_inverse=True)
    return labels, len(kinds)


def _sums(labels: np.ndarray, count: int, values: Array) -> Array:
    """Sum of ``values`` in each bin (count, S), as `_shifted`."""
    return _shifted(np.arange(count)[:, None] == labels, values)


def _shifted(weights: Array | NDArray[np.bool_], values: Array) -> Array:
    """Sums of ``values`` (K,) by each of the ``weights`` (B, K), (B, S): as they are, then shifted around by one step
    after another, as many as SHIFTS or as they have."""
    steps = np.unique(np.linspace(0, len(values), SHIFTS + 2)[:-1].round().astype(int) % len(values))
    other = np.fft.rfft(values).conj()
    return np.asarray(np.fft.irfft(np.fft.rfft(weights) * other, len(values))[:, steps])


def _chance(found: Array, tried: int) -> float:
    """Of the first of ``found`` among all, times how many were ``tried``."""
    reached = int(np.count_nonzero(found[1:] >= found[0]))
    return min(1.0, tried * (1 + reached) / len(found))
