"""A set of effects that tells unseen motion several times worse than another one does not lead."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from catalogue import EFFECTS

from hdagen.diagnosis.data.data_settings import DATA
from hdagen.diagnosis.decision.decision_settings import DECISION
from hdagen.diagnosis.decision.posterior import Decision, Hypothesis
from hdagen.diagnosis.holdout import leading_set
from hdagen.diagnosis.holdout.holdout_check_settings import HOLDOUT_CHECK
from hdagen.diagnosis.holdout.leading_set import lead_on_unseen_motion, lead_with_effects
from hdagen.diagnosis.inference.candidate_priors import Candidate, CandidateSet, Column

LEAD, OTHER, THIRD = ("torque_ripple@1",), ("coulomb_friction@1",), ("coulomb_friction@1", "viscous_friction@1")


MEMBERS = ("coulomb_friction@1", "viscous_friction@1", "position_dependent_friction@1", "torque_ripple@1", "mass@1")
STATED = MEMBERS[:2]  # keys of the robot file
NUMBERS = MEMBERS[:1] + MEMBERS[4:]  # whose size may be wrong by a factor


def make_fit(names: tuple[str, ...], deviation: float = 0.1) -> Any:
    """A fit of a set of effects, as far as it says which of them are frictions of the robot file. All sizes are 1, with
    a standard ``deviation``."""
    members, columns = [], []
    for k, name in enumerate(MEMBERS):
        effect, _, joint = name.partition("@")
        members.append(Candidate(EFFECTS[effect], int(joint), (effect,), {}, True, name in NUMBERS))
        columns.append(Column(effect, k, 0.0, 1.0, 0.1, k, name in STATED))
    candidates = CandidateSet(tuple(members), tuple(columns))
    effects = tuple(MEMBERS.index(name) for name in names)
    posterior = np.ones(len(MEMBERS)), (deviation**2 * np.eye(len(MEMBERS)))
    sensitivities = SimpleNamespace(candidates=candidates)
    return SimpleNamespace(effects=effects, names=names, sensitivities=sensitivities, posterior=posterior)


@pytest.fixture(autouse=True)
def _every_effect_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every effect of a fit is large enough to count as present."""
    monkeypatch.setattr(leading_set, "keep_present_effects", lambda fit: fit.names)


def decide(*, unknown: bool = False, deviation: float = 0.1) -> Decision:
    """A decision for the first of three sets that were fitted, beside one that was not."""
    fits: dict[tuple[str, ...], Any] = {names: make_fit(names, deviation) for names in (LEAD, OTHER, THIRD, ())}
    shares = {LEAD: 0.96, OTHER: 0.02, THIRD: 0.01, (): 0.005}
    found = [Hypothesis(names, share, fits[names]) for names, share in shares.items()]
    found.append(Hypothesis(("payload@1",), 0.005, None))
    verdict = ("unknown@1",) if unknown else LEAD
    return Decision(tuple(found), verdict, 0.96, 0.99, fits[LEAD])


def lead(gaps: dict[tuple[str, ...], float], decision: Decision | None = None) -> Decision:
    return lead_on_unseen_motion(decision or decide(), lambda one: make_gap(gaps[one.verdict]))


def make_gap(after: float) -> dict[str, Any]:
    """`gap` of diagnosis.json of one channel."""
    return {"after": after, "by_channel": {"joint_position_1": {"after": after}}}


def test_the_set_that_tells_unseen_motion_several_times_better_leads_and_is_not_sure() -> None:
    found = lead({LEAD: 926.0, OTHER: 80.0, THIRD: 74.0})
    assert found.verdict == THIRD
    assert found.hypotheses[0].names == THIRD and found.hypotheses[0].fit is found.best
    assert not found.is_sure and DECISION.sure_below < found.marginal_probability(LEAD[0]) < found.probability
    assert sum(h.probability for h in found.hypotheses) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("gaps", "why"),
    [
        ({LEAD: 926.0, OTHER: 926.0 / HOLDOUT_CHECK.leading_gap_ratio + 1.0, THIRD: 900.0}, "not several times"),
        ({LEAD: DATA.significant_noise_multiple, OTHER: 1.0, THIRD: 1.0}, "nothing is left that counts"),
    ],
)
def test_the_most_probable_set_leads_otherwise(gaps: dict[tuple[str, ...], float], why: str) -> None:
    decision = decide()
    assert lead(gaps, decision) is decision, why


