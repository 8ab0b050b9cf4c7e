"""The next motion: which safe one separates effects best, and by how much the log evidence will tell them apart.

Every motion (`hdagen.safe_motion`) is run on the compiled arm. About its path the diagnosis' own linear model is made,
with the effects in question at their typical sizes as differences of whole simulations. A log of a machine that has
effect A is then that model with A present and everything else within its tolerance; the evidence for A less that for B
in it, first states, base parameters, spikes of all other effects and unexplained torque eliminated as in a diagnosis,
is what the motion separates them by. Source: Lindley, Ann. Math. Stat. 27 (1956) 986; Box, Hill, Technometrics 9
(1967) 57 (experiments that discriminate between models).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import logsumexp

from hdagen.diagnosis.candidate_list import dictionary
from hdagen.diagnosis.candidates import SILENT, Column, Dictionary
from hdagen.diagnosis.design import Design, Point, design
from hdagen.diagnosis.evidence import posteriors, score
from hdagen.diagnosis.linear import Linear
from hdagen.diagnosis.portion import Mask, Portion
from hdagen.diagnosis.record import record
from hdagen.diagnosis.shooting import Shooting
from hdagen.diagnosis.starts import Suggested, suggested
from hdagen.log import Log
from hdagen.names import meant
from hdagen.plant import Arm, Array, PlantError, is_number
from hdagen.reference import Reference
from hdagen.safe_motion import (
    MARGIN,
    Kept,
    Limits,
    Motion,
    drawn,
    follow,
    keep,
    limits_of,
    middle,
    motions,
    seen,
    shares,
    units,
    with_size,
)
from hdagen.simulation import Simulation
from hdagen.together import together
from hdagen.torques import torque_per_input

ENOUGH = 7.0  # nats, from where the other holds less than a tenth of a diagnosis' probability
TRUST = 3.0  # factor within which a prediction holds
WINDOW, FEWEST = 0.05, 25  # s and rows of a window of the diagnosis
DURATION = (2.0, 120.0)  # s
PERIOD = (1e-4, 0.01)  # s
MOST_ROWS = 40_000  # of a motion: what the linear model's memory is made for
SEEN = 3  # steps of its finer encoder by which a joint has to move: fewer are as good as rest
GENTLE, DOUBLED = 3, 12  # motions that are run, and how often they are doubled, for the least that is seen
DRAWS = 2  # of base parameters and spikes, for each true effect of a pair

Pair = tuple[str, str]


@dataclass(frozen=True, eq=False)
class Tried:
    """A motion with what it separates: nats by pair (the smaller of A true and of B true); ``kept`` None where the
    limits drop it, with ``why``."""

    name: str
    kept: Kept | None
    nats: Mapping[Pair, float] = field(default_factory=dict)
    why: str = ""

    @property
    def worst(self) -> float:
        """Nats of the pair that is separated least; −inf of a motion that is dropped."""
        return min(self.nats.values(), default=-np.inf)

    @property
    def merit(self) -> float:
        """What is maximised: a soft minimum over the pairs, which a pair that nothing separates does not rule alone;
        less than nothing is nothing."""
        if not self.nats:
            return -np.inf
        x = np.maximum(list(self.nats.values()), 0.0) / (ENOUGH * TRUST)
        return float(np.log(len(x)) - logsumexp(-x))


@dataclass(frozen=True, eq=False)
class Excitation:
    """All motions that were tried, the best first; ``effects`` to separate as name@joint; ``limits`` that are kept."""

    effects: tuple[str, ...]
    tried: tuple[Tried, ...]
    limits: Limits

    @property
    def best(self) -> Tried:
        """The motion to make."""
        return self.tried[0]

    @property
    def reference(self) -> Reference:
        """Of the best motion: positions of the joints (T, n), their rates, and the period."""
        assert self.best.kept is not None
        return self.best.kept.reference

    @property
    def separates(self) -> bool:
        """Whether each pair is expected to be told apart even where the prediction is off by its factor."""
        return self.best.worst >= ENOUGH * TRUST

    def columns(self) -> dict[str, Array]:
        """The reference as a log has it: time and joint_position_reference_j."""
        reference = self.reference
        return {"time": reference.time} | {
            f"joint_position_reference_{j + 1}": np.ascontiguousarray(x) for j, x in enumerate(reference.position.T)
        }


def excite(
    arm: Arm,
    separate: Sequence[str] = (),
    joint: int = 1,
    duration: float = 10.0,
    period: float = 1e-3,
    limits: Mapping[str, tuple[float, ...]] | None = None,
    say: Callable[[str], None] = lambda stage: None,
) -> Excitation:
    """The safe motion of ``arm`` (built with all effects) that separates ``separate`` best: names of effects of
    ``joint``, or name@joint; none: every pair of the joint's effects. ``limits`` as `safe_motion.limits_of` takes
    them. Raises PlantError for what does not exist and where no motion that is seen keeps the limits."""
    effects = _effects(arm, separate, joint, duration, period)
    bounds = limits_of(arm, limits)
    center = middle(arm, bounds)
    others = [with_size(arm, _typical(arm, name)) for name in effects] if separate else []
    places = [int(name.rpartition("@")[2]) for name in effects]
    joints = sorted({place - 1 for place in places if place}) or list(range(arm.n))
    shapes = motions(arm, places[0], duration, period)
    if resting(arm, bounds, shapes, center, period)[joints].all():
        raise PlantError(_too_narrow(arm, bounds, shapes, center, period, joints, []))
    tried = []
    for motion in shapes:
        say(motion.name)
        kept = keep(arm, others, bounds, motion, center, period)
        if isinstance(kept, Kept) and max(most := moved(arm, kept.simulation)[joints]) < SEEN:
            kept = f"moves joint {joints[int(np.argmax(most))] + 1} by less than {SEEN} steps of its encoder"
        if isinstance(kept, Kept):
            tried.append(Tried(motion.name, kept, separation(arm, effects, kept)))
        else:
            tried.append(Tried(motion.name, None, {}, kept))
    tried.sort(key=lambda t: (-t.merit, -t.worst))
    if tried[0].kept is None:
        raise PlantError(_too_narrow(arm, bounds, shapes, center, period, joints, tried))
    return Excitation(effects, tuple(tried), bounds)


def _effects(arm: Arm, separate: Sequence[str], joint: int, duration: float, period: float) -> tuple[str, ...]:
    """The effects to separate as name@joint. Raises PlantError with every problem."""
    problems = []
    for name, value, (low, high) in (("duration", duration, DURATION), ("period", period, PERIOD)):
        if not is_number(value) or not low <= value <= high:
            problems.append(f"the {name} is {value:g} s; possible is {low:g} to {high:g} s.")
    if not problems and duration / period > MOST_ROWS:
        problems.append(
            f"the motion has {duration / period:.0f} rows; possible are {MOST_ROWS}: make it shorter, or coarser."
        )
    if not 1 <= joint <= arm.n:
        problems.append(f"--joint {joint}: the robot has joints 1 to {arm.n}.")
        raise PlantError("\n".join(problems))
    there = [atom.name for atom in dictionary(arm, Suggested({}, {}, {})).atoms]
    here = sorted({name for name in there if name.endswith((f"@{joint}", "@0"))})
    found = []
    for name in separate:
        options = [name] if "@" in name else [f"{name}@{joint}", f"{name}@0"]
        known = [option for option in options if option in there]
        if not known:
            problems.append(
                f"--separate {name}: joint {joint} has no such effect{meant(options[0], there)}; there are "
                f"{', '.join(here)}, and name@joint means that of another joint."
            )
        found += known[:1]
    if len(set(found)) < len(found):
        problems.append(f"--separate {','.join(separate)}: names the same effect twice; name two that differ.")
    elif len(separate) == 1 and found:
        problems.append(f"--separate {separate[0]}: one effect alone; name two or more, or none for every pair.")
    if problems:
        raise PlantError("\n".join(problems))
    return tuple(found) if separate else tuple(here)


def _typical(arm: Arm, name: str) -> dict[str, float]:
    """The parameters of an effect at its typical size: of several amplitudes the first."""
    words = dictionary(arm, Suggested({}, {}, {}))
    k = next(k for k, atom in enumerate(words.atoms) if atom.name == name)
    column = next(c for c in words.columns if c.atom == k)
    return {column.parameter: column.center + _whole(arm, column) * column.unit}


def _whole(arm: Arm, column: Column) -> float:
    """The size at which an effect is looked at: the usual one, of the sign and as large as its bounds let it."""
    q = arm.parameters.described[column.parameter]
    up, down = (q.high - column.center) / column.unit, (column.center - q.low) / column.unit
    return 1.0 if up >= 1.0 or up >= down else -min(1.0, down)


# -- too little to be seen --------------------------------------------------------------------------------------------


def moved(arm: Arm, run: Simulation) -> Array:
    """By how many steps of its finer encoder each joint (n) moves in a run."""
    return seen(arm, run.state[:, [arm.index(f"joint_position_{j}") for j in range(1, arm.n + 1)]])


def resting(arm: Arm, limits: Limits, shapes: Sequence[Motion], center: Array, period: float) -> Mask:
    """The joints (n) that no motion within the limits moves visibly, told without a run: range, speed, torque and
    inertia draw each one too small, or dry friction holds the motor against all the current and gravity there are."""
    largest = np.max([seen(arm, drawn(arm, limits, m, center, period, 1.0).position) for m in shapes], axis=0)
    dry, ratio = (
        np.array([arm.parameters[f"{name}_{j}"] for j in range(1, arm.n + 1)]) for name in ("coulomb_friction", "ratio")
    )
    pull = np.abs(arm.evaluate("gravity_torque", q=center)["g"].ravel() / ratio)
    held = MARGIN * torque_per_input(arm) * limits.current + pull < dry
    return np.asarray((largest < SEEN) | held)


def least(
    arm: Arm, limits: Limits, shapes: Sequence[Motion], center: Array, period: float, joints: Sequence[int]
) -> dict[str, float]:
    """Shares of the limits, by name, that it takes to move one of ``joints`` (from 0) visibly: the gentlest motions are
    run within the robot file's limits alone, each ever twice as large, as dry friction holds small ones."""
    file, found = limits_of(arm), []
    for motion in sorted(shapes, key=lambda m: np.abs(np.diff(m.shape, axis=0)).max() / np.ptp(m.shape))[:GENTLE]:
        wave = SEEN * motion.shape / max(seen(arm, motion.shape)[joints])
        for k in range(DOUBLED):
            v = np.gradient(2**k * wave, period, axis=0)
            reference = Reference("joint", period, center + 2**k * wave, v, np.gradient(v, period, axis=0))
            run, _ = follow(arm, arm, reference, file)
            if run is not None and max(moved(arm, run)[joints]) >= SEEN:
                found.append(shares(arm, limits, run, run.torque / torque_per_input(arm)))
                break
    return min(found, key=lambda one: max(one.values()), default={})


