"""Hypotheses where they stand: what is kept of one whose columns were let go of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from compiled import Compiled
from numpy.linalg import LinAlgError
from test_shooting import shooting

from hdagen.arm.build_loader import PlantError
from hdagen.diagnosis.inference import fit_steps, linearization
from hdagen.diagnosis.inference.alternative_starts import refit_swapping
from hdagen.diagnosis.inference.candidate_settings import CANDIDATES
from hdagen.diagnosis.inference.fit_steps import advance_fit
from hdagen.diagnosis.inference.gauss_newton import place_theta
from hdagen.diagnosis.inference.likelihood_settings import LIKELIHOOD
from hdagen.diagnosis.inference.linearization import compute_sensitivities
from hdagen.diagnosis.inference.local_fit import Fit, restore_columns, start_fit
from hdagen.diagnosis.inference.sensitivities import OperatingPoint
from hdagen.diagnosis.initialization.candidate_list import build_candidates
from hdagen.diagnosis.initialization.initial_guess import guess_from_log

Builder = Callable[..., Compiled]
NAMES = {"transmission_hysteresis@1", "sensor_delay@1"}


@pytest.fixture(scope="module")
def fit(build: Builder) -> Fit:
    """Two effects at once, one step from their first values."""
    sh = shooting(build, "native")
    words = build_candidates(sh.arm, guess_from_log(sh.arm, sh.record))
    atoms = tuple(k for k, atom in enumerate(words.members) if atom.name in NAMES and atom.has_default_shapes)
    assert len(atoms) == 2
    at = compute_sensitivities(sh, words, OperatingPoint(sh.arm.p, sh.measured_initial_states(sh.arm.p)))
    return advance_fit(start_fit(at, words, atoms, 0.1), words)


@pytest.mark.parametrize("excess", [1.0, 1.7, 3.1, 40.0])
def test_what_was_let_go_of_tells_what_it_told(fit: Fit, excess: float) -> None:
    """At any temperature, also of the hypotheses with fewer effects: those that are compared were let go of or not."""
    bare = fit.without_columns()
    assert (
        fit.has_columns
        and not bare.has_columns
        and bare.sensitivities.columns.size == 0
        and bare.without_columns() is bare
    )
    assert len(fit.subsets) == 4
    for atoms in fit.subsets:
        assert bare.tempered_evidence(excess * LIKELIHOOD.likelihood_temperature, atoms) == fit.tempered_evidence(
            excess * LIKELIHOOD.likelihood_temperature, atoms
        )


def test_the_evidence_is_what_is_reached_at_the_temperature_of_the_fit(fit: Fit) -> None:
    assert fit.tempered_evidence(LIKELIHOOD.likelihood_temperature) == pytest.approx(fit.evidence_here, rel=1e-9)
    values = [fit.tempered_evidence(t * LIKELIHOOD.likelihood_temperature) for t in (1.0, 2.0, 4.0)]
    assert values == sorted(values)


def test_another_effect_begins_where_the_linear_model_has_it(fit: Fit) -> None:
    """With no more of what it replaces than is tolerated, and where what it promises there is."""
    at = fit.sensitivities
    words = build_candidates(at.shooting.arm, guess_from_log(at.shooting.arm, at.shooting.record))
    other = next(
        k for k, atom in enumerate(words.members) if atom.name == "presliding_friction@1" and atom.has_default_shapes
    )
    found = refit_swapping(fit, words, (other,))
    assert found.names == ("presliding_friction@1",) and found.has_columns and not found.has_converged
    assert (
        fit.predicted_evidence(()) > fit.predicted_evidence((other,)) > fit.predicted_evidence((other, *fit.effects))
    )  # the log holds none of them
    for c in at.candidates.columns:
        if c.candidate in fit.effects and c.spike_width < 1.0:
            off = found.sensitivities.point.p[c.index] - c.center
            assert abs(off) <= CANDIDATES.nuisance_limit * CANDIDATES.spike_scales[0] * abs(c.unit) * (1 + 1e-9)


@pytest.mark.parametrize("error", [PlantError("begun must be finite."), LinAlgError("singular")])
def test_a_hypothesis_whose_step_fails_stands_where_it_is(
    fit: Fit, error: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*of: object) -> None:
        raise error

    shooting, words = fit.sensitivities.shooting, fit.sensitivities.candidates
    failed, further = shooting.failure_count, replace(fit, has_converged=False, predicted_gain=1e3)
    monkeypatch.setattr(fit_steps, "descend_gauss_newton", fails)
    found = advance_fit(further, words)
    assert (
        found.has_converged
        and found.evidence_here == further.evidence_here
        and found.sensitivities is fit.sensitivities
    )
    assert shooting.failure_count == failed + 1


def test_a_step_keeps_the_columns_of_nuisance_effects_and_they_can_be_had_anew(fit: Fit) -> None:
    """All others are computed at the new point, and what the fit leaves is simulated there."""
    at = fit.sensitivities
    assert fit.has_kept_columns
    words = build_candidates(at.shooting.arm, guess_from_log(at.shooting.arm, at.shooting.record))
    whole = restore_columns(fit, words)
    assert not whole.has_kept_columns and restore_columns(whole, words) is whole
    assert whole.has_converged == fit.has_converged
    exact, columns = whole.sensitivities, at.candidates.columns
    assert [c.parameter for c in exact.candidates.columns] == [c.parameter for c in columns]
    np.testing.assert_array_equal(exact.residual, at.residual)
    head = at.shooting.m + at.k
    np.testing.assert_allclose(exact.columns[:head], at.columns[:head], rtol=1e-6, atol=1e-6)
    nuisance = np.array([at.candidates.is_nuisance(c) for c in columns])
    assert 0 < nuisance.sum() < len(nuisance)
    own = [head + k for k in np.flatnonzero(~nuisance)]
    np.testing.assert_allclose(exact.columns[own], at.columns[own], rtol=1e-6, atol=1e-6)
    torques = at.torques_of_nuisance
    assert torques is not None and fit.without_columns().has_kept_columns
    moved = np.linalg.norm(at.torque_columns - torques) / np.linalg.norm(torques)
    assert 0.0 < moved < LIKELIHOOD.largest_column_change
    others = [head + k for k in np.flatnonzero(nuisance)]
    assert not np.allclose(exact.columns[others], at.columns[others], rtol=1e-6, atol=1e-6)
    assert whole.evidence_here == pytest.approx(fit.evidence_here, abs=0.5)


def test_columns_that_were_dropped_come_back_at_the_same_point(fit: Fit) -> None:
    words = build_candidates(
        fit.sensitivities.shooting.arm,
        guess_from_log(fit.sensitivities.shooting.arm, fit.sensitivities.shooting.record),
    )
    whole, back = restore_columns(fit, words), restore_columns(fit.without_columns(), words)
    assert back.has_columns
    np.testing.assert_array_equal(back.sensitivities.columns, whole.sensitivities.columns)


def test_nothing_is_kept_where_the_columns_of_torques_have_changed_much(
    fit: Fit, monkeypatch: pytest.MonkeyPatch
) -> None:
    at = fit.sensitivities
    assert compute_sensitivities(at.shooting, at.candidates, at.point, at).torques_of_nuisance is not None
    monkeypatch.setattr(linearization, "LIKELIHOOD", replace(LIKELIHOOD, largest_column_change=1e-9))
    again = compute_sensitivities(at.shooting, at.candidates, at.point, at)
    assert again.torques_of_nuisance is None
    alone = compute_sensitivities(at.shooting, at.candidates, at.point)
    np.testing.assert_allclose(again.columns, alone.columns, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize(("name", "is_kept"), [("sensor_delay@1", True), ("transmission_hysteresis@1", False)])
def test_a_step_keeps_the_memory_of_nuisance_effects_and_not_that_of_its_own(
    fit: Fit, name: str, is_kept: bool
) -> None:
    """Once it is known: at the first point no effect had one."""
    at = fit.sensitivities
    words = build_candidates(at.shooting.arm, guess_from_log(at.shooting.arm, at.shooting.record))
    atoms = tuple(k for k, atom in enumerate(words.members) if atom.name == name and atom.has_default_shapes)
    p, begun = at.shooting.nominal_start()
    first = compute_sensitivities(at.shooting, words, OperatingPoint(p, begun))
    start = start_fit(first, words, atoms, 0.1).sensitivities
    theta = start.candidates.to_theta(p)
    assert place_theta(start, theta, begun).memory is None
    p[at.shooting.arm.parameters.index("hysteresis_torque_2")] = 0.1
    there = compute_sensitivities(at.shooting, start.candidates, OperatingPoint(p, begun))
    memory = place_theta(there, theta, begun).memory
    assert (memory is not None) == is_kept
    assert memory is None or (memory is there.point.memory and memory.any())