def test_an_effect_that_makes_most_of_a_gap_leads_though_it_is_too_small_to_count() -> None:
    decision = replace(decide(), verdict=(), probability=0.005)
    found = lead({(): 21.5, LEAD: 4.0, OTHER: 20.0, THIRD: 20.0}, decision)
    assert found.verdict == LEAD and not found.is_sure
    assert lead({(): 21.5, LEAD: 8.0, OTHER: 20.0, THIRD: 20.0}, decision) is decision
    near_the_noise = 0.9 * DATA.significant_noise_multiple
    assert lead({(): near_the_noise, LEAD: 1.0, OTHER: 1.0, THIRD: 1.0}, decision) is decision


@pytest.mark.parametrize(("share", "leads"), [(1.05, False), (0.95, True)])
def test_an_effect_takes_the_place_of_none_only_where_the_log_determines_its_size(share: float, leads: bool) -> None:
    deviation = share / HOLDOUT_CHECK.clear_deviations
    gaps = {(): 21.5, LEAD: 4.0, OTHER: 20.0, THIRD: 20.0}
    decision = replace(decide(deviation=deviation), verdict=(), probability=0.005)
    assert (lead(gaps, decision).verdict == LEAD) is leads
    assert lead({LEAD: 926.0, OTHER: 80.0, THIRD: 74.0}, decide(deviation=deviation)).verdict == THIRD


def test_where_something_unknown_is_said_no_set_leads() -> None:
    decision = decide(unknown=True)
    assert lead({}, decision) is decision


ROBOT_FILE_SET, RARER_SET = ("coulomb_friction@1", "viscous_friction@1"), ("position_dependent_friction@1",)


def lead_frictions(first: tuple[str, ...], *, rarer: float, both: float, one: float) -> Decision:
    """The decision where ``first`` leads, by what three sets of frictions leave."""
    gaps = {RARER_SET: rarer, ROBOT_FILE_SET: both, ROBOT_FILE_SET[:1]: one}
    fits = {names: make_fit(names) for names in gaps}
    found = [Hypothesis(names, 0.98 if names == first else 0.01, fits[names]) for names in gaps]
    return lead(gaps, Decision(tuple(found), first, 0.98, 0.99, fits[first]))


def test_frictions_of_the_robot_file_lead_where_they_leave_less() -> None:
    found = lead_frictions(ROBOT_FILE_SET[:1], rarer=9.0, both=2.0, one=2.5)
    assert found.verdict == ROBOT_FILE_SET and not found.is_sure
    assert lead_frictions(RARER_SET, rarer=2.5, both=2.0, one=2.4).verdict == ROBOT_FILE_SET


def test_of_frictions_that_leave_alike_the_fewest_lead() -> None:
    assert lead_frictions(RARER_SET, rarer=2.5, both=2.0, one=2.05).verdict == ROBOT_FILE_SET[:1]


def test_a_rarer_friction_stays_where_it_tells_motion_down_to_the_noise() -> None:
    assert lead_frictions(RARER_SET, rarer=2.0, both=2.0, one=2.0).verdict == RARER_SET
    assert lead_frictions(RARER_SET, rarer=2.0, both=2.5, one=2.5).verdict == RARER_SET


def test_far_above_the_noise_a_rarer_friction_gives_way_where_it_tells_no_more() -> None:
    much = 3.0 * DATA.significant_noise_multiple
    assert lead_frictions(RARER_SET, rarer=much, both=1.1 * much, one=2.0 * much).verdict == ROBOT_FILE_SET
    assert lead_frictions(RARER_SET, rarer=much, both=2.0 * much, one=2.0 * much).verdict == RARER_SET


