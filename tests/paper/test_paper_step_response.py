"""Settling, overshoot and displacement against closed forms, and the ideal against another solver."""

from __future__ import annotations

import numpy as np
import pytest

from hdagen.control.guarded_controller import Controller
from hdagen.paper.prototype.step_response import SETTLED_BAND, damping_ratio, measure_responses, simulate_ideal
from hdagen.paper.prototype.virtual_prototype import CIRCLE_PUSHES, PERIOD, Bench, cartesian_gains, make_controller
from hdagen.simulation.ideal_admittance import simulate_ideal_admittance

LONG = type(CIRCLE_PUSHES[0])(1.0, 9.0, (10.0, 0.0))


@pytest.mark.parametrize("M, B, K", [(2.0, 10.0, 500.0), (4.0, 40.0, 500.0), (1.0, 100.0, 300.0)])
def test_of_a_long_push_overshoot_and_displacement_are_the_closed_forms(M: float, B: float, K: float) -> None:
    moved = simulate_ideal(np.array([[M, B, K]]), [LONG], 11.5, PERIOD)
    settling, overshoot, largest = measure_responses(moved, [LONG], PERIOD)[0, 0]
    ratio = float(damping_ratio(*np.array([[M], [B], [K]]))[0])
    swing = np.exp(-np.pi * ratio / np.sqrt(1 - ratio**2)) if ratio < 1 else 0.0
    assert largest == pytest.approx(10.0 / K * (1 + swing), rel=1e-4)
    assert overshoot == pytest.approx(swing / (1 + swing), abs=2e-4)
    slow = B / (2 * M) if ratio < 1 else (B - np.sqrt(B**2 - 4 * K * M)) / (2 * M)
    assert settling <= (-np.log(SETTLED_BAND) + np.log(1 / np.sqrt(abs(1 - ratio**2)) + 1)) / slow, (
        "within the envelope"
    )
    assert settling > 0.2 / slow


def test_the_ideal_is_that_of_the_simulation(bench: Bench) -> None:
    law: Controller = make_controller(bench.arm(), "admittance", cartesian_gains(3.0, 20.0, 400.0))
    time = np.arange(8000) * PERIOD
    push = np.zeros((8000, 2))
    for one in CIRCLE_PUSHES:
        push[(time >= one.start) & (time < one.end)] += one.force
    ours = simulate_ideal(np.array([[3.0, 20.0, 400.0]]), CIRCLE_PUSHES, 8.0, PERIOD)[:, 0]
    assert np.abs(ours - simulate_ideal_admittance(law, push, PERIOD)).max() < 1e-12


def test_coarse_rows_of_the_ideal_are_fine_rows() -> None:
    sets = np.array([[0.5, 5.0, 2000.0], [32.0, 500.0, 200.0]])
    assert (
        np.abs(
            simulate_ideal(sets, CIRCLE_PUSHES, 8.0, 0.01) - simulate_ideal(sets, CIRCLE_PUSHES, 8.0, PERIOD)[::10]
        ).max()
        < 1e-10
    )


def test_what_is_lost_or_does_not_settle_has_no_number() -> None:
    swinging = simulate_ideal(np.array([[16.0, 1.0, 500.0]]), CIRCLE_PUSHES, 10.0, PERIOD)
    far = np.full_like(swinging, 2.0)
    found = measure_responses(np.concatenate([swinging, far, far * np.nan], axis=1), CIRCLE_PUSHES, PERIOD)
    assert np.isnan(found[0, :, 0]).all() and np.isfinite(found[0, :, 1:]).all()
    assert np.isnan(found[1:]).all()
