"""Whether a decision stands on held-out motion: what a whole model leaves of a joint's gap there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hdagen.adoption import verdict
from hdagen.diagnosis.data.data_settings import DATA
from hdagen.diagnosis.data.split import LogPortion
from hdagen.diagnosis.decision.posterior import Decision, Hypothesis
from hdagen.diagnosis.decision.verdict_content import StatedEffects
from hdagen.diagnosis.holdout import verdict_withdrawal
from hdagen.diagnosis.holdout.holdout_check_settings import HOLDOUT_CHECK
from hdagen.diagnosis.holdout.unseen_motion import HoldoutMotion
from hdagen.diagnosis.holdout.verdict_withdrawal import (
    LEAST_UNKNOWN_ODDS,
    _closes_gap,
    doubt_on_holdout,
    is_at_bound,
    leaves_little,
    measure_remaining_shares,
    remove_unknown,
    reweigh_unknown,
    withdraw_harmful,
)
from hdagen.log.measured_log import Log
from hdagen.prediction.window_replay import Replay

NOISE = {f"{quantity}_{j}": 1e-3 for j in (1, 2) for quantity in ("motor_position", "joint_position", "motor_current")}
ROWS = 1000
LOG = Log(1e-3 * np.arange(ROWS), {name: np.zeros(ROWS) for name in NOISE}, 2, "test")
HELD = LogPortion.all_rows(LOG)
FAR = {"motor_position_1": 100.0, "joint_position_1": 400.0, "motor_position_2": 300.0, "joint_position_2": 300.0}


def replay(multiples: Mapping[str, float]) -> Replay:
    """Errors in multiples of the noise, 1 where none is given."""
    errors = {name: multiples.get(name, 1.0) * noise for name, noise in NOISE.items()}
    columns = {name: np.full(ROWS, error) for name, error in errors.items()}
    return Replay(columns, np.zeros((ROWS, 1)), errors, NOISE, {}, np.arange(0, ROWS, 250), 0, ())


def left(first: float, second: float) -> Replay:
    """What `FAR` errs by, less at each joint."""
    return replay({name: value * (first if name.endswith("1") else second) for name, value in FAR.items()})


def motion(whole: Replay, flexible: Replay | None = None, base: Replay | None = None) -> HoldoutMotion:
    """What `FAR` errs by, where a simulation of any model is ``whole``."""
    return HoldoutMotion(HELD, lambda _: whole, replay(FAR), base or replay(FAR), flexible or whole)


def decision(names: tuple[str, ...], probability: float, *, also: tuple[str, ...] | None = None) -> Decision:
    """A decision beside none, or a payload where none is said; ``also``: another set that was fitted."""
    fit: Any = "where it stands"
    other = also if also is not None else () if names else ("payload@2",)
    hypotheses = (Hypothesis(names, probability, fit), Hypothesis(other, 1.0 - probability, fit))
    return Decision(hypotheses, names, probability, probability, fit)


ONE: Any = "where it stands"
FITS = dict.fromkeys(((), ("payload@1",), ("payload@2",)), ONE)


def worst(before: Replay, after: Replay, whole: Replay, named: set[int] | None = None) -> tuple[int, float]:
    shares = measure_remaining_shares(before, after, whole, HELD, named or set())
    return max(shares.items(), key=lambda one: one[1], default=(0, 0.0))


def test_the_worst_joint_is_the_one_of_which_most_is_left() -> None:
    assert worst(replay(FAR), left(0.1, 0.5), left(1.0, 1.0)) == (2, pytest.approx(0.5))
    assert worst(replay(FAR), left(1.0, 1.0), left(0.7, 0.5)) == (1, pytest.approx(0.7))
    assert worst(replay(FAR), left(0.7, 0.5), left(0.6, 0.9)) == (1, pytest.approx(0.6))  # joint 2: 0.5


def test_at_a_joint_that_is_named_the_verdict_alone_must_close_something() -> None:
    whole = left(0.2, 0.05)
    assert worst(replay(FAR), left(0.95, 0.05), whole, {1}) == (1, pytest.approx(0.95))
    assert worst(replay(FAR), left(0.85, 0.05), whole, {1}) == (1, pytest.approx(0.2))
    assert worst(replay(FAR), left(0.95, 0.05), whole, {2}) == (1, pytest.approx(0.2))
    assert worst(replay(FAR), left(0.95, 0.05), whole, {0}) == (1, pytest.approx(0.2))  # the whole robot


def test_an_encoder_that_is_explained_is_enough() -> None:
    mixed = replay(FAR | {"motor_position_1": 101.0, "joint_position_1": 160.0, "joint_position_2": 3.0})
    assert worst(replay(FAR), mixed, mixed, {1}) == (1, pytest.approx(0.4))


def test_a_torque_sensor_that_is_explained_is_enough_and_one_that_did_not_err_says_nothing() -> None:
    erred, right = FAR | {"motor_current_1": 200.0}, FAR | {"motor_current_1": 2.0}
    assert worst(replay(erred), replay(FAR | {"motor_current_1": 20.0}), replay(erred), {1})[0] == 2
    assert worst(replay(right), replay(FAR | {"joint_position_2": 2.0}), replay(right), {1}) == (1, 1.0)


def test_what_is_left_within_a_few_times_the_noise_does_not_count() -> None:
    near = replay(dict.fromkeys(FAR, 0.9 * DATA.significant_noise_multiple))
    assert worst(replay(dict.fromkeys(FAR, DATA.significant_noise_multiple)), near, near, {1, 2})[1] == 0.0
    assert worst(replay({}), replay({}), replay({}), {1, 2})[1] == 0.0


@pytest.fixture(autouse=True)
def whole_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    """The model where a best fit stands; a simulation of it is the motion's."""
    monkeypatch.setattr(verdict_withdrawal, "build_fitted_arm", lambda _: "all that it has")


