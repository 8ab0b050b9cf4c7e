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

SHARES = 0.05, 0.025, 0.0125  # typical sizes: standard deviation of an effect outside the hypothesis. A fit uses the
# first of them until the log shows how much of every effect the machine has.
TOLERATED = 3.0  # standard deviations that such an effect has at most; a larger one is present
SLAB = 1.0  # typical sizes: standard deviation of an effect of the hypothesis
FELT = 0.3  # of the spike width; the shapes of a larger effect are fitted, too
SILENT = 1e-4  # spike width of a candidate that only its own hypothesis uses: below any share of any size
PRESENT = 0.3  # typical sizes, from which an effect counts as present
OFF = 2.0  # tolerances of the robot file, from which a shifted base parameter counts as an effect
NEAR = 0.1  # step of a hypothesis' own parameters, about its present point
STEP = 0.1  # step of every other column: small, as nuisance effects are small; a scan tries large sizes
LEAST = 1e-3  # of a shape parameter's range: its unit where its value is 0
ORDER = "order"  # in the name of a shape that cannot be found by small steps
TWINS = {"current_bias", "asymmetric_friction"}
CHANGES_FRICTION = ("stribeck_friction", "asymmetric_friction", "thermal_friction", "presliding_friction")
WALL = 0.02  # rad (or m): unit of a wall's position, which has to be this fine for a hard wall
BROAD = "N m/rad", "N/m", "N m s/rad", "N s/m"  # units of walls and dampers, whose sizes span orders of magnitude
BROAD_KEY = "coulomb_friction"  # a robot file's value that may be a guess, so its size spans them, too
SHAPE = 0.5  # of a shape parameter's value: its unit


@dataclass(frozen=True)
class Atom:
    """An effect at a joint (0: the whole arm) with fixed shapes; ``first``: they are the default ones."""

    effect: str
    joint: int
    place: str
    amplitudes: tuple[str, ...]
    shapes: Mapping[str, float]
    first: bool

    @property
    def name(self) -> str:
        """The effect as name@joint, as diagnosis.json writes it."""
        return f"{self.effect}@{self.joint}"

    def presupposes(self, arm: Arm) -> str | None:
        """Name the effect, name@joint, without which this one has no meaning: an effect that only changes dry friction
        needs dry friction. None where the robot file has it, or the effect needs no other.

        Args:
            arm: the compiled model.

        """
        base = arm.parameters.described.get(f"coulomb_friction_{self.joint}")
        without = self.effect in CHANGES_FRICTION and base is not None and not base.nominal
        if without:
            return f"coulomb_friction@{self.joint}"
        return None

    def twin(self, other: Atom) -> bool:
        """Tell whether two effects differ at standstill only, so that a hypothesis with both says nothing.

        Args:
            other: the other candidate.

        """
        return self.joint == other.joint and {self.effect, other.effect} == TWINS

    def shape(self, arm: Arm, p: Array) -> None:
        """Write the shapes, clipped to their bounds, into the parameters ``p`` (np).

        Args:
            arm: the compiled model.
            p: parameters, changed in place.

        """
        for name, value in self.shapes.items():
            q = arm.parameters.described[name]
            p[arm.parameters.place(name)] = min(max(value, q.low), q.high)


@dataclass(frozen=True)
class Column:
    """A parameter to fit.

    ``index``: its place in p; ``center``: the value at θ = 0; ``unit`` of θ; ``spike``: prior standard deviation of θ;
    ``atom``: the candidate whose amplitude it is (−1: none); ``base``: every hypothesis fits it, as it does the keys of
    the robot file and the shapes of its own effects; ``seen``: initial guess of θ from the log (0: none);
    ``everywhere``: θ that every machine has a share of.
    """

    parameter: str
    index: int
    center: float
    unit: float
    spike: float
    atom: int
    base: bool
    step: float = STEP
    seen: float = 0.0
    everywhere: float = 1.0

    @property
    def tolerated(self) -> float:
        """Initial guess of the parameter, in its own unit, limited to the size of a nuisance effect."""
        most = TOLERATED * self.spike
        return self.center + min(max(self.seen, -most), most) * self.unit


