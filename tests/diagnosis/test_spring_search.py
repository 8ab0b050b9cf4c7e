"""Springs in rigid joints are searched where they can win, and nowhere else."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from hdagen.diagnosis.search import rigid_or_flexible
from hdagen.diagnosis.search.fit_ranking import can_gain, drop_hopeless_starts
from hdagen.diagnosis.search.search_settings import SEARCH
from hdagen.diagnosis.stages.time_budget import TimeBudget

PRICE = SEARCH.effect_penalty + SEARCH.least_lead


def fit(misfit: float, effects: tuple[int, ...] = ()) -> Any:
    """A fit that lacks so many nats to a residual of noise, at the temperature that goes with them."""
    budget = SimpleNamespace(shooting=SimpleNamespace(budget=TimeBudget()))
    temperature = max(1.0, misfit / 100.0)
    return SimpleNamespace(
        effects=effects, misfit=misfit, evidence_here=-misfit, misfit_temperature=temperature, sensitivities=budget
    )


def test_a_fit_that_lacks_less_than_an_effect_costs_is_not_improved() -> None:
    assert not can_gain(fit(0.9 * PRICE)) and can_gain(fit(1.1 * PRICE))
    assert can_gain(fit(1000.0)), "a large misfit is worth more than its price at any temperature"


@pytest.mark.parametrize("misfit, is_tried", [(0.5 * PRICE, False), (2.0 * PRICE, True)])
def test_no_model_with_springs_is_loaded_where_none_can_win(
    misfit: float, is_tried: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    class LoadedError(Exception):
        pass

    def refuse(*_: Any) -> None:
        raise LoadedError

    monkeypatch.setattr(rigid_or_flexible, "load_with_springs", refuse)
    arm: Any = SimpleNamespace(n=1, manifest={"flexible": []}, parameters={"motor_inertia_1": 0.1})
    found: Any = SimpleNamespace(fits=(fit(misfit),))
    given: Any = ("robot.toml", arm, None, 0.05, found, print)
    if is_tried:
        with pytest.raises(LoadedError):
            rigid_or_flexible.compare_with_springs(*given)
    else:
        assert rigid_or_flexible.compare_with_springs(*given) is found


def test_springs_must_reach_what_a_good_fit_has() -> None:
    find = rigid_or_flexible.find_least_evidence
    explains_most = [fit(200.0, (1,)), fit(2000.0)]
    assert find(explains_most[0], explains_most) == -200.0
    leaves_much = [fit(1500.0, (1,)), fit(2000.0)]
    assert find(leaves_much[0], leaves_much) == -1500.0 - SEARCH.hopeless_margin * 15.0
    lacks_little = [fit(72.0, (1,)), fit(99.0)]
    assert find(lacks_little[0], lacks_little) == -72.0 - SEARCH.close_call_margin


def test_a_start_far_behind_another_of_the_same_set_is_not_fitted() -> None:
    def begun(evidence: float, temperature: float = 1.0) -> Any:
        return SimpleNamespace(score=SimpleNamespace(evidence=evidence), misfit_temperature=temperature)

    best, near, far = begun(-100.0), begun(-100.0 - 0.9 * SEARCH.hopeless_margin), begun(-300.0)
    assert drop_hopeless_starts([far, best, near]) == [best, near]
    hot = begun(-100.0, 15.0)
    assert drop_hopeless_starts([hot, far]) == [hot, far], "of a large misfit more is left to be gained"
    assert drop_hopeless_starts([]) == []
