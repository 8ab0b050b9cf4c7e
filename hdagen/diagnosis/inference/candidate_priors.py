"""All candidate effects: every effect of the model on every joint, with the parameters that it frees and their typical
sizes.

Sizes are in typical sizes: θ = (value − center) / unit, where the unit is the effect's typical size (gen's effect
states it with a source). The unit of a base parameter that belongs to no effect is its tolerance. No effect is ever
exactly absent. Outside the hypothesis its size lies within a small share of the size that every machine has (SHARES);
inside it is free (SLAB).

Legend: an atom is an effect on a joint with its shape parameters at one of their starting values.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from hdagen.arm.arm_parameters import Parameter
from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.arm.effect_catalogue import EffectTraits
from hdagen.diagnosis.inference.candidate_settings import CANDIDATES


@dataclass(frozen=True)
class Candidate:
    """An effect at a joint (0: the whole arm) with fixed shapes, which may be the default ones.

    ``is_number``: the robot file states its size, which may be wrong by a factor, or all of it where it states 0.
    """

    traits: EffectTraits
    joint: int
    amplitudes: tuple[str, ...]
    shapes: Mapping[str, float]
    has_default_shapes: bool
    is_number: bool = False

    @property
    def effect(self) -> str:
        """The effect's name."""
        return self.traits.name

    @property
    def place(self) -> str:
        """The place where the effect acts."""
        return self.traits.place

    @property
    def name(self) -> str:
        """The effect as name@joint, as diagnosis.json writes it."""
        return f"{self.effect}@{self.joint}"

    def required_effect(self, arm: Arm) -> str | None:
        """Name the effect, name@joint, without which this one has no meaning: an effect that only changes dry friction
        needs dry friction. None where the robot file has it, or the effect needs no other.

        Args:
            arm: the compiled model.

        """
        if self.traits.presupposes is None:
            return None
        named = (f"{name}_{self.joint}" for name in arm.effects[self.traits.presupposes].amplitudes)
        stated = [arm.parameters.described[name].nominal for name in named if name in arm.parameters.described]
        if not stated or any(stated):
            return None
        return f"{self.traits.presupposes}@{self.joint}"

    def is_twin_of(self, other: Candidate) -> bool:
        """Tell whether two effects differ at standstill only, so that a hypothesis with both says nothing.

        Args:
            other: the other candidate.

        """
        return self.joint == other.joint and self.traits.is_twin_of(other.traits)

    def apply_shapes(self, arm: Arm, p: Array) -> None:
        """Write the shapes, clipped to their bounds, into the parameters ``p`` (np).

        Args:
            arm: the compiled model.
            p: parameters, changed in place.

        """
        for name, value in self.shapes.items():
            q = arm.parameters.described[name]
            p[arm.parameters.index(name)] = min(max(value, q.low), q.high)


@dataclass(frozen=True)
class Column:
    """A parameter to fit.

    ``index``: its place in p; ``center``: the value at θ = 0; ``unit`` of θ; ``spike_width``: prior standard deviation
    of θ; ``candidate`` whose amplitude it is (−1: none); ``in_every_hypothesis``: every hypothesis fits it, as it does
    the keys of the robot file and the shapes of its own effects; ``initial_guess`` of θ from the log (0: none);
    ``background_size``: θ that every machine has a share of; ``stated``: the number that the robot file states.
    """

    parameter: str
    index: int
    center: float
    unit: float
    spike_width: float
    candidate: int
    in_every_hypothesis: bool
    step: float = CANDIDATES.column_step
    initial_guess: float = 0.0
    background_size: float = 1.0
    stated: float = 0.0

    @property
    def initial_value(self) -> float:
        """Initial guess of the parameter, in its own unit, limited to the size of a nuisance effect."""
        most = CANDIDATES.nuisance_limit * self.spike_width
        return self.center + min(max(self.initial_guess, -most), most) * self.unit


