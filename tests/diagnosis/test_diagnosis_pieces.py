"""Pieces of the diagnosis by themselves: held steps, what torsion shows, what a hypothesis is made of."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from catalogue import EFFECTS
from test_diagnosis import problem

from hdagen.diagnosis.decision.identifiability import Identifiability
from hdagen.diagnosis.decision.wrong_robot import refuse_wrong_robot
from hdagen.diagnosis.inference.candidate_priors import Candidate, CandidateSet, Column
from hdagen.diagnosis.inference.candidate_settings import CANDIDATES
from hdagen.diagnosis.inference.gauss_newton import compute_hypothesis_widths
from hdagen.diagnosis.inference.likelihood_settings import LIKELIHOOD
from hdagen.diagnosis.inference.linear_gaussian import CrossProducts, TotalNormalEquations
from hdagen.diagnosis.inference.linear_model import LinearModel
from hdagen.diagnosis.inference.marginal_likelihood import apply_laplace, solve_with_scales
from hdagen.diagnosis.inference.sensitivities import count_torque_steps
from hdagen.diagnosis.initialization.encoder_regression import (
    _coefficient_bounds,
    _find_walls,
    _regress_robustly,
    _split_encoder_bias,
)
from hdagen.diagnosis.search import close_calls, fit_ranking, hypothesis_race
from hdagen.diagnosis.search.fit_ranking import drop_columns, first_with_columns
from hdagen.diagnosis.search.hypothesis_race import _find_at_bound
from hdagen.diagnosis.search.search_settings import SEARCH
from hdagen.diagnosis.stages.time_budget import TimeBudget
from hdagen.support.heap_memory import tune_malloc


def described(**parameters: float) -> Any:
    """An arm that has these parameters, of typical size 100 and nominal as given."""
    each = {name: SimpleNamespace(typical=100.0, nominal=value) for name, value in parameters.items()}
    return SimpleNamespace(parameters=SimpleNamespace(described=each), effects=EFFECTS)


# -- another machine's robot file -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("off", "named", "refused"),
    [
        ([0.9, -1.4, 0.3, 2.0], [], False),
        ([5.0, 0.1, -0.2, 0.3], [], False),  # one number that is wrong is no other machine
        ([4.3, 3.9, -3.1, 3.0], [], True),
        ([4.3, 3.9, -3.1, 3.0], [0, 1], False),  # what the verdict moves is not the file's
    ],
)
def test_a_robot_file_far_outside_its_tolerances_is_refused(off: list[float], named: list[int], refused: bool) -> None:
    names = ["mass_1", "inertia_2", "torque_constant_1", "coulomb_friction_2"]
    columns = [
        SimpleNamespace(parameter=n, in_every_hypothesis=True, candidate=k, spike_width=0.5)
        for k, n in enumerate(names)
    ]
    columns.append(
        SimpleNamespace(parameter="ripple_order_1", in_every_hypothesis=True, candidate=-1, spike_width=1e-9)
    )  # a shape
    described = {n: SimpleNamespace(tolerance=0.05 * (n in names)) for n in [*names, "ripple_order_1"]}
    arm = SimpleNamespace(parameters=SimpleNamespace(described=described))
    design: Any = SimpleNamespace(candidates=SimpleNamespace(columns=columns), shooting=SimpleNamespace(arm=arm))
    best: Any = SimpleNamespace(
        sensitivities=design,
        posterior=(np.array([0.5 * z for z in off] + [1.0]), None),
        effects=named,
        names=("payload@2",),
    )
    said = refuse_wrong_robot(best)
    assert (said is not None) == refused
    if said:
        assert "mass_1 by 4.3" in said and "payload@2" in said


# -- what counts ------------------------------------------------------------------------------------------------------


def test_what_the_robot_files_tolerance_allows_is_no_effect() -> None:
    atoms = tuple(Candidate(EFFECTS["payload"], j, (f"payload_mass_{j}",), {}, True) for j in (1, 2))
    columns = tuple(
        Column(atom.amplitudes[0], k, 0.0, 1.0, spike, k, True)
        for k, (atom, spike) in enumerate(zip(atoms, (CANDIDATES.spike_scales[0], 0.34), strict=True))
    )
    words = CandidateSet(atoms, columns)
    assert (words.presence_threshold(0), words.presence_threshold(1)) == (CANDIDATES.present_size, pytest.approx(0.68))


@pytest.mark.parametrize("unit, width", [("N m/rad", 90.0), ("N m s/rad", 90.0), ("N m", 1.0), ("1", 1.0)])
def test_only_walls_and_dampers_come_in_all_orders_of_magnitude(unit: str, width: float) -> None:
    words = SimpleNamespace(
        spike_widths=np.full(2, CANDIDATES.spike_scales[0]),
        columns=[SimpleNamespace(index=0), SimpleNamespace(index=1)],
        amplitude_columns=lambda atoms: np.array([1]),
        to_theta=lambda p: np.array([3.0, 90.0]),
    )
    described = {
        name: SimpleNamespace(name=name, unit=u, is_guess=False)
        for name, u in {"mass_1": "kg", "amplitude": unit}.items()
    }
    arm = SimpleNamespace(parameters=SimpleNamespace(described=described))
    at: Any = SimpleNamespace(candidates=words, shooting=SimpleNamespace(arm=arm), point=SimpleNamespace(p=np.zeros(2)))
    np.testing.assert_allclose(compute_hypothesis_widths(at, (0,)), [CANDIDATES.spike_scales[0], width])


def test_the_search_goes_on_from_what_has_its_columns_still() -> None:
    """A fit that lost its columns early may be better than all that kept theirs."""
    lost, kept, other = (
        SimpleNamespace(has_columns=whole, without_columns=lambda: "bare") for whole in (False, True, True)
    )
    fits: Any = [lost, kept, other]
    assert first_with_columns(fits) is kept
    assert drop_columns(fits) == ["bare", kept, "bare"]


def test_what_is_close_goes_on_until_it_stands(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that lags by less than what closeness means, and gains more on the way, wins; what is far behind is left."""
    ends = {(): -100.0, (1,): -103.0, (2,): -100.0}

    @dataclass(eq=False)
    class Fit:
        effects: tuple[int, ...]
        score: Any
        evidence_here: float
        has_columns: bool = True
        has_converged: bool = False
        has_kept_columns: bool = False
        misfit_temperature: float = 1.0

        @property
        def sensitivities(self) -> Any:
            return SimpleNamespace(shooting=SimpleNamespace(budget=TimeBudget()))

        @property
        def names(self) -> tuple[str, ...]:
            return tuple(f"{atom}@1" for atom in self.effects)

        def without_columns(self) -> Any:
            return self

    def fit(atoms: tuple[int, ...], evidence: float) -> Any:
        return Fit(effects=atoms, score=SimpleNamespace(evidence=evidence), evidence_here=evidence)

    moved: list[tuple[int, ...]] = []

    def step(one: Any, words: Any) -> Any:
        moved.append(one.effects)
        return fit(one.effects, min(one.score.evidence + 2.0, ends[one.effects]))

    monkeypatch.setattr(hypothesis_race, "advance_fit", step)
    lead, none, far = fit((1,), -104.0), fit((), -108.0), fit((2,), -130.0)
    found = close_calls.settle_close_calls([far, none, lead, fit((), -112.0)], None, lambda word: None)  # type: ignore[arg-type]
    assert [(f.effects, f.score.evidence) for f in found] == [((), -100), ((1,), -103), ((), -112), ((2,), -130)]
    assert set(moved) == {(), (1,)}
    assert close_calls.settle_close_calls([far, lead], None, print) == [lead, far]  # type: ignore[arg-type]
    bare: Any = Fit(
        effects=(3,),
        score=SimpleNamespace(evidence=-101.0),
        evidence_here=-101.0,
        has_columns=False,
        has_converged=True,
    )
    monkeypatch.setattr(close_calls, "restore_columns", lambda one, words: fit(one.effects, one.score.evidence))
    monkeypatch.setattr(hypothesis_race, "advance_fit", lambda one, words: one)
    assert first_with_columns(close_calls.settle_close_calls([far, lead, bare], None, print)).effects == (3,)  # type: ignore[arg-type]


