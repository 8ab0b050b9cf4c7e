"""When the robot file's numbers are searched as causes, and which of the two searches stands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, cast

import pytest

from hdagen.diagnosis.judged_search import JudgedSearch, judge_numbers_first, judge_with_numbers
from hdagen.diagnosis.search.hypothesis_search import SearchResult
from hdagen.log.data_table import LogError

SEARCH = cast(SearchResult, None)
SEARCH_FOUND = cast(SearchResult, SimpleNamespace())
BEFORE = 60.0  # times the noise, without any effect


@dataclass(frozen=True, eq=False)
class FakeJudgedSearch(JudgedSearch):
    """A search without fits: ``told`` has the names of the properties that the fits would give as true."""

    told: frozenset[str]
    evidence: float

    @property
    def best(self) -> Any:
        return SimpleNamespace(evidence_here=self.evidence, misfit_temperature=1.0)

    @property
    def may_stand_for_numbers(self) -> bool:
        return "may_stand_for_numbers" in self.told

    @property
    def may_lack_numbers(self) -> bool:
        return "may_lack_numbers" in self.told

    @property
    def has_exact_number(self) -> bool:
        return "has_exact_number" in self.told


def judged(
    after: float,
    *verdict: str,
    contradiction: str | None = None,
    end: str | None = None,
    is_sure: bool = True,
    told: str = "may_lack_numbers",
    evidence: float = 0.0,
) -> JudgedSearch:
    """A search whose verdict leaves ``after`` times the noise on the motion that decides; ``end``: of the range of its
    effects, where they stand at one; ``told``: the property of the fits that is true;
    ``evidence``: log evidence of its fit."""
    gap = {"before": BEFORE, "after": after, "by_channel": {"motor_position_1": {"after": after}}}
    size = {"value": 1.0, "std": 0.1, "end": end}
    causes = [{"effect": name[:-2], "joint": int(name[-1]), "parameters": {"size": size}} for name in verdict]
    stated = SimpleNamespace(causes=causes)
    decision = SimpleNamespace(is_sure=is_sure)
    statement = SimpleNamespace(confirmed=SimpleNamespace(effects=verdict), stated=stated, decision=decision)
    checked: Any = SimpleNamespace(
        contradiction=contradiction, settled=SimpleNamespace(deciding_gap=gap, statement=statement)
    )
    numbers = frozenset({"motor_inertia@1", "mass@1", "inertia@1"})
    return FakeJudgedSearch(SEARCH, checked, (), numbers, frozenset({told}), evidence)


class Numbers:
    """The second search; ``asked`` has the first verdict of every call."""

    def __init__(self, found: JudgedSearch | None) -> None:
        self.found = found
        self.asked: list[Sequence[str] | None] = []

    def __call__(self, verdict: Sequence[str] | None) -> JudgedSearch | None:
        self.asked.append(verdict)
        return self.found


def refuse(_: SearchResult) -> JudgedSearch:
    raise LogError(["this log seems to be of another robot."])


@pytest.mark.parametrize(("after", "verdict"), [(5.0, ["viscous_friction@1"]), (1.9, [])])
def test_numbers_that_would_gain_nothing_are_not_searched_where_about_the_noise_is_left(
    after: float, verdict: list[str]
) -> None:
    first, numbers = judged(after, *verdict, is_sure=False, told="nothing"), Numbers(judged(1.2, "motor_inertia@1"))
    assert judge_with_numbers(lambda _: first, SEARCH, numbers) is first
    assert numbers.asked == []


@pytest.mark.parametrize("verdict", [[], ["coulomb_friction@2"], ["unknown@1"]])
def test_numbers_are_searched_where_much_is_left_however_sure_the_verdict_is(verdict: list[str]) -> None:
    """The linear model shows no gain beside much unexplained torque."""
    first, numbers = judged(11.3, *verdict, told="nothing"), Numbers(judged(6.6, "motor_inertia@1"))
    assert judge_with_numbers(lambda _: first, SEARCH, numbers) is numbers.found


def test_numbers_that_would_gain_beside_a_verdict_are_searched_however_little_is_left() -> None:
    first, numbers = judged(1.9), Numbers(judged(1.2, "motor_inertia@1"))
    assert judge_with_numbers(lambda _: first, SEARCH, numbers) is numbers.found


def test_an_effect_that_wrong_numbers_would_explain_as_well_is_compared_with_them_however_sure() -> None:
    first = judged(3.3, "link_flexibility@1", told="may_stand_for_numbers")
    numbers = Numbers(judged(1.2, "motor_inertia@1"))
    assert judge_with_numbers(lambda _: first, SEARCH, numbers) is numbers.found
    assert numbers.asked == [("link_flexibility@1",)]


@pytest.mark.parametrize(("after", "is_sure", "searched"), [(90.0, True, True), (3.8, False, True), (3.8, True, False)])
def test_a_number_that_the_file_knows_exactly_is_searched_where_the_verdict_leaves_room(
    after: float, is_sure: bool, searched: bool
) -> None:
    first = judged(after, "link_flexibility@1", is_sure=is_sure, told="has_exact_number")
    numbers = Numbers(judged(1.2, "motor_inertia@1"))
    assert judge_with_numbers(lambda _: first, SEARCH, numbers) is (numbers.found if searched else first)


def test_logs_that_contradict_each_other_are_no_reason_to_doubt_the_file() -> None:
    first, numbers = judged(90.0, contradiction="the logs differ."), Numbers(judged(1.0))
    assert judge_with_numbers(lambda _: first, SEARCH, numbers) is first
    assert numbers.asked == []


@pytest.mark.parametrize(
    ("first", "second", "stands"),
    [
        ((90.0, "unknown@1"), (3.0, "motor_inertia@1"), "second"),
        ((90.0, "viscous_friction@1"), (80.0, "mass@1", "inertia@1"), "first"),  # about as much, with more names
        ((90.0, "mass@1", "inertia@1"), (85.0, "motor_inertia@1"), "second"),  # about as much, with fewer
        ((90.0, "viscous_friction@1"), (85.0,), "first"),  # nothing named says nothing
        ((90.0, "viscous_friction@1"), (200.0, "motor_inertia@1"), "first"),
    ],
)
def test_what_leaves_clearly_less_stands(first: Any, second: Any, stands: str) -> None:
    both = {"first": judged(*first), "second": judged(*second)}
    numbers = Numbers(both["second"])
    assert judge_with_numbers(lambda _: both["first"], SEARCH, numbers) is both[stands]
    assert numbers.asked == [tuple(first[1:])]


@pytest.mark.parametrize(
    ("after", "evidence", "numbers", "stands"),
    [
        (12.0, 47.0, ["mass@1"], "second"),  # little more is left, but the one number is far more probable
        (12.0, 5.0, ["mass@1"], "first"),  # not clearly more probable
        (30.0, 47.0, ["mass@1"], "first"),  # much more is left
        (12.0, 47.0, ["mass@1", "inertia@1"], "first"),  # no fewer effects
    ],
)
def test_a_likelier_number_in_place_of_two_effects_stands_though_it_leaves_a_little_more(
    after: float, evidence: float, numbers: list[str], stands: str
) -> None:
    both = {
        "first": judged(9.0, "cable_spring@1", "torque_ripple@1"),
        "second": judged(after, *numbers, evidence=evidence),
    }
    assert judge_with_numbers(lambda _: both["first"], SEARCH, Numbers(both["second"])) is both[stands]


def test_a_number_at_an_end_of_its_range_corrects_nothing() -> None:
    first = judged(90.0, "viscous_friction@1")
    assert judge_with_numbers(lambda _: first, SEARCH, Numbers(judged(3.0, "motor_inertia@1", end="high"))) is first


def test_a_second_search_without_a_number_of_the_file_corrects_nothing() -> None:
    first = judged(90.0, "viscous_friction@1")
    assert judge_with_numbers(lambda _: first, SEARCH, Numbers(judged(3.0, "encoder_eccentricity@1"))) is first


def test_a_second_search_that_fails_leaves_the_first() -> None:
    first = judged(90.0, "unknown@1")
    assert judge_with_numbers(lambda _: first, SEARCH, Numbers(None)) is first


def test_a_file_that_seems_another_machines_is_searched_for_wrong_numbers() -> None:
    numbers = Numbers(judged(2.0, "motor_inertia@1"))
    assert judge_with_numbers(refuse, SEARCH, numbers) is numbers.found
    assert numbers.asked == [None]


def test_a_file_whose_wrong_numbers_are_surely_named_is_not_another_machines() -> None:
    numbers = Numbers(judged(0.4 * BEFORE, "motor_inertia@1"))
    assert judge_with_numbers(refuse, SEARCH, numbers) is numbers.found


@pytest.mark.parametrize(
    "second", [None, judged(40.0, "motor_inertia@1"), judged(0.4 * BEFORE, "motor_inertia@1", is_sure=False)]
)
def test_it_is_refused_where_wrong_numbers_leave_much_too(second: JudgedSearch | None) -> None:
    with pytest.raises(LogError, match="another robot"):
        judge_with_numbers(refuse, SEARCH, Numbers(second))


def test_a_file_that_seems_another_machines_is_judged_again_where_the_time_ends_before_its_numbers_are_searched() -> (
    None
):
    """The judge refuses no file once the time is up."""
    stated, numbers = judged(90.0, "viscous_friction@1"), Numbers(None)

    def judge(search: SearchResult) -> JudgedSearch:
        return stated if numbers.asked else refuse(search)

    assert judge_with_numbers(judge, SEARCH, numbers) is stated


def test_a_first_search_with_numbers_that_leaves_little_stands_alone() -> None:
    numbers = judged(5.0, "motor_inertia@1", "coulomb_friction@1")
    assert judge_numbers_first(numbers, pytest.fail, refuse) is numbers


@pytest.mark.parametrize(("stated", "stands"), [((3.0, "payload@1"), "stated"), ((80.0, "unknown@1"), "numbers")])
def test_a_first_search_with_numbers_that_leaves_much_is_compared_with_the_other(stated: Any, stands: str) -> None:
    both = {"numbers": judged(40.0, "motor_inertia@1"), "stated": judged(*stated)}
    found = judge_numbers_first(both["numbers"], lambda: SEARCH_FOUND, lambda _: both["stated"])
    assert found is both[stands]


def test_where_there_is_no_time_for_the_other_search_the_first_one_stands() -> None:
    numbers = judged(40.0, "motor_inertia@1")
    assert judge_numbers_first(numbers, lambda: None, refuse) is numbers


def test_where_neither_search_could_be_made_that_is_said() -> None:
    with pytest.raises(LogError, match="neither search"):
        judge_numbers_first(None, lambda: None, refuse)


def test_where_the_numbers_were_searched_first_contradicting_logs_correct_nothing() -> None:
    numbers, first = judged(12.0, "motor_inertia@1"), judged(90.0, contradiction="the logs differ.")
    assert judge_numbers_first(numbers, lambda: SEARCH_FOUND, lambda _: first) is first
