"""Stages that a diagnosis can do without, and simulations that fail: left out and said, and all else stays."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from numpy.linalg import LinAlgError

from hdagen.arm.build_loader import PlantError
from hdagen.diagnosis import explanation
from hdagen.diagnosis.checked_verdict import CheckedVerdict
from hdagen.diagnosis.decision.verdict_content import StatedEffects
from hdagen.diagnosis.holdout.holdout_check import SettledStatement, Statement
from hdagen.diagnosis.holdout.hypothesis_ranking import find_gap_after
from hdagen.diagnosis.holdout.verdict_withdrawal import ConfirmedVerdict
from hdagen.diagnosis.search.effect_search import describe_failed_simulations
from hdagen.diagnosis.stages.optional_stages import Attempts
from hdagen.log.data_table import LogError

CAUSE = {"effect": "payload", "joint": 1, "parameters": {"payload_mass": 1.0}}
GAP = {"before": 9.0, "after": 2.0, "flexible": 3.0, "achievable": 2.0}


@pytest.mark.parametrize("error", [PlantError("p is not within."), LogError(["too short."]), LinAlgError("singular")])
def test_what_fails_is_left_out_and_said(error: Exception) -> None:
    attempts = Attempts()

    def fails() -> int:
        raise error

    assert attempts.attempt("the ranking", fails, 3) == 3
    assert attempts.attempt("where and when", lambda: 4, 3) == 4
    assert attempts.failures == [f"Left out, as it failed: the ranking. {error}"]


def test_simulations_that_fail_are_counted() -> None:
    good: Any = SimpleNamespace(rollout_count=10, failure_count=0)
    bad: Any = SimpleNamespace(rollout_count=30, failure_count=2)
    assert describe_failed_simulations([good]) == []
    (said,) = describe_failed_simulations([good, bad])
    assert said.startswith("In 2 of 40 simulations of the fit")


def check_payload() -> CheckedVerdict:
    """A payload that the held-out motion confirms."""
    unused: Any = None
    decision: Any = SimpleNamespace(best=None, is_sure=True)
    motion: Any = SimpleNamespace(before=None, portion=None, simulate=None)
    confirmed = ConfirmedVerdict(("payload@1",), {}, False, GAP, unused, unused)
    statement = Statement(decision, StatedEffects(("payload@1",), (CAUSE,)), confirmed)
    return CheckedVerdict(SettledStatement(statement, None, (), {"after": 0.0}), (), None, motion, ())


def test_a_late_stage_that_fails_takes_nothing_of_what_was_found(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*of: Any) -> list[dict[str, Any]]:
        raise PlantError("parameter payload_mass_1: 1e-12 kg is not within [0, 20].")

    checked, attempts = check_payload(), Attempts()
    monkeypatch.setattr(explanation, "rank_nuisance_effects", refused)
    monkeypatch.setattr(explanation, "rank_hypotheses", lambda *of: [{"effects": ["payload@1"], "gap": 2.0}])
    found = explanation.rank_alternatives(checked, attempts)
    assert found.gap == GAP and found.is_sure
    assert found.nuisance_effects == [] and find_gap_after(CAUSE, found.ranking) == 2.0
    assert "payload_mass_1" in attempts.failures[0]
    monkeypatch.setattr(explanation, "rank_hypotheses", refused)
    found = explanation.rank_alternatives(checked, attempts)
    assert found.ranking == [] and find_gap_after(CAUSE, found.ranking) is None
    assert len(attempts.failures) == 3
