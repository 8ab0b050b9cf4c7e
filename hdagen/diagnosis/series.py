"""Whether a drive that the robot file calls rigid has a spring: the same record on a model that has one.

Such a model has other states, so it is no candidate among those of the rigid one. It is fitted by itself, with every
spring free, and what else it misses beside them; evidence tells which of the two models it is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from hdagen.diagnosis.candidates import dictionary
from hdagen.diagnosis.design import Point, design
from hdagen.diagnosis.fitting import Fitted, begun
from hdagen.diagnosis.portion import Portion
from hdagen.diagnosis.record import Record, record
from hdagen.diagnosis.search import Search, bared, best_first, raced
from hdagen.diagnosis.shooting import Shooting
from hdagen.diagnosis.starts import suggested
from hdagen.plant import Arm, load

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
    atoms = tuple(k for k, atom in enumerate(words.atoms) if atom.effect == EFFECT and atom.first)
    own = [c for c in words.columns if c.atom in atoms]
    field: list[Fitted] = []
    for size in SIZES:
        p = flexible.p.copy()
        for c in own:
            p[c.index] = c.center + size * c.unit
        p = flexible.parameters.within(p)
        at = design(shooting, words, Point(p, shooting.begun(p)))
        field.append(begun(at, words, atoms, found.fitted[0].score.at.s))
    fits = raced(at, words, field, say)
    return replace(found, fitted=tuple(bared(best_first([*found.fitted, *fits]))))


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
