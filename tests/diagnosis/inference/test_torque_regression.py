"""Starts from a regression of the missing torque: regressors against closed forms; sets that are put in and found."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from compiled import Compiled
from hanging_legs import build_legs, drive_legs
from replayed import FLEXIBLE, SEVERAL, simulated

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.data.split import LogPortion
from hdagen.diagnosis.data.windows import cut_windows
from hdagen.diagnosis.inference.candidate_priors import CandidateSet
from hdagen.diagnosis.initialization.candidate_list import build_candidates
from hdagen.diagnosis.initialization.initial_guess import guess_from_log
from hdagen.diagnosis.initialization.initialization_settings import INITIALIZATION
from hdagen.diagnosis.initialization.torque_regression import TorqueRegression
from hdagen.diagnosis.residuals.measured_motion import MeasuredMotion
from hdagen.diagnosis.residuals.torque_balance import TorqueBalance
from hdagen.diagnosis.search.fit_ranking import sort_by_evidence
from hdagen.diagnosis.search.hypothesis_search import search_hypotheses
from hdagen.diagnosis.search.null_model import fit_null_model
from hdagen.diagnosis.stages.stage import ignore_stage
from hdagen.log.measured_log import Log

Builder = Callable[..., Compiled]
TRUTH = {"coulomb_friction_1": 0.6, "viscous_friction_1": 0.15, "coulomb_friction_2": 0.35, "viscous_friction_2": 0.1}


def regressed(arm: Arm, log: Log) -> tuple[TorqueRegression, CandidateSet]:
    seen = cut_windows(arm, LogPortion.all_rows(log), 0.05)
    words = build_candidates(arm, guess_from_log(arm, seen))
    found = TorqueRegression.from_record(arm, seen, words)
    assert found is not None
    return found, words


def sizes(arm: Arm, words: CandidateSet, theta: Array) -> dict[str, float]:
    """The parameters that sizes θ move, by name."""
    names = list(arm.parameters.described)
    return {names[c.index]: c.center + float(t) * c.unit for c, t in zip(words.columns, theta, strict=True) if t}


@pytest.fixture(scope="module", params=[(0.0, 0.0), (0.1, 0.05)])
def lacking(build: Builder, request: pytest.FixtureRequest) -> tuple[Arm, dict[str, float], Log]:
    """An arm with the frictions that its file states, those of the machine, and the machine's log."""
    arm, truth, gain = build_legs(build, *request.param), TRUTH, 40.0
    if any(request.param):
        truth, gain = {"coulomb_friction_1": 2.5, "coulomb_friction_2": 2.0}, 120.0
    return arm, truth, drive_legs(arm, truth, gain=gain)


def test_frictions_that_the_file_lacks_at_both_joints_are_found_together(
    lacking: tuple[Arm, dict[str, float], Log],
) -> None:
    arm, truth, log = lacking
    found, words = regressed(arm, log)
    sets = {words.names_of(one.effects): one for one in found.best_sets}
    right = tuple(sorted(name.replace("_1", "@1").replace("_2", "@2") for name in truth))
    assert right in sets and max(map(len, sets)) <= INITIALIZATION.largest_regressed_set
    told = sizes(arm, words, sets[right].theta)
    assert told == pytest.approx(truth, rel=0.05)


def test_the_search_ends_with_all_frictions_that_the_file_lacks(lacking: tuple[Arm, dict[str, float], Log]) -> None:
    arm, truth, log = lacking
    null = fit_null_model(arm, cut_windows(arm, LogPortion.all_rows(log.rows(0, 1000)), 0.05))
    best = sort_by_evidence(search_hypotheses(null.shooting, null.candidates, ignore_stage).fits)[0]
    assert best.names == tuple(sorted(name.replace("_1", "@1").replace("_2", "@2") for name in truth))
    names = list(arm.parameters.described)
    fitted = {name: float(best.sensitivities.point.p[names.index(name)]) for name in truth}
    assert fitted == pytest.approx(truth, rel=0.05)


def test_friction_may_be_any_number_of_times_what_the_file_states(build: Builder) -> None:
    described, left_out = (build_legs(build, *stated).parameters.described for stated in ((0.1, 0.05), (0.0, 0.0)))
    for name in TRUTH:
        assert described[name].high == left_out[name].high


def test_where_nothing_is_missing_no_set_is_proposed(build: Builder) -> None:
    arm = build_legs(build, 0.1, 0.3)
    found, _ = regressed(arm, drive_legs(arm, {}))
    assert found.best_sets == [] and found.distant_effects() == {}


def test_friction_of_a_slow_joint_has_its_whole_level_however_wide_its_smooth_sign_is(build: Builder) -> None:
    arm = build_legs(build, 0.1, 0.3)
    motion = MeasuredMotion(arm, drive_legs(arm, {}), ())
    left = TorqueBalance(motion).residual(arm.p).motor
    speed = np.abs(motion.sensed_states[:, arm.index("joint_velocity_1")])
    is_slow = motion.valid & motion.is_sliding(1) & (speed < 0.15)
    lacking = 0.3 * (1.0 - np.tanh(speed[is_slow] / 0.05))  # N m, of the smooth sign
    assert is_slow.sum() > 20 and lacking.max() > 0.1
    assert np.abs(left[is_slow, 0]) @ lacking < 0.3 * (lacking @ lacking)


def test_regressors_of_friction_are_speed_and_its_sign(build: Builder) -> None:
    arm = build_legs(build)
    log = drive_legs(arm, TRUTH)
    found, words = regressed(arm, log)
    missing = found.products[0, -1]
    places = {c.parameter: i for i, c in enumerate(words.columns)}
    v = np.gradient(np.convolve(log["joint_position_1"], np.full(8, 1 / 8), "same"), 2e-3)[20:-20]
    for name, closed in (("viscous_friction_1", v), ("coulomb_friction_1", np.sign(v))):
        i = places[name]
        unit = words.columns[i].unit
        square = found.products[0, i, i] / found.counts[0] / unit**2
        assert square == pytest.approx(float(np.mean(closed**2)), rel=0.1)  # torque of friction by its size
        assert missing[i] > 0  # it is lost
    assert found.products[1, places["viscous_friction_1"]] == pytest.approx(0.0, abs=1e-12)  # of another joint's motor


def test_too_little_motion_has_no_regression(build: Builder) -> None:
    arm = build_legs(build)
    still = drive_legs(arm, {"coulomb_friction_1": 500.0, "coulomb_friction_2": 500.0}, 2.0)
    seen = cut_windows(arm, LogPortion.all_rows(still), 0.05)
    assert TorqueRegression.from_record(arm, seen, build_candidates(arm, guess_from_log(arm, seen))) is None


def test_an_arm_with_two_encoders_a_joint_has_a_balance_on_each_side(build: Builder) -> None:
    arm = Arm(build(FLEXIBLE, effects=SEVERAL).folder)
    p, names = arm.p.copy(), list(arm.parameters.described)
    p[names.index("payload_mass_2")] = 1.0
    found, words = regressed(arm, simulated(arm.with_parameters(p), 3.0))
    assert len(found.counts) == 4
    k = next(k for k, atom in enumerate(words.members) if atom.effect == "payload")
    assert sizes(arm, words, found.fit_set((k,)).theta)["payload_mass_2"] == pytest.approx(1.0, rel=0.1)
