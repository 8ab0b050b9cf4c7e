"""The linear model of a record about a point: residuals, and columns for first states, torques and parameters.

Legend: R rows that are looked at, M channels, C columns; θ parameters in usual sizes (`hdagen.diagnosis.candidates`).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from hdagen.diagnosis.bundle import Bundle
from hdagen.diagnosis.candidates import Column, Dictionary
from hdagen.diagnosis.linear import Gram, Linear
from hdagen.diagnosis.record import usual_torque
from hdagen.diagnosis.shooting import Lane, Shooting
from hdagen.plant import Array

STEPS = 16  # of unexplained torque in a window, shared by the motors and links that it acts on: time and memory
FEWEST_STEPS, FEWEST_ROWS = 2, 3  # of each, and of data in one
KICKS = 5  # impulses on a link in a step
SHARE = 0.02  # of the usual motor torque: unit of unexplained torque
START = 3.0  # noise, by which a first position is moved
TEMPERATURE = 12.0  # of the likelihood, in fits as in decisions: fits of one log end in places that differ by as much
SHOWN = 1e-3  # noise, that a usual size moves a channel by at least, if that shows anything of it
REACTION = 0.01  # s: a first velocity is moved by START noise in that time


@dataclass(frozen=True, eq=False)
class Point:
    """Where the model stands: parameters (np), first states (W, m) and, where the model went through all windows, the
    effects' own states (K, nx − m) with which those that are looked at begin."""

    p: Array
    begun: Array
    memory: Array | None = None

    @property
    def lane(self) -> Lane:
        """Its simulation."""
        return Lane(self.p, self.begun, memory=self.memory)

    def with_begun(self, begun: Array) -> Point:
        """With other first states: of what the windows remember they change next to nothing."""
        return replace(self, begun=begun)


@dataclass(eq=False)
class Design:
    """Columns (C, R M) in units of noise, first states, then torques (``k``), then parameters; the residual (R, M)."""

    shooting: Shooting
    words: Dictionary
    point: Point
    columns: Array
    residual: Array
    k: int

    def linear(self, temperature: float = TEMPERATURE) -> Linear:
        """The cross products with the residual as it would be at nominal parameters; the likelihood counts as its root
        of order ``temperature``."""
        return replace(self._products, temperature=temperature)

    @cached_property
    def _products(self) -> Linear:
        one = self.bundle([self.point], self.residual[None])
        least = uncertain_torque(self.shooting)
        return Linear(self.gram, one.z[0], one.r2[0], one.rows, one.theta[0], TEMPERATURE, least)

    def bundle(self, points: Sequence[Point], residuals: Array) -> Bundle:
        """The same columns at other points with their ``residuals`` (B, R, M)."""
        head, record = self.shooting.m + self.k, self.shooting.record
        theta = np.stack([self.words.theta(point.p) for point in points])
        r = residuals.reshape(len(points), -1) + theta @ self.columns[head:]
        z = np.stack([r[:, part] @ self.columns[:, part].T for part in self.parts], 1)
        begins = self.edges[:-1]
        told = np.add.reduceat(((record.noise / record.spread) ** 2).reshape(-1), begins)
        return Bundle(self.gram, z, np.add.reduceat(r**2, begins, axis=1), told, theta, TEMPERATURE)

    @property
    def edges(self) -> np.ndarray:
        """The first row of each window in ``columns``, and the end."""
        counts = [len(rows) for rows in self.shooting.record.looked]
        return np.asarray(np.concatenate([[0], np.cumsum(counts)]) * self.residual.shape[1])

    @property
    def parts(self) -> list[slice]:
        """The rows of each window."""
        return [slice(int(a), int(b)) for a, b in itertools.pairwise(self.edges)]

    @cached_property
    def gram(self) -> Gram:
        """Cross products of the columns."""
        products = np.stack([self.columns[:, part] @ self.columns[:, part].T for part in self.parts])
        return Gram(products, self.shooting.m, self.k)

    def bare(self) -> Design:
        """Words and point alone: what is needed of a hypothesis that is not fitted any more."""
        return Design(
            self.shooting, self.words, self.point, self.columns[:, :0].copy(), self.residual[:0].copy(), self.k
        )

    def sharing(self, share: float) -> Design:
        """The same with what is not meant tolerated to another share."""
        other = replace(self, words=self.words.sharing(share))
        if self.residual.size:
            other.__dict__["gram"] = self.gram
        return other

    def widened(self, places: Sequence[int]) -> Design:
        """The same with the columns of some parameters over a whole usual size: of what answers with a corner, or
        beyond a limit, a small step says nothing."""
        columns, head = self.columns.copy(), self.shooting.m + self.k
        whole = [replace(self.words.columns[k], step=1.0) for k in places]
        lanes = [_moved(self.shooting, self.words, self.point, c) for c in whole]
        columns[[head + k for k in places]] = _differences(self.shooting, self.point, self.residual, lanes)
        return replace(self, columns=columns)

    def whole(self) -> Design:
        """The same with the effects' columns over a whole usual size where a small step shows nothing."""
        head = self.shooting.m + self.k
        return self.widened(
            [k for k, c in enumerate(self.words.columns) if c.atom >= 0 and not _shows(self.columns[head + k])]
        )

    def silent(self) -> frozenset[int]:
        """Atoms of which no channel shows anything: of those another log may tell."""
        own, head = self.words.columns, self.shooting.m + self.k
        shown = {c.atom for k, c in enumerate(own) if _shows(self.columns[head + k])}
        return frozenset({c.atom for c in own if c.atom >= 0} - shown)

    def moved(self, point: Point) -> Design:
        """The same columns with the residual of another point."""
        read, memory = self.shooting.recalled(point.lane)
        return self.seen(replace(point, memory=memory), read)

    def seen(self, point: Point, read: Array) -> Design:
        """The same columns with another point, at which the channels read ``read`` (R, M)."""
        other = Design(self.shooting, self.words, point, self.columns, residual(self.shooting, read), self.k)
        other.__dict__["gram"] = self.gram
        return other


