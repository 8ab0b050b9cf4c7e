"""Whether a drive that the robot file calls rigid has a spring: the same record on a model that has one.

Such a model has other states, so it is no candidate among those of the rigid one. It is fitted by itself, with every
spring free, and what else it misses beside them, from what the rigid one was found to miss; evidence tells which of the
two models it is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from hdagen.diagnosis.candidates import Dictionary, dictionary
from hdagen.diagnosis.design import Design, Point, design
from hdagen.diagnosis.fitting import Fitted, begun
from hdagen.diagnosis.portion import Portion
from hdagen.diagnosis.record import Record, record
from hdagen.diagnosis.search import TRAILING, Search, bared, best_first, leaves_much, raced
from hdagen.diagnosis.shooting import Shooting
from hdagen.diagnosis.starts import suggested
from hdagen.plant import Arm, Array, load

EFFECT = "missing_compliance"
SIZES = (1.0, 4.0)  # usual sizes at which it is begun
STEP = 2.5e-4  # s: springs may get ten times as stiff as usual on the way; what this does not carry is as good as rigid


def with_springs(
    robot: str | Path, arm: Arm, seen: Record, window: float, found: Search, say: Callable[[str], None]
) -> Search:
    """``found`` in ``seen`` on ``arm``, and what a model with springs in its rigid joints finds there. Raises
    PlantError."""
    if len(arm.manifest["flexible"]) == arm.n:
        return found
    flexible = load(robot, "native", ("all", EFFECT))
    _tell_rigid(flexible, say)
    if len(flexible.manifest["flexible"]) == len(arm.manifest["flexible"]):
        return found  # no rotor that could turn by itself
    _narrowed(flexible)
    say("a spring in what the robot file calls rigid")
    shooting = Shooting(flexible, record(flexible, Portion(seen.log, seen.shown), window), STEP)
    words = dictionary(flexible, suggested(flexible, shooting.record), shooting.record.uncommanded).sharing(
        found.words.share
    )
    at, field = _begun(shooting, words, found)
    lead = best_first(found.fitted)[0]
    least = (
        -np.inf if leaves_much(lead, found.fitted) else lead.reached
    )  # what leaves little and gains nothing by springs
    fits = raced(at, words, field, say, least)
    return replace(found, fitted=tuple(bared(best_first([*found.fitted, *fits]))))


def _begun(shooting: Shooting, words: Dictionary, found: Search) -> tuple[Design, list[Fitted]]:
    """Where a race of springs begins: their design, and the field, at each size the springs alone and, where
    these promise less than what was ``found`` without has reached, beside that; then alone only if they promise a
    share of what that gains."""
    springs = tuple(k for k, atom in enumerate(words.atoms) if atom.effect == EFFECT and atom.first)
    lead, near = best_first(found.fitted)[0], found.fitted[0].score.at.s
    none = next((fit for fit in found.fitted if not fit.atoms), lead)
    beside = tuple(k for k, atom in enumerate(words.atoms) if atom.name in lead.names and atom.first)
    alone: list[Fitted] = []
    for size in SIZES:
        p = _stiffened(shooting.arm, words, springs, shooting.arm.p.copy(), size)
        at = design(shooting, words, Point(p, shooting.begun(p)))
        alone.append(begun(at, words, springs, near))
    if not beside or max(fit.score.evidence for fit in alone) >= lead.reached:
        return at, alone
    least = none.reached + TRAILING * (lead.reached - none.reached)
    field = [fit for fit in alone if fit.score.evidence >= least]
    for size in SIZES:
        p = _stiffened(shooting.arm, words, springs, _carried_over(shooting.arm, lead), size)
        field.append(begun(at, words, (*springs, *beside), near, Point(p, shooting.begun(p))))
    return at, field


def _stiffened(flexible: Arm, words: Dictionary, springs: tuple[int, ...], p: Array, size: float) -> Array:
    """Parameters (np) with springs at a size, within their bounds."""
    for c in words.columns:
        if c.atom in springs:
            p[c.index] = c.center + size * c.unit
    return flexible.parameters.within(p)


def _carried_over(flexible: Arm, lead: Fitted) -> Array:
    """The parameters (np) of a model with springs as they are where a fit without stands."""
    stood = dict(zip(lead.design.shooting.arm.parameters.described, lead.design.point.p, strict=True))
    return np.array([stood.get(name, q.nominal) for name, q in flexible.parameters.described.items()])


def _tell_rigid(flexible: Arm, say: Callable[[str], None]) -> None:
    """Which joints with a rotor have no spring even here, and the number because of which."""
    for j in range(1, flexible.n + 1):
        inertia = flexible.parameters[f"motor_inertia_{j}"]
        if j not in flexible.manifest["flexible"] and inertia:
            step = f"a step of {flexible.step_size:g} s carries no spring beside motor_inertia = {inertia:g} kg m²"
            say(f"joint {j} stays rigid: {step}")


def _narrowed(flexible: Arm) -> None:
    """Bounds of the springs and of their damping so narrow that the step carries them."""
    described = flexible.parameters.described
    names = list(described)
    for place, (least, most) in flexible.carried.springs(STEP).items():
        q = described[names[place]]
        low, high = min(max(q.low, least), q.nominal), max(min(q.high, most), q.nominal)
        described[names[place]] = replace(q, low=low, high=high)
