"""Sensitivities of a record about a point: columns of initial states, torques and parameters, and the residual.

Legend: R sampled rows, M channels, C columns; θ parameters in typical sizes
(`hdagen.diagnosis.inference.candidate_priors`).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.ratings import compute_torque_per_input
from hdagen.diagnosis.data.windows import measure_usual_torque
from hdagen.diagnosis.inference.batch_evidence import ResidualBatch
from hdagen.diagnosis.inference.candidate_priors import CandidateSet, Column
from hdagen.diagnosis.inference.likelihood_settings import LIKELIHOOD
from hdagen.diagnosis.inference.linear_gaussian import CrossProducts
from hdagen.diagnosis.inference.linear_model import LinearModel
from hdagen.diagnosis.inference.multiple_shooting import MultipleShooting
from hdagen.diagnosis.inference.rollout import Rollout


@dataclass(frozen=True, eq=False)
class OperatingPoint:
    """Where the model is linearized: parameters (np) and initial states (W, m). ``memory``: effects' own states (K, nx
    − m) at which the selected windows begin, known once the model has run through all windows."""

    p: Array
    initial_states: Array
    memory: Array | None = None

    @property
    def rollout(self) -> Rollout:
        """The simulation of this point."""
        return Rollout(self.p, self.initial_states, memory=self.memory)

    def with_initial_states(self, begun: Array) -> OperatingPoint:
        """Return the point with other initial states, which change the effects' memory little.

        Args:
            begun: initial states (W, m).

        """
        return replace(self, initial_states=begun)


@dataclass(eq=False)
class Sensitivities:
    """Columns (C, R M) in units of noise, first initial states, then torques (``k``), then parameters; the residual (R,
    M). ``torques_of_nuisance``: the torques' columns (k, R M) at an earlier point whose columns of nuisance effects
    were kept; None: all columns are those of one point."""

    shooting: MultipleShooting
    candidates: CandidateSet
    point: OperatingPoint
    columns: Array
    residual: Array
    k: int
    torques_of_nuisance: Array | None = None

    @property
    def torque_columns(self) -> Array:
        """The columns of torques (k, R M)."""
        return self.columns[self.shooting.m : self.shooting.m + self.k]

    def linear_model(self, temperature: float = LIKELIHOOD.likelihood_temperature) -> LinearModel:
        """Build the linear model, with the residual extrapolated to nominal parameters.

        Args:
            temperature: the likelihood counts as its root of this order.

        Returns:
            Cross products of columns and residual, window by window.

        """
        return replace(self._products, temperature=temperature)

    @cached_property
    def _products(self) -> LinearModel:
        one = self.batch_residuals([self.point], self.residual[None])
        least = float(measure_input_uncertainty(self.shooting).min())  # one size serves all joints
        return LinearModel(
            self.cross_products, one.z[0], one.r2[0], one.rows, one.theta[0], LIKELIHOOD.likelihood_temperature, least
        )

    def batch_residuals(self, points: Sequence[OperatingPoint], residuals: Array) -> ResidualBatch:
        """Pair the same columns with the residuals of other points.

        Args:
            points: the B points.
            residuals: their residuals (B, R, M), in units of noise.

        Returns:
            All of these linear models at once.

        """
        head, record = self.shooting.m + self.k, self.shooting.record
        theta = np.stack([self.candidates.to_theta(point.p) for point in points])
        r = residuals.reshape(len(points), -1) + theta @ self.columns[head:]
        z = np.stack([r[:, part] @ self.columns[:, part].T for part in self.window_slices], 1)
        begins = self.window_edges[:-1]
        sample_counts = np.add.reduceat(((record.noise / record.sample_noise) ** 2).reshape(-1), begins)
        return ResidualBatch(
            self.cross_products,
            z,
            np.add.reduceat(r**2, begins, axis=1),
            sample_counts,
            theta,
            LIKELIHOOD.likelihood_temperature,
        )

    @property
    def window_edges(self) -> np.ndarray:
        """First row of each window in ``columns``, and the end."""
        counts = [len(rows) for rows in self.shooting.record.sampled_rows]
        return np.asarray(np.concatenate([[0], np.cumsum(counts)]) * self.residual.shape[1])

    @property
    def window_slices(self) -> list[slice]:
        """Rows of each window."""
        return [slice(int(a), int(b)) for a, b in itertools.pairwise(self.window_edges)]

    @cached_property
    def cross_products(self) -> CrossProducts:
        """Cross products of the columns."""
        count = len(self.columns)
        products = np.empty((len(self.window_edges) - 1, count, count))
        for one, part in zip(products, self.window_slices, strict=True):
            np.matmul(self.columns[:, part], self.columns[:, part].T, out=one)
        return CrossProducts(products, self.shooting.m, self.k)

    def drop_products(self) -> None:
        """Drop the cross products, which take more memory than the columns that they can be computed from again."""
        for name in ("cross_products", "_products"):
            self.__dict__.pop(name, None)

    def without_columns(self) -> Sensitivities:
        """Return the candidates and the point alone: all that a hypothesis needs once it is not fitted any more."""
        torques = self.torques_of_nuisance
        return replace(
            self,
            columns=self.columns[:, :0].copy(),
            residual=self.residual[:0].copy(),
            torques_of_nuisance=None if torques is None else torques[:, :0].copy(),
        )

    def with_spike_scale(self, share: float) -> Sensitivities:
        """Return the design with another spike width of the inactive effects.

        Args:
            share: spike width in typical sizes.

        """
        other = replace(self, candidates=self.candidates.with_spike_scale(share))
        if self.residual.size:
            other.cross_products = self.cross_products
        return other

    def with_finite_step(self, places: Sequence[int]) -> Sensitivities:
        """Return the design with some columns taken over a whole typical size. A small step says nothing of an effect
        that has a corner or acts beyond a limit.

        Args:
            places: places of their parameters.

        """
        columns, head = self.columns.copy(), self.shooting.m + self.k
        whole = [replace(self.candidates.columns[k], step=1.0) for k in places]
        lanes = [step_parameter(self.shooting, self.candidates, self.point, c) for c in whole]
        columns[[head + k for k in places]] = compute_finite_differences(
            self.shooting, self.point, self.residual, lanes
        )
        return replace(self, columns=columns)

    def with_visible_columns(self) -> Sensitivities:
        """Return the design with columns over a whole typical size for effects that a small step does not show."""
        head = self.shooting.m + self.k
        return self.with_finite_step(
            [
                k
                for k, c in enumerate(self.candidates.columns)
                if c.candidate >= 0 and not _is_visible(self.columns[head + k])
            ]
        )

    def undetectable_candidates(self) -> frozenset[int]:
        """Find the candidates that no channel of this log shows."""
        own, head = self.candidates.columns, self.shooting.m + self.k
        shown = {c.candidate for k, c in enumerate(own) if _is_visible(self.columns[head + k])}
        return frozenset({c.candidate for c in own if c.candidate >= 0} - shown)

    def at_point(self, point: OperatingPoint) -> Sensitivities:
        """Return the same columns with the simulated residual of another point.

        Args:
            point: the other point.

        """
        read, memory = self.shooting.predict_with_memory(point.rollout)
        return self.at_prediction(replace(point, memory=memory), read)

    def at_prediction(self, point: OperatingPoint, read: Array) -> Sensitivities:
        """Return the same columns with the residual of another point whose readings are known.

        Args:
            point: the other point.
            read: predicted readings (R, M) there.

        """
        other = replace(self, point=point, residual=weigh_residual(self.shooting, read))
        other.cross_products = self.cross_products
        return other


def weigh_residual(shooting: MultipleShooting, seen: Array) -> Array:
    """Subtract predicted from measured readings, limited to each channel's range.

    Args:
        shooting: the record and its model.
        seen: predicted readings (…, R, M).

    Returns:
        The residual in units of noise, of the same shape.

    """
    return np.asarray(shooting.record.subtract_prediction(seen) / shooting.record.sample_noise)


def _is_visible(column: Array) -> bool:
    """Tell whether a typical size moves a channel somewhere by more than rounding does."""
    return bool(np.abs(column).max(initial=0.0) > LIKELIHOOD.least_visible_change)


def measure_torque_units(shooting: MultipleShooting) -> Array:
    """Choose the unit of unexplained torque at each motor.

    Args:
        shooting: the record and its model.

    Returns:
        The units (n), N m.

    """
    arm = shooting.arm
    friction = [arm.parameters.described[f"coulomb_friction_{j}"].nominal for j in range(1, arm.n + 1)]
    return LIKELIHOOD.torque_unit_share * np.maximum(
        np.maximum(measure_usual_torque(arm, shooting.record), 0.1 * np.array(friction)), 1e-6
    )


def measure_input_uncertainty(shooting: MultipleShooting) -> Array:
    """Measure the uncertainty of measured inputs over a step of unexplained torque, as the log shows it.

    Args:
        shooting: the record and its model.

    Returns:
        The uncertainty (n), in units of unexplained torque.

    """
    record = shooting.record
    rows = float(np.mean(record.ends - record.starts)) / count_torque_steps(shooting)
    return np.asarray(record.input_noise / measure_torque_units(shooting) / np.sqrt(rows))


def measure_input_noise(shooting: MultipleShooting) -> Array:
    """Measure the torque that the noise of measured inputs makes over a step of unexplained torque: what the log shows,
    or all that the robot file states. Neighbouring rows hardly show a noise that changes slowly.

    Args:
        shooting: the record and its model.

    Returns:
        The torque (n), in units of unexplained torque; 0 where a command drives the joint.

    """
    arm = shooting.arm
    stated = np.array([joint["sensor"]["current_noise"] for joint in arm.robot["joints"]])
    stated = stated * np.abs(compute_torque_per_input(arm)) / measure_torque_units(shooting)
    is_measured = np.isin(np.arange(1, arm.n + 1), list(shooting.record.joints_without_command))
    return np.maximum(measure_input_uncertainty(shooting), np.where(is_measured, stated, 0.0))


def count_torque_steps(shooting: MultipleShooting) -> int:
    """Count the steps of unexplained torque in a window, at each motor and at each link of a flexible joint. The fewer
    they are, the more of a real machine's torque is taken for noise.

    Args:
        shooting: the record and its model.

    """
    arm, record = shooting.arm, shooting.record
    rows = int((record.ends - record.starts).min())
    return max(
        min(LIKELIHOOD.torque_steps // (arm.n + len(arm.manifest["flexible"])), rows // LIKELIHOOD.fewest_rows_of_step),
        LIKELIHOOD.fewest_torque_steps,
    )


def compute_finite_differences(
    shooting: MultipleShooting, point: OperatingPoint, left: Array, lanes: Sequence[tuple[Rollout, float]]
) -> Array:
    """Difference lanes about a point into columns.

    Args:
        shooting: the record and its model.
        point: the point.
        left: the residual at the point (R, M), in units of noise.
        lanes: the simulations beside the point, each with its step in units.

    Returns:
        Columns (C, R M), each over its step; 0 where a lane yields no number.

    """
    columns = np.zeros((len(lanes), left.size))
    predictions = shooting.predict_near(point.rollout, [lane for lane, _ in lanes])
    for column, read, (_, step) in zip(columns, predictions, lanes, strict=True):
        if np.isfinite(read).all():
            column[:] = ((left - weigh_residual(shooting, read)) / step).reshape(-1)
    return columns


def select_columns(at: Sensitivities, words: CandidateSet, nearer: Sensitivities | None = None) -> Sensitivities:
    """Select columns of a design by the set of candidates that names them.

    Args:
        at: the design with all columns.
        words: the candidates; columns that ``at`` lacks are left out.
        nearer: a design whose point and own columns are used in place of those of ``at``.

    Returns:
        The smaller design.

    """
    head = at.shooting.m + at.k
    kept = {(c.parameter, c.candidate): head + i for i, c in enumerate(at.candidates.columns)}
    words = replace(words, columns=tuple(c for c in words.columns if (c.parameter, c.candidate) in kept))
    old = [*range(head), *(kept[c.parameter, c.candidate] for c in words.columns)]
    if nearer is None:
        selected = replace(at, candidates=words, columns=at.columns[old])
        selected.cross_products = CrossProducts(at.cross_products.take_columns(old), at.shooting.m, at.k)
        return selected
    own = {(c.parameter, c.candidate): head + i for i, c in enumerate(nearer.candidates.columns)}
    columns, torques = at.columns[old], at.torques_of_nuisance
    if torques is None:
        torques = at.torque_columns
    columns[:head] = nearer.columns[:head]
    for i, c in enumerate(words.columns, head):
        if (c.parameter, c.candidate) in own:
            columns[i] = nearer.columns[own[c.parameter, c.candidate]]
    return Sensitivities(at.shooting, words, nearer.point, columns, nearer.residual, at.k, torques)


def step_parameter(
    shooting: MultipleShooting, words: CandidateSet, point: OperatingPoint, column: Column
) -> tuple[Rollout, float]:
    """Make a lane with one parameter moved by its step, or as far as the wider side of its bounds allows.

    Args:
        shooting: the record and its model.
        words: the candidates that the column belongs to.
        point: where to linearize.
        column: the parameter and its step.

    Returns:
        The lane, and the step in units. Without any room the lane stays at the point.

    """
    described = list(shooting.arm.parameters.described.values())
    q, p = described[column.index], point.p.copy()
    if column.candidate >= 0:
        atom = words.members[column.candidate]
        if (
            not atom.has_default_shapes and atom.name not in words.active
        ):  # the default candidate keeps the shapes of the point
            atom.apply_shapes(shooting.arm, p)
    room = [(end - p[column.index]) / column.unit for end in (q.low, q.high)]
    step = next((step for step in (column.step, -column.step) if min(room) <= step <= max(room)), max(room, key=abs))
    p[column.index] = min(max(p[column.index] + step * column.unit, q.low), q.high)
    return Rollout(p, point.initial_states), step or column.step