def residual(shooting: Shooting, seen: Array) -> Array:
    """Measured less predicted (R, M) in units of noise, as far as the channel's range."""
    return np.asarray(shooting.record.missed(seen) / shooting.record.spread)


def _shows(column: Array) -> bool:
    """Whether a usual size moves a channel somewhere by more than rounding does."""
    return bool(np.abs(column).max(initial=0.0) > SHOWN)


def torque_units(shooting: Shooting) -> Array:
    """Unit of unexplained torque at each motor (n), N m."""
    arm = shooting.arm
    friction = [arm.parameters.described[f"coulomb_friction_{j}"].nominal for j in range(1, arm.n + 1)]
    return SHARE * np.maximum(np.maximum(usual_torque(arm, shooting.record), 0.1 * np.array(friction)), 1e-6)


def uncertain_torque(shooting: Shooting) -> float:
    """What is uncertain of measured inputs over a step of unexplained torque, in its units: of the joint of which that
    is least, as one size serves all."""
    record = shooting.record
    rows = float(np.mean(record.ends - record.starts)) / knots(shooting)
    return float(np.min(record.input_noise / torque_units(shooting))) / np.sqrt(rows)


def knots(shooting: Shooting) -> int:
    """Steps of unexplained torque in a window at each motor and each link of a flexible joint: the more, the less of a
    real machine's torque within a step is taken for noise."""
    arm, record = shooting.arm, shooting.record
    rows = int((record.ends - record.starts).min())
    return max(min(STEPS // (arm.n + len(arm.manifest["flexible"])), rows // FEWEST_ROWS), FEWEST_STEPS)


def design(shooting: Shooting, words: Dictionary, point: Point) -> Design:
    """Everything about one point, a lane each: itself, first states, steps of torque, parameters."""
    read, memory = shooting.recalled(Lane(point.p, point.begun))
    point = replace(point, memory=memory)
    torques = [(lane, 1.0) for lane in _torques(shooting, point)]
    lanes = _first(shooting, point) + torques + [_moved(shooting, words, point, c) for c in words.columns]
    left = residual(shooting, read)  # held to the channels' ranges: of what flies apart no slope says anything
    return Design(shooting, words, point, _differences(shooting, point, left, lanes), left, len(torques))


def _differences(shooting: Shooting, point: Point, left: Array, lanes: Sequence[tuple[Lane, float]]) -> Array:
    """The columns (C, R M) of lanes about a point that leaves ``left`` (R, M), each over its step; 0, as of what shows
    nothing, where a lane reads what is no number."""
    columns = np.zeros((len(lanes), left.size))
    seen = shooting.near(point.lane, [lane for lane, _ in lanes])
    for column, read, (_, step) in zip(columns, seen, lanes, strict=True):
        if np.isfinite(read).all():
            column[:] = ((left - residual(shooting, read)) / step).reshape(-1)
    return columns


def chosen(at: Design, words: Dictionary, nearer: Design | None = None) -> Design:
    """The columns of ``at`` that ``words`` names, at the point of ``nearer`` with those columns that it has itself."""
    head = at.shooting.m + at.k
    kept = {(c.parameter, c.atom): head + i for i, c in enumerate(at.words.columns)}
    words = replace(words, columns=tuple(c for c in words.columns if (c.parameter, c.atom) in kept))
    old = [*range(head), *(kept[c.parameter, c.atom] for c in words.columns)]
    if nearer is None:
        made = Design(at.shooting, words, at.point, at.columns[old], at.residual, at.k)
        made.__dict__["gram"] = Gram(at.gram.some(old), at.shooting.m, at.k)
        return made
    own = {(c.parameter, c.atom): head + i for i, c in enumerate(nearer.words.columns)}
    columns = at.columns[old]
    columns[:head] = nearer.columns[:head]
    for i, c in enumerate(words.columns, head):
        if (c.parameter, c.atom) in own:
            columns[i] = nearer.columns[own[c.parameter, c.atom]]
    return Design(at.shooting, words, nearer.point, columns, nearer.residual, at.k)


def _moved(shooting: Shooting, words: Dictionary, point: Point, column: Column) -> tuple[Lane, float]:
    """A lane with one parameter moved by its step, or as far as the wider side of its bounds allows, and the step in
    units; where there is no room nothing is moved, and the lane shows nothing."""
    described = list(shooting.arm.parameters.described.values())
    q, p = described[column.index], point.p.copy()
    atom = words.atoms[column.atom] if column.atom >= 0 else None
    if atom and not atom.first and atom.name not in words.meant:  # the first has its shapes where it stands
        atom.shape(shooting.arm, p)
    room = [(end - p[column.index]) / column.unit for end in (q.low, q.high)]
    step = next((step for step in (column.step, -column.step) if min(room) <= step <= max(room)), max(room, key=abs))
    p[column.index] = min(max(p[column.index] + step * column.unit, q.low), q.high)
    return Lane(p, point.begun), step or column.step


def _first(shooting: Shooting, point: Point) -> list[tuple[Lane, float]]:
    """A lane for each first position and velocity."""
    lanes = []
    for i, size in enumerate(_first_steps(shooting)):
        moved = point.begun.copy()
        moved[:, i] += size
        lanes.append((Lane(point.p, moved), size))
    return lanes


def _first_steps(shooting: Shooting) -> list[float]:
    """By how much each first position and velocity (m) is moved."""
    arm, record = shooting.arm, shooting.record
    noise = {(q, j): s for (q, j), s in zip(record.outputs, record.noise, strict=True)}
    found = []
    for name in arm.state_names[: shooting.m]:
        side, quantity, j = name.split("_")
        ratio = arm.parameters[f"ratio_{j}"]
        own, other = (
            noise.get((f"{side}_position", int(j))),
            noise.get(("joint_position" if side == "motor" else "motor_position", int(j)), 0.0),
        )
        size = START * (own or (other * ratio if side == "motor" else other / ratio))
        found.append(size if quantity == "position" else size / REACTION)
    return found


def _torques(shooting: Shooting, point: Point) -> list[Lane]:
    """A step of torque in each part of the windows, at each motor and, in a flexible joint, each link."""
    arm, record = shooting.arm, shooting.record
    units, lanes, steps = torque_units(shooting), [], knots(shooting)
    edges = np.linspace(record.starts, record.ends, steps + 1, axis=1).round().astype(int)
    part = np.full(len(record.time), -1)  # which step each row is in
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