def _too_narrow(
    arm: Arm,
    limits: Limits,
    shapes: Sequence[Motion],
    center: Array,
    period: float,
    joints: Sequence[int],
    tried: Sequence[Tried],
) -> str:
    """That the limits admit no motion: which of them, and what of it the least motion that is seen takes."""
    takes = []
    for name, share in least(arm, limits, shapes, center, period, joints).items():
        kind, _, number = name.rpartition("_")
        if not MARGIN < share < np.inf:
            continue
        if kind == "tip":
            (low, high), unit = limits.tip["xy".index(number)], "m"
        else:
            j, most = int(number) - 1, {"speed": limits.speed, "torque": limits.torque, "current": limits.current}
            low, high = limits.position[j] if kind == "position" else (0.0, most[kind][j])
            unit = units(arm, j)[kind]
        wide = "a range of " if kind in ("tip", "position") else ""
        takes.append(f"{wide}{name} of at least {(high - low) * share / MARGIN:.2g} {unit} ({high - low:.2g} is given)")
    whys = "; ".join(f"{t.name}: {t.why}" for t in tried[:3])
    if not takes:
        return f"the limits admit no motion ({whys}); widen them, or move elsewhere."
    return (
        f"the limits admit no motion: one that moves joint {' or '.join(str(j + 1) for j in joints)} by {SEEN} steps "
        f"of its encoder takes {' and '.join(takes)}; widen the limits."
    )


