"""Which fit states a set of effects."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from catalogue import EFFECTS

from hdagen.diagnosis.search.fit_ranking import choose_stated_fits

MEMBERS = tuple(
    SimpleNamespace(name=f"{effect}@1", traits=EFFECTS[effect]) for effect in ("current_bias", "missing_compliance")
)
NONE, BIAS, SPRING = (), ("current_bias@1",), ("missing_compliance@1",)


def make_fit(names: tuple[str, ...], evidence: float, springs: int) -> Any:
    """A fit of a set on a model with some springs."""
    arm = SimpleNamespace(manifest={"flexible": list(range(1, springs + 1))})
    sensitivities = SimpleNamespace(candidates=SimpleNamespace(members=MEMBERS), shooting=SimpleNamespace(arm=arm))
    effects = tuple(k for k, one in enumerate(MEMBERS) if one.name in names)
    return SimpleNamespace(names=names, effects=effects, evidence_here=evidence, sensitivities=sensitivities)


@pytest.mark.parametrize("names", [NONE, BIAS])
def test_a_set_without_a_spring_is_stated_by_the_rigid_model(names: tuple[str, ...]) -> None:
    """A replay of the set has no spring, so numbers that were fitted beside one are not its own."""
    rigid, worse, beside_spring = make_fit(names, -50.0, 0), make_fit(names, -60.0, 0), make_fit(names, -10.0, 1)
    assert choose_stated_fits([beside_spring, worse, rigid])[names] is rigid
    assert choose_stated_fits([beside_spring])[names] is beside_spring


def test_a_set_with_a_spring_is_stated_by_its_best_fit() -> None:
    best, other = make_fit(SPRING, -10.0, 2), make_fit(SPRING, -20.0, 1)
    assert choose_stated_fits([other, best])[SPRING] is best
