"""A set of effects that tells unseen motion several times worse than another one does not lead."""

from __future__ import annotations

from typing import Any

import pytest

from hdagen.diagnosis.data.data_settings import DATA
from hdagen.diagnosis.decision.decision_settings import DECISION
from hdagen.diagnosis.decision.posterior import Decision, Hypothesis
from hdagen.diagnosis.holdout.holdout_check_settings import HOLDOUT_CHECK
from hdagen.diagnosis.holdout.leading_set import lead_on_unseen_motion

LEAD, OTHER, THIRD = ("torque_ripple@1",), ("coulomb_friction@1",), ("coulomb_friction@1", "viscous_friction@1")


def decide(*, unknown: bool = False) -> Decision:
    """A decision for the first of three sets that were fitted, beside one that was not."""
    fits: dict[tuple[str, ...], Any] = {names: object() for names in (LEAD, OTHER, THIRD, ())}
    shares = {LEAD: 0.96, OTHER: 0.02, THIRD: 0.01, (): 0.005}
    found = [Hypothesis(names, share, fits[names]) for names, share in shares.items()]
    found.append(Hypothesis(("payload@1",), 0.005, None))
    verdict = ("unknown@1",) if unknown else LEAD
    return Decision(tuple(found), verdict, 0.96, 0.99, fits[LEAD])


def lead(gaps: dict[tuple[str, ...], float], decision: Decision | None = None) -> Decision:
    return lead_on_unseen_motion(decision or decide(), lambda one: {"after": gaps[one.verdict]})


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


def test_where_something_unknown_is_said_no_set_leads() -> None:
    decision = decide(unknown=True)
    assert lead({}, decision) is decision