# -- prediction -------------------------------------------------------------------------------------------------------


def modelled(arm: Arm, log: Log, effects: Sequence[str], states: Array | None = None) -> Design:
    """The linear model of ``log`` about the nominal arm. ``effects`` have columns of their typical size and are free or
    absent, not within a tolerance, which would bound what can be told; windows begin at ``states`` (T, nx), by default
    as measured."""
    seen = record(arm, Portion.whole(log), max(WINDOW, FEWEST * log.period))
    shooting = Shooting(arm, seen)
    words = dictionary(arm, Suggested(suggested(arm, seen).shapes, {}, {}))
    chosen = {k for k, atom in enumerate(words.atoms) if atom.name in effects}
    columns = tuple(
        replace(c, step=_whole(arm, c), spike=c.spike if c.base else SILENT) if c.atom in chosen else c
        for c in words.columns
        if c.atom in chosen or c.atom < 0 or words.atoms[c.atom].first
    )
    p, begun = shooting.begin()
    if states is not None:
        begun = states[seen.starts, : shooting.m].copy()
    return design(shooting, Dictionary(words.atoms, columns), Point(p, begun))


def separation(arm: Arm, effects: Sequence[str], kept: Kept) -> dict[Pair, float]:
    """Expected log evidence, nats, by which the motion separates each pair of ``effects``; of more than two without
    those that no channel of the log shows."""
    at = modelled(arm, kept.simulation.log, effects, kept.simulation.state)
    linear, random = at.linear(1.0), np.random.default_rng(0)
    energy = np.diagonal(linear.gram.products, axis1=1, axis2=2).sum(0)[linear.m + linear.k :]
    shown = {
        at.words.atoms[c.atom].name for c, e in zip(at.words.columns, energy, strict=True) if c.atom >= 0 and e > 0
    }
    count = DRAWS if len(effects) == 2 else 1
    logs = [_sizes(at.words, effects, true, random) for true in effects for _ in range(count)]
    found = together(lambda theta: weighed(_with(linear, theta), at.words, effects), logs)
    evidence = {
        true: {name: float(np.mean([one[name] for one in found[k * count : (k + 1) * count]])) for name in effects}
        for k, true in enumerate(effects)
    }
    return {
        (a, b): min(evidence[a][a] - evidence[a][b], evidence[b][b] - evidence[b][a])
        for a, b in itertools.combinations(effects, 2)
        if len(effects) == 2 or {a, b} <= shown
    }


