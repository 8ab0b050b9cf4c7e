"""Known effects in place of something unknown: which set is weighed against it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from catalogue import EFFECTS

from hdagen.diagnosis.decision.posterior import Decision, Hypothesis
from hdagen.diagnosis.holdout import holdout_check
from hdagen.diagnosis.holdout.holdout_check import HoldoutJudge
from hdagen.diagnosis.inference.candidate_priors import Candidate, CandidateSet

UNKNOWN, PAYLOAD, RIPPLE = ("unknown@1",), ("payload@1",), ("torque_ripple@1",)
MEMBERS = (*PAYLOAD, *RIPPLE)
SHARES = {UNKNOWN: 0.9, (): 0.05, PAYLOAD: 0.03, RIPPLE: 0.02}


def make_fit(names: tuple[str, ...]) -> Any:
    """A fit of a set of effects, as far as the decision reads it."""
    members = tuple(Candidate(EFFECTS[name.partition("@")[0]], 1, (name,), {}, True, False) for name in MEMBERS)
    effects = tuple(MEMBERS.index(name) for name in names)
    return SimpleNamespace(
        effects=effects, names=names, sensitivities=SimpleNamespace(candidates=CandidateSet(members, ()))
    )


@pytest.fixture
def weighed(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Decision, tuple[str, ...]]]:
    """The decisions that are weighed against something unknown, each with the known effects."""
    found: list[tuple[Decision, tuple[str, ...]]] = []

    def reweigh(decision: Decision, said: tuple[str, ...], motion: object, alone: object) -> Decision:
        found.append((decision, said))
        return decision

    monkeypatch.setattr(holdout_check, "reweigh_unknown", reweigh)
    return found


def try_effects(monkeypatch: pytest.MonkeyPatch, gaps: dict[tuple[str, ...], float], shares: dict[Any, float]) -> None:
    """Try the known effects beside something unknown, by what each set leaves of held-out motion."""
    fits = {names: make_fit(names) for names in gaps}

    def state(_: HoldoutJudge, decision: Decision) -> Any:
        left = gaps[decision.verdict]
        gap = {"before": 40.0, "after": left, "by_channel": {"joint_position_1": {"after": left}}}
        confirmed = SimpleNamespace(gap=gap, effects=decision.verdict, after=None)
        return SimpleNamespace(decision=decision, stated=SimpleNamespace(causes=()), confirmed=confirmed)

    monkeypatch.setattr(HoldoutJudge, "state_decision", state)
    found = tuple(Hypothesis(names, share, fits.get(names)) for names, share in shares.items())
    unused: Any = None
    judge = HoldoutJudge(unused, unused, unused, (), unused)
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
