"""In which regime a missing quantity concentrates: speed, load, angle, time, … each with its share and a significance.

Two questions are asked of every regressor: how much of the quantity's variance the means of its bins explain, and how
much of its energy lies in one end bin. Neighbouring samples are not independent, so the significance is that of
circular shifts: quantity and regressor keep their own course in time, only their match is taken apart.

Source: Theiler et al., Physica D 58 (1992) 77 (surrogates that keep the spectrum); Besag, Clifford, Biometrika 76
(1989) 633 (Monte Carlo significance).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hdagen.plant import Array

BINS = 8  # of equally many samples each
SHIFTS = 199  # equally spaced; the smallest significance is 1 in 200
LEAST = 0.05  # significance from which a regime is not named
SAMPLES = 6000  # that are looked at, at most


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
    """How much of a variance (0 to 1) the means of a regressor's bins explain, and how likely chance does that."""

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
    y = quantity[rows]
    y = y - y.mean()
    total = float(y @ y)
    found = []
    for r in regressors:
        labels, count = _bins(r.values[rows])
        if count < 2 or total <= 0:
            continue
        held = np.bincount(labels, minlength=count)

        def share(values: Array, labels: np.ndarray = labels, count: int = count, held: np.ndarray = held) -> float:
            return float((np.bincount(labels, values, count) ** 2 / held).sum() / total)

        seen = share(y)
        found.append(Explained(r, seen, _chance(seen, [share(part) for part in _shifted(y)])))
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
        part = np.bincount(labels, minlength=count)[[0, -1]] / len(y)

        def excess(of: Array, labels: np.ndarray = labels, part: Array = part, count: int = count) -> Array:
            return np.asarray(np.bincount(labels, of, count)[[0, -1]] / total - part)

        seen = excess(y)
        end = int(np.argmax(seen))
        chance = _chance(float(seen[end]), [float(excess(other).max()) for other in _shifted(y)])
        inside = values[labels == (count - 1 if end else 0)]
        edge = float(inside.min() if end else inside.max())
        found.append(Concentrated(r, float(seen[end] + part[end]), float(part[end]), edge, not end, chance))
    return sorted(found, key=lambda c: c.part - c.share)


def _rows(count: int) -> np.ndarray:
    return np.unique(np.linspace(0, count - 1, min(count, SAMPLES)).round().astype(int))


def _bins(values: Array) -> tuple[np.ndarray, int]:
    """The bin of each value, and how many bins there are: by quantiles, fewer where values repeat."""
    edges = np.unique(np.quantile(values, np.linspace(0, 1, BINS + 1)[1:-1]))
    labels = np.searchsorted(edges, values, side="left")
    kinds, labels = np.unique(labels, return_inverse=True)
    return labels, len(kinds)


def _shifted(values: Array) -> list[Array]:
    """Circular shifts that are apart from the series itself."""
    steps = np.linspace(0, len(values), SHIFTS + 2)[1:-1].round().astype(int)
    return [np.roll(values, int(step)) for step in steps]


def _chance(seen: float, others: Sequence[float]) -> float:
    return (1 + sum(other >= seen for other in others)) / (1 + len(others))
