"""Effects of a verdict without which held-out motion is told about as well are listed as small, and not named."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import pytest

from hdagen.diagnosis.decision.posterior import Decision, Hypothesis
from hdagen.diagnosis.holdout.small_effects import drop_small_effects

FRICTION, TILT, DELAY = "coulomb_friction@1", "gravity_tilt@0", "sensor_delay@2"


def decided(*named: str, fitted: tuple[tuple[str, ...], ...] = (), **changes: Any) -> Decision:
    """A decision for ``named``, and the sets that were ``fitted`` beside it."""
    sets = (named, *fitted, ())
    fits: dict[tuple[str, ...], Any] = {
        names: SimpleNamespace(names=names, evidence_here=-float(k)) for k, names in enumerate(sets)
    }
    others = [Hypothesis(names, 0.04 / len(fitted), fits[names]) for names in fitted]
    hypotheses = (Hypothesis(named, 0.95, fits[named]), *others, Hypothesis((), 0.01, fits[()]))
    return Decision(hypotheses, named, 0.95, 0.99, fits[named], **changes)


def measured(gaps: dict[tuple[str, ...], tuple[float, float]]) -> Any:
    """What `gap` of diagnosis.json holds of a decision: of each verdict what two channels err by."""

    def measure(decision: Decision) -> dict[str, Any]:
        each = gaps[decision.verdict]
        channels = {f"joint_position_{j}": {"before": 200.0, "after": one} for j, one in enumerate(each, 1)}
        return {"before": 200.0, "after": float((each[0] * each[1]) ** 0.5), "by_channel": channels}

    return measure


def drop(decision: Decision, measure: Any, kept: Sequence[str] = ()) -> Any:
    """Without small effects, where every hypothesis with a fit was fitted by itself."""
    return drop_small_effects(decision, {h.names: h.fit for h in decision.hypotheses if h.fit}, measure, kept)


def test_what_closes_next_to_nothing_is_listed_as_small() -> None:
    before = decided(FRICTION, TILT, fitted=((FRICTION,), (TILT,)))
    gaps = {(FRICTION, TILT): (38.5, 38.5), (FRICTION,): (39.0, 39.2), (TILT,): (190.0, 180.0)}
    after, small = drop(before, measured(gaps))
    assert after.verdict == (FRICTION,) and after.best.names == (FRICTION,)
    assert after.probability == pytest.approx(0.97)
    assert sum(h.probability for h in after.hypotheses) == pytest.approx(1.0)
    assert after.marginal_probability(TILT) == pytest.approx(0.02)
    (one,) = small
    assert (one["effect"], one["joint"], one["with"]) == ("gravity_tilt", 0, 38.5)
    assert one["without"] == pytest.approx(39.1, rel=1e-3)


@pytest.mark.parametrize(
    ("both", "alone", "why"),
    [
        ((3.85, 3.85), (4.2, 4.1), "a tenth of all is left"),
        ((3.85, 3.85), (3.85, 4.4), "one channel tells it"),
        ((38.5, 38.5), (38.5, 56.0), "its part of one channel is more than what remains there"),
        ((3.85, 38.5), (4.4, 39.0), "one channel that is near the noise tells it"),
    ],
)
def test_what_closes_something_stays(both: tuple[float, float], alone: tuple[float, float], why: str) -> None:
    before = decided(FRICTION, TILT, fitted=((FRICTION,),))
    after, small = drop(before, measured({(FRICTION, TILT): both, (FRICTION,): alone}))
    assert after is before and small == [], why


def test_what_closes_less_than_what_remains_is_small() -> None:
    before = decided(FRICTION, TILT, fitted=((FRICTION,),))
    after, small = drop(before, measured({(FRICTION, TILT): (38.5, 38.5), (FRICTION,): (50.0, 52.0)}))
    assert after.verdict == (FRICTION,) and len(small) == 1


def test_what_the_log_shows_by_itself_is_never_small() -> None:
    before = decided(FRICTION, DELAY, fitted=((FRICTION,),))
    gaps = measured({(FRICTION, DELAY): (38.5, 38.5), (FRICTION,): (39.0, 39.0)})
    assert drop(before, gaps, [DELAY]) == (before, [])


def test_of_two_that_are_small_the_one_that_the_log_tells_less_goes() -> None:
    """Though the gap is a little less with it alone."""
    before = decided(FRICTION, TILT, fitted=((FRICTION,), (TILT,)))
    gaps = {(FRICTION, TILT): (45.0, 45.0), (FRICTION,): (53.0, 53.0), (TILT,): (48.0, 48.0)}
    assert drop(before, measured(gaps))[0].verdict == (FRICTION,)


def test_below_the_noise_nothing_is_left_to_tell() -> None:
    before = decided(FRICTION, TILT, fitted=((FRICTION,),))
    after, small = drop(before, measured({(FRICTION, TILT): (0.5, 0.5), (FRICTION,): (0.9, 0.9)}))
    assert after.verdict == (FRICTION,) and len(small) == 1


def test_what_was_not_fitted_without_it_stays() -> None:
    before = decided(FRICTION, TILT, fitted=((DELAY,),))
    after, small = drop(before, measured({(FRICTION, TILT): (38.5, 38.5)}))
    assert after is before and small == []


def test_one_after_another_and_what_the_log_tells_least_first() -> None:
    whole = (FRICTION, TILT, DELAY)
    fitted = ((FRICTION, TILT), (FRICTION, DELAY), (FRICTION,))
    gaps = {whole: (10.0, 10.0), fitted[0]: (10.4, 10.0), fitted[1]: (10.1, 10.0), (FRICTION,): (10.3, 10.2)}
    after, small = drop(decided(*whole, fitted=fitted), measured(gaps | {(TILT, DELAY): (200.0, 200.0)}))
    assert after.verdict == (FRICTION,)
    assert [one["effect"] for one in small] == ["sensor_delay", "gravity_tilt"]
    assert sum(h.probability for h in after.hypotheses) == pytest.approx(1.0)


@pytest.mark.parametrize("named", [(FRICTION,), (FRICTION, "unknown@1"), ()])
def test_one_effect_alone_and_what_is_unknown_are_left(named: tuple[str, ...]) -> None:
    before = decided(*named, fitted=((DELAY,),))
    after, small = drop(before, lambda one: pytest.fail("nothing is to be measured"))
    assert after is before and small == []
