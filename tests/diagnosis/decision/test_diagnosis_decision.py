"""The decision: what is named beside what, where none is in doubt, what counts as unknown, and the calibration."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from catalogue import EFFECTS

from hdagen.arm.arrays import Array
from hdagen.diagnosis.decision import calibration
from hdagen.diagnosis.decision.decision_settings import DECISION
from hdagen.diagnosis.decision.effect_presence import measure_effect_sizes
from hdagen.diagnosis.decision.posterior import (
    Hypothesis,
    _add_shifted_base_parameters,
    _compute_unknown_odds,
    _drop_negligible,
    _weigh_hypotheses,
    conclude_verdict,
    score_hypotheses,
)
from hdagen.diagnosis.inference.candidate_priors import Candidate
from hdagen.diagnosis.inference.rollout import Rollout

TRAITS = {
    entry: EFFECTS[entry.partition("@")[0]]
    for entry in (
        "thermal_friction@2",
        "position_dependent_friction@2",
        "position_dependent_friction@1",
        "current_bias@2",
        "kinematic_error@1",
        "encoder_eccentricity@1",
        "backlash@1",
        "contact@1",
        "link_flexibility@1",
    )
}


@pytest.mark.parametrize(
    ("leader", "companion", "sort"),
    [
        ("thermal_friction@2", "position_dependent_friction@2", True),
        ("thermal_friction@2", "position_dependent_friction@1", False),  # the friction of another motor
        ("thermal_friction@2", "current_bias@2", False),  # no friction
        ("kinematic_error@1", "encoder_eccentricity@1", True),
        ("kinematic_error@1", "position_dependent_friction@1", False),
        ("backlash@1", "link_flexibility@1", True),
        ("backlash@1", "contact@1", False),  # a wall mends no gear
    ],
)
def test_what_may_only_make_up_for_a_formula_must_bring_a_share(leader: str, companion: str, sort: bool) -> None:
    both = tuple(sorted((leader, companion)))
    for share, said in (
        (0.9 * DECISION.form_correction_share, (leader,) if sort else both),
        (1.1 * DECISION.form_correction_share, both),
    ):
        evidence = {(): -50.0, (leader,): 0.0, (companion,): -49.0, both: 50.0 * share}
        assert _drop_negligible(both, {leader: 3.0, companion: 2.0}, evidence, TRAITS) == said


def test_a_companion_s_share_is_of_its_own_sort_s_gain_alone() -> None:
    gear, friction, other = "encoder_eccentricity@1", "thermal_friction@2", "position_dependent_friction@2"
    names = tuple(sorted((gear, friction, other)))
    evidence = {(): -500.0, (gear,): -20.0, (gear, friction): 0.0, names: 5.0}
    evidence |= {(gear, other): -19.0, tuple(sorted((friction, other))): -470.0}
    size = dict.fromkeys(names, 2.0)
    assert _drop_negligible(names, size, evidence, TRAITS) == names  # 5 of 20, though the gear's gain is 480
    assert _drop_negligible(names, size, evidence | {names: 3.0}, TRAITS) == (gear, friction)


@pytest.mark.parametrize(
    ("tolerances", "std", "there"),
    [
        (2.1, 0.1, False),  # one in thirty is
        (DECISION.rare_parameter_deviation - 0.1, 0.1, False),
        (DECISION.rare_parameter_deviation + 0.1, 0.1, True),
        (-DECISION.rare_parameter_deviation - 0.1, 0.1, True),
        (DECISION.rare_parameter_deviation + 0.1, 0.6, False),  # not told
    ],
)
def test_what_hardly_a_parameter_is_off_by_is_there_though_it_is_not_meant(
    tolerances: float, std: float, there: bool
) -> None:
    spike = 0.2  # usual sizes
    atoms = [SimpleNamespace(name=name) for name in ("torque_constant@1", "payload@2", "current_bias@1")]
    columns = [SimpleNamespace(candidate=k, in_every_hypothesis=not k, spike_width=spike) for k in range(3)]
    columns.append(SimpleNamespace(candidate=-1, in_every_hypothesis=True, spike_width=1.0))  # a mass is no effect
    mean = np.array([spike * tolerances, 0.5, 5.0, 3.0])
    words = SimpleNamespace(members=atoms, columns=columns)
    posterior = mean, np.diag([(spike * std) ** 2, 1e-6, 1e-6, 1e-6])
    fit: Any = SimpleNamespace(
        sensitivities=SimpleNamespace(candidates=words), posterior=posterior, names=("payload@2",)
    )
    assert _add_shifted_base_parameters(fit) == (("payload@2", "torque_constant@1") if there else ("payload@2",))


class Stands(SimpleNamespace):
    """A fit that is told from others by what it is."""

    def __hash__(self) -> int:  # type: ignore[override]
        return id(self)

    @property
    def misfit(self) -> float:
        return float(self.noise_only_evidence - self.evidence_here)


def standing(mean: list[float], stood: list[float], came: float = 1.0) -> Any:
    """A fit of a thermal friction and a bias that promises ``mean`` and stands at ``stood``."""
    atoms = tuple(Candidate(EFFECTS[name], 2, (), {}, True) for name in ("thermal_friction", "current_bias"))
    words = SimpleNamespace(
        members=atoms,
        measure_size=lambda k, theta: abs(theta[k]),
        to_theta=lambda p: p,
        presence_threshold=lambda k: 0.3,
        list_absent_numbers=list,
    )
    words.names_of = lambda some: tuple(sorted(atoms[k].name for k in some))

    def recalled(lane: Rollout) -> tuple[None, Array]:
        assert lane.memory is None and lane.p.tolist() == stood  # all windows, where it stands
        return None, np.array([[0.9, 0.0], [0.9, 0.5 * came], [0.9, came]])  # three windows, states of two effects

    arm = SimpleNamespace(state_names=("motor_position_1", "warmth_1", "warmth_2"), manifest={"flexible": [1, 2]})
    point = SimpleNamespace(p=np.array(stood), initial_states=None)
    design = SimpleNamespace(
        candidates=words, shooting=SimpleNamespace(arm=arm, predict_with_memory=recalled), point=point
    )
    return Stands(effects=(0, 1), sensitivities=design, posterior=(np.array(mean), None))


@pytest.mark.parametrize("came", [1.0, 0.632, 0.151])
def test_what_comes_over_time_counts_as_far_as_it_came(came: float) -> None:
    found = measure_effect_sizes(standing([0.5, -0.7], [0.5, -0.7], came))
    assert found == pytest.approx({"thermal_friction@2": 0.5 * came, "current_bias@2": 0.7})


def test_a_size_that_no_step_came_to_does_not_count() -> None:
    found = measure_effect_sizes(standing([0.9, -0.1], [0.24, -0.7]))
    assert found == pytest.approx({"thermal_friction@2": 0.24, "current_bias@2": 0.1})


@pytest.mark.parametrize(
    ("size", "leaves", "said"),
    [
        (0.2, 0.0, ()),  # both too small to count: nothing is missing
        (0.5, 0.0, ("thermal_friction@2",)),
        (0.2, 0.8, ("unknown@1",)),  # but what made up for much of a gap that stays, and is too small, explains none
        (0.5, 0.8, ("thermal_friction@2",)),
    ],
)
def test_a_set_that_was_not_fitted_itself_is_as_large_as_where_it_stands(
    size: float, leaves: float, said: tuple[str, ...]
) -> None:
    assert score_hypotheses(beside_a_bias(size, leaves)).verdict == said


def beside_a_bias(size: float, leaves: float, alone: float | None = None) -> Any:
    """A search that found a thermal friction that explains much beside a bias, and fitted it ``alone`` to that log
    evidence, or not."""
    both = ("current_bias@2", "thermal_friction@2")
    fit = standing([size, -0.1], [size, -0.1])
    worth = {(): -60.0, (0,): 0.0, (1,): -58.0, (0, 1): -2.0}
    fit.names, fit.subsets, fit.tempered_evidence = both, list(worth), lambda _, atoms, worth=worth: worth[atoms]
    words = fit.sensitivities.candidates
    words.columns, words.spike_widths = (), np.full(2, 0.05)
    none = Stands(**{**vars(fit), "names": (), "effects": (), "subsets": [()], "tempered_evidence": lambda *_: -60.0})
    own = Stands(
        **{**vars(fit), "names": both[1:], "effects": (0,), "subsets": [(0,)], "tempered_evidence": lambda *_: alone}
    )
    fitted = (fit, none) if alone is None else (fit, own, none)
    for each in fitted:
        each.temperature, each.misfit_temperature, each.noise_only_evidence, each.evidence_here = (
            12.0,
            1.0,
            0.0,
            -1.0 if each is fit else -60.0,
        )
        each.unexplained_torque = np.array([leaves if each is fit else 4.0 * leaves, 0.0])
        each.score = SimpleNamespace(posterior=SimpleNamespace(noise_level=1.0))
    return SimpleNamespace(candidates=words, fits=fitted, screened=[SimpleNamespace(effects=(), evidence=-60.0)])


@pytest.mark.parametrize(
    ("alone", "done"),
    [
        (-1.0, True),
        (5.0, True),
        (1.0 - DECISION.most_evidence_deficit, True),
        (-1.0 - DECISION.most_evidence_deficit, False),
    ],
)
def test_a_fit_that_was_left_on_the_way_does_not_stand_for_its_set(alone: float, done: bool) -> None:
    search = beside_a_bias(0.5, 0.0, alone)
    found = score_hypotheses(search)
    assert found.verdict == ("thermal_friction@2",)
    assert found.best is search.fits[1 if done else 0]


def test_what_was_not_worth_a_fit_is_none_as_far_as_it_is_too_small_to_count() -> None:
    """Of a log that says nothing of it, the effect keeps what its prior gives it; of one that says that it is small,
    next to nothing."""

    def stated(large: float) -> float:
        search = beside_a_bias(0.2, 0.0)
        search.candidates.members += (Candidate(EFFECTS["payload"], 1, (), {}, True),)
        search.screened.append(SimpleNamespace(effects=(2,), evidence=-60.0, presence_probability=large))
        search.fits[0].tempered_evidence = lambda *_: -60.0
        found = score_hypotheses(search)
        assert found.verdict == ()
        return found.uncalibrated_probability

    none = [stated(large) for large in (0.0, 0.25, 1.0)]
    assert none[0] == pytest.approx(1.0, abs=1e-12) and none[2] < 0.9
    assert none[0] - none[1] == pytest.approx(0.25 * (none[0] - none[2]))


def test_what_is_too_small_is_not_in_the_set() -> None:
    names = ("current_bias@2", "thermal_friction@2")
    assert (
        _drop_negligible(names, dict(zip(names, (0.99, 3.0), strict=True)), {(): -9.0, names: 0.0}, TRAITS) == names[1:]
    )


@pytest.mark.parametrize(
    ("probable", "said"),
    [
        ({"payload@2": 0.97, "": 0.02}, ("payload@2",)),
        ({"payload@2": 0.7, "": 0.3}, ("payload@2",)),
        ({"payload@2": 0.6, "": 0.39}, ()),  # an alarm needs more
        ({"payload@2": 0.6, "stiffness@1": 0.38, "": 0.01}, ("payload@2",)),  # that there is one is in no doubt
        ({"unknown@1": 0.6, "": 0.35}, ("unknown@1",)),
        ({"unknown@1": 0.4, "payload@2": 0.3, "stiffness@1": 0.28, "": 0.02}, ("payload@2",)),  # one of two is there
        ({"unknown@1": 0.2, "payload@2": 0.45, "": 0.35}, ()),
        ({"": 0.9, "payload@2": 0.05}, ()),
    ],
)
def test_no_effect_is_named_where_none_is_in_doubt(probable: dict[str, float], said: tuple[str, ...]) -> None:
    fit: Any = "where it stands"
    given = [Hypothesis((name,) if name else (), p, None if "unknown" in name else fit) for name, p in probable.items()]
    found = conclude_verdict(given, fit)
    assert found.verdict == said
    assert found.uncalibrated_probability == probable["".join(said)]
    assert next(h.probability for h in found.hypotheses if h.names == said) == found.probability
    assert [h.probability for h in found.hypotheses] == sorted((h.probability for h in found.hypotheses), reverse=True)
    np.testing.assert_allclose(sum(h.probability for h in found.hypotheses), 1.0)


def fit(s: float, left: float, level: float = 1.0, lacks: float | None = None) -> Any:
    """A fit that leaves that much, of the torque, and of the evidence unless that is given."""
    at = SimpleNamespace(s=s, noise_level=level)
    reached = -100.0 * (left if lacks is None else lacks)
    return SimpleNamespace(
        score=SimpleNamespace(posterior=at),
        misfit=-reached,
        unexplained_torque=np.array([left, 0.0]),
    )


def test_unknown_is_what_the_named_effects_leave_of_what_none_leaves() -> None:
    assert _compute_unknown_odds(fit(1.0, 3.0), fit(3.0, 3.1)) > 3  # nothing was told
    assert _compute_unknown_odds(fit(1.0, 0.5), fit(3.0, 3.1)) < 0.1  # a real machine, whose gap one effect tells
    assert _compute_unknown_odds(fit(0.01, 0.01), fit(0.01, 0.01)) < 0.01  # nothing to tell
    assert (
        _compute_unknown_odds(fit(0.01, 3.0, level=5.0), fit(0.01, 3.0, level=9.0)) > 3
    )  # no torque, but not noise either
    assert (
        _compute_unknown_odds(fit(1.0, 3.0, lacks=0.1), fit(3.0, 3.1)) < 0.1
    )  # a saturation: the torque stays unexplained
    assert _compute_unknown_odds(fit(1.0, 0.5, lacks=3.0), fit(3.0, 3.1)) < 0.1  # a large error, told for the most part
    assert (
        _compute_unknown_odds(fit(30.0, 0.3), fit(90.0, 3.1)) < 0.1
    )  # so is one whose motion is worth much of its torque
    assert _compute_unknown_odds(fit(30.0, 0.9), fit(90.0, 9.0)) < 0.5
    assert (
        _compute_unknown_odds(fit(1.0, 0.1), fit(1.0, 0.1)) < 0.01
    )  # a little of everything, of which nothing is told
    assert _compute_unknown_odds(fit(30.0, 2.9), fit(90.0, 3.1)) > 3  # unless little is told
    sizes = [_compute_unknown_odds(fit(1.0, torque), fit(3.0, 3.0)) for torque in (0.1, 0.5, 1.0, 2.0, 3.0)]
    assert sizes == sorted(sizes)


def frozen(temperature: float, path: Path, lapse: float = 0.0) -> calibration.Calibration:
    losses = {"loss_before": 1.0, "loss_after": 0.5}
    content = {"schema": 2, "temperature": temperature, "lapse": lapse, "seeds": [], "cases": 48, **losses}
    path.write_text(json.dumps({**content, "sha256": calibration.compute_digest(content)}))
    return calibration.read(path)


def test_a_calibrated_probability_is_less_sure_and_keeps_its_order(tmp_path: Path) -> None:
    found = frozen(4.0, tmp_path / "c.json")
    stated = np.array([0.51, 0.7, 0.9, 0.99, 1 - 1e-9, 1.0])
    believed = np.array([found.calibrate(p) for p in stated])
    assert (np.diff(believed) >= 0).all() and (believed <= stated).all() and (believed > 0.5).all()
    assert believed[-1] == pytest.approx(believed[-2]) and believed[-1] < 0.98
    assert found.calibrate(0.3) == 0.3
    odds = believed[1] / (1 - believed[1])
    assert odds**4 == pytest.approx(0.7 / 0.3)
    same = frozen(1.0, tmp_path / "c.json")
    assert same.calibrate(0.9) == pytest.approx(0.9)


def test_nothing_is_believed_beyond_what_a_search_may_miss(tmp_path: Path) -> None:
    few = frozen(1.0, tmp_path / "c.json", lapse=0.05)
    assert [few.calibrate(p) for p in (0.3, 0.52, 0.6, 1.0)] == pytest.approx([0.3, 0.5, 0.57, 0.95], abs=1e-6)


def test_the_calibration_that_comes_with_the_product_is_as_it_was_frozen(tmp_path: Path) -> None:
    content = json.loads(calibration.CALIBRATION_FILE.read_text())
    assert calibration.read().temperature == content["temperature"] >= 1.0
    assert calibration.read().lapse == content["lapse"] >= 1.0 / (content["cases"] + 2)
    content["temperature"] = 1.0 + content["temperature"]
    changed = tmp_path / "calibration.json"
    changed.write_text(json.dumps(content))
    with pytest.raises(calibration.CalibrationError, match="not as it was frozen"):
        calibration.read(changed)
    with pytest.raises(calibration.CalibrationError, match="cannot be read"):
        calibration.read(tmp_path / "none.json")


def test_a_number_that_the_file_leaves_out_is_as_likely_there_as_not() -> None:
    evidence = {(): 0.0, ("motor_inertia@1",): 0.0, ("payload@2",): 0.0, ("motor_inertia@1", "payload@2"): 0.0}
    counted = _weigh_hypotheses(evidence, {}, {}, frozenset())
    found = _weigh_hypotheses(evidence, {}, {}, frozenset({"motor_inertia@1"}))
    assert found[("motor_inertia@1",)] == found[()] and found[("motor_inertia@1", "payload@2")] == found[("payload@2",)]
    assert counted[("motor_inertia@1",)] == counted[("payload@2",)] < counted[()]


def of_four_effects(sizes: list[float], three_fitted: bool) -> Any:
    """A search whose best set has four effects, and was fitted without the last one, or not."""
    names = ("cable_spring", "current_bias", "payload", "viscous_friction")
    atoms = tuple(Candidate(EFFECTS[name], 2, (), {}, True) for name in names)
    whole = standing(sizes, sizes)
    words = whole.sensitivities.candidates
    words.members, words.columns, words.spike_widths = atoms, (), np.full(4, 0.05)
    words.names_of = lambda some: tuple(sorted(atoms[k].name for k in some))
    fits = []
    for effects in ((0, 1, 2, 3), *([(0, 1, 2)] if three_fitted else []), ()):
        subsets = [(), *((k,) for k in effects), effects]
        worth = dict.fromkeys(subsets, -60.0) | {effects: -60.0 if not effects else -float(4 - len(effects))}
        fit = Stands(**{**vars(whole), "names": words.names_of(effects), "effects": effects, "subsets": list(worth)})
        fit.tempered_evidence = lambda _, some, worth=worth: worth[some]
        fit.temperature, fit.misfit_temperature, fit.noise_only_evidence, fit.evidence_here = 12.0, 1.0, 0.0, -1.0
        fit.unexplained_torque = np.zeros(2)
        fit.score = SimpleNamespace(posterior=SimpleNamespace(noise_level=1.0))
        fits.append(fit)
    return SimpleNamespace(candidates=words, fits=fits, screened=[SimpleNamespace(effects=(), evidence=-60.0)])


@pytest.mark.parametrize(
    ("sizes", "three_fitted", "said"),
    [
        ([0.9, 0.9, 0.9, 0.1], True, ("cable_spring@2", "current_bias@2", "payload@2")),
        ([0.9, 0.9, 0.1, 0.1], True, ("cable_spring@2", "current_bias@2", "payload@2")),  # two alone were not evaluated
        ([0.9, 0.9, 0.1, 0.1], False, ("cable_spring@2", "current_bias@2", "payload@2", "viscous_friction@2")),
        ([0.1, 0.1, 0.1, 0.1], True, ()),
    ],
)
def test_a_set_without_its_small_effects_that_was_not_evaluated_is_never_no_effect(
    sizes: list[float], three_fitted: bool, said: tuple[str, ...]
) -> None:
    found = score_hypotheses(of_four_effects(sizes, three_fitted))
    assert found.verdict == said
    assert found.hypotheses[0].names == said
