"""Hypotheses where they stand: what is kept of one whose columns were let go of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
from compiled import Compiled
from numpy.linalg import LinAlgError
from test_shooting import shooting

from hdagen.arm.build_loader import PlantError
from hdagen.diagnosis.inference import local_fit
from hdagen.diagnosis.inference.candidate_priors import SHARES, TOLERATED
from hdagen.diagnosis.inference.local_fit import Fitted, advanced, begun, instead
from hdagen.diagnosis.inference.sensitivities import TEMPERATURE, Point, design
from hdagen.diagnosis.initialization.candidate_list import dictionary
from hdagen.diagnosis.initialization.initial_guess import suggested

Builder = Callable[..., Compiled]
NAMES = {"transmission_hysteresis@1", "sensor_delay@1"}


@pytest.fixture(scope="module")
def fit(build: Builder) -> Fitted:
    """Two effects at once, one step from their first values."""
    sh = shooting(build, "native")
    words = dictionary(sh.arm, suggested(sh.arm, sh.record))
    atoms = tuple(k for k, atom in enumerate(words.atoms) if atom.name in NAMES and atom.first)
    assert len(atoms) == 2
    at = design(sh, words, Point(sh.arm.p, sh.begun(sh.arm.p)))
    return advanced(begun(at, words, atoms, 0.1), words)


@pytest.mark.parametrize("excess", [1.0, 1.7, 3.1, 40.0])
def test_what_was_let_go_of_tells_what_it_told(fit: Fitted, excess: float) -> None:
    """At any temperature, also of the hypotheses with fewer effects: those that are compared were let go of or not."""
    bare = fit.bare()
    assert fit.whole and not bare.whole and bare.design.columns.size == 0 and bare.bare() is bare
    assert len(fit.lesser) == 4
    for atoms in fit.lesser:
        assert bare.evidence(excess * TEMPERATURE, atoms) == fit.evidence(excess * TEMPERATURE, atoms)


def test_the_evidence_is_what_is_reached_at_the_temperature_of_the_fit(fit: Fitted) -> None:
    assert fit.evidence(TEMPERATURE) == pytest.approx(fit.reached, rel=1e-9)
    values = [fit.evidence(t * TEMPERATURE) for t in (1.0, 2.0, 4.0)]
    assert values == sorted(values)


def test_another_effect_begins_where_the_linear_model_has_it(fit: Fitted) -> None:
    """With no more of what it replaces than is tolerated, and where what it promises there is."""
    at = fit.design
    words = dictionary(at.shooting.arm, suggested(at.shooting.arm, at.shooting.record))
    other = next(k for k, atom in enumerate(words.atoms) if atom.name == "presliding_friction@1" and atom.first)
    found = instead(fit, words, (other,))
    assert found.names == ("presliding_friction@1",) and found.whole and not found.stands
    assert fit.promised(()) > fit.promised((other,)) > fit.promised((other, *fit.atoms))  # the log holds none of them
    for c in at.words.columns:
        if c.atom in fit.atoms and c.spike < 1.0:
            off = found.design.point.p[c.index] - c.center
            assert abs(off) <= TOLERATED * SHARES[0] * abs(c.unit) * (1 + 1e-9)


@pytest.mark.parametrize("error", [PlantError("begun must be finite."), LinAlgError("singular")])
def test_a_hypothesis_whose_step_fails_stands_where_it_is(
    fit: Fitted, error: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*of: object) -> None:
        raise error

    shooting, words = fit.design.shooting, fit.design.words
    failed, further = shooting.failed, replace(fit, stands=False, ahead=1e3)
    monkeypatch.setattr(local_fit, "descend", fails)
    found = advanced(further, words)
    assert found.stands and found.reached == further.reached and found.design is fit.design
    assert shooting.failed == failed + 1
