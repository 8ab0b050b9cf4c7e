"""The linear model of a record about a point: residuals and their sensitivities to initial states, torques and
parameters.

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
from hdagen.diagnosis.data.windows import usual_torque
from hdagen.diagnosis.inference.batch_evidence import Bundle
from hdagen.diagnosis.inference.candidate_priors import Column, Dictionary
from hdagen.diagnosis.inference.linear_gaussian import Gram, Linear
from hdagen.diagnosis.inference.multiple_shooting import Lane, Shooting

STEPS = 16  # steps of unexplained torque in a window, shared by all motors and links: bounds time and memory
FEWEST_STEPS, FEWEST_ROWS = 2, 3  # steps for each motor or link, and rows in a step, at least
KICKS = 5  # impulses on a link in a step
SHARE = 0.02  # of the usual motor torque: unit of unexplained torque
START = 3.0  # standard deviations of noise by which an initial position is moved
TEMPERATURE = 12.0  # of the likelihood, in fits and decisions: local optima of one log differ by as much log evidence
SHOWN = 1e-3  # standard deviations of noise by which a typical size moves a channel that shows the effect
REACTION = 0.01  # s, in which a moved initial velocity moves its position by START standard deviations


@dataclass(frozen=True, eq=False)
class Point:
    """Where the model is linearized: parameters (np) and initial states (W, m). ``memory``: effects' own states (K, nx
    − m) at which the selected windows begin, known once the model has run through all windows."""

    p: Array
    begun: Array
    memory: Array | None = None

    @property
    def lane(self) -> Lane:
        """The simulation of this point."""
        return Lane(self.p, self.begun, memory=self.memory)

    def with_begun(self, begun: Array) -> Point:
        """Return the point with other initial states, which change the effects' memory little.

        Args:
            begun: initial states (W, m).

        """
        return replace(self, begun=begun)


@dataclass(eq=False)
class Design:
    """Columns (C, R M) in units of noise, first initial states, then torques (``k``), then parameters; the residual (R,
    M)."""

    shooting: Shooting
    words: Dictionary
    point: Point
    columns: Array
    residual: Array
    k: int

    def linear(self, temperature: float = TEMPERATURE) -> Linear:
        """Build the linear model, with the residual extrapolated to nominal parameters.

        Args:
            temperature: the likelihood counts as its root of this order.

        Returns:
            Cross products of columns and residual, window by window.

        """
        return replace(self._products, temperature=temperature)

    @cached_property
    def _products(self) -> Linear:
        one = self.bundle([self.point], self.residual[None])
        least = uncertain_torque(self.shooting)
        return Linear(self.gram, one.z[0], one.r2[0], one.rows, one.theta[0], TEMPERATURE, least)

    def bundle(self, points: Sequence[Point], residuals: Array) -> Bundle:
        """Pair the same columns with the residuals of other points.

        Args:
            points: the B points.
            residuals: their residuals (B, R, M), in units of noise.

        Returns:
            All of these linear models at once.

        """
        head, record = self.shooting.m + self.k, self.shooting.record
        theta = np.stack([self.words.theta(point.p) for point in points])
        r = residuals.reshape(len(points), -1) + theta @ self.columns[head:]
        z = np.stack([r[:, part] @ self.columns[:, part].T for part in self.parts], 1)
        begins = self.edges[:-1]
        told = np.add.reduceat(((record.noise / record.spread) ** 2).reshape(-1), begins)
        return Bundle(self.gram, z, np.add.reduceat(r**2, begins, axis=1), told, theta, TEMPERATURE)

    @property
    def edges(self) -> np.ndarray:
        """First row of each window in ``columns``, and the end."""
        counts = [len(rows) for rows in self.shooting.record.looked]
        return np.asarray(np.concatenate([[0], np.cumsum(counts)]) * self.residual.shape[1])

    @property
    def parts(self) -> list[slice]:
        """Rows of each window."""
        return [slice(int(a), int(b)) for a, b in itertools.pairwise(self.edges)]

    @cached_property
    def gram(self) -> Gram:
        """Cross products of the columns."""
        products = np.stack([self.columns[:, part] @ self.columns[:, part].T for part in self.parts])
        return Gram(products, self.shooting.m, self.k)

    def bare(self) -> Design:
        """Return the candidates and the point alone: all that a hypothesis needs once it is not fitted any more."""
        return Design(
            self.shooting, self.words, self.point, self.columns[:, :0].copy(), self.residual[:0].copy(), self.k
        )

    def sharing(self, share: float) -> Design:
        """Return the design with another spike width of the inactive effects.

        Args:
            share: spike width in typical sizes.

        """
        other = replace(self, words=self.words.sharing(share))
        if self.residual.size:
            other.gram = self.gram
        return other

    def widened(self, places: Sequence[int]) -> Design:
        """Return the design with some columns taken over a whole typical size. A small step says nothing of an effect
        that has a corner or acts beyond a limit.

        Args:
            places: places of their parameters.

        """
        columns, head = self.columns.copy(), self.shooting.m + self.k
        whole = [replace(self.words.columns[k], step=1.0) for k in places]
        lanes = [_moved(self.shooting, self.words, self.point, c) for c in whole]
        columns[[head + k for k in places]] = _differences(self.shooting, self.point, self.residual, lanes)
        return replace(self, columns=columns)

    def whole(self) -> Design:
        """Return the design with columns over a whole typical size for effects that a small step does not show."""
        head = self.shooting.m + self.k
        return self.widened(
            [k for k, c in enumerate(self.words.columns) if c.atom >= 0 and not _shows(self.columns[head + k])]
        )

    def silent(self) -> frozenset[int]:
        """Find the candidates that no channel of this log shows."""
        own, head = self.words.columns, self.shooting.m + self.k
        shown = {c.atom for k, c in enumerate(own) if _shows(self.columns[head + k])}
        return frozenset({c.atom for c in own if c.atom >= 0} - shown)

    def moved(self, point: Point) -> Design:
        """Return the same columns with the simulated residual of another point.

        Args:
            point: the other point.

        """
        read, memory = self.shooting.recalled(point.lane)
        return self.seen(replace(point, memory=memory), read)

    def seen(self, point: Point, read: Array) -> Design:
        """Return the same columns with the residual of another point whose readings are known.

        Args:
            point: the other point.
            read: predicted readings (R, M) there.

        """
        other = Design(self.shooting, self.words, point, self.columns, residual(self.shooting, read), self.k)
        other.gram = self.gram
        return other


def residual(shooting: Shooting, seen: Array) -> Array:
    """Subtract predicted from measured readings, limited to each channel's range.

    Args:
        shooting: the record and its model.
        seen: predicted readings (…, R, M).

    Returns:
        The residual in units of noise, of the same shape.

    """
    return np.asarray(shooting.record.missed(seen) / shooting.record.spread)


def _shows(column: Array) -> bool:
    """Tell whether a typical size moves a channel somewhere by more than rounding does."""
    return bool(np.abs(column).max(initial=0.0) > SHOWN)


def torque_units(shooting: Shooting) -> Array:
    """Choose the unit of unexplained torque at each motor.

    Args:
        shooting: the record and its model.

    Returns:
        The units (n), N m.

    """
    arm = shooting.arm
    friction = [arm.parameters.described[f"coulomb_friction_{j}"].nominal for j in range(1, arm.n + 1)]
    return SHARE * np.maximum(np.maximum(usual_torque(arm, shooting.record), 0.1 * np.array(friction)), 1e-6)


def uncertain_torque(shooting: Shooting) -> float:
    """Measure the uncertainty of measured inputs over a step of unexplained torque. One size serves all joints, so the
    joint of least uncertainty counts.

    Args:
        shooting: the record and its model.

    Returns:
        The uncertainty, in units of unexplained torque.

    """
    record = shooting.record
    rows = float(np.mean(record.ends - record.starts)) / knots(shooting)
    return float(np.min(record.input_noise / torque_units(shooting))) / np.sqrt(rows)


def knots(shooting: Shooting) -> int:
    """Count the steps of unexplained torque in a window, at each motor and at each link of a flexible joint. The fewer
    they are, the more of a real machine's torque is taken for noise.

    Args:
        shooting: the record and its model.

    """
    arm, record = shooting.arm, shooting.record
    rows = int((record.ends - record.starts).min())
    return max(min(STEPS // (arm.n + len(arm.manifest["flexible"])), rows // FEWEST_ROWS), FEWEST_STEPS)


def design(shooting: Shooting, words: Dictionary, point: Point) -> Design:
    """Linearize a record about a point by one lane for each initial state, step of torque, and parameter.

    Args:
        shooting: the record and its model.
        words: the parameters.
        point: where to linearize.

    Returns:
        Sensitivities and residual at the point.

    """
    read, memory = shooting.recalled(Lane(point.p, point.begun))
    point = replace(point, memory=memory)
    torques = [(lane, 1.0) for lane in _torques(shooting, point)]
    lanes = _first(shooting, point) + torques + [_moved(shooting, words, point, c) for c in words.columns]
    left = residual(shooting, read)  # limited to the channels' ranges: a diverging simulation has no useful slope
    return Design(shooting, words, point, _differences(shooting, point, left, lanes), left, len(torques))


def _differences(shooting: Shooting, point: Point, left: Array, lanes: Sequence[tuple[Lane, float]]) -> Array:
    """Difference the lanes about a point with residual ``left`` (R, M) into columns (C, R M), each over its step; 0
    where a lane yields no number."""
    columns = np.zeros((len(lanes), left.size))
    seen = shooting.near(point.lane, [lane for lane, _ in lanes])
    for column, read, (_, step) in zip(columns, seen, lanes, strict=True):
        if np.isfinite(read).all():
            column[:] = ((left - residual(shooting, read)) / step).reshape(-1)
    return columns


def chosen(at: Design, words: Dictionary, nearer: Design | None = None) -> Design:
    """Select columns of a design by the set of candidates that names them.

    Args:
        at: the design with all columns.
        words: the candidates; columns that ``at`` lacks are left out.
        nearer: a design whose point and own columns are used in place of those of ``at``.

    Returns:
        The smaller design.

    """
    head = at.shooting.m + at.k
    kept = {(c.parameter, c.atom): head + i for i, c in enumerate(at.words.columns)}
    words = replace(words, columns=tuple(c for c in words.columns if (c.parameter, c.atom) in kept))
    old = [*range(head), *(kept[c.parameter, c.atom] for c in words.columns)]
    if nearer is None:
        made = Design(at.shooting, words, at.point, at.columns[old], at.residual, at.k)
        made.gram = Gram(at.gram.some(old), at.shooting.m, at.k)
        return made
    own = {(c.parameter, c.atom): head + i for i, c in enumerate(nearer.words.columns)}
    columns = at.columns[old]
    columns[:head] = nearer.columns[:head]
    for i, c in enumerate(words.columns, head):
        if (c.parameter, c.atom) in own:
            columns[i] = nearer.columns[own[c.parameter, c.atom]]
    return Design(at.shooting, words, nearer.point, columns, nearer.residual, at.k)


def _moved(shooting: Shooting, words: Dictionary, point: Point, column: Column) -> tuple[Lane, float]:
    """Make a lane with one parameter moved by its step, or as far as the wider side of its bounds allows, and return
    the step in units. Without any room the lane stays at the point."""
    described = list(shooting.arm.parameters.described.values())
    q, p = described[column.index], point.p.copy()
    if column.atom >= 0:
        atom = words.atoms[column.atom]
        if not atom.first and atom.name not in words.meant:  # the default candidate keeps the shapes of the point
            atom.shape(shooting.arm, p)
    room = [(end - p[column.index]) / column.unit for end in (q.low, q.high)]
    step = next((step for step in (column.step, -column.step) if min(room) <= step <= max(room)), max(room, key=abs))
    p[column.index] = min(max(p[column.index] + step * column.unit, q.low), q.high)
    return Lane(p, point.begun), step or column.step


def _first(shooting: Shooting, point: Point) -> list[tuple[Lane, float]]:
    """Make a lane for each initial position and velocity."""
    lanes = []
    for i, size in enumerate(_first_steps(shooting)):
        moved = point.begun.copy()
        moved[:, i] += size
        lanes.append((Lane(point.p, moved), size))
    return lanes


def _first_steps(shooting: Shooting) -> list[float]:
    """Choose the step of each initial position and velocity (m)."""
    arm, record = shooting.arm, shooting.record
    noise = {(q, j): s for (q, j), s in zip(record.outputs, record.noise, strict=True)}
    found = []
    for name in arm.state_names[: shooting.m]:
        side, quantity, j = name.split("_")
        ratio = arm.parameters[f"ratio_{j}"]
        own = noise.get((f"{side}_position", int(j)))
        if not own and side == "motor":
            own = noise.get(("joint_position", int(j)), 0.0) * ratio
        elif not own:
            own = noise.get(("motor_position", int(j)), 0.0) / ratio
        size = START * own
        if quantity != "position":
            size = size / REACTION
        found.append(size)
    return found


def _torques(shooting: Shooting, point: Point) -> list[Lane]:
    """Make a lane for each step of torque in the windows, at each motor and at each link of a flexible joint."""
    arm, record = shooting.arm, shooting.record
    units, lanes, steps = torque_units(shooting), [], knots(shooting)
    edges = np.linspace(record.starts, record.ends, steps + 1, axis=1).round().astype(int)
    part = np.full(len(record.time), -1)  # the step that each row lies in
    part[record.rows] = np.repeat(np.tile(np.arange(steps), len(edges)), np.diff(edges).reshape(-1))
    for j in range(1, arm.n + 1):
        for k in range(steps):
            torque = np.zeros((len(record.time), arm.n))
            torque[part == k, j - 1] = units[j - 1]
            lanes.append(Lane(point.p, point.begun, torque=torque))
    elapsed = np.append(0.0, np.cumsum(record.steps))
    for j in arm.manifest["flexible"]:
        unit = units[j - 1] * abs(arm.parameters[f"ratio_{j}"])
        for first, end in zip(edges[:, :-1].T, edges[:, 1:].T, strict=True):
            impulse = np.zeros((len(record.time), arm.n))
            rows = np.linspace(first, end, KICKS, endpoint=False, axis=1).astype(int)
            kicks = 1 + np.count_nonzero(np.diff(rows), axis=1)
            impulse[rows, j - 1] = (unit * (elapsed[end] - elapsed[first]) / kicks)[:, None]
            lanes.append(Lane(point.p, point.begun, impulse=impulse))
    return lanes