def test_of_one_set_that_began_in_two_places_only_the_better_is_close(monkeypatch: pytest.MonkeyPatch) -> None:
    """In whatever order its effects came; and a larger set pays for what the prior takes from it."""

    def fit(atoms: tuple[int, ...], evidence: float) -> Any:
        names = tuple(sorted(f"{atom}@1" for atom in atoms))
        one = SimpleNamespace(effects=atoms, names=names, evidence_here=evidence)
        one.score = SimpleNamespace(evidence=evidence)
        one.sensitivities = SimpleNamespace(shooting=SimpleNamespace(budget=TimeBudget()))
        one.has_columns, one.has_converged, one.misfit_temperature, one.without_columns = True, False, 1.0, lambda: one
        one.has_kept_columns = False
        return one

    went: list[float] = []
    monkeypatch.setattr(close_calls, "continue_fit", lambda one, *_: went.append(one.evidence_here) or one)
    both = [fit((1, 2), -100.0), fit((2, 1), -101.0), fit((1,), -106.0), fit((1, 2, 3), -109.0), fit((4,), -117.0)]
    close_calls.settle_close_calls(both, None, lambda word: None)  # type: ignore[arg-type]
    assert sorted(went) == [-106.0, -100.0]


def test_where_no_effect_tells_anything_no_second_one_is_looked_for() -> None:
    def fits(none: float, best: float) -> Any:
        pairs = (((), none), ((1,), best))
        return [SimpleNamespace(effects=atoms, evidence_here=-lacks, misfit=lacks) for atoms, lacks in pairs]

    assert fit_ranking.is_beyond_known_effects(fits(1300.0, 1240.0))
    assert not fit_ranking.is_beyond_known_effects(fits(1300.0, 900.0))  # it tells a third
    assert not fit_ranking.is_beyond_known_effects(fits(400.0, 390.0))  # little is left to be told at all


