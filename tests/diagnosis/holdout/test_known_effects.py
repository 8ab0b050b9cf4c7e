"""Known effects in place of something unknown: which set is weighed against it. And effects of long windows in place of
a verdict that leaves much."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from catalogue import EFFECTS

from hdagen.diagnosis.data.data_settings import DATA
from hdagen.diagnosis.decision.posterior import Decision, Hypothesis
from hdagen.diagnosis.holdout import holdout_check
from hdagen.diagnosis.holdout.holdout_check import HoldoutJudge
from hdagen.diagnosis.holdout.holdout_check_settings import HOLDOUT_CHECK
from hdagen.diagnosis.inference.candidate_priors import Candidate, CandidateSet, Column

UNKNOWN, PAYLOAD, RIPPLE = ("unknown@1",), ("payload@1",), ("torque_ripple@1",)
MEMBERS = (*PAYLOAD, *RIPPLE)
SHARES = {UNKNOWN: 0.9, (): 0.05, PAYLOAD: 0.03, RIPPLE: 0.02}


def make_fit(names: tuple[str, ...], deviation: float = 0.1) -> Any:
    """A fit of a set of effects, as far as the decision reads it. All sizes are 1, with a standard ``deviation``."""
    members = tuple(Candidate(EFFECTS[name.partition("@")[0]], 1, (name,), {}, True, False) for name in MEMBERS)
    columns = tuple(Column(name, k, 0.0, 1.0, 0.1, k, False) for k, name in enumerate(MEMBERS))
    effects = tuple(MEMBERS.index(name) for name in names)
    sensitivities = SimpleNamespace(candidates=CandidateSet(members, columns))
    posterior = np.ones(len(MEMBERS)), deviation**2 * np.eye(len(MEMBERS))
    return SimpleNamespace(effects=effects, names=names, sensitivities=sensitivities, posterior=posterior)


@pytest.fixture
def weighed(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Decision, tuple[str, ...]]]:
    """The decisions that are weighed against something unknown, each with the known effects."""
    found: list[tuple[Decision, tuple[str, ...]]] = []

    def reweigh(decision: Decision, said: tuple[str, ...], motion: object, alone: object) -> Decision:
        found.append((decision, said))
        return decision

    monkeypatch.setattr(holdout_check, "reweigh_unknown", reweigh)
    return found


def judge_by(monkeypatch: pytest.MonkeyPatch, gaps: dict[tuple[str, ...], float], measured: Any = None) -> HoldoutJudge:
    """A judge that knows what each set leaves of held-out motion, and the gap ``measured`` with base parameters."""

    def state(_: HoldoutJudge, decision: Decision) -> Any:
        left = gaps[decision.verdict]
        gap = {"before": 40.0, "after": left, "by_channel": {"joint_position_1": {"after": left}}}
        confirmed = SimpleNamespace(gap=gap, effects=decision.verdict, after=None)
        return SimpleNamespace(decision=decision, stated=SimpleNamespace(causes=()), confirmed=confirmed)

    monkeypatch.setattr(HoldoutJudge, "state_decision", state)
    unused: Any = None
    motion: Any = SimpleNamespace(refitted_base=None, measure_gap=lambda _: measured)
    return HoldoutJudge(unused, unused, unused, (), motion)


def try_effects(monkeypatch: pytest.MonkeyPatch, gaps: dict[tuple[str, ...], float], shares: dict[Any, float]) -> None:
    """Try the known effects beside something unknown, by what each set leaves of held-out motion."""
    fits = {names: make_fit(names) for names in gaps}
    found = tuple(Hypothesis(names, share, fits.get(names)) for names, share in shares.items())
    judge = judge_by(monkeypatch, gaps)
    assert judge.try_known_effects(Decision(found, UNKNOWN, shares[UNKNOWN], shares[UNKNOWN], fits[()])) is None


def test_where_no_effect_leads_the_known_ones_the_effect_that_closes_a_third_is_weighed(
    monkeypatch: pytest.MonkeyPatch, weighed: list[tuple[Decision, tuple[str, ...]]]
) -> None:
    try_effects(monkeypatch, {(): 26.0, PAYLOAD: 12.0, RIPPLE: 25.0}, SHARES)
    ((decision, said),) = weighed
    assert said == PAYLOAD and decision.best.names == PAYLOAD
    known = {h.names: h.probability for h in decision.hypotheses if not h.is_unknown}
    assert max(known, key=lambda names: known[names]) == PAYLOAD


def test_where_none_closes_a_third_nothing_is_weighed(
    monkeypatch: pytest.MonkeyPatch, weighed: list[tuple[Decision, tuple[str, ...]]]
) -> None:
    try_effects(monkeypatch, {(): 26.0, PAYLOAD: 18.0, RIPPLE: 25.0}, SHARES)
    assert not weighed


def test_an_effect_that_leads_the_known_ones_is_weighed_as_it_is(
    monkeypatch: pytest.MonkeyPatch, weighed: list[tuple[Decision, tuple[str, ...]]]
) -> None:
    shares = {UNKNOWN: 0.9, (): 0.01, PAYLOAD: 0.08, RIPPLE: 0.01}
    try_effects(monkeypatch, {(): 26.0, PAYLOAD: 12.0, RIPPLE: 25.0}, shares)
    ((decision, said),) = weighed
    assert said == PAYLOAD and {h.names: h.probability for h in decision.hypotheses} == shares


def try_long_windows(
    monkeypatch: pytest.MonkeyPatch,
    said: tuple[str, ...],
    found: tuple[str, ...],
    gaps: dict[tuple[str, ...], float],
    deviation: float = 0.1,
) -> Decision:
    """Decide for a verdict, beside which long windows find a set that short ones did not fit."""
    shares = {said: 0.6, RIPPLE: 0.1, PAYLOAD: 0.1}
    fits = {said: make_fit(said)}
    decision = Decision(
        tuple(Hypothesis(names, share, fits.get(names)) for names, share in shares.items()), said, 0.6, 0.6, fits[said]
    )
    fit = make_fit(found, deviation)
    hypotheses = (Hypothesis(found, 0.99, fit), *decision.hypotheses)
    long = replace(decision, hypotheses=hypotheses, best=fit, undetectable=("x@1",))
    return judge_by(monkeypatch, gaps).try_long_windows(decision, lambda _: long)


def test_an_effect_of_long_windows_takes_the_place_of_no_effect_that_leaves_several_times_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    decision = try_long_windows(monkeypatch, (), PAYLOAD, {(): 286.0, PAYLOAD: 25.0})
    assert decision.verdict == PAYLOAD and decision.is_long_horizon and not decision.is_sure
    shares = {h.names: h.probability for h in decision.hypotheses}
    assert len(shares) == len(decision.hypotheses) == 3  # the set stands once
    assert shares[PAYLOAD] + shares[()] == pytest.approx(0.7) and shares[RIPPLE] == 0.1
    assert decision.best.names == PAYLOAD


@pytest.mark.parametrize(
    ("said", "left", "closed"),
    [
        ((), 286.0, 286.0 / HOLDOUT_CHECK.leading_gap_ratio + 1.0),
        ((), DATA.significant_noise_multiple, 1.0),  # nothing is left that counts
        (RIPPLE, 286.0, 286.0 / HOLDOUT_CHECK.leading_gap_ratio + 1.0),
    ],
)
def test_what_long_windows_find_stands_back_where_it_closes_too_little(
    monkeypatch: pytest.MonkeyPatch, said: tuple[str, ...], left: float, closed: float
) -> None:
    decision = try_long_windows(monkeypatch, said, PAYLOAD, {said: left, PAYLOAD: closed})
    assert decision.verdict == said and not decision.is_long_horizon


@pytest.mark.parametrize(("said", "leads"), [((), False), (RIPPLE, True)])
def test_an_effect_of_long_windows_whose_size_is_open_takes_the_place_of_another_one_but_not_of_none(
    monkeypatch: pytest.MonkeyPatch, said: tuple[str, ...], leads: bool
) -> None:
    deviation = 1.05 / HOLDOUT_CHECK.clear_deviations
    decision = try_long_windows(monkeypatch, said, PAYLOAD, {said: 286.0, PAYLOAD: 25.0}, deviation)
    assert (decision.verdict == PAYLOAD) is leads


@pytest.mark.parametrize(("left_by_base", "names"), [(13.0, None), (24.0, PAYLOAD)])
def test_a_known_effect_stands_beside_something_unknown_only_where_base_parameters_leave_clearly_more(
    monkeypatch: pytest.MonkeyPatch, left_by_base: float, names: tuple[str, ...] | None
) -> None:
    fits = {names: make_fit(names) for names in ((), PAYLOAD)}
    found = (Hypothesis(UNKNOWN, 0.5, None), Hypothesis(PAYLOAD, 0.4, fits[PAYLOAD]), Hypothesis((), 0.1, fits[()]))
    known = replace(Decision(found, PAYLOAD, 0.6, 0.6, fits[PAYLOAD]))
    monkeypatch.setattr(holdout_check, "reweigh_unknown", lambda *_: known)
    gap = {"after": left_by_base, "by_channel": {"joint_position_1": {"after": left_by_base}}}
    judge = judge_by(monkeypatch, {PAYLOAD: 12.0, (): 26.0}, measured=gap)
    tried = judge.try_known_effects(Decision(found, UNKNOWN, 0.5, 0.5, fits[()]))
    assert (tried and tried.verdict) == names


def test_an_effect_that_long_windows_find_takes_the_lead_where_another_leaves_several_times_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    decision = try_long_windows(monkeypatch, RIPPLE, PAYLOAD, {RIPPLE: 286.0, PAYLOAD: 25.0})
    assert decision.verdict == PAYLOAD and not decision.is_sure
