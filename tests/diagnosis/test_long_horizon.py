"""What works all the time: truths put into a motion that something unknown shakes are told, and nothing is not."""

from __future__ import annotations

from collections.abc import Callable

import arms
import numpy as np
import pytest
from compiled import Compiled

from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis import long_horizon
from hdagen.diagnosis.data.split import LogPortion
from hdagen.diagnosis.data.windows import cut_windows
from hdagen.diagnosis.holdout.holdout_check_settings import HOLDOUT_CHECK
from hdagen.diagnosis.inference.multiple_shooting import MultipleShooting
from hdagen.diagnosis.initialization.candidate_list import build_candidates
from hdagen.diagnosis.initialization.initial_guess import guess_from_log
from hdagen.diagnosis.long_horizon import LongHorizonSearch, find_lasting_effects
from hdagen.diagnosis.long_window_errors import LongWindowErrors
from hdagen.diagnosis.long_window_fit import LongWindowFit
from hdagen.diagnosis.search.hypothesis_search import SearchResult
from hdagen.diagnosis.search.null_model import fit_without_effects
from hdagen.log.measured_log import Log
from hdagen.prediction.window_replay import REPLAY_WINDOW

Builder = Callable[..., Compiled]
RUBBING = arms.arm("R", rigid="r", drive="[joint.limits]\ntorque = 20.0")
ROBOT = RUBBING.replace("coulomb_friction = 0.03", "coulomb_friction = 0.0")
EFFECTS = ("load_dependent_friction", "asymmetric_friction", "current_bias", "cable_spring", "quadratic_friction")
COUNT = 1e-4  # rad, of the encoder
HELD, SHAKEN = 5, 0.3  # rows for which the unknown torque holds, and its rms as a share of the command's
SECONDS = 10.0


