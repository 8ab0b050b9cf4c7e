"""What wrong numbers of the robot file would gain, told without a search for them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pytest
import wrist
from catalogue import EFFECTS

from hdagen.diagnosis.data.models import load_models
from hdagen.diagnosis.data.prepared_data import prepare_data
from hdagen.diagnosis.decision.decision_settings import DECISION
from hdagen.diagnosis.decision.file_trust import describe_factor, has_exact_number, measure_number_gain
from hdagen.diagnosis.inference.candidate_priors import Candidate
from hdagen.diagnosis.inference.local_fit import Fit
from hdagen.diagnosis.search.null_model import fit_null_model
from hdagen.diagnosis.stages.time_budget import TimeBudget

ROBOT = wrist.ROBOT.replace("motor_inertia = 0.0", "motor_inertia = 0.02").replace("1e-3", "1e-3\ntolerance = 0.05", 1)
EXACT = ROBOT.replace("tolerance = 0.05", "tolerance = 0.0")


def fit_machine(folder: Path, factors: Mapping[str, float], text: str = ROBOT) -> Fit:
    """Fit no effect to a log of the machine whose numbers are the file's times ``factors``."""
    robot = folder / "robot.toml"
    robot.write_text(text)
    models, rotor = load_models(robot), 0.02 * factors.get("motor_inertia_1", 1.0)
    data = prepare_data(models, [wrist.move_wrist(robot, factors, 6.0, rotor)], ())
    return fit_null_model(models.full, data.record, TimeBudget()).fit


@pytest.mark.parametrize("number", ["inertia_1", "motor_inertia_1", "mass_1"])
def test_a_wrong_number_gains_much(tmp_path: Path, number: str) -> None:
    assert measure_number_gain(fit_machine(tmp_path, {number: 1.6})) > 5.0 * DECISION.least_number_gain


def test_numbers_of_a_right_file_gain_nothing(tmp_path: Path) -> None:
    fit = fit_machine(tmp_path, {})
    assert measure_number_gain(fit) < DECISION.least_number_gain
    assert not has_exact_number(fit)


def test_wrong_inertias_gain_little_of_what_a_friction_explains(tmp_path: Path) -> None:
    fit = fit_machine(tmp_path, {"viscous_friction_1": 4.0})
    words = fit.sensitivities.candidates
    friction = next(k for k, one in enumerate(words.members) if one.name == "viscous_friction@1")
    own = words.amplitude_columns((friction,)).tolist()
    gained = fit.evidence_with_widths(own, [1.0]) - fit.evidence_with_widths(own, words.spike_widths[own].tolist())
    assert gained > 10.0 * DECISION.least_number_gain
    assert measure_number_gain(fit) < DECISION.look_alike_share * gained


def test_a_number_that_the_file_claims_to_know_exactly_is_told(tmp_path: Path) -> None:
    assert has_exact_number(fit_machine(tmp_path, {}, EXACT))


def test_a_spring_that_the_model_lacks_has_no_factor() -> None:
    """Of a verdict of rigid drives the search with springs has candidates, too."""
    spring = Candidate(EFFECTS["missing_compliance"], 1, ("missing_compliance_1",), {}, True, True)
    assert describe_factor(spring, {}, {"missing_compliance_1": {"value": 1e-4, "std": 1e-5}}) == {}
