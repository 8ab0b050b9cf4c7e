"""Kinematic torsion: what is put in comes back within its standard errors, nothing comes back of nothing, and the basis
that predicts unseen turns."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from hdagen.paper.figures.kinematic_torsion_figures import (
    EXCESS_TORQUES,
    PUBLISHED_TORSION,
    WAVE_GENERATOR_ERROR,
    compare_on_held_out_turns,
    evaluate_torsion,
    measure_torsion,
    torsion_bases,
    turn_slowly,
)
from hdagen.paper.prototype.kinematic_torsion_fit import TorsionFit, angle_difference, fit_torsion, turn_joint
from hdagen.paper.prototype.virtual_prototype import TORSION_JOINT_1, TORSION_JOINT_2, Bench, torsion_changes
from hdagen.prediction.measurement_model import Readings

CHI_SQUARE_999 = 22.46  # six degrees of freedom


def standard_error(found: TorsionFit, s: np.ndarray) -> np.ndarray:
    """Of the fitted curve at turns s, rad."""
    powers = np.vander(s, 6, increasing=True)
    return np.sqrt(np.einsum("ti,ij,tj->t", powers, found.covariance, powers))


@pytest.mark.parametrize("j", PUBLISHED_TORSION)
@pytest.mark.parametrize("fine", [True, False])
def test_the_published_coefficients_come_back(bench: Bench, j: int, fine: bool) -> None:
    """Each within three standard errors, all six together likely; the errors are not just wide."""
    found = measure_torsion(bench, j, fine).fit
    assert (
        np.abs(found.deviations_from(PUBLISHED_TORSION[j])).max() < 3
        and found.squared_distance_to(PUBLISHED_TORSION[j]) < CHI_SQUARE_999
    )
    s = np.linspace(0, 1, 101)
    sure = standard_error(found, s)
    assert (
        np.abs(evaluate_torsion(found.coefficients, s) - evaluate_torsion(PUBLISHED_TORSION[j], s)) < 3.5 * sure
    ).all()
    assert sure.max() < (2e-6 if fine else 6e-5), "two µrad of 3.5 mrad, with 16 µrad of noise and counting in a row"
    wrong = np.asarray(PUBLISHED_TORSION[j]) * [1, 1, 1.3, 1, 1, 1]
    assert not fine or found.squared_distance_to(wrong.tolist()) > 10 * CHI_SQUARE_999, "another set is told apart"


def test_standard_errors_are_what_other_noise_gives(bench: Bench) -> None:
    """Two coefficients of three lie within one, as they should, and all six together where chance has them."""
    fits = [measure_torsion(bench, 1, True, repeat).fit for repeat in range(12)]
    off = np.abs([found.deviations_from(TORSION_JOINT_1) for found in fits])
    assert 0.5 < (off < 1).mean() < 0.85 and (off < 2).mean() > 0.85
    assert 3.0 < np.mean([found.squared_distance_to(TORSION_JOINT_1) for found in fits]) < 9.0, (
        "six, and one of standard error"
    )


def test_of_no_torsion_none_is_found(bench: Bench) -> None:
    none = torsion_changes(1, (0.0,) * 6)
    logs = [
        (turn_joint(bench, 1, EXCESS_TORQUES[0], way, none, fine=True).log, way, EXCESS_TORQUES[0]) for way in (1, -1)
    ]
    found = fit_torsion(logs, 1, 100.0)
    s = np.linspace(0, 1, 50)
    assert (np.abs(evaluate_torsion(found.coefficients, s)) < 3.5 * standard_error(found, s)).all()
    assert standard_error(found, s).max() < 4e-6
    assert found.squared_distance_to((0.0,) * 6) < CHI_SQUARE_999


def test_the_torsion_does_not_depend_on_the_torque(bench: Bench) -> None:
    """Fig. 14: fits of one torque each are one curve."""
    logs = measure_torsion(bench, 1, True).logs
    s = np.linspace(0, 1, 50)
    fits = [fit_torsion([(logs[above, way], way, above) for way in (1, -1)], 1, 100.0) for above in EXCESS_TORQUES]
    for one, other in combinations(fits, 2):
        apart, together = one.coefficients - other.coefficients, one.covariance + other.covariance
        assert float(apart @ np.linalg.solve(together, apart)) < CHI_SQUARE_999
    curves = np.stack([evaluate_torsion(one.coefficients, s) for one in fits])
    assert np.ptp(curves, axis=0).max() < 2.5e-3 * np.ptp(curves[0])


def test_the_published_torsion_is_what_the_arm_has() -> None:
    """In turns at one turn 3.5e-3 rad, and 3.2e-4 at most; in radians −1.1 and −2.3 rad, which no gear has."""
    s = np.linspace(0, 1, 1001)
    assert evaluate_torsion(TORSION_JOINT_1, s)[-1] == pytest.approx(3.51e-3, rel=1e-2) and evaluate_torsion(
        TORSION_JOINT_2, s
    ).max() == pytest.approx(3.2e-4, rel=1e-2)
    assert evaluate_torsion(TORSION_JOINT_1, np.array([2 * np.pi]))[0] == pytest.approx(-1.1, rel=0.02)
    assert evaluate_torsion(TORSION_JOINT_2, np.array([2 * np.pi]))[0] == pytest.approx(-2.3, rel=0.02)


def test_a_replay_begins_where_the_kinematic_torsion_is_larger_than_any_of_the_springs(bench: Bench) -> None:
    """Motor and joint differ there by 3.5 mrad, which the model knows: both encoders are believed."""
    arm = bench.arm(changes=torsion_changes(1, TORSION_JOINT_1))
    log = turn_joint(bench, 1, EXCESS_TORQUES[0], -1, torsion_changes(1, TORSION_JOINT_1), fine=True).log
    begin = Readings.from_log(arm, log).state_at(arm, 0)
    for side in ("motor", "joint"):
        assert begin[arm.index(f"{side}_position_1")] == pytest.approx(log[f"{side}_position_1"][0], abs=1e-3)
    assert abs(arm.outputs(begin, np.zeros(arm.nu))["torsion"][0]) < 1e-4


def test_the_basis_that_has_the_wave_generator_too_predicts_unseen_turns(bench: Bench) -> None:
    flat = torsion_changes(1, (TORSION_JOINT_1[0], -sum(TORSION_JOINT_1[2:]), *TORSION_JOINT_1[2:]))
    log = turn_slowly(bench, flat | {"kinematic_sine_twice_1": WAVE_GENERATOR_ERROR})
    left = compare_on_held_out_turns(log, 1, 100.0)
    best = min(left, key=lambda name: left[name][1])
    assert best == "both Fourier, and a ratio" and left[best][1] < 2e-5
    assert left["(13), begun anew every turn"][1] == pytest.approx(WAVE_GENERATOR_ERROR / np.sqrt(2), rel=0.05)
    assert left["(13), continued"][1] > 50 * left["(13), begun anew every turn"][1]
    s, y = angle_difference(log, 1, 100.0)
    assert s.max() > 3 and np.abs(y).max() < 0.02 and set(left) == set(torsion_bases())