def shaken(arm: Arm, seed: int, **truth: float) -> Log:
    """A log of an arm with ``truth`` among its parameters, under sines and a torque that changes all the time, of
    which the command says nothing."""
    rng, names = np.random.default_rng(seed), list(arm.parameters.described)
    p = arm.p.copy()
    for name, value in truth.items():
        p[names.index(name)] = value
    time = np.arange(0.0, SECONDS, 2e-3)
    swing = np.sin(2 * np.pi * np.outer(time, [0.5, 0.9, 1.3]) + rng.uniform(0, 6, 3)) @ [0.6, 0.5, 0.3]
    command = 0.25 * swing
    beside = SHAKEN * command.std() * np.repeat(rng.standard_normal(len(time) // HELD), HELD)
    u = np.zeros((len(time), arm.nu))
    u[:, 0] = command + beside
    x = arm.with_parameters(p).rollout(arm.rest([-np.pi / 2]), u[:-1], np.diff(time), exact=True)
    q = x[:, arm.index("joint_position_1")]
    columns = {"motor_torque_command_1": command, "joint_position_1": np.round(q / COUNT) * COUNT}
    return Log(time, {name: np.ascontiguousarray(values) for name, values in columns.items()}, 1, "shaken")


def seen(arm: Arm, log: Log) -> LongHorizonSearch:
    """The search in the windows of a log."""
    windows = cut_windows(arm, LogPortion.all_rows(log), REPLAY_WINDOW)
    errors = LongWindowErrors(MultipleShooting(arm, windows), arm.p.copy())
    return LongHorizonSearch(LongWindowFit(errors, build_candidates(arm, guess_from_log(arm, windows))))


def told(arm: Arm, log: Log) -> tuple[tuple[str, ...], dict[str, float], float]:
    """Names of what is told, the parameters with it, and what it leaves of the errors."""
    lasting = seen(arm, log)
    best, *others = lasting.find_effects()
    assert not best.atoms or others[-1].atoms == ()
    assert all(best.cost < one.cost for one in others)
    values = dict(
        zip(arm.parameters.described, lasting.fit.parameters_at(lasting.fit.limit_base_parameters(best)), strict=True)
    )
    return lasting.fit.candidates.names_of(best.atoms), values, float(np.sqrt(np.mean(best.errors**2)))


@pytest.fixture(scope="module")
def arm(build: Builder) -> Arm:
    return Arm(build(ROBOT, "native", EFFECTS).folder)


TRUTHS = {
    "coulomb_friction@1": {"coulomb_friction_1": 0.08},
    "load_dependent_friction@1": {"load_share_1": 0.3},
    "cable_spring@1": {"cable_stiffness_1": 4.0},
}


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("name", TRUTHS)
def test_what_works_all_the_time_is_told_beside_what_shakes(arm: Arm, name: str, seed: int) -> None:
    names, values, left = told(arm, shaken(arm, seed, **TRUTHS[name]))
    assert names == (name,)
    for parameter, value in TRUTHS[name].items():
        assert values[parameter] == pytest.approx(value, rel=0.15)
    assert left < 0.5


@pytest.mark.parametrize("seed", range(3))
def test_of_what_only_shakes_nothing_is_told(arm: Arm, seed: int) -> None:
    assert told(arm, shaken(arm, seed))[0] == ()


def test_an_effect_too_small_to_count_is_found_only_if_its_size_is_known(
    arm: Arm, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = LogPortion.all_rows(shaken(arm, 0, **TRUTHS["coulomb_friction@1"]))
    windows = cut_windows(arm, log, 0.05)
    candidates = build_candidates(arm, guess_from_log(arm, windows))
    null = fit_without_effects(MultipleShooting(arm, windows), candidates)
    result = SearchResult(null.sensitivities.candidates, (null,), ())
    lasting = find_lasting_effects(result, arm, log, 0.05, ())
    assert lasting and lasting.fit.names == ("coulomb_friction@1",)
    monkeypatch.setattr(long_horizon, "keep_present_effects", lambda _: ())
    for deviations, stands in ((1.05, True), (0.95, False)):
        known = {"coulomb_friction@1": deviations * HOLDOUT_CHECK.clear_deviations}
        monkeypatch.setattr(long_horizon, "measure_deviations", lambda _, known=known: known)
        assert (find_lasting_effects(result, arm, log, 0.05, ()) is not None) is stands


def test_what_would_not_show_is_not_told_and_what_would_is(arm: Arm) -> None:
    nothing = seen(arm, shaken(arm, 0))
    unseen = nothing.find_undetectable(nothing.find_effects()[-1])
    words = nothing.fit.candidates
    for effect in ("payload", "current_bias", "quadratic_friction", "cable_spring"):
        own = [c for c in words.columns if c.candidate >= 0 and words.members[c.candidate].effect == effect]
        names, _, _ = told(arm, shaken(arm, 0, **{c.parameter: c.center + c.unit for c in own}))
        assert names == (() if f"{effect}@1" in unseen else (f"{effect}@1",))
    assert unseen == ["payload@1"]  # the links' masses are tolerated as far


def test_of_two_that_differ_at_standstill_alone_one_is_guessed_and_the_other_said(build: Builder) -> None:
    rubbing = Arm(build(RUBBING, "native", EFFECTS).folder)
    lasting = seen(rubbing, shaken(rubbing, 0, bias_1=0.08))
    first, *others, none = lasting.find_effects()
    twins = {"current_bias@1", "asymmetric_friction@1"}
    (guessed,) = twins & set(lasting.fit.candidates.names_of(first.atoms))
    (other,) = twins - {guessed}
    alike = [one for one in others if other in lasting.fit.candidates.names_of(one.atoms)]
    assert min(one.cost for one in alike) < first.cost + 2.0 * np.log(100.0)  # neither is out of the question
    assert none.cost > first.cost + 2.0 * np.log(100.0)
    names, values, _ = told(rubbing, shaken(rubbing, 0, load_share_1=0.3))
    assert names == ("load_dependent_friction@1",)
    assert values["load_share_1"] == pytest.approx(0.3, rel=0.15)


def test_the_same_log_tells_the_same_to_the_bit(arm: Arm) -> None:
    log = shaken(arm, 1, coulomb_friction_1=0.08)
    assert told(arm, log) == told(arm, log)
