"""What can be missing: every effect of the model on every joint, as parameters to free, each with what is usual.

Sizes are counted in what is usual: θ = (value − centre) / unit, the unit being the effect's typical size (which gen's
effect states with a source). A base parameter that is no effect's has its tolerance as unit. No effect is ever exactly
absent: its size is within a small share of what every machine has of it (SHARES), or it is free (SLAB).

Legend: an atom is an effect on a joint with its shape parameters at one of their starts.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hdagen.diagnosis.starts import Suggested
from hdagen.plant import Arm, Array, Parameter

SHARES = 0.05, 0.025, 0.0125  # standard deviation of the size of an effect that is not meant, in usual sizes: the first
# until a log says how little of everything it has
TOLERATED = 3.0  # standard deviations that such an effect has at most: with more it is present
SLAB = 1.0  # of one that is
FELT = 0.3  # of that standard deviation, from which its shapes are fitted
SILENT = 1e-4  # of an atom that is looked at only in its own hypothesis: below any share of any size
PRESENT = 0.3  # size from which an effect counts as present
OFF = 2.0  # tolerances of the robot file, from which a base parameter off its value is an effect
NEAR = 0.1  # by which a parameter of a hypothesis is moved about where it stands
STEP = 0.1  # by which a parameter is moved for its column: small, as what is not meant is; large sizes are scanned
LEAST = 1e-3  # of a shape parameter's range: its unit where the value is 0
ORDER = "order"  # in the name of a shape that is no matter of small steps
TWINS = {"current_bias", "asymmetric_friction"}
CHANGES_FRICTION = ("stribeck_friction", "asymmetric_friction", "thermal_friction", "presliding_friction")
WALL = 0.02  # rad (or m), unit of where a wall stands: its range says nothing of what a hard one bears
BROAD = "N m/rad", "N/m", "N m s/rad", "N s/m"  # units of walls and dampers, which come in all orders of magnitude
BROAD_KEY = "coulomb_friction"  # of the robot file, whose size does, too: what is stated may be a guess
SHAPE = 0.5  # of a shape parameter's value: its unit


@dataclass(frozen=True)
class Atom:
    """An effect at a joint (0: the whole arm) with its shapes fixed; ``first``: the shapes are the usual ones."""

    effect: str
    joint: int
    place: str
    amplitudes: tuple[str, ...]
    shapes: Mapping[str, float]
    first: bool

    @property
    def name(self) -> str:
        """name@joint as diagnosis.json writes it."""
        return f"{self.effect}@{self.joint}"

    def presupposes(self, arm: Arm) -> str | None:
        """What has to be there first: dry friction, where the robot file has none, for what only changes it."""
        base = arm.parameters.described.get(f"coulomb_friction_{self.joint}")
        without = self.effect in CHANGES_FRICTION and base is not None and not base.nominal
        return f"coulomb_friction@{self.joint}" if without else None

    def twin(self, other: Atom) -> bool:
        """Whether the two differ at standstill only, so that one of them beside the other says nothing."""
        return self.joint == other.joint and {self.effect, other.effect} == TWINS

    def shape(self, arm: Arm, p: Array) -> None:
        """Put its shapes, as far as their bounds allow, into the parameters ``p`` (np), in place."""
        for name, value in self.shapes.items():
            q = arm.parameters.described[name]
            p[arm.parameters.place(name)] = min(max(value, q.low), q.high)


@dataclass(frozen=True)
class Column:
    """A parameter to move: its place in p, where θ is 0, unit of θ, spike width in units, the atom whose amplitude it
    is (−1: none); ``base``: refitted in every hypothesis, as keys of the robot file and shapes of what is free are;
    ``seen``: θ as read off the log before any fit (0: it is not); ``everywhere``: θ of which every machine has a
    share."""

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
        """The parameter as it was read off, as far as that is tolerated."""
        most = TOLERATED * self.spike
        return self.center + min(max(self.seen, -most), most) * self.unit


@dataclass(frozen=True, eq=False)
class Dictionary:
    """All atoms and columns of a model; ``meant``: names of the atoms that are free; ``share``: of the usual sizes, to
    which the others are tolerated."""

    atoms: tuple[Atom, ...]
    columns: tuple[Column, ...]
    meant: frozenset[str] = frozenset()
    share: float = SHARES[0]

    @property
    def spike(self) -> Array:
        """Prior standard deviations (P) with nothing free."""
        return np.array([c.spike for c in self.columns])

    def bounds(self, arm: Arm) -> tuple[Array, Array]:
        """Lowest and highest θ (P): those of the parameters, and of an effect that is not meant what is tolerated."""
        described = list(arm.parameters.described.values())
        ends = []
        for c in self.columns:
            low, high = sorted((end - c.center) / c.unit for end in (described[c.index].low, described[c.index].high))
            meant = c.atom < 0 or self.atoms[c.atom].name in self.meant
            most = np.inf if meant else TOLERATED * c.spike
            ends.append((max(low, -most), min(high, most)))
        low, high = np.array(ends).T
        return low, high

    def sharing(self, share: float) -> Dictionary:
        """The same with what is not meant tolerated to another share."""
        wider = share**2 - self.share**2
        columns = tuple(
            c if c.atom < 0 or c.spike <= SILENT else replace(c, spike=math.sqrt(c.spike**2 + wider * c.everywhere**2))
            for c in self.columns
        )
        return replace(self, columns=columns, share=share)

    def another(self, k: int, shapes: Mapping[str, float]) -> Dictionary:
        """With one more atom, the last: the effect of atom k with other shapes."""
        atom = replace(self.atoms[k], shapes=dict(shapes), first=False)
        own = [replace(c, spike=SILENT, atom=len(self.atoms), base=False) for c in self.columns if c.atom == k]
        return replace(self, atoms=(*self.atoms, atom), columns=(*self.columns, *own))

    def meaning(self, atoms: tuple[int, ...]) -> Dictionary:
        """The same columns where only these atoms are meant."""
        return replace(self, meant=frozenset(self.atoms[k].name for k in atoms))

    def free(self, atoms: tuple[int, ...]) -> np.ndarray:
        """Columns that are free when ``atoms`` are."""
        return np.array([c for c, column in enumerate(self.columns) if column.atom in atoms], int)

    def counts(self, k: int) -> float:
        """The size from which atom k is present: a base parameter within twice its tolerance is as the robot file
        says."""
        return max(PRESENT, OFF * float(self.spike[self.free((k,))].max(initial=0.0)))

    def own(self, atoms: tuple[int, ...]) -> np.ndarray:
        """Columns that only a hypothesis with ``atoms`` has: their amplitudes and shapes."""
        shapes = {shape for k in atoms for shape in self.atoms[k].shapes}
        return np.array([c for c, one in enumerate(self.columns) if one.atom in atoms or one.parameter in shapes], int)

    def theta(self, p: Array) -> Array:
        """The parameters p in usual sizes (P); where several atoms share one, it is that of the widest alone."""
        widest: dict[str, int] = {}
        for k, c in enumerate(self.columns):
            if c.parameter not in widest or c.spike > self.columns[widest[c.parameter]].spike:
                widest[c.parameter] = k
        own = set(widest.values())
        return np.array([(p[c.index] - c.center) / c.unit if k in own else 0.0 for k, c in enumerate(self.columns)])

    @property
    def base(self) -> Dictionary:
        """The columns that every hypothesis refits, alone."""
        return replace(self, columns=tuple(c for c in self.columns if c.base), meant=frozenset())

    def names(self, atoms: Iterable[int]) -> tuple[str, ...]:
        """Those of some atoms as name@joint, sorted."""
        return tuple(sorted(self.atoms[k].name for k in atoms))

    def fits(self, arm: Arm, k: int, lead: Iterable[int]) -> bool:
        """Whether atom k says something beside the atoms of ``lead``."""
        atom, beside = self.atoms[k], [self.atoms[i] for i in lead]
        there = atom.presupposes(arm) in (*(b.name for b in beside), None)
        return there and not any(map(atom.twin, beside))

    def focused(self, atoms: tuple[int, ...], every: bool = False) -> Dictionary:
        """The columns of one hypothesis: of its effects its own atoms, of the others the first (all with ``every``)."""
        meant = {self.atoms[k].name for k in atoms}
        columns = []
        for c in self.columns:
            if c.atom < 0 or (
                c.atom in atoms if self.atoms[c.atom].name in meant else every or self.atoms[c.atom].first
            ):
                own = c.atom in atoms
                first = next((d.spike for d in self.columns if d.parameter == c.parameter), c.spike)
                columns.append(replace(c, spike=first) if own else c)
        return replace(self, columns=tuple(columns), meant=frozenset(meant))

    def about(self, arm: Arm, atoms: tuple[int, ...], p: Array) -> Dictionary:
        """`focused`, about where the hypothesis stands in ``p``: its sizes by small steps, with its shapes free, and
        those of what is tolerated and felt."""
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
            broad = max(SHAPE * abs(value), LEAST * (q.high - q.low)) if q.low >= 0 else 0.1 * (q.high - q.low) / 2
            unit = WALL if name.startswith(("contact_above", "contact_below")) else broad
            columns.append(Column(name, names.index(name), value, unit, 1.0, -1, True, NEAR))
        return replace(focus, columns=tuple(columns))


def is_broad(parameter: Parameter) -> bool:
    """Whether a size comes in all orders of magnitude, so that its usual one says little."""
    return parameter.unit.endswith(BROAD) or parameter.name.startswith(BROAD_KEY)


def dictionary(arm: Arm, suggested: Suggested, uncommanded: Collection[int] = ()) -> Dictionary:
    """Every effect of ``arm`` that a log can show, with what the log itself suggests; of ``uncommanded`` joints, whose
    measured inputs drive the model, none that lies between a command and what acts."""
    described = arm.parameters.described
    place = {name: k for k, name in enumerate(described)}
    atoms: list[Atom] = []
    columns: list[Column] = []
    for effect in arm.manifest["effects"]:
        for j in effect["joints"]:
            suffix = f"_{j}" if j else ""
            stated = (a + suffix for a in effect["amplitudes"])
            names = tuple(name for name in stated if name in described and described[name].typical)
            if not names or (effect["place"] == "input" and j in uncommanded):
                continue
            shapes = [s + suffix for s in effect["shapes"]]
            for number, chosen in enumerate(_together([suggested.shapes.get(s, described[s].starts) for s in shapes])):
                atoms.append(
                    Atom(effect["name"], j, effect["place"], names, dict(zip(shapes, chosen, strict=True)), not number)
                )
                columns += [
                    _column(described[name], place[name], len(atoms) - 1, not number, suggested) for name in names
                ]
    owned = {c.parameter for c in columns}
    for name, q in described.items():
        if q.role == "base" and name not in owned and q.tolerance > 0 and q.nominal:
            columns.append(Column(name, place[name], q.nominal, q.tolerance * abs(q.nominal), 1.0, -1, True))
    return Dictionary(tuple(atoms), tuple(columns))


def _together(starts: Sequence[Sequence[float]]) -> list[tuple[float, ...]]:
    """One start of each shape at a time, all of them in turn."""
    count = max((len(s) for s in starts), default=1)
    return [tuple(s[k % len(s)] for s in starts) for k in range(count)]


def _column(q: Parameter, index: int, atom: int, first: bool, suggested: Suggested) -> Column:
    assert q.typical
    name, base = q.name, q.role == "base"
    unit = suggested.units.get(name, q.typical)
    nominal = q.low if not base and q.low > 0 else q.nominal  # what cannot be 0 is absent at its lowest
    everywhere = (q.everywhere or q.typical) / q.typical
    spike = math.hypot(q.tolerance * abs(nominal) / unit, SHARES[0] * everywhere) if first else SILENT
    step = suggested.sizes[name] / unit if name in suggested.sizes else STEP
    seen = (suggested.seen[name] - nominal) / unit if first and name in suggested.seen else 0.0
    return Column(name, index, nominal, unit, spike, atom, base and first, step, seen, everywhere)
