"""Whether a drive that the robot file calls rigid has a spring: the same record on a model with springs.

Such a model has other states, so it cannot be a candidate among those of the rigid model. It is fitted by itself with
every spring free, then with further effects taken from the rigid model's result. The evidence chooses between the two
models.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm, load
from hdagen.diagnosis.data.split import Portion
from hdagen.diagnosis.data.windows import Record, record
from hdagen.diagnosis.inference.candidate_priors import Dictionary
from hdagen.diagnosis.inference.local_fit import Fitted, begun
from hdagen.diagnosis.inference.multiple_shooting import Shooting
from hdagen.diagnosis.inference.sensitivities import Design, Point, design
from hdagen.diagnosis.initialization.candidate_list import dictionary
from hdagen.diagnosis.initialization.initial_guess import suggested
from hdagen.diagnosis.search.fit_order import bared, best_first, leaves_much
from hdagen.diagnosis.search.hypothesis_search import TRAILING, Search, raced

EFFECT = "missing_compliance"
SIZES = (1.0, 4.0)  # typical sizes at which a fit with springs starts
STEP = 2.5e-4  # s, stable for springs ten times as stiff as typical ones; a stiffer spring is as good as rigid


def with_springs(
    robot: str | Path, arm: Arm, seen: Record, window: float, found: Search, say: Callable[[str], None]
) -> Search:
    """Compare the search's result with a model that has springs in its rigid joints.

    Args:
        robot: a preset or a robot.toml.
        arm: the compiled model.
        seen: the record.
        window: length of a window, s.
        found: the result of the search.
        say: receives a sentence as each stage begins.

    Returns:
        ``found`` with the fits of the model with springs.

    Raises:
        PlantError: the model cannot be loaded.

    """
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
    least = -np.inf
    if not leaves_much(lead, found.fitted):  # a good fit must gain by springs before anything is tried beside them
        least = lead.reached
    fits = raced(at, words, field, say, least)
    return replace(found, fitted=tuple(bared(best_first([*found.fitted, *fits]))))


def _begun(shooting: Shooting, words: Dictionary, found: Search) -> tuple[Design, list[Fitted]]:
    """Start the fits with springs: the springs alone at each size, and beside the effects found, where the springs
    alone promise less than these have reached. Then the springs alone stay only if they promise a share of that
    gain."""
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
    """Return the parameters (np) with springs at a size, within their bounds."""
    for c in words.columns:
        if c.atom in springs:
            p[c.index] = c.center + size * c.unit
    return flexible.parameters.within(p)


def _carried_over(flexible: Arm, lead: Fitted) -> Array:
    """Return the parameters (np) of a model with springs at the point of a fit without."""
    stood = dict(zip(lead.design.shooting.arm.parameters.described, lead.design.point.p, strict=True))
    return np.array([stood.get(name, q.nominal) for name, q in flexible.parameters.described.items()])


def _tell_rigid(flexible: Arm, say: Callable[[str], None]) -> None:
    """Say which joints with a rotor stay rigid even here, and the number that prevents a spring."""
    for j in range(1, flexible.n + 1):
        inertia = flexible.parameters[f"motor_inertia_{j}"]
        if j not in flexible.manifest["flexible"] and inertia:
            step = f"a step of {flexible.step_size:g} s carries no spring beside motor_inertia = {inertia:g} kg m²"
            say(f"joint {j} stays rigid: {step}")


def _narrowed(flexible: Arm) -> None:
    """Limit the springs and their damping to values that the step integrates stably."""
    described = flexible.parameters.described
    names = list(described)
    for place, (least, most) in flexible.carried.springs(STEP).items():
        q = described[names[place]]
        low, high = min(max(q.low, least), q.nominal), max(min(q.high, most), q.nominal)
        described[names[place]] = replace(q, low=low, high=high)
