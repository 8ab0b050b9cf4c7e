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
from functools import cached_property

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.data.split import LogPortion
from hdagen.diagnosis.data.windows import WindowedRecord
from hdagen.diagnosis.inference.bounded_least_squares import Bounds, solve_box_qp
from hdagen.diagnosis.inference.candidate_priors import CandidateSet
from hdagen.diagnosis.inference.candidate_settings import CANDIDATES
from hdagen.diagnosis.inference.parameter_scale import is_scale_free
from hdagen.diagnosis.initialization.initialization_settings import INITIALIZATION
from hdagen.diagnosis.residuals.measured_motion import MeasuredMotion
from hdagen.diagnosis.residuals.torque_balance import TorqueBalance
from hdagen.support.parallel import map_in_threads


@dataclass(frozen=True, eq=False)
class RegressedSet:
    """A set of effects with their sizes ``theta`` (C), 0 elsewhere; ``nuisance`` (C): the sizes of everything else that
    is free beside them; ``criterion``: half the sum of n log of each balance's residual (mean square), plus the cost of
    the sizes; ``mean_squares``: these residuals (B)."""

    effects: tuple[int, ...]
    theta: Array
    nuisance: Array
    criterion: float
    mean_squares: Array


@dataclass(frozen=True, eq=False)
class TorqueRegression:
    """Cross products (B, C + 1, C + 1) of regressors and residual torque of each balance, over ``counts`` (B) instants;
    ``bounds`` of θ (C each) and its prior ``precision`` (C) with everything free."""

    candidates: CandidateSet
    arm: Arm
    products: Array
    counts: Array
    bounds: Bounds
    precision: Array

    @classmethod
    def from_record(cls, arm: Arm, record: WindowedRecord, words: CandidateSet) -> TorqueRegression | None:
        """Regress the visible rows of a record.

        Args:
            arm: the compiled model.
            record: the log in windows.
            words: all candidates.

        Returns:
            The regression; None where there is too little motion.

        """
        points = [arm.p, *_stepped_parameters(arm, words)]
        parts = [_balance_torques(arm, part, points) for part in _sample_stretches(record)]
        none, *moved = map(_concatenate_parts, zip(*parts, strict=True))
        if min(map(len, none)) < INITIALIZATION.fewest_instants:
            return None
        products, steps = [], _regressor_steps(arm, words)
        for b, y in enumerate(none):
            X = np.column_stack([*((y - one[b]) / step for one, step in zip(moved, steps, strict=True)), y])
            products.append(X.T @ X)
        counts = np.array([len(y) for y in none])
        free = words.with_active(tuple(range(len(words.members))))
        described = list(arm.parameters.described.values())
        broad = [is_scale_free(described[c.index]) for c in words.columns]
        precision = np.where(broad, INITIALIZATION.scale_free_precision, CANDIDATES.slab_width**-2.0)
        return cls(words, arm, np.stack(products), counts, free.theta_bounds(arm), precision)

    def distant_effects(self) -> dict[int, Array]:
        """Return the sizes θ (C) of each effect by itself, by candidate, where they are distant."""
        single_fits = {k: self.fit_set((k,)).theta for k in self._visible_candidates()}
        return {k: theta for k, theta in single_fits.items() if np.abs(theta).max() > INITIALIZATION.distant_size}

    @cached_property
    def best_sets(self) -> list[RegressedSet]:
        """The best set of each number of effects from two to `INITIALIZATION.largest_regressed_set`, the smallest
        first. They grow as long as one more effect explains much."""
        shown, beam = self._visible_candidates(), [self.fit_set(())]
        found: list[RegressedSet] = []
        for _ in range(INITIALIZATION.largest_regressed_set):
            further: dict[tuple[int, ...], RegressedSet] = {}
            for atoms in (atoms for one in beam for atoms in self._enlarge_set(one.effects, shown)):
                if atoms not in further:
                    further[atoms] = self.fit_set(atoms)
            less, beam = beam[0], sorted(further.values(), key=lambda one: one.criterion)[: INITIALIZATION.beam_width]
            if not beam or not self._is_worth_start(beam[0], less):
                break
            found.append(beam[0])
        return found[1:]

    def _enlarge_set(self, atoms: tuple[int, ...], shown: Sequence[int]) -> Iterator[tuple[int, ...]]:
        """Add each further effect that has a meaning beside a set."""
        names = self.candidates.names_of(atoms)
        for k in shown:
            if self.candidates.members[k].name not in names and self.candidates.is_compatible(self.arm, k, atoms):
                yield tuple(sorted((*atoms, k)))

    def fit_set(self, atoms: tuple[int, ...]) -> RegressedSet:
        """Fit a set of effects, with the base parameters and a nuisance share of base effects, each balance weighted by
        its residual.

        Args:
            atoms: places of the set's candidates.

        Returns:
            The set with its sizes.

        """
        free = np.array(
            [i for i, c in enumerate(self.candidates.columns) if c.in_every_hypothesis or c.candidate in atoms], int
        )
        own = np.array([self.candidates.columns[i].candidate in atoms for i in free], bool)
        precision = np.where(own, self.precision[free], self.candidates.spike_widths[free] ** -2.0)
        most = np.where(own, np.inf, CANDIDATES.nuisance_limit * self.candidates.spike_widths[free])
        within = np.clip(self.bounds[0][free], -most, None), np.clip(self.bounds[1][free], None, most)
        N, b, c = self.products[:, free[:, None], free], self.products[:, free, -1], self.products[:, -1, -1]
        theta, left = np.zeros(len(free)), c / self.counts
        for _ in range(INITIALIZATION.balance_reweightings):
            weight, old = 1.0 / np.maximum(left, np.finfo(float).tiny), left
            H, g = np.tensordot(weight, N, 1) + np.diag(precision), weight @ b
            theta = solve_box_qp(H, g, np.asarray(np.linalg.solve(H, g), float), within)
            least = 1e-12 * c
            left = np.maximum(c - 2.0 * b @ theta + np.einsum("i,bij,j->b", theta, N, theta), least) / self.counts
            if np.abs(np.log(left / old)).max() < INITIALIZATION.balance_tolerance:
                break
        cost = 0.5 * float(self.counts @ np.log(left)) + 0.5 * float((precision * theta**2).sum())
        cost += 0.5 * math.log(float(self.counts.sum())) * int(own.sum())
        sizes, nuisance = np.zeros((2, len(self.candidates.columns)))
        sizes[free[own]], nuisance[free[~own]] = theta[own], theta[~own]
        return RegressedSet(atoms, sizes, nuisance, cost, left)

    def _visible_candidates(self) -> list[int]:
        """List the candidates that a balance shows."""
        power = np.einsum("bcc->bc", self.products)
        shows = (power[:, :-1] > INITIALIZATION.least_regressor_ratio**2 * power[:, -1:]).any(0)
        return sorted(
            {c.candidate for c, told in zip(self.candidates.columns, shows, strict=True) if c.candidate >= 0 and told}
        )

    def _is_worth_start(self, more: RegressedSet, less: RegressedSet) -> bool:
        """Tell whether one more effect explains enough of a balance to be worth a start."""
        return more.criterion < less.criterion and bool(
            (more.mean_squares < INITIALIZATION.largest_remaining_ratio**2 * less.mean_squares).any()
        )