@dataclass(frozen=True, eq=False)
class Dictionary:
    """All atoms and columns of a model; ``meant``: names of the active effects; ``share``: spike width of the others,
    in typical sizes."""

    atoms: tuple[Atom, ...]
    columns: tuple[Column, ...]
    meant: frozenset[str] = frozenset()
    share: float = SHARES[0]

    @property
    def spike(self) -> Array:
        """Prior standard deviations (P) of the null model."""
        return np.array([c.spike for c in self.columns])

    def bounds(self, arm: Arm) -> tuple[Array, Array]:
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
            most = TOLERATED * c.spike
            if c.atom < 0 or self.atoms[c.atom].name in self.meant:
                most = np.inf
            ends.append((max(low, -most), min(high, most)))
        low, high = np.array(ends).T
        return low, high

    def sharing(self, share: float) -> Dictionary:
        """Return the set with another spike width of the inactive effects, in typical sizes.

        Args:
            share: spike width.

        """
        wider = share**2 - self.share**2

        def widen(c: Column) -> Column:
            if c.atom < 0 or c.spike <= SILENT:
                return c
            return replace(c, spike=math.sqrt(c.spike**2 + wider * c.everywhere**2))

        return replace(self, columns=tuple(map(widen, self.columns)), share=share)

    def another(self, k: int, shapes: Mapping[str, float]) -> Dictionary:
        """Return the set with a copy of a candidate with other shapes as the last one.

        Args:
            k: place of the candidate.
            shapes: its new shapes by parameter.

        """
        atom = replace(self.atoms[k], shapes=dict(shapes), first=False)
        own = [replace(c, spike=SILENT, atom=len(self.atoms), base=False) for c in self.columns if c.atom == k]
        return replace(self, atoms=(*self.atoms, atom), columns=(*self.columns, *own))

    def meaning(self, atoms: tuple[int, ...]) -> Dictionary:
        """Return the set with the same columns, in which a hypothesis' effects are active.

        Args:
            atoms: places of its candidates.

        """
        return replace(self, meant=frozenset(self.atoms[k].name for k in atoms))

    def free(self, atoms: tuple[int, ...]) -> np.ndarray:
        """Return the places of the amplitudes' columns that a hypothesis frees.

        Args:
            atoms: places of its candidates.

        """
        return np.array([c for c, column in enumerate(self.columns) if column.atom in atoms], int)

    def counts(self, k: int) -> float:
        """Return the size, in typical sizes, from which a candidate counts as present: a base parameter within twice
        its tolerance is as the robot file states.

        Args:
            k: place of the candidate.

        """
        return max(PRESENT, OFF * float(self.spike[self.free((k,))].max(initial=0.0)))

    def own(self, atoms: tuple[int, ...]) -> np.ndarray:
        """Return the places of the columns that only a hypothesis has: its amplitudes and shapes.

        Args:
            atoms: places of its candidates.

        """
        shapes = {shape for k in atoms for shape in self.atoms[k].shapes}
        return np.array([c for c, one in enumerate(self.columns) if one.atom in atoms or one.parameter in shapes], int)

    def theta(self, p: Array) -> Array:
        """Return parameters in typical sizes, θ (P). Where several candidates share a parameter, the one with the
        widest spike takes all of it.

        Args:
            p: parameters (np).

        """
        widest: dict[str, int] = {}
        for k, c in enumerate(self.columns):
            if c.parameter not in widest or c.spike > self.columns[widest[c.parameter]].spike:
                widest[c.parameter] = k
        theta = np.zeros(len(self.columns))
        for k in widest.values():
            theta[k] = (p[self.columns[k].index] - self.columns[k].center) / self.columns[k].unit
        return theta

    @property
    def base(self) -> Dictionary:
        """The columns that every hypothesis fits, alone."""
        return replace(self, columns=tuple(c for c in self.columns if c.base), meant=frozenset())

    def names(self, atoms: Iterable[int]) -> tuple[str, ...]:
        """Return the names of some candidates, name@joint, sorted.

        Args:
            atoms: their places.

        """
        return tuple(sorted(self.atoms[k].name for k in atoms))

    def fits(self, arm: Arm, k: int, lead: Iterable[int]) -> bool:
        """Tell whether a candidate adds a meaning to a hypothesis: not as a twin of its effects, nor without an effect
        it needs.

        Args:
            arm: the compiled model.
            k: place of the candidate.
            lead: places of the hypothesis' candidates.

        """
        atom, beside = self.atoms[k], [self.atoms[i] for i in lead]
        there = atom.presupposes(arm) in (*(b.name for b in beside), None)
        return there and not any(map(atom.twin, beside))

    def focused(self, atoms: tuple[int, ...], every: bool = False) -> Dictionary:
        """Return the columns of one hypothesis, in which its effects are active: of these its own candidates, of the
        others the default ones.

        Args:
            atoms: places of its candidates.
            every: keep all candidates of the other effects.

        """
        meant = {self.atoms[k].name for k in atoms}
        columns = []
        for c in self.columns:
            if c.atom in atoms:
                first = next((d.spike for d in self.columns if d.parameter == c.parameter), c.spike)
                columns.append(replace(c, spike=first))
            elif c.atom < 0 or (self.atoms[c.atom].name not in meant and (every or self.atoms[c.atom].first)):
                columns.append(c)
        return replace(self, columns=tuple(columns), meant=frozenset(meant))

    def about(self, arm: Arm, atoms: tuple[int, ...], p: Array) -> Dictionary:
        """Return the columns of one hypothesis about its present point, with small steps for its own sizes. The shapes
        of its effects, and those of nuisance effects large enough to matter, become columns, too.

        Args:
            arm: the compiled model.
            atoms: places of its candidates.
            p: parameters (np) of the point.

        """
        focus = self.focused(atoms)
        columns = [replace(c, step=NEAR) if c.atom in atoms else c for c in focus.columns]
        seen = [
            c.atom
            for c in focus.columns
            if c.atom >= 0 and c.atom not in atoms and abs(p[c.index] - c.center) > FELT * c.spike * abs(c.unit)
        ]
        names = list(arm.parameters.described)
        shapes = [name for k in atoms for name in self.atoms[k].shapes]
        shapes += [name for k in seen for name in self.atoms[k].shapes if ORDER not in name]
        for name in dict.fromkeys(shapes):
            q = arm.parameters.described[name]
            value = float(p[names.index(name)])
            columns.append(Column(name, names.index(name), value, _shape_unit(q, value), 1.0, -1, True, NEAR))
        return replace(focus, columns=tuple(columns))


def _shape_unit(q: Parameter, value: float) -> float:
    """Choose the unit of a shape parameter that has this value."""
    if q.name.startswith(("contact_above", "contact_below")):
        return WALL
    if q.low >= 0:
        return max(SHAPE * abs(value), LEAST * (q.high - q.low))
    return 0.1 * (q.high - q.low) / 2


def is_broad(parameter: Parameter) -> bool:
    """Tell whether a parameter's size spans orders of magnitude, so that its typical size says little.

    Args:
        parameter: the parameter.

    """
    return parameter.unit.endswith(BROAD) or parameter.name.startswith(BROAD_KEY)
