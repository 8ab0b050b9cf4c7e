"""Each hypothesis is held against motion that no fit saw, with its own parameters; who replaces whom in a verdict."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from compiled import Compiled
from replayed import FLEXIBLE, SEVERAL, simulated

from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.data.held_out_gap import evaluate_gap
from hdagen.diagnosis.data.split import LogPortion
from hdagen.diagnosis.decision.decision_settings import DECISION
from hdagen.diagnosis.decision.posterior import Hypothesis
from hdagen.diagnosis.decision.verdict_content import _compute_alternative_probability
from hdagen.diagnosis.holdout.holdout_check_settings import HOLDOUT_CHECK
from hdagen.diagnosis.holdout.hypothesis_ranking import rank_hypotheses
from hdagen.diagnosis.inference.candidate_priors import CandidateSet
from hdagen.diagnosis.initialization.candidate_list import build_candidates
from hdagen.diagnosis.initialization.initial_guess import InitialGuess
from hdagen.prediction.window_replay import Replay, replay

Builder = Callable[..., Compiled]
TRUTH = {"cable_stiffness_1": 1.5, "bias_2": 0.01}


def stands(arm: Arm, words: CandidateSet, names: tuple[str, ...], values: dict[str, float]) -> Any:
    """A fit of ``names`` that stands at ``values``."""
    p = arm.p.copy()
    for name, value in values.items():
        p[list(arm.parameters.described).index(name)] = value
    atoms = tuple(
        next(k for k, a in enumerate(words.members) if a.name == name and a.has_default_shapes) for name in names
    )
    design = SimpleNamespace(candidates=words, point=SimpleNamespace(p=p), shooting=SimpleNamespace(arm=arm))
    posterior = np.zeros(len(words.columns)), np.eye(len(words.columns))
    return SimpleNamespace(sensitivities=design, posterior=posterior, effects=atoms, names=names)


def test_each_rung_is_a_hypothesis_with_its_own_parameters(build: Builder) -> None:
    arm = Arm(build(FLEXIBLE, effects=SEVERAL).folder)
    words = build_candidates(arm, InitialGuess({}, {}, {})).columns_for(())
    arm.parameters.update(TRUTH)
    log = simulated(arm)
    whole = replay(arm, log)
    arm.parameters.reset()
    held, before = LogPortion(log, np.ones(len(log), bool)), replay(arm, log)
    cable, bias = ("cable_spring@1",), ("current_bias@2",)
    both = cable + bias
    mass = arm.parameters["mass_1"]
    hypotheses = [
        Hypothesis(both, 0.9, stands(arm, words, both, TRUTH)),
        Hypothesis(("unknown@1",), 0.05, None),
        Hypothesis(cable, 0.03, stands(arm, words, cable, {"cable_stiffness_1": 1.5})),
        Hypothesis((), 0.02, stands(arm, words, (), {"mass_1": 2.0 * mass})),
        *(
            Hypothesis(bias, 0.0, stands(arm, words, bias, {"bias_2": 0.01}))
            for _ in range(HOLDOUT_CHECK.most_ranked_hypotheses)
        ),
    ]
    decision: Any = SimpleNamespace(hypotheses=hypotheses, verdict=both, probability=0.9)
    bases: list[float] = []

    def seen(changed: Arm) -> Replay:
        bases.append(changed.parameters["mass_1"])
        return replay(changed, log)

    found = rank_hypotheses(decision, list(both), before, whole, held, seen)
    by = {(one["model"], tuple(one["effects"])): one for one in found}
    assert [one["gap"] for one in found] == sorted((one["gap"] for one in found), reverse=True)
    assert len(found) == 3 + HOLDOUT_CHECK.most_ranked_hypotheses and ("hypothesis", ("unknown@1",)) not in by
    exact = evaluate_gap(before, whole, held)
    assert by["robot file", ()]["gap"] == pytest.approx(exact["before"]) and by["robot file", ()]["probability"] is None
    assert by["verdict", both]["gap"] == pytest.approx(exact["after"]) and by["verdict", both]["probability"] == 0.9
    assert by["verdict", both]["gap"] < by["hypothesis", cable]["gap"] < by["robot file", ()]["gap"]
    reach = mass * (1 + 3 * arm.parameters.described["mass_1"].tolerance)
    assert max(bases) == pytest.approx(reach)  # a base parameter goes no further than three tolerances
    assert all(one["interval"][0] <= one["gap"] <= one["interval"][1] for one in found)
    assert arm.parameters["mass_1"] == mass  # the arm is as it was


def test_a_verdict_that_was_withdrawn_stays_as_a_hypothesis(build: Builder) -> None:
    arm = Arm(build(FLEXIBLE, effects=SEVERAL).folder)
    words, log = build_candidates(arm, InitialGuess({}, {}, {})).columns_for(()), simulated(arm)
    held, before, name = LogPortion(log, np.ones(len(log), bool)), replay(arm, log), ("current_bias@2",)
    hypotheses = [Hypothesis(name, 0.9, stands(arm, words, name, {"bias_2": 0.01}))]
    decision: Any = SimpleNamespace(hypotheses=hypotheses, verdict=name, probability=0.9)
    found = rank_hypotheses(decision, [], before, before, held, lambda changed: replay(changed, log))
    said = {one["model"]: (one["effects"], one["probability"]) for one in found}
    assert said == {"robot file": ([], None), "verdict": ([], None), "hypothesis": (["current_bias@2"], 0.9)}


@pytest.mark.parametrize(
    ("name", "other", "instead"),
    [
        ("kinematic_error@1", "coulomb_friction@2", False),  # that stands for the other one of the verdict
        ("torque_constant@2", "coulomb_friction@2", True),
        ("kinematic_error@1", "backlash@1", True),
        ("torque_constant@2", "backlash@1", False),
        ("kinematic_error@1", "payload@2", True),  # beside the whole verdict: it may be there, too
        ("coulomb_friction@2", "kinematic_error@1", True),  # of what is not in the verdict everything likely counts
    ],
)
def test_only_what_may_be_there_in_its_place_is_confounded_with_an_effect(name: str, other: str, instead: bool) -> None:
    verdict = ("kinematic_error@1", "torque_constant@2")
    sets = {
        verdict: 0.8,
        ("coulomb_friction@2", "kinematic_error@1"): 0.1,
        ("backlash@1", "torque_constant@2"): 0.06,
        (*verdict, "payload@2"): 0.04,
    }
    hypotheses = [Hypothesis(n, p, None) for n, p in sets.items()]
    decision: Any = SimpleNamespace(verdict=verdict, hypotheses=hypotheses, direct_evidence={})
    assert (_compute_alternative_probability(decision, name, other) > DECISION.least_mentioned_probability) is instead
    decision.direct_evidence = {name: {}}  # read off, and surely there
    assert _compute_alternative_probability(decision, name, other) == 0.0
