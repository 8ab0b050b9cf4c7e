"""All numbers of a robot file fitted together: several that are wrong come back, and right ones stay."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import pytest
from compiled import Compiled
from hanging_legs import build_legs, drive_legs

from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.data.split import LogPortion
from hdagen.diagnosis.data.windows import cut_windows
from hdagen.diagnosis.inference.gauss_newton import place_sizes
from hdagen.diagnosis.inference.linearization import compute_sensitivities
from hdagen.diagnosis.inference.local_fit import Fit, start_fit
from hdagen.diagnosis.inference.sensitivities import Sensitivities
from hdagen.diagnosis.initialization.torque_regression import TorqueRegression
from hdagen.diagnosis.search.null_model import fit_null_model, make_nominal_point
from hdagen.diagnosis.search.regressed_starts import place_regressed_set
from hdagen.diagnosis.search.whole_file import fit_whole_file

Builder = Callable[..., Compiled]
WRONG = {"mass_2": 1.5, "motor_inertia_1": 2.5, "viscous_friction_1": 4.0, "coulomb_friction_2": 2.0}


def make_truth(arm: Arm, factors: Mapping[str, float]) -> dict[str, float]:
    """The parameters of a machine whose numbers are the file's times some factors."""
    return {name: factor * float(arm.parameters[name]) for name, factor in factors.items()}


def regress_legs(build: Builder, truth: Mapping[str, float]) -> tuple[Sensitivities, TorqueRegression, float]:
    """The sensitivities about the robot file, the regression, and the null model's unexplained torque."""
    arm = build_legs(build, 0.1, 0.2, tolerance=0.05)
    log = drive_legs(arm, make_truth(arm, truth), seconds=4.0, gain=80.0)
    record = cut_windows(arm, LogPortion.all_rows(log), 0.05)
    null = fit_null_model(arm, record, with_numbers=True)
    words = null.candidates
    at = compute_sensitivities(null.shooting, words, make_nominal_point(null.shooting, words)).with_visible_columns()
    regression = TorqueRegression.from_record(arm, record, words)
    assert regression is not None
    return at, regression, null.fit.score.posterior.s


def list_factors(fit: Fit) -> dict[str, float]:
    """The factor of each number of a fit, by parameter."""
    arm, p = fit.sensitivities.shooting.arm, fit.sensitivities.point.p
    words: Any = fit.sensitivities.candidates
    columns = [c for c in words.columns if c.candidate in fit.effects and c.stated]
    return {c.parameter: float(p[c.index]) / float(arm.p[c.index]) for c in columns}


def test_four_wrong_numbers_come_back_together(build: Builder) -> None:
    at, regression, near = regress_legs(build, WRONG)
    fit = fit_whole_file(regression, at, at.candidates, (), near)
    found = list_factors(fit)
    assert found.keys() == WRONG.keys()
    assert found == pytest.approx(WRONG, rel=0.1)


def test_no_number_of_a_right_file_is_kept(build: Builder) -> None:
    at, regression, near = regress_legs(build, {})
    assert fit_whole_file(regression, at, at.candidates, (), near).names == ()


def test_an_effect_that_was_named_without_need_is_dropped(build: Builder) -> None:
    at, regression, near = regress_legs(build, {"mass_2": 1.5})
    fit = fit_whole_file(regression, at, at.candidates, ("quadratic_friction@1",), near)
    assert fit.names == ("mass@2",)


def test_a_regressed_set_starts_with_the_base_parameters_where_the_regression_has_them(build: Builder) -> None:
    """Numbers that are off by what the file admits belong to the start of a set as its own sizes do."""
    at, regression, near = regress_legs(build, {"mass_1": 1.1, "mass_2": 1.1, "viscous_friction_1": 4.0})
    words = at.candidates
    own = tuple(k for k, one in enumerate(words.members) if one.name == "viscous_friction@1")
    found = regression.fit_set(own)
    assert found.nuisance.any() and not found.nuisance[found.theta != 0].any()
    placed = start_fit(at, words, own, near, place_regressed_set(at, words, found))
    own_sizes_only = start_fit(at, words, own, near, place_sizes(at, words, own, found.theta))
    assert placed.evidence_here > own_sizes_only.evidence_here
