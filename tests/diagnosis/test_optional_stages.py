"""Stages that a diagnosis can do without, and simulations that fail: left out and said, and all else stays."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from numpy.linalg import LinAlgError

from hdagen.adoption.verdict import SCHEMA
from hdagen.arm.build_loader import PlantError
from hdagen.diagnosis import pipeline
from hdagen.diagnosis.optional_stages import Attempts
from hdagen.log.data_table import LogError

CONTENT: dict[str, Any] = {
    "schema": SCHEMA,
    "verdict": ["payload@1"],
    "causes": [{"effect": "payload", "joint": 1, "parameters": {"payload_mass": 1.0}}],
    "parameters": {},
    "gap": {"before": 9.0, "after": 2.0, "flexible": 3.0, "achievable": 2.0},
    "sure": True,
}


@pytest.mark.parametrize("error", [PlantError("p is not within."), LogError(["too short."]), LinAlgError("singular")])
def test_what_fails_is_left_out_and_said(error: Exception) -> None:
    attempts = Attempts()

    def fails() -> int:
        raise error

    assert attempts.attempt("the ladder", fails, 3) == 3
    assert attempts.attempt("where and when", lambda: 4, 3) == 4
    assert attempts.failures == [f"Left out, as it failed: the ladder. {error}"]


def test_simulations_that_fail_are_counted() -> None:
    attempts, good, bad = (
        Attempts(),
        SimpleNamespace(rollout_count=10, failure_count=0),
        SimpleNamespace(rollout_count=30, failure_count=2),
    )
    attempts.report_failed_simulations([good])  # type: ignore[list-item]
    assert attempts.failures == []
    attempts.report_failed_simulations([good, bad])  # type: ignore[list-item]
    assert len(attempts.failures) == 1 and attempts.failures[0].startswith("In 2 of 40 simulations of the fit")


def test_a_late_stage_that_fails_takes_nothing_of_what_was_found(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*of: Any) -> list[dict[str, Any]]:
        raise PlantError("parameter payload_mass_1: 1e-12 kg is not within [0, 20].")

    told: Any = SimpleNamespace(decision=SimpleNamespace(best=None), content=CONTENT, after=None)
    motion: Any = SimpleNamespace(before=None, portion=None, simulate=None)
    monkeypatch.setattr(pipeline, "rank_nuisance_effects", refused)
    monkeypatch.setattr(pipeline, "rank_hypotheses", lambda *of: [{"effects": ["payload@1"], "gap": 2.0}])
    attempts = Attempts()
    found = pipeline._describe_alternatives(told, motion, attempts)
    assert found["gap"] == CONTENT["gap"]
    assert found["tolerated"] == [] and found["causes"] == [CONTENT["causes"][0] | {"gap_after": 2.0}]
    assert "payload_mass_1" in attempts.failures[0]
    monkeypatch.setattr(pipeline, "rank_hypotheses", refused)
    found = pipeline._describe_alternatives(told, motion, attempts)
    assert found["ladder"] == [] and found["causes"][0]["gap_after"] is None
    assert len(attempts.failures) == 3