@pytest.mark.parametrize(
    ("first", "says"),
    [
        (0.02, False),
        (HOLDOUT_CHECK.most_remaining_share - 0.01, False),
        (HOLDOUT_CHECK.most_remaining_share + 0.01, True),
        (1.0, True),
    ],
)
@pytest.mark.parametrize("names", [(), ("payload@1",)])
def test_what_leaves_most_of_a_joints_gap_is_unknown_there(names: tuple[str, ...], first: float, says: bool) -> None:
    given = decision(names, 0.95, also=("payload@1",) if not names else ())
    named = min(first, 0.9)  # of more than that the verdict itself must close something
    found, told = doubt_on_holdout(given, FITS, names, motion(left(first, 0.1)), left(named if names else 1.0, 0.1))
    if not says:
        assert found is given and told is None
        return
    assert told == {"verdict": list(names), "joint": 1, "left": pytest.approx(named if names else first)}
    assert found.verdict == ("unknown@1",) and not found.is_sure and found.best is given.best
    assert 0.4 < found.probability < 0.9
    assert sum(h.probability for h in found.hypotheses) == pytest.approx(1.0)
    second = next(h for h in found.hypotheses if h.names == names)
    other = next(h for h in found.hypotheses if h not in (second, found.hypotheses[0]))
    assert second.probability == pytest.approx(19 * other.probability)  # as they were to each other


def test_the_more_is_left_the_surer_it_is() -> None:
    given = decision((), 0.8)
    seen = [left(share, 0.1) for share in (0.7, 0.8, 1.0)]
    sure = [doubt_on_holdout(given, FITS, (), motion(one), one)[0].probability for one in seen]
    assert sure == sorted(sure) and sure[0] < sure[-1]


def test_a_verdict_that_closes_nothing_where_it_is_said_to_be_is_unknown() -> None:
    """Though the whole model does: much that is tolerated stands in for what is not known."""
    given, much = decision(("payload@2",), 0.95), motion(left(0.1, 0.1))
    assert doubt_on_holdout(given, FITS, given.verdict, much, left(0.1, 1.0))[0].verdict == ("unknown@2",)
    assert doubt_on_holdout(given, FITS, given.verdict, much, left(1.0, 0.1)) == (given, None)
    assert doubt_on_holdout(given, FITS, (), much, replay(FAR)) == (given, None)  # none is said: it was withdrawn


