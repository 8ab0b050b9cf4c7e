"""The linear model of a record: what its columns promise is what a simulation keeps, and what flies apart has none."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from catalogue import EFFECTS
from compiled import Compiled
from replayed import FLEXIBLE, SEVERAL, simulated

from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.data.split import LogPortion
from hdagen.diagnosis.data.windows import cut_windows
from hdagen.diagnosis.inference import alternative_starts, gauss_newton
from hdagen.diagnosis.inference.alternative_starts import refit_from_start
from hdagen.diagnosis.inference.candidate_priors import Candidate, CandidateSet, Column
from hdagen.diagnosis.inference.linearization import compute_sensitivities
from hdagen.diagnosis.inference.multiple_shooting import MultipleShooting
from hdagen.diagnosis.inference.rollout import Rollout
from hdagen.diagnosis.inference.sensitivities import OperatingPoint, Sensitivities, weigh_residual
from hdagen.diagnosis.initialization.candidate_list import build_candidates
from hdagen.diagnosis.initialization.initial_guess import guess_from_log
from hdagen.diagnosis.search.null_model import make_nominal_point

Builder = Callable[..., Compiled]


@pytest.fixture(scope="module")
def shooting(build: Builder) -> MultipleShooting:
    arm = Arm(build(FLEXIBLE, effects=SEVERAL).folder)
    log = simulated(arm)
    return MultipleShooting(arm, cut_windows(arm, LogPortion(log, np.ones(len(log), bool)), 0.05))


def moved(at: Sensitivities, c: Column) -> tuple[np.ndarray, np.ndarray]:
    """What the column of ``c`` promises of a step of its, and what a simulation makes of it (R, M)."""
    q = list(at.shooting.arm.parameters.described.values())[c.index]
    step = c.step if q.low <= at.point.p[c.index] + c.step * c.unit <= q.high else -c.step
    p = at.point.p.copy()
    p[c.index] += step * c.unit
    column = at.columns[at.shooting.m + at.k + at.candidates.columns.index(c)].reshape(at.residual.shape)
    return step * column, at.residual - weigh_residual(
        at.shooting, at.shooting.predict(Rollout(p, at.point.initial_states))
    )


@pytest.mark.parametrize("tolerated", [0.0, 2.0])
def test_a_column_is_what_its_parameter_does_where_the_point_stands(
    shooting: MultipleShooting, tolerated: float
) -> None:
    """Walls are tolerated where the log suggests them, not where the model has them by itself, which may be in the
    middle of the motion; so are ripples."""
    arm = shooting.arm
    hints = guess_from_log(arm, shooting.record)
    hints.shapes["ripple_order_1"] = 7.0, 1.0
    words = build_candidates(arm, hints)
    start = make_nominal_point(shooting, words)
    names = list(arm.parameters.described)
    assert start.p[names.index("ripple_order_1")] == 7.0
    assert start.p[names.index("contact_above_1")] == hints.shapes["contact_above_1"][0]
    for c in words.columns:
        if c.candidate >= 0 and words.members[c.candidate].has_default_shapes:
            start.p[c.index] = c.center + tolerated * c.spike_width * c.unit
    at = compute_sensitivities(shooting, words, OperatingPoint(start.p, shooting.measured_initial_states(start.p)))
    for c in words.columns:
        if c.candidate < 0 or words.members[c.candidate].has_default_shapes:
            promised, kept = moved(at, c)
            np.testing.assert_allclose(promised, kept, atol=1e-6 * max(1.0, np.abs(kept).max()), err_msg=c.parameter)


def test_what_flies_apart_has_no_slope_beyond_its_channels_ranges(shooting: MultipleShooting) -> None:
    words = build_candidates(shooting.arm, guess_from_log(shooting.arm, shooting.record)).always_fitted
    good = shooting.predict_near

    class Flying(SimpleNamespace):
        def predict_near(self, here: Any, lanes: Any) -> list[np.ndarray]:
            base = shooting.predict(here)
            return [1e200 * np.sign(seen - base) for seen in good(here, lanes)]

    flying: Any = Flying(**{name: getattr(shooting, name) for name in ("arm", "record", "m", "predict_with_memory")})
    at = compute_sensitivities(flying, words, OperatingPoint(*shooting.nominal_start()))
    most = 2.0 * np.ptp(shooting.record.samples, axis=0) / shooting.record.sample_noise
    steps = np.array([c.step for c in words.columns])
    own = np.abs(at.columns[at.shooting.m + at.k :]).reshape(len(steps), *at.residual.shape)
    assert (own <= most / steps[:, None, None] * (1 + 1e-9)).all()


def test_a_set_begins_anew_from_the_robot_files_numbers_with_its_own_effects(monkeypatch: pytest.MonkeyPatch) -> None:
    names = ["mass_1", "payload_mass_2", "contact_stiffness_above_1", "contact_above_1"]
    arm = SimpleNamespace(parameters=SimpleNamespace(described=dict.fromkeys(names)))
    atoms = (
        Candidate(EFFECTS["payload"], 2, ("payload_mass_2",), {}, True),
        Candidate(EFFECTS["contact"], 1, ("contact_stiffness_above_1",), {"contact_above_1": 1.0}, True),
    )
    bent = SimpleNamespace(p=np.array([9.0, 0.5, 70.0, 0.8]))
    shooting = SimpleNamespace(arm=arm, filtered_initial_states=lambda p: p[:1])
    at = SimpleNamespace(shooting=shooting, point=bent)
    fit: Any = SimpleNamespace(
        sensitivities=at, score=SimpleNamespace(posterior=SimpleNamespace(s=0.1)), noise_only_evidence=-1.0
    )
    monkeypatch.setattr(alternative_starts, "start_fit_at", lambda shooting, words, atoms, point, near, clean: point)
    start = OperatingPoint(np.array([1.0, 0.0, 0.0, 1.0]), np.zeros(1))
    for some, p in (((0,), [1.0, 0.5, 0.0, 1.0]), ((0, 1), [1.0, 0.5, 70.0, 0.8])):
        begun: Any = refit_from_start(start, fit, CandidateSet(atoms, ()), some)
        np.testing.assert_array_equal(begun.p, p)
        np.testing.assert_array_equal(begun.initial_states, [1.0])  # where the windows begin is told by its own numbers
    np.testing.assert_array_equal(start.p, [1.0, 0.0, 0.0, 1.0])


def test_a_window_on_the_wrong_side_begins_anew_where_the_encoders_say(shooting: MultipleShooting) -> None:
    """One that begins wrong by far more than its columns hold for; what the others have found stays theirs."""
    words = build_candidates(shooting.arm, guess_from_log(shooting.arm, shooting.record)).always_fitted
    p, begun = shooting.nominal_start()
    kept = shooting.record.selected_windows
    found = begun.copy()
    found[kept, shooting.m - 1] += 1e-5  # rad/s
    assert (
        gauss_newton._restart_bad_windows(at := compute_sensitivities(shooting, words, OperatingPoint(p, found)), 0.1)
        is at
    )
    wrong, lost = found.copy(), kept[len(kept) // 2]
    wrong[lost, shooting.m // 2 :] = -50.0
    again = gauss_newton._restart_bad_windows(
        compute_sensitivities(shooting, words, OperatingPoint(p, found)).at_point(OperatingPoint(p, wrong)), 0.1
    ).point.initial_states
    np.testing.assert_array_equal(again[lost], begun[lost])
    np.testing.assert_array_equal(np.delete(again, lost, 0), np.delete(found, lost, 0))


def test_points_that_are_looked_at_together_are_what_each_is_alone(shooting: MultipleShooting) -> None:
    """Products of the columns with a residual as it would be at nominal parameters, window by window."""
    arm = shooting.arm
    words = build_candidates(arm, guess_from_log(arm, shooting.record)).always_fitted
    at = compute_sensitivities(shooting, words, OperatingPoint(*shooting.nominal_start()))
    points = []
    for k, c in enumerate(words.columns[:3]):
        p = at.point.p.copy()
        p[c.index] += (0.1 + k) * c.step * c.unit
        points.append(OperatingPoint(p, at.point.initial_states))
    left = np.stack(
        [weigh_residual(shooting, shooting.predict(Rollout(point.p, point.initial_states))) for point in points]
    )
    found = at.batch_residuals(points, left)
    for z, r2, own_theta, point, own in zip(found.z, found.r2, found.theta, points, left, strict=True):
        theta = words.to_theta(point.p)
        nominal = own.reshape(-1) + theta @ at.columns[shooting.m + at.k :]
        np.testing.assert_allclose(z.sum(0), at.columns @ nominal, rtol=1e-9, atol=1e-9 * abs(z).max())
        np.testing.assert_allclose(r2, [nominal[part] @ nominal[part] for part in at.window_slices], rtol=1e-10)
        np.testing.assert_array_equal(own_theta, theta)
        alone = at.at_point(point).linear_model()
        np.testing.assert_allclose(z, alone.z, rtol=1e-9, atol=1e-9 * abs(alone.z).max())
        np.testing.assert_array_equal(found.rows, alone.rows)


def test_what_no_channel_shows_is_silent_and_what_shows_in_its_whole_size_is_not(build: Builder) -> None:
    """Nothing measures the joint's torque; a limit of the drive shows where it is as low as usual, not where higher."""
    arm = Arm(build(FLEXIBLE, effects=SEVERAL).folder)
    log = simulated(arm)
    shooting = MultipleShooting(arm, cut_windows(arm, LogPortion(log, np.ones(len(log), bool)), 0.05))
    words = build_candidates(arm, guess_from_log(arm, shooting.record))
    at = compute_sensitivities(shooting, words, OperatingPoint(*shooting.nominal_start()))
    column = next(k for k, c in enumerate(words.columns) if c.parameter == "saturation_inverse_1")
    head = shooting.m + at.k
    silent = {words.members[k].name for k in at.with_visible_columns().undetectable_candidates()}
    assert silent >= {"torque_sensor_gain@1"} and not {name for name in silent if "cable" in name}
    reached = np.abs(log["motor_current_command_1"]).max() * words.columns[column].unit > 1.0
    assert ("current_saturation@1" in silent) is not reached
    wide = at.with_finite_step([column])
    np.testing.assert_array_equal(np.delete(wide.columns, head + column, 0), np.delete(at.columns, head + column, 0))
    p = at.point.p.copy()
    p[words.columns[column].index] += words.columns[column].unit
    kept = at.residual - weigh_residual(shooting, shooting.predict(Rollout(p, at.point.initial_states)))
    np.testing.assert_allclose(
        wide.columns[head + column].reshape(kept.shape), kept, atol=1e-6 * max(1.0, np.abs(kept).max())
    )
