"""Numbers of the robot file: their size by factor, and those that a motion cannot part."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hdagen.diagnosis.decision.number_combinations import combine_numbers
from hdagen.diagnosis.inference.candidate_priors import Candidate, CandidateSet, Column

TRAITS: dict[str, Any] = {
    "mass@2": SimpleNamespace(alternatives=("mass", "inertia", "payload")),
    "inertia@2": SimpleNamespace(alternatives=("mass", "inertia")),
}


def stand_at(name: str, value: float, stated: float = 1.0) -> Any:
    """A fit of one number, of which the file states 1 or 0, at a value; its usual size is 0.5."""
    atom = SimpleNamespace(name=name, amplitudes=("n",), is_number=True)
    described = {"n": SimpleNamespace(compute_factor=lambda value: value / stated, stated=stated, typical=0.5)}
    parameters = SimpleNamespace(index=lambda name: 0, described=described)
    shooting = SimpleNamespace(arm=SimpleNamespace(parameters=parameters))
    point = SimpleNamespace(p=np.array([value]))
    design = SimpleNamespace(candidates=SimpleNamespace(members=[atom]), shooting=shooting, point=point)
    return SimpleNamespace(effects=(0,), sensitivities=design)


@pytest.mark.parametrize("odds", [2.0, 1e4])
def test_sets_of_like_odds_are_one_statement_under_the_number_that_changes_least(odds: float) -> None:
    weight = {("mass@2",): 1.0, ("inertia@2",): 1.0 / odds, ("backlash@1",): 0.5, (): 1e-6}
    total = sum(weight.values())
    fits: dict[tuple[str, ...], Any] = {
        ("mass@2",): stand_at("mass@2", 2.0),
        ("inertia@2",): stand_at("inertia@2", 0.8),
    }
    found = combine_numbers(weight, fits, frozenset(TRAITS), TRAITS)
    assert sum(weight.values()) == pytest.approx(total)
    if odds < 100.0:
        assert found == {"inertia@2": ("inertia@2", "mass@2")}
        assert weight["inertia@2",] == pytest.approx(1.5) and ("mass@2",) not in weight
    else:
        assert not found and weight["mass@2",] == 1.0


@pytest.mark.parametrize(("rotor", "least"), [(0.4, "motor_inertia@2"), (3.0, "inertia@2")])
def test_a_number_that_is_0_in_the_file_changes_by_multiples_of_its_usual_size(rotor: float, least: str) -> None:
    names = ("motor_inertia", "inertia")
    traits: Any = {f"{name}@2": SimpleNamespace(alternatives=names) for name in names}
    weight = {("motor_inertia@2",): 1.0, ("inertia@2",): 0.9, (): 1e-6}
    fits: dict[tuple[str, ...], Any] = {
        ("motor_inertia@2",): stand_at("motor_inertia@2", rotor, stated=0.0),
        ("inertia@2",): stand_at("inertia@2", 3.0),
    }
    assert combine_numbers(weight, fits, frozenset(traits), traits) == {least: ("inertia@2", "motor_inertia@2")}


def test_a_payload_is_the_same_as_a_wrong_mass_of_its_link_alone() -> None:
    for payload, same in (("payload@2", True), ("payload@1", False)):
        weight = {("mass@2",): 1.0, (payload,): 0.5, (): 0.1}
        fits: dict[tuple[str, ...], Any] = {("mass@2",): stand_at("mass@2", 2.0)}
        assert bool(combine_numbers(weight, fits, frozenset(TRAITS), TRAITS)) == same


@pytest.mark.parametrize("factor", [1.1, 2.0, 6.0])
def test_too_large_by_a_factor_counts_as_too_small_by_it(factor: float) -> None:
    traits: Any = SimpleNamespace(name="mass")
    atom = Candidate(traits, 2, ("mass_2",), {}, True, True)
    words = CandidateSet((atom,), (Column("mass_2", 0, 3.0, 1.0, 0.15, 0, True, stated=3.0),))
    sizes = [words.measure_size(0, np.array([(one - 1.0) * 3.0])) for one in (factor, 1.0 / factor)]
    assert sizes[0] == pytest.approx(sizes[1]) == pytest.approx(np.log(factor) / np.log(4 / 3))