@pytest.mark.parametrize("name", ["payload@2", "gravity_tilt@0"])
def test_what_closes_its_own_joint_is_there_though_another_one_is_not_explained(name: str) -> None:
    given, after = decision((name,), 0.95), left(1.0, 0.1)
    assert doubt_on_holdout(given, FITS, given.verdict, motion(after), after) == (given, None)


def test_of_two_effects_the_one_that_closes_its_joint_stays() -> None:
    both, after = ("backlash@1", "payload@2"), left(1.0, 0.1)
    found, told = doubt_on_holdout(decision(both, 0.95, also=("payload@2",)), FITS, both, motion(after), after)
    assert found.verdict == ("payload@2",) and found.probability == pytest.approx(1.0)
    assert told == {"verdict": list(both), "joint": 1, "left": pytest.approx(1.0)}
    given = decision(both, 0.95, also=("payload@2",))
    assert doubt_on_holdout(given, {}, both, motion(after), after) == (given, None)  # it was not fitted by itself


@pytest.mark.parametrize("named", [0.5, 0.99, 1.0, 1.005, 2.0])
@pytest.mark.parametrize("based", [0.5, 1.0, 2.0])
def test_what_is_said_never_leaves_more_than_the_robot_file(
    named: float, based: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever effect and base parameters leave together, and the effect alone, in shares of what there was."""
    cause = {"effect": "payload", "joint": 2, "parameters": {"payload": {"value": 1.0}}}
    stated = StatedEffects(("payload@2",), (cause,))
    plain: Any = "robot file"
    both: Any = "all effects"

    def simulate(said: Any) -> Replay:
        return left(named * based, named * based) if said.base_parameters else left(named, named)

    monkeypatch.setattr(verdict, "apply_verdict", lambda _, said: (said, []))
    other = HoldoutMotion(HELD, simulate, replay(FAR), replay(FAR), left(0.1, 0.1))
    found = withdraw_harmful(plain, both, stated, [other], {"mass_1": {"value": 2.0}})
    gap, model = found.gap, found.arm
    assert gap["after"] <= gap["before"] and gap["achievable"] <= min(gap["after"], gap["flexible"])
    assert gap["after"] == pytest.approx(found.after.gap, rel=1e-9)
    assert (model is both) == (found.effects == ("payload@2",)) == (not found.is_withdrawn)
    assert (model is both) == (min(named, named * based) < 1.0)
    assert (gap["after"] == gap["before"]) == (model is plain)


@pytest.mark.parametrize("names", [(), ("unknown@1",)])
def test_a_verdict_that_changes_nothing_closes_nothing(names: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    """Though the model with every effect at no size happens to err less than the robot file's own."""
    monkeypatch.setattr(verdict, "apply_verdict", lambda arm, _: (arm, []))
    plain: Any = "robot file"
    found = withdraw_harmful(plain, plain, StatedEffects(names, ()), [motion(left(0.5, 0.5))], {})
    assert found.effects == names and found.base_parameters == {}
    assert found.gap["after"] == found.gap["before"]
    assert found.is_withdrawn


def test_what_makes_one_motion_worse_is_withdrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """The blocks that judge, or the log that is held out."""
    monkeypatch.setattr(verdict, "apply_verdict", lambda arm, _: (arm, []))
    cause = {"effect": "payload", "joint": 2, "parameters": {"payload": {"value": 1.0}}}
    better, worse = motion(left(0.1, 0.1)), motion(left(1.1, 1.1))
    stated = StatedEffects(("payload@2",), (cause,))
    for motions, kept in (([better], ("payload@2",)), ([better, worse], ()), ([worse, better], ())):
        plain: Any = "robot file"
        found = withdraw_harmful(plain, plain, stated, motions, {})
        assert found.effects == kept
        assert (found.gap["after"] < found.gap["before"]) == bool(kept)


def strange(probability: float) -> Decision:
    """Something unknown at joint 1, a payload, and none, the latter two 3 to 1."""
    fit: Any = "where it stands"
    shares = ((("unknown@1",), probability), (("payload@2",), 0.75 * (1 - probability)), ((), 0.25 * (1 - probability)))
    hypotheses = tuple(Hypothesis(names, share, None if "unknown@1" in names else fit) for names, share in shares)
    return Decision(hypotheses, ("unknown@1",), probability, probability, fit)


def test_what_is_known_is_said_without_what_is_not() -> None:
    found = remove_unknown(strange(0.9))
    assert found.verdict == ("payload@2",) and found.uncalibrated_probability == pytest.approx(0.75)
    assert {h.names for h in found.hypotheses} == {("payload@2",), ()}
    fit: Any = "where it stands"
    bare = Decision((Hypothesis(("unknown@1",), 0.9, None), Hypothesis((), 0.1, fit)), ("unknown@1",), 0.9, 0.9, fit)
    assert remove_unknown(bare).verdict == ()


def is_unknown(found: Decision, odds: float) -> bool:
    """Whether something unknown has these odds against all that is known, or the least there are, but for the
    calibration."""
    odds = max(odds, LEAST_UNKNOWN_ODDS)
    assert sum(h.probability for h in found.hypotheses) == pytest.approx(1.0)
    unknown = sum(h.probability for h in found.hypotheses if h.is_unknown)
    return bool(unknown == pytest.approx(odds / (1.0 + odds), abs=0.05))


SAID = ("payload@2",)


@pytest.mark.parametrize(
    "most", [0.02, 0.2, 0.5, HOLDOUT_CHECK.most_remaining_share - 1e-3, HOLDOUT_CHECK.most_remaining_share + 1e-3, 1.0]
)
def test_what_closes_a_third_of_its_joints_error_is_there(most: float) -> None:
    """Whatever is unknown beside it: of odds of 9 no more than what is left of two thirds stays."""
    structure = replay(dict.fromkeys(FAR, 1.0))  # a regression tells it all
    found = reweigh_unknown(strange(0.9), SAID, motion(structure), left(0.01, most))
    assert found.verdict == (SAID if most <= HOLDOUT_CHECK.most_remaining_share else ("unknown@1",))
    odds = 9.0 * min(most / HOLDOUT_CHECK.most_remaining_share, 1.0) ** 4
    expected = (
        min(odds, 0.75 * most / HOLDOUT_CHECK.most_remaining_share)
        if most <= HOLDOUT_CHECK.most_remaining_share
        else odds
    )
    assert is_unknown(found, expected)


def test_what_closes_its_own_joint_is_there_whatever_another_one_lacks() -> None:
    found = reweigh_unknown(strange(0.9), SAID, motion(replay(dict.fromkeys(FAR, 1.0))), left(1.0, 0.01))
    assert found.verdict == SAID


def test_what_base_parameters_close_by_themselves_is_not_the_effects() -> None:
    alone, structure = left(0.01, 0.5), replay(dict.fromkeys(FAR, 1.0))
    assert reweigh_unknown(strange(0.9), SAID, motion(structure, base=left(0.5, 0.6)), alone).is_unknown
    assert not reweigh_unknown(strange(0.9), SAID, motion(structure, base=left(0.5, 0.9)), alone).is_unknown


def test_within_a_few_times_the_noise_nothing_is_unknown() -> None:
    near = replay(dict.fromkeys(FAR, 0.9 * DATA.significant_noise_multiple))
    for flexible in (near, replay(FAR)):
        found = reweigh_unknown(strange(0.999), SAID, motion(flexible), near)
        assert found.verdict == SAID and not found.is_sure  # short windows do not tell it


BASED = left(0.9, 0.4)  # base parameters close as much: the effect has no credit for it


@pytest.mark.parametrize(
    ("most", "flexible", "odds"),
    [(0.5, 0.25, 2.85), (0.5, 0.5, 2.85), (0.5, 0.6, 1.37), (0.5, 5.0, 0.90), (0.7, 5.0, 9.0), (0.3, 0.1, 0.37)],
)
def test_where_no_regression_closes_more_less_of_it_is_unknown(most: float, flexible: float, odds: float) -> None:
    """A regression that closes as little as counts as nothing is no witness."""
    found = reweigh_unknown(strange(0.9), SAID, motion(left(0.9, flexible), base=BASED), left(0.01, most))
    assert is_unknown(found, odds)


@pytest.mark.parametrize(
    ("most", "flexible", "odds"),
    [(0.5, 0.25, 45.6), (0.5, 0.4, 6.95), (0.5, 0.5, 2.85), (0.5, 0.6, 1.37), (0.3, 0.1, 29.9), (0.1, 0.1, 0.0046)],
)
def test_of_what_long_windows_tell_more_is_unknown_where_a_regression_closes_more(
    most: float, flexible: float, odds: float
) -> None:
    given = replace(strange(0.9), undetectable=("contact@1",))
    base = left(0.9, 0.8 * most)
    found = reweigh_unknown(given, SAID, motion(left(0.9, flexible), base=base), left(0.01, most))
    assert is_unknown(found, odds)
    assert found.undetectable == given.undetectable and found.is_long_horizon


@pytest.mark.parametrize("unseen", [None, ()])
def test_where_no_encoder_erred_nothing_bears_out_what_is_known(unseen: tuple[str, ...] | None) -> None:
    given, near = replace(strange(0.9), undetectable=unseen), replay({})
    silent = replace(near, driving_channels=tuple(name for name in near.errors if "position" in name))
    mute = HoldoutMotion(HELD, lambda _: silent, silent, silent, silent)
    assert reweigh_unknown(given, ("payload@2",), mute, silent).is_unknown


def test_what_is_unknown_already_is_left_as_it_is() -> None:
    given = decision(("unknown@2",), 0.7)
    never = replace(motion(replay(FAR)), simulate=lambda _: pytest.fail("it was replayed"))
    assert doubt_on_holdout(given, FITS, (), never, replay(FAR)) == (given, None)


@pytest.mark.parametrize(
    ("after", "interval", "bent", "closes"),
    [
        (90.0, [-0.2, 0.4], False, True),
        (110.0, [-0.2, 0.4], False, False),
        (90.0, [-0.2, 0.4], True, False),  # what is unknown may have bent it
        (90.0, [0.05, 0.2], True, False),  # a little of this motion, which may be none of the next
        (50.0, [0.3, 0.7], True, True),
        (90.0, None, True, True),  # too short for an interval
        (110.0, None, True, False),
    ],
)
def test_beside_something_unknown_a_gap_must_surely_be_much_smaller(
    after: float, interval: list[float] | None, bent: bool, closes: bool
) -> None:
    assert _closes_gap({"before": 100.0, "after": after, "interval": interval}, bent) is closes


@pytest.mark.parametrize(
    ("verdict", "std", "end", "says"),
    [
        (["joint_damping@2"], 0.5, "high", True),
        (["joint_damping@2"], 0.5, "low", True),
        (["joint_damping@2"], 0.5, None, False),
        (["joint_damping@2"], None, "high", False),  # a shape
        (["joint_damping@1"], 0.5, "high", False),  # another candidate's
    ],
)
def test_a_size_at_an_end_of_what_it_may_be_is_more_than_is_known(
    verdict: list[str], std: float | None, end: str | None, says: bool
) -> None:
    inner = {"value": 3.0, "std": 0.1, "unit": "1", "end": None}
    estimate = {"value": 120.0, "std": std, "unit": "N m s/rad", "end": end}
    parameters = {"torsional_stiffness": inner, "torsional_damping": estimate}
    cause = {"effect": "joint_damping", "joint": 2, "parameters": parameters}
    other = {"effect": "joint_damping", "joint": 1, "parameters": {"torsional_damping": inner}}
    assert is_at_bound(verdict, [cause, other]) == says


@pytest.mark.parametrize(
    ("after", "others", "little"),
    [
        (3.0, [1.0], True),  # a few times the noise
        (40.0, [35.0, 900.0], True),  # nothing leaves much less
        (40.0, [900.0, 20.0], False),
        (926.0, [2445.0, 74.0], False),
        (1550.0, [6390.0], False),  # whatever else leaves
        (5.0, [], True),
    ],
)
def test_a_verdict_that_leaves_much_is_not_sure(after: float, others: list[float], little: bool) -> None:
    assert leaves_little(after, others) == little
