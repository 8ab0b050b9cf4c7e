"""What a verdict leaves within tolerance is listed with what it is worth; where it is worth nothing, nothing is. What a
base leans goes along."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from compiled import Compiled
from replayed import FLEXIBLE, SEVERAL, simulated

from hdagen.adoption import verdict
from hdagen.adoption.diagnosis_schema import SCHEMA
from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.data.held_out_gap import evaluate_gap
from hdagen.diagnosis.data.split import LogPortion
from hdagen.diagnosis.decision.parameter_estimates import estimate_parameters
from hdagen.diagnosis.decision.verdict_content import build_hypothetical_verdict
from hdagen.diagnosis.holdout.holdout_check_settings import HOLDOUT_CHECK
from hdagen.diagnosis.holdout.nuisance_effects import rank_nuisance_effects
from hdagen.diagnosis.inference.candidate_priors import CandidateSet
from hdagen.diagnosis.initialization.candidate_list import build_candidates
from hdagen.diagnosis.initialization.initial_guess import InitialGuess
from hdagen.prediction.window_replay import Replay, replay

Builder = Callable[..., Compiled]
SIZE = 0.1  # usual sizes of what is there
NOTHING = {"schema": SCHEMA, "verdict": [], "causes": [], "parameters": {}}


def stands(arm: Arm, words: CandidateSet, size: float, std: float, atoms: tuple[int, ...] = ()) -> Any:
    """A fit that has both joints' cables and the base's lean at ``size``, told to ``std``."""
    mean, p = np.zeros(len(words.columns)), arm.p.copy()
    for k, c in enumerate(words.columns):
        if c.parameter.startswith(("cable_stiffness", "tilt_")):
            mean[k], p[c.index] = size, c.center + size * c.unit
    design = SimpleNamespace(candidates=words, point=SimpleNamespace(p=p), shooting=SimpleNamespace(arm=arm))
    names = tuple(words.members[k].name for k in atoms)
    return SimpleNamespace(
        sensitivities=design, posterior=(mean, std**2 * np.eye(len(mean))), effects=atoms, names=names
    )


def test_what_is_tolerated_is_listed_by_what_it_closes(build: Builder) -> None:
    arm = Arm(build(FLEXIBLE, effects=SEVERAL).folder)
    words = build_candidates(arm, InitialGuess({}, {}, {})).columns_for(())
    usual = arm.parameters.described["cable_stiffness_1"].typical
    assert usual
    arm.parameters["cable_stiffness_1"] = SIZE * usual
    log = simulated(arm)
    arm.parameters.reset()
    held, before, said = LogPortion(log, np.ones(len(log), bool)), replay(arm, log), verdict.read_verdict(NOTHING)

    def seen(changed: Arm) -> Replay:
        return replay(changed, log)

    def found(fit: Any) -> list[dict[str, Any]]:
        return rank_nuisance_effects(fit, said, before, before, held, seen)

    (one,) = found(stands(arm, words, SIZE, 0.01))  # the other joint's, which is not there, closes nothing
    assert (one["effect"], one["joint"], one["size"]) == ("cable_spring", 1, pytest.approx(SIZE))
    stiffness = one["parameters"]["cable_stiffness_1"]
    told = {"value": SIZE * usual, "std": pytest.approx(0.01 * usual), "unit": "N m/rad", "end": None}
    assert stiffness.items() >= told.items() and stiffness["file"] is None
    assert (
        one["gap"] < (1 - HOLDOUT_CHECK.least_listed_gain) * evaluate_gap(before, before, held)["after"]
        and one["gap"] < 1.2
    )
    assert arm.parameters["cable_stiffness_1"] == 0.0  # the arm is as it was
    assert not found(stands(arm, words, SIZE, 0.05))  # not told
    assert not found(stands(arm, words, 0.0, 0.01))
    named = next(k for k, atom in enumerate(words.members) if atom.name == "cable_spring@1" and atom.has_default_shapes)
    assert not found(stands(arm, words, SIZE, 0.01, (named,)))  # the verdict has it


def test_what_was_moved_to_an_end_of_its_range_is_told(build: Builder) -> None:
    arm = Arm(build(FLEXIBLE, effects=SEVERAL).folder)
    words = build_candidates(arm, InitialGuess({}, {}, {})).columns_for(())
    (atom,) = (k for k, atom in enumerate(words.members) if atom.name == "cable_spring@1" and atom.has_default_shapes)
    spring = arm.parameters.described["cable_stiffness_1"]
    ends = {}
    for value in (spring.nominal, spring.low, 0.5 * spring.high, spring.high):
        fit = stands(arm, words, 0.0, 0.01, (atom,))
        fit.sensitivities.point.p[list(arm.parameters.described).index(spring.name)] = value
        ends[value] = estimate_parameters(fit, atom)[spring.name]["end"]
    assert spring.low == spring.nominal == 0.0  # no spring at all: nowhere to go, and nothing to say
    assert ends == {0.0: None, 0.5 * spring.high: None, spring.high: "high"}


@pytest.mark.parametrize(
    ("above", "below", "there"),
    [(30.0, 5.0, (30.0, 5.0)), (30.0, 1.9, (30.0, 0.0)), (0.5, 7.0, (0.0, 7.0)), (1.0, 1.5, (1.0, 1.5))],
)
def test_of_two_walls_the_one_that_the_log_does_not_tell_is_not_there(
    above: float, below: float, there: tuple[float, float], build: Builder
) -> None:
    """In standard deviations; where it tells neither, the wall that is named is either."""
    arm = Arm(build(FLEXIBLE, effects=("contact", "gravity_tilt")).folder)
    words = build_candidates(arm, InitialGuess({}, {}, {})).columns_for(())
    (atom,) = (k for k, atom in enumerate(words.members) if atom.name == "contact@1" and atom.has_default_shapes)
    std, places = 0.01, list(arm.parameters.described)
    fit, sizes = stands(arm, words, 0.0, std, (atom,)), {"above": above, "below": below}
    units = {}
    for k, c in enumerate(words.columns):
        if c.candidate == atom:
            side = c.parameter.split("_")[2]
            fit.posterior[0][k], units[side] = std * sizes[side], c.unit
            fit.sensitivities.point.p[places.index(c.parameter)] = std * sizes[side] * c.unit
    found = estimate_parameters(fit, atom)
    told = [found[f"contact_stiffness_{side}_1"]["value"] / (std * units[side]) for side in ("above", "below")]
    assert told == pytest.approx(there)
    assert found["contact_stiffness_above_1"]["std"] == pytest.approx(std * units["above"])


def test_what_a_base_leans_goes_with_any_verdict_that_does_not_name_it(build: Builder) -> None:
    arm = Arm(build(FLEXIBLE, effects=("contact", "gravity_tilt")).folder)
    words = build_candidates(arm, InitialGuess({}, {}, {})).columns_for(())
    usual = {axis: float(arm.parameters.described[f"tilt_{axis}"].typical or 0.0) for axis in "xy"}
    assert usual["x"] and usual["y"]
    arm.parameters.update({f"tilt_{axis}": SIZE * size for axis, size in usual.items()})
    log = simulated(arm)
    true = replay(arm, log).gap
    arm.parameters.reset()
    held, before = LogPortion(log, np.ones(len(log), bool)), replay(arm, log)
    fit = stands(arm, words, SIZE, 0.01)
    said = build_hypothetical_verdict(fit, ())
    assert said.base_parameters["gravity_x"] == pytest.approx(SIZE * usual["x"])
    assert said.base_parameters["gravity_y"] == pytest.approx(SIZE * usual["y"] - 9.81)
    after = replay(arm, log, with_=said)
    assert after.gap == pytest.approx(true) and true < before.gap / 5
    assert not rank_nuisance_effects(
        fit, said, before, before, held, lambda changed: replay(changed, log)
    )  # it is not listed, too
    place = list(arm.parameters.described).index("gravity_y")
    fit.sensitivities.point.p[place] = -9.9  # where the file has a tolerance for it
    assert build_hypothetical_verdict(fit, ()).base_parameters["gravity_y"] == pytest.approx(SIZE * usual["y"] - 9.9)
    named = next(k for k, atom in enumerate(words.members) if atom.effect == "gravity_tilt")
    assert not {"gravity_x", "gravity_y"} & set(
        build_hypothetical_verdict(stands(arm, words, SIZE, 0.01, (named,)), ()).base_parameters
    )
