"""What a verdict leaves within tolerance is listed with what it is worth; where it is worth nothing, nothing is."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from compiled import Compiled
from replayed import FLEXIBLE, simulated

from hdagen import verdict
from hdagen.diagnosis.candidates import Dictionary, dictionary
from hdagen.diagnosis.gap import gap
from hdagen.diagnosis.portion import Portion
from hdagen.diagnosis.starts import Suggested
from hdagen.diagnosis.tolerated import WORTH, tolerated
from hdagen.plant import Arm
from hdagen.replay import Replay, replay

Builder = Callable[..., Compiled]
EFFECTS = ("cable_spring", "current_bias")
SIZE = 0.1  # usual sizes of what is there
NOTHING = {"schema": verdict.SCHEMA, "verdict": [], "causes": [], "parameters": {}}


def stands(arm: Arm, words: Dictionary, size: float, std: float, atoms: tuple[int, ...] = ()) -> Any:
    """A fit that has both joints' cables at ``size``, told to ``std``."""
    mean, p = np.zeros(len(words.columns)), arm.p.copy()
    for k, c in enumerate(words.columns):
        if c.parameter.startswith("cable_stiffness"):
            mean[k], p[c.index] = size, c.center + size * c.unit
    design = SimpleNamespace(words=words, point=SimpleNamespace(p=p), shooting=SimpleNamespace(arm=arm))
    names = tuple(words.atoms[k].name for k in atoms)
    return SimpleNamespace(design=design, posterior=(mean, std**2 * np.eye(len(mean))), atoms=atoms, names=names)


def test_what_is_tolerated_is_listed_by_what_it_closes(build: Builder) -> None:
    arm = Arm(build(FLEXIBLE, effects=EFFECTS).folder)
    words = dictionary(arm, Suggested({}, {}, {})).focused(())
    usual = arm.parameters.described["cable_stiffness_1"].typical
    assert usual
    arm.parameters["cable_stiffness_1"] = SIZE * usual
    log = simulated(arm)
    arm.parameters.reset()
    held, before, said = Portion(log, np.ones(len(log), bool)), replay(arm, log), verdict.read(NOTHING)

    def seen(changed: Arm) -> Replay:
        return replay(changed, log)

    def found(fit: Any) -> list[dict[str, Any]]:
        return tolerated(fit, said, before, before, held, seen)

    (one,) = found(stands(arm, words, SIZE, 0.01))  # the other joint's, which is not there, closes nothing
    assert (one["effect"], one["joint"], one["size"]) == ("cable_spring", 1, pytest.approx(SIZE))
    stiffness = one["parameters"]["cable_stiffness_1"]
    assert stiffness == {"value": SIZE * usual, "std": pytest.approx(0.01 * usual), "unit": "N m/rad"}
    assert one["gap"] < (1 - WORTH) * gap(before, before, held)["after"] and one["gap"] < 1.2
    assert arm.parameters["cable_stiffness_1"] == 0.0  # the arm is as it was
    assert not found(stands(arm, words, SIZE, 0.05))  # not told
    assert not found(stands(arm, words, 0.0, 0.01))
    named = next(k for k, atom in enumerate(words.atoms) if atom.name == "cable_spring@1" and atom.first)
    assert not found(stands(arm, words, SIZE, 0.01, (named,)))  # the verdict has it
