"""Other numbers of the robot file that move an arm as a fit does, against mass matrix, weight and fits of their own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import wrist

from hdagen.diagnosis.data.models import Models, load_models
from hdagen.diagnosis.data.prepared_data import prepare_data
from hdagen.diagnosis.inference.linearization import compute_sensitivities
from hdagen.diagnosis.inference.local_fit import Fit, restore_columns, start_fit
from hdagen.diagnosis.search.equal_motions import find_equal_motions, refit_at_point
from hdagen.diagnosis.search.hypothesis_race import continue_fit
from hdagen.diagnosis.search.null_model import NullModel, fit_null_model, make_nominal_point

ROBOT = wrist.ROBOT.replace("step = 1e-3", "step = 1e-3\ntolerance = 0.1")
HEAVIER = {"mass_1": 1.6}
POSES = np.linspace(-2.0, 1.0, 7)[:, None]


def fit_hypothesis(robot: Path, *names: str) -> tuple[Models, NullModel, Fit]:
    """The fit of some numbers to a log of a wrist whose link is 1.6 times as heavy as the file says."""
    models = load_models(robot)
    data = prepare_data(models, [wrist.move_wrist(robot, HEAVIER, 6.0)], [])
    null = fit_null_model(models.full, data.record, with_numbers=True)
    words = null.candidates
    atoms = tuple(k for k, one in enumerate(words.members) if one.name in names)
    at = compute_sensitivities(null.shooting, words, make_nominal_point(null.shooting, words))
    fit = continue_fit(start_fit(at, words, atoms, null.fit.score.posterior.s), words, 20, 0.1)
    return models, null, restore_columns(fit, words)


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    path = tmp_path / "robot.toml"
    path.write_text(ROBOT)
    return path


def test_one_heavier_link_is_found_in_place_of_two_numbers_that_move_as_it_does(robot: Path) -> None:
    """A linear model about the two does not: the inertia of a mass goes with the square of its distance."""
    models, null, two = fit_hypothesis(robot, "center_of_mass@1", "inertia@1")
    found = {null.candidates.names_of(one.effects): one for one in find_equal_motions(two, null.candidates)}
    mass = found["mass@1",]
    arms = [models.full.with_parameters(p) for p in (mass.point.p, two.sensitivities.point.p)]
    for name, entry in (("mass_matrix", "M"), ("gravity_torque", "g")):
        ours, theirs = (arm.evaluate(name, q=POSES)[entry] for arm in arms)
        np.testing.assert_allclose(ours, theirs, rtol=0.02, atol=0.02 * np.abs(theirs).max())
    begun = refit_at_point(mass.point, two, null.candidates, mass.effects)
    fitted = continue_fit(begun, null.candidates, 20, 0.1)
    assert fitted.evidence_here > two.evidence_here - 2.0
    factor = fitted.sensitivities.point.p[models.full.parameters.index("mass_1")] / 2.0
    assert factor == pytest.approx(HEAVIER["mass_1"], rel=0.1)


def test_an_effect_that_moves_no_mass_has_no_equal(robot: Path) -> None:
    _, null, friction = fit_hypothesis(robot, "viscous_friction@1")
    assert find_equal_motions(friction, null.candidates) == []