def _concatenate_parts(parts: Sequence[list[Array]]) -> list[Array]:
    """Concatenate each balance over the parts of a log."""
    return [np.concatenate(pieces) for pieces in zip(*parts, strict=True)]


def _sample_stretches(record: WindowedRecord) -> list[LogPortion]:
    """Take the visible rows of a record; of a long log's, pieces spread all over it."""
    log, pieces = record.log, 1
    if len(log) > INITIALIZATION.most_regressed_rows:
        pieces = INITIALIZATION.regressed_stretches
    firsts = np.linspace(0, len(log), pieces, endpoint=False).astype(int)
    length = min(len(log), INITIALIZATION.most_regressed_rows // pieces)
    return [LogPortion(log.rows(a, a + length), record.visible_rows[a : a + length]) for a in firsts.tolist()]


def _regressor_steps(arm: Arm, words: CandidateSet) -> list[float]:
    """Choose the step of each parameter, in typical sizes, away from a bound."""
    described = list(arm.parameters.described.values())
    steps = []
    for c in words.columns:
        allowed = described[c.index].low <= c.center + c.unit <= described[c.index].high
        steps.append(1.0 if allowed else -1.0)
    return steps


def _stepped_parameters(arm: Arm, words: CandidateSet) -> list[Array]:
    """Return the robot file's parameters (np) with each column's parameter moved by its step, its effect in its
    shapes."""
    found = []
    for c, step in zip(words.columns, _regressor_steps(arm, words), strict=True):
        p = arm.p.copy()
        if c.candidate >= 0:
            words.members[c.candidate].apply_shapes(arm, p)
        p[c.index] = c.center + step * c.unit
        found.append(p)
    return found


def _balance_torques(arm: Arm, part: LogPortion, points: Sequence[Array]) -> list[list[Array]]:
    """Compute the residual torque of each balance (B) under some parameters (np), at independent instants in which its
    motor slides."""
    motion = MeasuredMotion(arm, part.log, ())
    balance = TorqueBalance(motion)
    covered = motion.valid & part.covers(motion.time)
    sliding = [np.flatnonzero(covered & motion.is_sliding(j))[:: motion.grid.window_rows] for j in range(1, arm.n + 1)]

    def balances(p: Array) -> list[Array]:
        missing = balance.residual(p)
        sides = [missing.motor]
        if missing.link is not None:
            sides.append(missing.link)
        return [side[rows, b] for side in sides for b, rows in enumerate(sliding)]

    return map_in_threads(balances, points)