@dataclass(frozen=True, eq=False)
class CandidateSet:
    """All candidates and columns of a model; ``active``: names of the active effects; ``spike_scale``: spike width of
    the others, in typical sizes."""

    members: tuple[Candidate, ...]
    columns: tuple[Column, ...]
    active: frozenset[str] = frozenset()
    spike_scale: float = CANDIDATES.spike_scales[0]

    @property
    def spike_widths(self) -> Array:
        """Prior standard deviations (P) of the null model."""
        return np.array([c.spike_width for c in self.columns])

    def is_nuisance(self, column: Column) -> bool:
        """Tell whether a column is that of an inactive effect.

        Args:
            column: one of a set with the same candidates.

        """
        return column.candidate >= 0 and self.members[column.candidate].name not in self.active

    def theta_bounds(self, arm: Arm) -> tuple[Array, Array]:
        """Bound θ by the parameters' limits, and an inactive effect by the largest size of a nuisance effect.

        Args:
            arm: the compiled model.

        Returns:
            Lowest and highest θ (P each).

        """
        described = list(arm.parameters.described.values())
        ends = []
        for c in self.columns:
            low, high = sorted((end - c.center) / c.unit for end in (described[c.index].low, described[c.index].high))
            most = np.inf
            if self.is_nuisance(c):
                most = CANDIDATES.nuisance_limit * c.spike_width
            ends.append((max(low, -most), min(high, most)))
        low, high = np.array(ends).T
        return low, high

    def with_spike_scale(self, share: float) -> CandidateSet:
        """Return the set with another spike width of the inactive effects, in typical sizes.

        Args:
            share: spike width.

        """
        wider = share**2 - self.spike_scale**2

        def widen(c: Column) -> Column:
            if c.candidate < 0 or c.spike_width <= CANDIDATES.silent_spike_width:
                return c
            return replace(c, spike_width=math.sqrt(c.spike_width**2 + wider * c.background_size**2))

        return replace(self, columns=tuple(map(widen, self.columns)), spike_scale=share)

    def with_shapes_added(self, k: int, shapes: Mapping[str, float]) -> CandidateSet:
        """Return the set with a copy of a candidate with other shapes as the last one.

        Args:
            k: place of the candidate.
            shapes: its new shapes by parameter.

        """
        atom = replace(self.members[k], shapes=dict(shapes), has_default_shapes=False)
        own = [
            replace(
                c, spike_width=CANDIDATES.silent_spike_width, candidate=len(self.members), in_every_hypothesis=False
            )
            for c in self.columns
            if c.candidate == k
        ]
        return replace(self, members=(*self.members, atom), columns=(*self.columns, *own))

    def with_active(self, atoms: tuple[int, ...]) -> CandidateSet:
        """Return the set with the same columns, in which a hypothesis' effects are active.

        Args:
            atoms: places of its candidates.

        """
        return replace(self, active=frozenset(self.members[k].name for k in atoms))

    def amplitude_columns(self, atoms: tuple[int, ...]) -> np.ndarray:
        """Return the places of the amplitudes' columns that a hypothesis frees.

        Args:
            atoms: places of its candidates.

        """
        return np.array([c for c, column in enumerate(self.columns) if column.candidate in atoms], int)

    def presence_threshold(self, k: int) -> float:
        """Return the size, in typical sizes, from which a candidate counts as present: a base parameter within twice
        its tolerance is as the robot file states. Of a number that is 0 in the file any clear size counts.

        Args:
            k: place of the candidate.

        """
        if self.is_absent_number(k):
            return CANDIDATES.least_absent_number
        theta = np.zeros(len(self.columns))
        own = self.amplitude_columns((k,))
        theta[own] = CANDIDATES.base_deviation_limit * float(self.spike_widths[own].max(initial=0.0))
        if len(own) > 1:
            return max(CANDIDATES.present_size, float(theta[own].max()))
        return max(CANDIDATES.present_size, self.measure_size(k, theta))

    @property
    def has_numbers(self) -> bool:
        """Whether numbers of the robot file are among the candidates."""
        return any(one.is_number for one in self.members)

    def is_absent_number(self, k: int) -> bool:
        """Tell whether a candidate is a number that the robot file states as 0, as a URDF's rotors are.

        Args:
            k: place of the candidate.

        """
        own = self.amplitude_columns((k,))
        return self.members[k].is_number and len(own) == 1 and not self.columns[own[0]].stated

    def list_absent_numbers(self) -> list[str]:
        """List the candidates, name@joint, that are numbers which the robot file states as 0."""
        return [one.name for k, one in enumerate(self.members) if self.is_absent_number(k)]

    def measure_size(self, k: int, theta: Array) -> float:
        """Measure the size of a candidate. That of a number that the robot file states is the logarithm of its factor,
        as it may be too large by as many times as too small. A number that is 0 in the file has no factor.

        Args:
            k: place of the candidate.
            theta: θ (P).

        Returns:
            The size in usual sizes; sine and cosine of one effect count together.

        """
        own = self.amplitude_columns((k,))
        size = float(np.linalg.norm(theta[own]))
        if not self.members[k].is_number or len(own) != 1 or not self.columns[own[0]].stated:
            return size
        usual = self.columns[own[0]].unit / self.columns[own[0]].stated
        factor = 1.0 + float(theta[own[0]]) * usual
        if factor <= 0.0:
            return size
        return abs(math.log(factor)) / math.log1p(abs(usual))

    def hypothesis_columns(self, atoms: tuple[int, ...]) -> np.ndarray:
        """Return the places of the columns that only a hypothesis has: its amplitudes and shapes.

        Args:
            atoms: places of its candidates.

        """
        shapes = {shape for k in atoms for shape in self.members[k].shapes}
        return np.array(
            [c for c, one in enumerate(self.columns) if one.candidate in atoms or one.parameter in shapes], int
        )

    def to_theta(self, p: Array) -> Array:
        """Return parameters in typical sizes, θ (P). Where several candidates share a parameter, the one with the
        widest spike takes all of it.

        Args:
            p: parameters (np).

        """
        widest: dict[str, int] = {}
        for k, c in enumerate(self.columns):
            if c.parameter not in widest or c.spike_width > self.columns[widest[c.parameter]].spike_width:
                widest[c.parameter] = k
        theta = np.zeros(len(self.columns))
        for k in widest.values():
            theta[k] = (p[self.columns[k].index] - self.columns[k].center) / self.columns[k].unit
        return theta

    @property
    def always_fitted(self) -> CandidateSet:
        """The columns that every hypothesis fits, alone."""
        return replace(self, columns=tuple(c for c in self.columns if c.in_every_hypothesis), active=frozenset())

    def names_of(self, atoms: Iterable[int]) -> tuple[str, ...]:
        """Return the names of some candidates, name@joint, sorted.

        Args:
            atoms: their places.

        """
        return tuple(sorted(self.members[k].name for k in atoms))

    def is_compatible(self, arm: Arm, k: int, lead: Iterable[int]) -> bool:
        """Tell whether a candidate adds a meaning to a hypothesis: not as a twin of its effects, nor without an effect
        it needs.

        Args:
            arm: the compiled model.
            k: place of the candidate.
            lead: places of the hypothesis' candidates.

        """
        atom, beside = self.members[k], [self.members[i] for i in lead]
        there = atom.required_effect(arm) in (*(b.name for b in beside), None)
        return there and not any(map(atom.is_twin_of, beside))

    def columns_for(self, atoms: tuple[int, ...], every: bool = False) -> CandidateSet:
        """Return the columns of one hypothesis, in which its effects are active: of these its own candidates, of the
        others the default ones.

        Args:
            atoms: places of its candidates.
            every: keep all candidates of the other effects.

        """
        meant = {self.members[k].name for k in atoms}
        columns = []
        for c in self.columns:
            if c.candidate in atoms:
                first = next((d.spike_width for d in self.columns if d.parameter == c.parameter), c.spike_width)
                columns.append(replace(c, spike_width=first))
            elif c.candidate < 0 or (
                self.members[c.candidate].name not in meant and (every or self.members[c.candidate].has_default_shapes)
            ):
                columns.append(c)
        return replace(self, columns=tuple(columns), active=frozenset(meant))

    def columns_near(self, arm: Arm, atoms: tuple[int, ...], p: Array) -> CandidateSet:
        """Return the columns of one hypothesis about its present point, with small steps for its own sizes. The shapes
        of its effects, and those of nuisance effects large enough to matter, become columns, too.

        Args:
            arm: the compiled model.
            atoms: places of its candidates.
            p: parameters (np) of the point.

        """
        focus = self.columns_for(atoms)
        columns = [replace(c, step=CANDIDATES.local_step) if c.candidate in atoms else c for c in focus.columns]
        seen = [
            c.candidate
            for c in focus.columns
            if c.candidate >= 0
            and c.candidate not in atoms
            and abs(p[c.index] - c.center) > CANDIDATES.shape_fit_threshold * c.spike_width * abs(c.unit)
        ]
        names = list(arm.parameters.described)
        shapes = [name for k in atoms for name in self.members[k].shapes]
        described = arm.parameters.described
        shapes += [name for k in seen for name in self.members[k].shapes if not described[name].is_motor_order]
        for name in dict.fromkeys(shapes):
            q = described[name]
            value = float(p[names.index(name)])
            columns.append(
                Column(name, names.index(name), value, _shape_unit(q, value), 1.0, -1, True, CANDIDATES.local_step)
            )
        return replace(focus, columns=tuple(columns))


def _shape_unit(q: Parameter, value: float) -> float:
    """Choose the unit of a shape parameter that has this value."""
    if q.search_unit is not None:
        return q.search_unit
    if q.low >= 0:
        return max(CANDIDATES.shape_unit_share * abs(value), CANDIDATES.least_shape_unit * (q.high - q.low))
    return 0.1 * (q.high - q.low) / 2