def weighed(linear: Linear, words: Dictionary, effects: Sequence[str]) -> dict[str, float]:
    """Log evidence of each of ``effects`` in a linear model, the best of its atoms."""
    atoms = [k for k, atom in enumerate(words.atoms) if atom.name in effects]
    best: dict[str, float] = {}
    for one in score(posteriors(linear, words.spike), words, [(k,) for k in atoms]):
        best.setdefault(words.atoms[one.atoms[0]].name, one.evidence)
    return best


def _sizes(words: Dictionary, effects: Sequence[str], true: str, random: np.random.Generator) -> Array:
    """θ of a machine that has the effect ``true`` and everything else within its tolerance."""
    theta = random.normal(size=len(words.columns)) * words.spike
    atom = next(k for k, atom in enumerate(words.atoms) if atom.name == true)
    own = words.free((atom,))
    size = random.normal(size=len(own)) if len(own) > 1 else np.ones(1)
    meant = [k for k, atom in enumerate(words.atoms) if atom.name in effects]
    theta[words.free(tuple(meant))] = 0.0
    theta[own] = np.sign(words.columns[own[0]].step) * size / np.linalg.norm(size)
    return theta


def _with(linear: Linear, theta: Array) -> Linear:
    """The linear model of a log of a machine with θ: its products follow from those of the columns."""
    gram = linear.gram
    moved = np.concatenate([np.zeros(gram.m + gram.k), theta])
    added = gram.products @ moved
    return replace(linear, z=linear.z + added, r2=linear.r2 + (2 * linear.z + added) @ moved)
