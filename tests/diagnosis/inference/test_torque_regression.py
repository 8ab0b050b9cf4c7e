"""Starts from a regression of the missing torque: regressors against closed forms; sets that are put in and found."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import pytest
from compiled import Compiled
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
from hdagen.log.column_map import name_command_channel
from hdagen.log.measured_log import Log

Builder = Callable[..., Compiled]
JOINT = """[[joint]]
length = 0.2
mass = 0.5
center_of_mass = 0.1
inertia = 0.004
[joint.drive]
rigid = true
ratio = 1
motor_inertia = 0.01
viscous_friction = {viscous}
coulomb_friction = {coulomb}
friction_smoothing = 0.05
[joint.sensor]
joint_encoder_noise = 1e-5
"""
EFFECTS = ("current_saturation", "voltage_sag", "quadratic_friction", "load_dependent_friction", "torque_constant")
TRUTH = {"coulomb_friction_1": 0.6, "viscous_friction_1": 0.15, "coulomb_friction_2": 0.35, "viscous_friction_2": 0.1}


def legs(build: Builder, viscous: float = 0.0, coulomb: float = 0.0) -> Arm:
    """Two rigid joints of ratio 1 that hang."""
    joint = JOINT.format(viscous=viscous, coulomb=coulomb)
    return Arm(build(f'name = "leg"\ngravity = [9.81, 0]\n{joint}{joint}', effects=EFFECTS).folder)


def driven(arm: Arm, truth: Mapping[str, float], seconds: float = 6.0, gain: float = 40.0) -> Log:
    """The log of a machine with ``truth`` that follows sums of sines."""
    machine, p, names = arm, arm.p.copy(), list(arm.parameters.described)
    for name, value in truth.items():
        p[names.index(name)] = value
    machine = arm.with_parameters(p)
    rng, h = np.random.default_rng(3), 2e-3
    time = h * np.arange(round(seconds / h))
    waves = np.stack([np.sin(2 * np.pi * np.outer(time, (0.4, 1.1)) + rng.uniform(0, 6, 2)).sum(1) for _ in "12"], 1)
    wanted = 0.5 * np.clip(time, 0, 1)[:, None] * waves
    speed = np.gradient(wanted, h, axis=0)
    at = [arm.index(f"joint_{what}_{j}") for what in ("position", "velocity") for j in (1, 2)]
    x, u, rows = arm.rest([0.0, 0.0]), np.zeros(arm.nu), []
    for k in range(len(time)):
        q, v = x[at[:2]] + 1e-5 * rng.standard_normal(2), x[at[2:]]
        u[:2] = gain * (wanted[k] - q) + 0.03 * gain * (speed[k] - v)
        rows.append([*q, *u[:2]])
        x = machine.rollout(x, u[None], h, exact=True)[-1]
    names = ["joint_position_1", "joint_position_2", *(name_command_channel(f"motor_torque_{j}") for j in (1, 2))]
    return Log(time, dict(zip(names, np.ascontiguousarray(np.array(rows).T), strict=True)), 2, "leg")


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
    arm, truth, gain = legs(build, *request.param), TRUTH, 40.0
    if any(request.param):
        truth, gain = {"coulomb_friction_1": 2.5, "coulomb_friction_2": 2.0}, 120.0
    return arm, truth, driven(arm, truth, gain=gain)


def test_frictions_that_the_file_lacks_at_both_joints_are_found_together(
    lacking: tuple[Arm, dict[str, float], Log],
) -> None:
    arm, truth, log = lacking
    found, words = regressed(arm, log)
    sets = {words.names_of(one.effects): one for one in found.best_sets()}
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
    described, left_out = (legs(build, *stated).parameters.described for stated in ((0.1, 0.05), (0.0, 0.0)))
    for name in TRUTH:
        assert described[name].high == left_out[name].high


def test_where_nothing_is_missing_no_set_is_proposed(build: Builder) -> None:
    arm = legs(build, 0.1, 0.3)
    found, _ = regressed(arm, driven(arm, {}))
    assert found.best_sets() == [] and found.distant_effects() == {}


def test_friction_of_a_slow_joint_has_its_whole_level_however_wide_its_smooth_sign_is(build: Builder) -> None:
    arm = legs(build, 0.1, 0.3)
    motion = MeasuredMotion(arm, driven(arm, {}), ())
    left = TorqueBalance(motion).residual(arm.p).motor
    speed = np.abs(motion.sensed_states[:, arm.index("joint_velocity_1")])
    is_slow = motion.valid & motion.is_sliding(1) & (speed < 0.15)
    lacking = 0.3 * (1.0 - np.tanh(speed[is_slow] / 0.05))  # N m, of the smooth sign
    assert is_slow.sum() > 20 and lacking.max() > 0.1
    assert np.abs(left[is_slow, 0]) @ lacking < 0.3 * (lacking @ lacking)


def test_regressors_of_friction_are_speed_and_its_sign(build: Builder) -> None:
    arm = legs(build)
    log = driven(arm, TRUTH)
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
    arm = legs(build)
    still = driven(arm, {"coulomb_friction_1": 500.0, "coulomb_friction_2": 500.0}, 2.0)
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
