"""Starts for sets of effects far from the robot file: a regression of the residual torque.

A fit moves in small steps from the robot file's own numbers. Where the file lacks several frictions at once, none of
them alone is near its optimum. Along the measured motion, smoothed and differentiated, the residual torque is nearly
linear in the effects' sizes, so sets of them are found by least squares, without a simulation. The regressors are
differences of the model's torque balance, so every effect that the balance shows has one.

Legend: K instants, thinned to independent ones; B balances, one for a motor or a link; C columns of the candidates, and
one more, the residual torque itself; θ (C) in typical sizes.

Source: Gautier, Proc. IEEE ICRA (1997) 1801 (inverse dynamics identified from filtered motion); Pati, Rezaiifar,
Krishnaprasad, Proc. Asilomar 27 (1993) 40 (orthogonal matching pursuit, here with a beam); Schwarz, Ann. Stat. 6 (1978)
461 (the cost of a further effect).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.data.split import Portion
from hdagen.diagnosis.data.windows import Record
from hdagen.diagnosis.inference.bounded_least_squares import Bounds, bounded
from hdagen.diagnosis.inference.candidate_priors import SLAB, TOLERATED, Dictionary, is_broad
from hdagen.diagnosis.inference.gauss_newton import put_sizes
from hdagen.diagnosis.inference.local_fit import Fitted, begun
from hdagen.diagnosis.inference.sensitivities import Design
from hdagen.diagnosis.residuals.residual_torque import Sight
from hdagen.support.parallel import together

MOST = 4  # effects of a set
BEAM = 3  # sets of each size that are enlarged
LESS = 0.9  # of a balance's residual (rms), that one more effect may leave at most
FAR = 2.0  # typical sizes: a larger effect is far from the robot file; a smaller one is found from there
MOST_ROWS, STRETCHES = 6000, 4  # rows of a log that are used, and the number of pieces they come in
FEWEST = 50  # instants of a balance
SETTLED = 1e-2  # change of the logarithm of a balance's residual, below which the weights have converged
ROUNDS = 5  # reweightings of the balances
RIDGE = 1e-6  # prior precision of a size that spans orders of magnitude
DARK = 1e-9  # of the residual torque (rms): a smaller column shows nothing of an effect


@dataclass(frozen=True, eq=False)
class Regressed:
    """A set of effects with their sizes ``theta`` (C), 0 elsewhere; ``left``: half the sum of n log of each balance's
    residual (mean square), plus the cost of the sizes; ``by_balance``: these residuals (B)."""

    atoms: tuple[int, ...]
    theta: Array
    left: float
    by_balance: Array


@dataclass(frozen=True, eq=False)
class Regression:
    """Cross products (B, C + 1, C + 1) of regressors and residual torque of each balance, over ``counts`` (B) instants;
    ``bounds`` of θ (C each) and its prior ``precision`` (C) with everything free."""

    words: Dictionary
    arm: Arm
    products: Array
    counts: Array
    bounds: Bounds
    precision: Array

    @classmethod
    def of(cls, arm: Arm, record: Record, words: Dictionary) -> Regression | None:
        """Regress the visible rows of a record.

        Args:
            arm: the compiled model.
            record: the log in windows.
            words: all candidates.

        Returns:
            The regression; None where there is too little motion.

        """
        points = [arm.p, *_moved(arm, words)]
        parts = [_balances(arm, part, points) for part in _sampled(record)]
        none, *moved = map(_concatenate, zip(*parts, strict=True))
        if min(map(len, none)) < FEWEST:
            return None
        products, steps = [], _steps(arm, words)
        for b, y in enumerate(none):
            X = np.column_stack([*((y - one[b]) / step for one, step in zip(moved, steps, strict=True)), y])
            products.append(X.T @ X)
        counts = np.array([len(y) for y in none])
        free = words.meaning(tuple(range(len(words.atoms))))
        described = list(arm.parameters.described.values())
        broad = [is_broad(described[c.index]) for c in words.columns]
        precision = np.where(broad, RIDGE, SLAB**-2.0)
        return cls(words, arm, np.stack(products), counts, free.bounds(arm), precision)

    def far(self) -> dict[int, Array]:
        """Return the sizes θ (C) of each effect by itself, by candidate, where they exceed `FAR`."""
        alone = {k: self.fitted((k,)).theta for k in self._shown()}
        return {k: theta for k, theta in alone.items() if np.abs(theta).max() > FAR}

    def sets(self) -> list[Regressed]:
        """Return the best set of each number of effects from two to MOST, the smallest first. They grow as long as one
        more effect explains much, and contain an effect larger than `FAR`."""
        shown, beam = self._shown(), [self.fitted(())]
        found: list[Regressed] = []
        for _ in range(MOST):
            further: dict[tuple[int, ...], Regressed] = {}
            for atoms in (atoms for one in beam for atoms in self._enlarged(one.atoms, shown)):
                if atoms not in further:
                    further[atoms] = self.fitted(atoms)
            less, beam = beam[0], sorted(further.values(), key=lambda one: one.left)[:BEAM]
            if not beam or not self._tells(beam[0], less):
                break
            found.append(beam[0])
        return [one for one in found[1:] if np.abs(one.theta).max() > FAR]

    def _enlarged(self, atoms: tuple[int, ...], shown: Sequence[int]) -> Iterator[tuple[int, ...]]:
        """Add each further effect that has a meaning beside a set."""
        names = self.words.names(atoms)
        for k in shown:
            if self.words.atoms[k].name not in names and self.words.fits(self.arm, k, atoms):
                yield tuple(sorted((*atoms, k)))

    def fitted(self, atoms: tuple[int, ...]) -> Regressed:
        """Fit a set of effects, with the base parameters and a nuisance share of base effects, each balance weighted by
        its residual.

        Args:
            atoms: places of the set's candidates.

        Returns:
            The set with its sizes.

        """
        free = np.array([i for i, c in enumerate(self.words.columns) if c.base or c.atom in atoms], int)
        own = np.array([self.words.columns[i].atom in atoms for i in free], bool)
        precision = np.where(own, self.precision[free], self.words.spike[free] ** -2.0)
        most = np.where(own, np.inf, TOLERATED * self.words.spike[free])
        within = np.clip(self.bounds[0][free], -most, None), np.clip(self.bounds[1][free], None, most)
        N, b, c = self.products[:, free[:, None], free], self.products[:, free, -1], self.products[:, -1, -1]
        theta, left = np.zeros(len(free)), c / self.counts
        for _ in range(ROUNDS):
            weight, old = 1.0 / np.maximum(left, np.finfo(float).tiny), left
            H, g = np.tensordot(weight, N, 1) + np.diag(precision), weight @ b
            theta = bounded(H, g, np.asarray(np.linalg.solve(H, g), float), within)
            least = 1e-12 * c
            left = np.maximum(c - 2.0 * b @ theta + np.einsum("i,bij,j->b", theta, N, theta), least) / self.counts
            if np.abs(np.log(left / old)).max() < SETTLED:
                break
        cost = 0.5 * float(self.counts @ np.log(left)) + 0.5 * float((precision * theta**2).sum())
        cost += 0.5 * math.log(float(self.counts.sum())) * int(own.sum())
        whole = np.zeros(len(self.words.columns))
        whole[free[own]] = theta[own]
        return Regressed(atoms, whole, cost, left)

    def _shown(self) -> list[int]:
        """List the candidates that a balance shows."""
        power = np.einsum("bcc->bc", self.products)
        shows = (power[:, :-1] > DARK**2 * power[:, -1:]).any(0)
        return sorted({c.atom for c, told in zip(self.words.columns, shows, strict=True) if c.atom >= 0 and told})

    def _tells(self, more: Regressed, less: Regressed) -> bool:
        """Tell whether one more effect explains enough of a balance to be worth a start."""
        return more.left < less.left and bool((more.by_balance < LESS**2 * less.by_balance).any())


def _concatenate(parts: Sequence[list[Array]]) -> list[Array]:
    """Concatenate each balance over the parts of a log."""
    return [np.concatenate(pieces) for pieces in zip(*parts, strict=True)]


def begin_sets(regression: Regression, at: Design, near: float) -> list[Fitted]:
    """Start fits at the best sets of several effects, each at its regressed sizes.

    Args:
        regression: the regression of the record, with the candidates of ``at``.
        at: sensitivities about the robot file's numbers.
        near: size of unexplained torque to start from.

    Returns:
        The fits, the smallest set first.

    """

    def begin(one: Regressed) -> Fitted:
        return begun(at, at.words, one.atoms, near, put_sizes(at, at.words, one.atoms, one.theta))

    return together(begin, regression.sets())


def _sampled(record: Record) -> list[Portion]:
    """Take the visible rows of a record; of a long log's, pieces spread all over it."""
    log, pieces = record.log, 1
    if len(log) > MOST_ROWS:
        pieces = STRETCHES
    firsts = np.linspace(0, len(log), pieces, endpoint=False).astype(int)
    length = min(len(log), MOST_ROWS // pieces)
    return [Portion(log.rows(a, a + length), record.shown[a : a + length]) for a in firsts.tolist()]


def _steps(arm: Arm, words: Dictionary) -> list[float]:
    """Choose the step of each parameter, in typical sizes, away from a bound."""
    described = list(arm.parameters.described.values())
    steps = []
    for c in words.columns:
        allowed = described[c.index].low <= c.center + c.unit <= described[c.index].high
        steps.append(1.0 if allowed else -1.0)
    return steps


def _moved(arm: Arm, words: Dictionary) -> list[Array]:
    """Return the robot file's parameters (np) with each column's parameter moved by its step, its effect in its
    shapes."""
    found = []
    for c, step in zip(words.columns, _steps(arm, words), strict=True):
        p = arm.p.copy()
        if c.atom >= 0:
            words.atoms[c.atom].shape(arm, p)
        p[c.index] = c.center + step * c.unit
        found.append(p)
    return found


def _balances(arm: Arm, part: Portion, points: Sequence[Array]) -> list[list[Array]]:
    """Compute the residual torque of each balance (B) under some parameters (np), at independent instants in which its
    motor slides."""
    sight = Sight(arm, part.log, (), arm.p, arm.p, {})
    seen = sight.kept & part.at(sight.time)
    sliding = [np.flatnonzero(seen & sight.slides(j))[:: sight.grid.width] for j in range(1, arm.n + 1)]

    def balances(p: Array) -> list[Array]:
        missing = sight.missing(p)
        sides = [missing.motor]
        if missing.link is not None:
            sides.append(missing.link)
        return [side[rows, b] for side in sides for b, rows in enumerate(sliding)]

    return together(balances, points)