# -- what a motion tells ----------------------------------------------------------------------------------------------


def test_what_does_not_show_is_unseen_and_what_looks_alike_stands_beside() -> None:
    """Four effects: one by itself, its likeness, one without any signal, another one by itself."""
    rng = np.random.default_rng(7)
    rows, names = 400, ("payload@1", "torque_constant@1", "backlash@2", "contact@2")
    own, other, first = rng.normal(size=(3, rows))
    J = np.stack([30 * own, 30 * own + 0.5 * rng.normal(size=rows), 1e-3 * own, 30 * other])
    block = np.vstack([first, J])
    linear = LinearModel(
        CrossProducts((block @ block.T)[None], 1, 0), np.zeros((1, 5)), np.zeros(1), np.array([rows]), np.zeros(4)
    )
    words = SimpleNamespace(
        spike_widths=np.full(4, 0.05),
        members=[SimpleNamespace(name=name) for name in names],
        columns=[SimpleNamespace(candidate=k) for k in range(4)],
    )
    design: Any = SimpleNamespace(candidates=words, linear_model=lambda: linear, with_finite_step=lambda places: design)
    score = SimpleNamespace(posterior=SimpleNamespace(s=0.0, kappa2=np.ones(1)))
    fit: Any = SimpleNamespace(score=score, sensitivities=design, posterior=(np.array([0.8, 0.0, 0.0, 1.0]), None))
    told = Identifiability(fit, 12.0)
    assert told.find_undetectable() == ["backlash@2"]
    assert told.find_confusable("payload@1") == ["torque_constant@1"]
    assert told.find_confusable("contact@2") == []
    assert set(Identifiability(fit, 1e7).find_undetectable()) == set(
        names
    )  # a log that counts for nothing shows nothing
    J[2] = 30 * rng.normal(size=rows)  # what the third does in its whole size
    block = np.vstack([first, J])
    wide = replace(linear, cross_products=CrossProducts((block @ block.T)[None], 1, 0))
    design.with_finite_step = lambda places: (
        SimpleNamespace(candidates=words, linear_model=lambda: wide) if places == [2] else None
    )
    assert Identifiability(fit, 12.0).find_undetectable() == []


