"""What prediction over long windows takes from the odds of a set; a set that it speaks against does not lead."""

from __future__ import annotations

import math

import numpy as np
import pytest
from replayed import erring
from test_diagnosis_decision import beside_a_bias

from hdagen.diagnosis.data.held_out_gap import evaluate_gap, measure_block_errors
from hdagen.diagnosis.data.split import LogPortion
from hdagen.diagnosis.decision.posterior import score_hypotheses
from hdagen.diagnosis.holdout.holdout_check_settings import HOLDOUT_CHECK
from hdagen.diagnosis.holdout.long_window_prediction import compare_errors
from hdagen.log.measured_log import Log

THERMAL = ("thermal_friction@2",)


def test_what_errs_about_alike_loses_nothing() -> None:
    best = np.geomspace(2.0, 90.0, 12)
    assert compare_errors(np.stack([best, 1.4 * best, best[::-1]])).tolist() == [0.0, 0.0, 0.0]


def test_below_the_noise_nothing_errs_more_than_another() -> None:
    assert compare_errors(np.array([[0.1, 0.2], [0.9, 1.0]])).tolist() == [0.0, 0.0]


def test_each_block_counts_as_one_observation_of_a_scale() -> None:
    best = np.full(20, 10.0)
    lost = compare_errors(np.stack([best, 6.0 * best]))
    assert lost.tolist() == pytest.approx([0.0, -20 * math.log(6.0 / HOLDOUT_CHECK.error_margin)])
    assert compare_errors(np.stack([best[:5], 6.0 * best[:5]])).tolist() == pytest.approx([0.0, lost[1] / 4])


@pytest.mark.parametrize("broken", [math.inf, math.nan])
def test_a_simulation_that_flies_apart_errs_most(broken: float) -> None:
    assert compare_errors(np.array([[5.0, 5.0], [5.0, broken]])).tolist()[1] < -100.0


def test_blocks_are_those_of_the_gap() -> None:
    rng = np.random.default_rng(1)
    names = ("motor_position_1", "joint_position_1")
    log = Log(1e-3 * np.arange(8000), {name: rng.normal(size=8000) for name in names}, 1, "log.csv")
    seen, portion = (erring(log, 9.0, 1), erring(log, 3.0, 2)), LogPortion.all_rows(log)
    errors = measure_block_errors(seen, portion)
    assert errors.shape == (2, 8)
    told = evaluate_gap(*seen, portion)
    assert errors.mean(1).tolist() == pytest.approx([told["before"], told["after"]], rel=0.01)


def test_a_set_that_predicts_several_times_worse_does_not_lead() -> None:
    search = beside_a_bias(0.5, 0.0, alone=-1.0)
    search.fits[2].tempered_evidence = lambda *_: 1.0  # none is likelier in short windows
    assert score_hypotheses(search).verdict == ()
    assert score_hypotheses(search, {(): -30.0, THERMAL: 0.0}).verdict == THERMAL
    leads = score_hypotheses(search, {THERMAL: -90.0, ("current_bias@2", *THERMAL): -90.0, (): 0.0})
    assert leads.verdict == () and leads.probability > 0.9