def test_frictions_too_small_to_count_do_not_lead(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(leading_set, "keep_present_effects", lambda fit: fit.names[:1])
    assert lead_frictions(ROBOT_FILE_SET[:1], rarer=9.0, both=2.0, one=2.5).verdict == ROBOT_FILE_SET[:1]


def test_a_set_with_the_leaders_frictions_takes_no_lead_from_it() -> None:
    """Both tell the motion down to the noise, and differ in what is no friction."""
    first, other = ROBOT_FILE_SET, (*ROBOT_FILE_SET, "torque_ripple@1")
    fits = {names: make_fit(names) for names in (first, other)}
    found = (Hypothesis(first, 0.9, fits[first]), Hypothesis(other, 0.05, fits[other]))
    assert lead({first: 5.0, other: 3.0}, Decision(found, first, 0.9, 0.95, fits[first])).verdict == first


NUMBER, EFFECT, PAIR = ("mass@1",), ("torque_ripple@1",), ("position_dependent_friction@1", "torque_ripple@1")


def lead_numbers(first: tuple[str, ...], gaps: dict[tuple[str, ...], float]) -> Decision:
    """The decision where ``first`` leads surely, by what it and other sets leave."""
    fits = {names: make_fit(names) for names in gaps}
    found = [Hypothesis(names, 0.98 if names == first else 0.0, fits[names]) for names in gaps]
    return lead(gaps, Decision(tuple(found), first, 0.98, 0.99, fits[first]))


@pytest.mark.parametrize("left", [67.0, 79.3])
def test_a_wrong_number_is_not_sure_beside_an_effect_that_leaves_no_more(left: float) -> None:
    """Or about as much, of many times the noise."""
    found = lead_numbers(NUMBER, {NUMBER: 70.8, EFFECT: left, PAIR: 60.0})
    assert found.verdict == NUMBER and found.best.names == NUMBER and not found.is_sure
    assert [(h.names, h.probability) for h in found.hypotheses] == [(NUMBER, 0.49), (EFFECT, 0.49), (PAIR, 0.0)]


@pytest.mark.parametrize(
    ("first", "gaps", "why"),
    [
        (NUMBER, {NUMBER: 2.1, EFFECT: 2.2}, "the effect leaves more"),
        (NUMBER, {NUMBER: 62.4, EFFECT: 95.0}, "the effect leaves much more"),
        (NUMBER, {NUMBER: 2.1, PAIR: 1.5}, "two effects are more than one number"),
        (EFFECT, {EFFECT: 2.1, ("position_dependent_friction@1",): 2.0}, "no number leads"),
        (("coulomb_friction@1",), {("coulomb_friction@1",): 2.1, EFFECT: 2.0}, "every drive has friction"),
        (EFFECT, {EFFECT: 2.1, NUMBER: 2.0}, "the number leaves less, and is the rarer cause"),
    ],
)
def test_a_leader_stays_sure_otherwise(first: tuple[str, ...], gaps: dict[tuple[str, ...], float], why: str) -> None:
    found = lead_numbers(first, gaps)
    assert (found.verdict, found.probability) == (first, 0.98), why


def lead_without_leader(gaps: dict[tuple[str, ...], float]) -> Decision:
    """The decision in place of no effect, which leads three sets, where something unknown is at work."""
    decision = replace(decide(), verdict=(), probability=0.005)
    return lead_with_effects(decision, lambda one: make_gap(gaps[one.verdict]))


@pytest.mark.parametrize(
    ("gaps", "verdict", "why"),
    [
        ({(): 90.0, LEAD: 80.0, OTHER: 90.0, THIRD: 59.0}, THIRD, "one set closes a third"),
        (
            {(): 90.0, LEAD: 80.0, OTHER: 59.0, THIRD: 45.0},
            OTHER,
            "the more probable of two that leave about as little",
        ),
        ({(): 90.0, LEAD: 80.0, OTHER: 59.0, THIRD: 30.0}, THIRD, "it leaves far more than the other"),
        ({(): 90.0, LEAD: 80.0, OTHER: 85.0, THIRD: 61.0}, (), "none closes a third"),
    ],
)
def test_where_something_is_at_work_effects_that_close_a_third_stand_in_place_of_none(
    gaps: dict[tuple[str, ...], float], verdict: tuple[str, ...], why: str
) -> None:
    found = lead_without_leader(gaps)
    assert found.verdict == verdict and not found.is_sure, why


def test_where_no_set_was_fitted_no_effect_stays() -> None:
    decision = replace(decide(), verdict=(), hypotheses=decide().hypotheses[-2:])
    assert lead_with_effects(decision, lambda one: pytest.fail("nothing is measured")) is decision
