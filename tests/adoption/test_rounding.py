"""Fitted numbers keep the digits that the log determines, and no more."""

from __future__ import annotations

import json
from pathlib import Path

import arms
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from replayed import diagnosis
from uncompiled import UncompiledArm, find_settings, load_uncompiled

from hdagen.adoption import robot_update, verdict
from hdagen.adoption.robot_update import adopt
from hdagen.adoption.rounding import read_conditional_deviations, round_parameters, round_to_deviation
from hdagen.diagnosis.decision.parameter_estimates import _compute_conditional_deviations


@given(st.floats(-1e6, 1e6), st.floats(1e-9, 1e6))
def test_a_number_moves_by_less_than_a_hundredth_of_its_deviation(value: float, std: float) -> None:
    rounded = round_to_deviation(value, std)
    assert abs(rounded - value) <= 0.005 * std * (1 + 1e-9) + 1e-15 * abs(value)
    assert round_to_deviation(rounded, std) == rounded
    assert len(repr(rounded).replace("-", "").replace(".", "")) <= 17


@pytest.mark.parametrize(
    ("value", "std", "rounded"),
    [(4.61234, 0.1, 4.612), (1.23456e-5, 3e-7, 1.2346e-5), (9743.123, 1e4, 9700.0), (-0.98765, 0.5, -0.988)],
)
def test_digits_below_a_hundredth_of_the_deviation_are_dropped(value: float, std: float, rounded: float) -> None:
    assert round_to_deviation(value, std) == rounded


@pytest.mark.parametrize("std", [5e-324, 1e-300, 1e300, 1e308])
def test_any_deviation_gives_a_number(std: float) -> None:
    deviations = read_conditional_deviations(_estimate(4.61234, std), verdict.read_verdict(_estimate(4.61234, std)))
    for one in deviations.values():
        assert np.isfinite(round_to_deviation(4.61234, one))


@pytest.mark.parametrize("std", [None, True, "0.1", 0.0, -1.0, 10**400])
def test_what_is_no_deviation_rounds_nothing(std: object) -> None:
    content = _estimate(4.61234, std)
    assert read_conditional_deviations(content, verdict.read_verdict(content)) == {}


def _estimate(value: float, std: object) -> dict:
    return diagnosis(verdict=[], parameters={"mass_1": {"value": value, "std": 0.1, "conditional_std": std}})


def test_the_deviation_with_all_others_held_is_that_of_the_conditional_distribution() -> None:
    draws = np.random.default_rng(0).normal(size=(200, 5)) * [1.0, 3.0, 1e-6, 1e3, 0.2]
    draws[:, 1] += 30.0 * draws[:, 0]  # two that compensate each other
    covariance = np.cov(draws.T)
    expected = []
    for k in range(5):
        rest = [i for i in range(5) if i != k]
        cross = covariance[k, rest]
        expected.append(np.sqrt(covariance[k, k] - cross @ np.linalg.solve(covariance[np.ix_(rest, rest)], cross)))
    found = _compute_conditional_deviations(covariance)
    assert found == pytest.approx(np.array(expected), rel=1e-6)
    assert found[0] < 0.2 * np.sqrt(covariance[0, 0])


def test_parameters_keep_their_bounds_and_the_numbers_of_the_file(tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text(arms.SMALL)
    arm = UncompiledArm(tmp_path / "robot.toml")
    most = arm.parameters.described["mass_1"].high
    fitted = {"mass_1": most, "inertia_1": 0.0812345, "coulomb_friction_1": 0.03, "bias_1": 0.0123456}
    arm.parameters.update(fitted)
    rounded = round_parameters(arm, {"mass_1": 3.0e4, "inertia_1": 1e-3, "coulomb_friction_1": 5.0})
    assert rounded.parameters["mass_1"] == most  # 0 would lie beyond its bounds
    assert rounded.parameters["inertia_1"] == 0.08123
    assert rounded.parameters["coulomb_friction_1"] == 0.03  # the file's
    assert rounded.parameters["bias_1"] == 0.0123456  # without a deviation
    assert arm.parameters["inertia_1"] == 0.0812345  # a copy was changed


def test_the_file_gets_the_rounded_numbers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (verdict, robot_update):
        monkeypatch.setattr(module, "load", load_uncompiled)
    monkeypatch.setattr(robot_update, "find_stable_settings", find_settings)
    (tmp_path / "robot.toml").write_text(arms.SMALL)
    bias = {"bias": {"value": 0.0212345678, "std": 0.004, "conditional_std": 0.0007}}
    stated = diagnosis(
        verdict=["current_bias@1"],
        causes=[{"effect": "current_bias", "joint": 1, "parameters": bias}],
        parameters={"mass_1": {"value": 4.6123456, "std": 0.09, "conditional_std": 0.02}},
    )
    (tmp_path / "diagnosis.json").write_text(json.dumps(stated))
    found = adopt(tmp_path / "diagnosis.json", tmp_path / "robot.toml", None)
    assert {change.where: (change.after, change.std) for change in found.changes} == {
        "joint[1].mass": (4.6123, 0.09),
        "current_bias@1.bias": (0.021235, 0.004),
    }
    assert "mass = 4.6123\n" in found.text and "bias = {value = 0.021235, tolerance = 0.188}" in found.text
