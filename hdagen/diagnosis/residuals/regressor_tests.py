"""The regime in which a residual concentrates: speed, load, angle, time, …, each with its share and significance.

Two questions are asked of every regressor. How much of the residual's variance do the means of its bins explain? How
much of its energy lies in one end bin? Of an angle a third one is asked: how much of the residual repeats with it, once
in a turn or more often? Neighbouring samples depend on each other, so the significance comes from circular shifts:
residual and regressor keep their own course in time, and only their match is broken. The significance is multiplied by
the number of regressors, as the best of them is looked for.

Source: Theiler et al., Physica D 58 (1992) 77 (surrogates that keep the spectrum); Besag, Clifford, Biometrika 76
(1989) 633 (Monte Carlo significance).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdagen.arm.arrays import Array
from hdagen.data_quality.channel_check_settings import CHANNEL_CHECK
from hdagen.diagnosis.residuals.explanation_settings import EXPLANATION

WAVES_OF_ORDER = 2  # regressors of an order: a sine and a cosine


@dataclass(frozen=True)
class Regressor:
    """A series (K) with its ``name`` in a sentence and its ``unit``. ``by_magnitude``: only its magnitude says where
    energy lies, as for a speed."""

    name: str
    unit: str
    values: Array
    by_magnitude: bool = False


@dataclass(frozen=True)
class VarianceShare:
    """The share of a variance (0 to 1) that the means of a regressor's bins explain, and the probability that chance
    explains as much with any of the regressors tried."""

    regressor: Regressor
    share: float
    p: float


@dataclass(frozen=True)
class EnergyConcentration:
    """The ``share`` of an energy in an end bin of a regressor, which holds ``part`` of the time; ``edge``: bound of
    that bin, which lies ``is_below`` it or above it; ``p``: probability that chance does as much with any of the
    regressors tried."""

    regressor: Regressor
    share: float
    time_share: float
    edge: float
    is_below: bool
    p: float


def explain_variance(quantity: Array, regressors: Sequence[Regressor]) -> list[VarianceShare]:
    """Explain a quantity by each regressor's bins.

    Source: Theiler et al., Physica D 58 (1992) 77.

    Args:
        quantity: the quantity (K).
        regressors: series of the same instants.

    Returns:
        The shares, the largest first; a constant regressor is left out.

    """
    rows = _thin_samples(len(quantity))
    y = _subtract_mean(quantity[rows])
    total, found = float(y @ y), []
    if not total > 0:
        return []
    for r in regressors:
        labels, count = _assign_bins(r.values[rows])
        if count >= 2:
            sums = _sum_bins(labels, count, y)
            shares = (sums**2 / np.bincount(labels)[:, None]).sum(0) / total
            found.append(VarianceShare(r, float(shares[0]), _shift_significance(shares, len(regressors))))
    return sorted(found, key=lambda e: -e.share)


@dataclass(frozen=True)
class PeriodicShare:
    """The share of a variance (0 to 1) that a sine and a cosine of ``order`` times an angle explain, and the
    probability that chance explains as much with any of the orders tried."""

    order: int
    share: float
    p: float


def explain_by_orders(quantity: Array, angle: Array, orders: Sequence[int]) -> list[PeriodicShare]:
    """Explain a quantity by each order of an angle that runs through two cycles or more.

    Source: Theiler et al., Physica D 58 (1992) 77.

    Args:
        quantity: the quantity (K).
        angle: the angle (K), rad.
        orders: orders to try.

    Returns:
        The shares, the largest first.

    """
    rows = _thin_samples(len(quantity))
    y, theta = _subtract_mean(quantity[rows]), angle[rows]
    total, found = float(y @ y), []
    if not total > 0:
        return []
    for k in orders:
        if k * np.ptp(theta) < 2 * math.tau or len(theta) < CHANNEL_CHECK.least_rows_per_term * (WAVES_OF_ORDER + 1):
            continue
        waves = np.stack([np.cos(k * theta), np.sin(k * theta)], 1)
        own = np.linalg.qr(waves - waves.mean(0))[0].T
        shares = (_sum_shifted(own, y) ** 2).sum(0) / total
        others = shares[
            len(shares) // EXPLANATION.small_shift_divisor : -(len(shares) // EXPLANATION.small_shift_divisor) or None
        ]  # a small shift is but another phase
        found.append(PeriodicShare(k, float(shares[0]), _shift_significance(np.append(shares[0], others), len(orders))))
    return sorted(found, key=lambda e: -e.share)


def find_concentrations(energy: Array, regressors: Sequence[Regressor]) -> list[EnergyConcentration]:
    """Find the end bin of each regressor that holds most energy beyond its part of the time.

    Source: Theiler et al., Physica D 58 (1992) 77.

    Args:
        energy: energy (K), which may be negative in places.
        regressors: series of the same instants.

    Returns:
        The concentrations, the strongest first; none where the total energy is not positive.

    """
    rows = _thin_samples(len(energy))
    y = energy[rows]
    total, found = float(y.sum()), []
    if not total > 0:
        return []
    for r in regressors:
        values = r.values[rows]
        if r.by_magnitude:
            values = np.abs(values)
        labels, count = _assign_bins(values)
        if count < 2:
            continue
        part = np.bincount(labels)[[0, -1]] / len(y)
        beyond = _sum_bins(labels, count, y)[[0, -1]] / total - part[:, None]
        end = int(np.argmax(beyond[:, 0]))
        edge = float(values[labels == 0].max())
        if end:
            edge = float(values[labels == count - 1].min())
        share, chance = float(beyond[end, 0] + part[end]), _shift_significance(beyond.max(0), len(regressors))
        found.append(EnergyConcentration(r, share, float(part[end]), edge, not end, chance))
    return sorted(found, key=lambda c: c.time_share - c.share)


def _thin_samples(count: int) -> np.ndarray:
    """Choose the samples to test, of ``count``."""
    return np.unique(np.linspace(0, count - 1, min(count, EXPLANATION.most_tested_samples)).round().astype(int))


def _subtract_mean(values: Array) -> Array:
    """Subtract the mean from values (K); there may be none, as of a joint that never moves."""
    if not len(values):
        return values
    return values - values.mean()


def _assign_bins(values: Array) -> tuple[np.ndarray, int]:
    """Assign each value to a bin by quantiles, and count the bins: fewer where values are few or repeat."""
    most = min(EXPLANATION.quantile_bins, max(len(values) // CHANNEL_CHECK.least_rows_per_term, 1))
    edges = np.unique(np.quantile(values, np.linspace(0, 1, most + 1)[1:-1]))
    labels = np.searchsorted(edges, values, side="left")
    kinds, labels = np.unique(labels, return_inverse=True)
    return labels, len(kinds)


def _sum_bins(labels: np.ndarray, count: int, values: Array) -> Array:
    """Sum ``values`` in each bin (count, S), as `_sum_shifted` does."""
    return _sum_shifted(np.arange(count)[:, None] == labels, values)


def _sum_shifted(weights: Array | NDArray[np.bool_], values: Array) -> Array:
    """Sum ``values`` (K) by each of the ``weights`` (B, K), unshifted and then with up to SHIFTS circular shifts: (B,
    S)."""
    steps = np.unique(
        np.linspace(0, len(values), EXPLANATION.circular_shifts + 2)[:-1].round().astype(int) % len(values)
    )
    other = np.fft.rfft(values).conj()
    return np.asarray(np.fft.irfft(np.fft.rfft(weights) * other, len(values))[:, steps])


def _shift_significance(found: Array, tried: int) -> float:
    """Return the significance of the first of ``found`` among all, times how many were ``tried``."""
    reached = int(np.count_nonzero(found[1:] >= found[0]))
    return min(1.0, tried * (1 + reached) / len(found))