# -- steps ------------------------------------------------------------------------------------------------------------


def test_a_step_is_held_near_where_it_begins_and_free_without_a_reach() -> None:
    linear, _, _, _, many = problem(np.random.default_rng(8))
    linear = LinearModel(linear.cross_products, linear.z, linear.r2, linear.rows, np.linspace(-0.5, 0.5, many))
    prior = np.full(many, 0.3)
    free = solve_with_scales(linear, prior, 0.3).mean
    ways = [
        float(np.linalg.norm(solve_with_scales(linear, prior, 0.3, None, r).mean - linear.theta))
        for r in (1e-4, 0.1, 1, 10)
    ]
    assert ways == sorted(ways) and ways[0] < 1e-3
    np.testing.assert_allclose(solve_with_scales(linear, prior, 0.3, None, 1e4).mean, free, rtol=1e-4, atol=1e-6)


def test_a_held_step_stays_within_bounds() -> None:
    linear, _, _, _, many = problem(np.random.default_rng(9))
    bounds = np.full(many, -0.01), np.full(many, 0.02)
    for reach in (0.1, 1.0, np.inf):
        mean = solve_with_scales(linear, np.full(many, 1.0), 0.3, bounds, reach).mean
        assert (mean >= -0.01 - 1e-12).all() and (mean <= 0.02 + 1e-12).all()


@pytest.mark.parametrize(
    "joints, flexible, rows, expected",
    [
        (1, 0, 100, LIKELIHOOD.torque_steps),
        (1, 1, 100, LIKELIHOOD.torque_steps // 2),
        (2, 2, 100, LIKELIHOOD.torque_steps // 4),
        (6, 6, 100, LIKELIHOOD.fewest_torque_steps),
        (1, 0, 50, 50 // 3),
        (1, 0, 25, 25 // 3),
    ],
)
def test_few_joints_get_more_steps_of_unexplained_torque(joints: int, flexible: int, rows: int, expected: int) -> None:
    arm = SimpleNamespace(n=joints, manifest={"flexible": list(range(1, flexible + 1))})
    record = SimpleNamespace(starts=np.array([0, rows]), ends=np.array([rows, 2 * rows]))
    found = count_torque_steps(SimpleNamespace(arm=arm, record=record))  # type: ignore[arg-type]
    assert found == expected and found * LIKELIHOOD.fewest_rows_of_step <= max(
        rows, LIKELIHOOD.fewest_torque_steps * LIKELIHOOD.fewest_rows_of_step
    )


# -- what the torsion shows -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("stiffness", [500.0, 2e4])
def test_a_wall_is_read_off_where_it_stands(sign: float, stiffness: float) -> None:
    arm = described(contact_stiffness_above_1=0.0, contact_stiffness_below_1=0.0)
    angle = 0.5 * np.sin(np.linspace(0, 40, 8000))
    depth = np.maximum(sign * angle - 0.42, 0.0)
    torque = sign * stiffness * depth + np.random.default_rng(1).normal(0, 0.02, 8000)
    torque[::7] *= 0.3  # bounces that the smoothed motion gets wrong
    sizes, shapes = _find_walls(arm, 1, angle, torque)
    side = "above" if sign > 0 else "below"
    assert list(sizes) == [f"contact_stiffness_{side}_1"] and list(shapes) == [f"contact_{side}_1"]
    assert sizes[f"contact_stiffness_{side}_1"] == pytest.approx(stiffness, rel=0.35)
    assert shapes[f"contact_{side}_1"] == pytest.approx(sign * 0.42, abs=0.01)


def test_a_hard_wall_against_which_an_arm_rests_is_read_off_where_it_begins() -> None:
    """A row or two tell of the way into it: between the shares of rows that lie beyond an angle there is a jump."""
    arm = described(contact_stiffness_above_1=0.0, contact_stiffness_below_1=0.0)
    free = 0.4 * np.sin(np.linspace(0, 40, 7600))
    into = np.r_[np.linspace(0.4, 0.424, 12), np.full(380, 0.424), np.linspace(0.424, 0.4, 12)]
    angle = np.concatenate([free, into + np.random.default_rng(3).normal(0, 1e-6, len(into))])
    torque = 2e4 * np.maximum(angle - 0.42, 0.0) + np.random.default_rng(1).normal(0, 0.5, len(angle))
    sizes, shapes = _find_walls(arm, 1, angle, torque)
    assert shapes["contact_above_1"] == pytest.approx(0.42, abs=5e-4)
    assert sizes["contact_stiffness_above_1"] == pytest.approx(2e4, rel=0.1)


def test_the_torque_of_a_wall_is_not_told_by_a_bias_and_the_arc_of_a_large_eccentricity() -> None:
    rng = np.random.default_rng(4)
    angle, torque = 0.15 + 0.44 * np.sin(np.linspace(0, 60, 6000)), rng.normal(0, 2.0, 6000)
    walled = angle < -0.22
    columns = np.stack([-np.ones(6000), -np.sin(angle), -np.cos(angle), torque], 1)
    true = np.array([3e-4, 4e-4, -2e-4, 1e-4])
    twist = columns @ true - 2e-3 * walled + rng.normal(0, 1e-6, 6000)
    named = {"encoder_bias_1": (0.1, 1e-3), "eccentricity_sine_1": (0.01, 5e-4), "eccentricity_cosine_1": (0.01, 5e-4)}
    kinds = ("constant", "joint_sine", "joint_cosine")
    terms: Any = [
        SimpleNamespace(name=name, low=-most, high=most, typical=usual, encoder_term=kind)
        for (name, (most, usual)), kind in zip(named.items(), kinds, strict=True)
    ]
    low, high = _coefficient_bounds(terms, columns)
    assert list(high) == [0.1, 4 * 5e-4, 4 * 5e-4, np.inf] and np.array_equal(low, -high)
    found = _regress_robustly(columns, twist, (low, high))
    assert (np.abs(found) <= high * (1 + 1e-9)).all() and found[3] == pytest.approx(1e-4, rel=0.05)
    left = twist - columns @ found
    assert np.median(left[walled]) < -1e-3, "what pushes back there is still to be told"
    np.testing.assert_allclose(_regress_robustly(columns[~walled], twist[~walled], (low, high)), true, rtol=0.02)


@pytest.mark.parametrize("torque", ["noise", "spring", "friction"])
def test_no_wall_is_read_off_where_there_is_none(torque: str) -> None:
    arm = described(contact_stiffness_above_1=0.0, contact_stiffness_below_1=0.0)
    angle = 0.5 * np.sin(np.linspace(0, 40, 8000))
    of = {
        "noise": np.random.default_rng(2).normal(0, 1.0, 8000),
        "spring": 5.0 * angle,  # softer than what is met in walls
        "friction": np.sign(np.gradient(angle)),
    }
    assert _find_walls(arm, 1, angle, of[torque]) == ({}, {})


def test_as_much_of_a_constant_as_an_eccentricity_can_make_is_its_zero() -> None:
    terms = {
        "encoder_bias_1": ("encoder_bias", "constant"),
        "eccentricity_sine_1": ("encoder_eccentricity", "joint_sine"),
        "eccentricity_cosine_1": ("encoder_eccentricity", "joint_cosine"),
        "eccentricity_zero_1": ("encoder_eccentricity", "zero_offset"),
    }
    own: Any = [SimpleNamespace(name=name, effect=effect, encoder_term=term) for name, (effect, term) in terms.items()]
    seen = {"encoder_bias_1": -3e-4, "eccentricity_sine_1": 3e-4, "eccentricity_cosine_1": 4e-4}
    assert _split_encoder_bias(own, seen) == {"encoder_bias_1": 0.0, "eccentricity_zero_1": 3e-4}
    more = _split_encoder_bias(own, seen | {"encoder_bias_1": -9e-4})
    assert more == pytest.approx({"encoder_bias_1": -4e-4, "eccentricity_zero_1": 5e-4})
    assert _split_encoder_bias(own, {"encoder_bias_1": 1e-3}) == {}


# -- what a verdict is made of ----------------------------------------------------------------------------------------


def test_what_changes_dry_friction_presupposes_some() -> None:
    without, some = described(coulomb_friction_1=0.0), described(coulomb_friction_1=0.04)
    stribeck = Candidate(EFFECTS["stribeck_friction"], 1, ("stribeck_torque_1",), {}, True)
    viscous = Candidate(EFFECTS["viscous_friction"], 1, ("viscous_friction_1",), {}, True)
    assert stribeck.required_effect(without) == "coulomb_friction@1"
    assert stribeck.required_effect(some) is None and viscous.required_effect(without) is None


def test_what_differs_at_standstill_only_is_not_named_twice() -> None:
    bias, other = (Candidate(EFFECTS["current_bias"], j, (f"bias_{j}",), {}, True) for j in (1, 2))
    uneven = Candidate(EFFECTS["asymmetric_friction"], 1, ("asymmetric_torque_1",), {}, True)
    assert bias.is_twin_of(uneven) and uneven.is_twin_of(bias)
    assert not bias.is_twin_of(bias) and not other.is_twin_of(uneven)


def test_what_stands_at_its_brim_is_tried_the_fullest_first() -> None:
    names = ("payload@2", "cable_spring@1", "stiffness@1", "current_bias@1")
    words = SimpleNamespace(
        members=[SimpleNamespace(name=name) for name in names],
        columns=[SimpleNamespace(candidate=k, spike_width=0.05) for k in (0, 1, 2, 2, 3, -1)],
        active=frozenset({"current_bias@1"}),
        is_nuisance=lambda c: c.candidate in (0, 1, 2),
    )
    mean = 0.05 * np.array(
        [SEARCH.at_bound_deviations + 0.1, SEARCH.at_bound_deviations - 0.1, 0.2, -3.0, 20.0, 3.0]
    )  # the fourth atom is free, the last no atom
    fit: Any = SimpleNamespace(sensitivities=SimpleNamespace(candidates=words), posterior=(mean, None))
    assert _find_at_bound(fit) == [2, 0]


def test_what_can_be_had_again_is_let_go_of_and_comes_back_the_same() -> None:
    linear, *_ = problem(np.random.default_rng(8))
    before = linear.normal_equations(0.3)
    linear.cross_products.drop_caches()
    assert not linear.cross_products.dense_cache and "eliminated_states" not in linear.cross_products.__dict__
    after = linear.normal_equations(0.3)
    assert (
        (before.products.dense == after.products.dense).all()
        and (before.b == after.b).all()
        and before.log_determinant == after.log_determinant
    )
    tune_malloc()
    tune_malloc()


def test_a_column_that_flew_apart_does_not_stop_the_search() -> None:
    """Its products with itself are so large that rounding makes the rest negative somewhere."""
    rng = np.random.default_rng(2)
    J = rng.normal(size=(50, 4))
    spike = np.full(4, 0.05)
    good = J.T @ J
    bad = good.copy()
    bad[0, 0] = -1e4  # as rounding of 1e20 leaves it
    bad[0, 1:] = bad[1:, 0] = 0.0
    b = J.T @ rng.normal(size=50)
    found = apply_laplace(TotalNormalEquations(bad, b, 50.0, 0.0), spike, 0.1, np.ones(1), None, 1.0)
    assert np.isfinite(found.evidence) and np.isfinite(found.mean).all()
    none = bad.copy()
    none[0, 0] = 0.0
    same = apply_laplace(TotalNormalEquations(none, b, 50.0, 0.0), spike, 0.1, np.ones(1), None, 1.0)
    np.testing.assert_allclose(found.mean, same.mean, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(found.covariance, same.covariance, rtol=1e-9, atol=1e-12)
