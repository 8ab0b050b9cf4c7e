"""How a fit moves: the size of unexplained torque, steps that leave less of it, when it stands, who stays in a race."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from catalogue import EFFECTS

from hdagen.diagnosis.inference import fit_steps
from hdagen.diagnosis.inference.batch_evidence import ResidualBatch
from hdagen.diagnosis.inference.candidate_priors import Candidate, CandidateSet, Column
from hdagen.diagnosis.inference.fit_settings import FIT
from hdagen.diagnosis.inference.fit_steps import advance_fit
from hdagen.diagnosis.inference.linear_gaussian import CrossProducts, NormalEquations, ReducedProducts
from hdagen.diagnosis.inference.linear_model import LinearModel
from hdagen.diagnosis.inference.local_fit import Fit
from hdagen.diagnosis.inference.marginal_likelihood import (
    TORQUE_GRID,
    apply_laplace,
    compute_posteriors,
    solve_with_scales,
)
from hdagen.diagnosis.search import close_calls, hypothesis_race, multistart
from hdagen.diagnosis.search.fit_ranking import drop_undeserved, first_with_columns
from hdagen.diagnosis.search.hypothesis_race import run_race, start_promising
from hdagen.diagnosis.search.search_settings import SEARCH
from hdagen.diagnosis.stages.time_budget import TimeBudget


def shaken(s: float, many: int = 3, by_torque: bool = False) -> LinearModel:
    """Windows of noise and of torques of size ``s``, which no parameter of ``many`` tells; ``by_torque``: each
    parameter acts as a torque does."""
    rng = np.random.default_rng(11)
    m, k, rows, windows = 2, 8, 60, 40
    blocks = [rng.normal(size=(rows, m + k + many)) for _ in range(windows)]
    if by_torque:
        blocks = [np.hstack([b[:, : m + k], b[:, m : m + k] @ rng.normal(size=(k, many))]) for b in blocks]
    left = [rng.normal(size=rows) + b[:, m : m + k] @ (s * rng.normal(size=k)) for b in blocks]
    gram = CrossProducts(np.stack([b.T @ b for b in blocks]), m, k)
    z = np.stack([b.T @ r for b, r in zip(blocks, left, strict=True)])
    return LinearModel(gram, z, np.array([r @ r for r in left]), np.full(windows, rows), np.zeros(many))


@pytest.mark.parametrize("near", [0.0, 1e-3, 0.1, 3.0, 100.0])
@pytest.mark.parametrize("true", [0.0, 0.3, 1.7])
def test_the_size_of_unexplained_torque_is_found_from_anywhere(true: float, near: float) -> None:
    linear, spike = shaken(true), np.full(3, 0.1)
    best = max(compute_posteriors(linear, spike, near), key=lambda one: one.evidence)
    fine = (*TORQUE_GRID, *np.geomspace(TORQUE_GRID[1], TORQUE_GRID[-1], 12 * len(TORQUE_GRID)))
    grid, exact = (
        max((solve_with_scales(linear, spike, s) for s in sizes), key=lambda one: one.evidence)
        for sizes in (TORQUE_GRID, fine)
    )
    assert best.evidence >= grid.evidence - 1e-9
    assert best.evidence == pytest.approx(exact.evidence, abs=0.1)
    if true:
        assert best.s == pytest.approx(exact.s, rel=0.03)
    assert best.s == pytest.approx(true, rel=0.3, abs=0.05)


def test_the_compared_evidence_is_smooth_in_the_size_of_torques() -> None:
    """Hypotheses are compared by evidence for which a few columns pay. From a point of the grid of sizes to the next
    one it had a step of some nine nats here."""
    spike, own, found = np.full(30, 3.0), np.array([0]), []
    for true in np.geomspace(0.3, 0.6, 17):
        posteriors = compute_posteriors(shaken(true, 30, by_torque=True), spike, 0.3)
        found.append(max(posteriors, key=lambda one: one.evidence).evidence_paid_by(spike, own))
    assert np.abs(np.diff(found, 2)).max() < 2.0


@pytest.mark.parametrize("s", [0.0, 0.03, 1.0])
@pytest.mark.parametrize("temperature", [1.0, 12.0])
def test_many_residuals_at_once_are_each_as_alone(s: float, temperature: float) -> None:
    """Loud windows among quiet ones, so that scales settle after more or fewer rounds."""
    alone, rng, count = shaken(0.3), np.random.default_rng(5), 7
    theta, spikes = rng.normal(size=(count, 3)), rng.uniform(0.01, 2.0, (count, 3))
    loud = np.where(rng.random((count, 40)) < 0.2, rng.uniform(1.0, 100.0, (count, 40)), 1.0)
    z, r2 = np.sqrt(loud)[..., None] * alone.z, loud * alone.r2
    found = ResidualBatch(alone.cross_products, z, r2, alone.rows, theta, temperature).log_evidences(s, spikes)
    each = [
        solve_with_scales(
            LinearModel(alone.cross_products, each_z, each_r2, rows, start, temperature), spike, s
        ).evidence
        for each_z, each_r2, rows, start, spike in zip(
            z, r2, np.tile(alone.rows, (count, 1)), theta, spikes, strict=True
        )
    ]
    np.testing.assert_allclose(found, each, rtol=1e-9)
    assert np.ptp(each) > 10.0


UNLIMITED = SimpleNamespace(budget=TimeBudget())  # a simulator whose time is never up


def fit(evidence: float, ahead: float = 0.0, level: float = 1.0, **more: Any) -> Any:
    """A fit that stands at ``evidence``, of which it has not yet reached ``ahead``, with windows at ``level``."""
    score = SimpleNamespace(evidence=evidence, posterior=SimpleNamespace(s=0.5, noise_level=level))
    at: Any = more.pop(
        "sensitivities", SimpleNamespace(shooting=UNLIMITED, cross_products=CrossProducts(np.zeros((1, 1, 1)), 0, 0))
    )
    return Fit((1,), at, score, np.zeros(1), evidence, ahead, **more)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("ahead", "level", "ends", "found", "tried"),
    [
        (
            0.5,
            1.0,
            {FIT.stiff_torque_share: -90.0, 1.0: -85.0},
            -90.0,
            [FIT.stiff_torque_share],
        ),  # the first that is better
        (0.5, 1.0, {FIT.stiff_torque_share: -103.0, 1.0: -95.0}, -95.0, [FIT.stiff_torque_share, 1.0]),
        (0.5, 1.0, {FIT.stiff_torque_share: -103.0, 1.0: -101.0}, -100.0, [FIT.stiff_torque_share, 1.0]),
        (0.5, 1.0, {FIT.stiff_torque_share: None, 1.0: None}, -100.0, [FIT.stiff_torque_share, 1.0]),
        (
            0.5,
            1.0,
            {FIT.stiff_torque_share: -99.99, 1.0: -95.0},
            -95.0,
            [FIT.stiff_torque_share, 1.0],
        ),  # a little is no reason to stand
        (
            0.5,
            9.0,
            {FIT.stiff_torque_share: -90.0, 1.0: -95.0},
            -95.0,
            [1.0],
        ),  # where the log leaves many times its noise
        (0.5, 9.0, {FIT.stiff_torque_share: -90.0, 1.0: -105.0}, -90.0, [1.0, FIT.stiff_torque_share]),
        (
            40.0,
            1.0,
            {FIT.stiff_torque_share: -130.0, 1.0: -145.0},
            -130.0,
            [FIT.stiff_torque_share, 1.0],
        ),  # better than what was reached
        (40.0, 1.0, {FIT.stiff_torque_share: -141.0, 1.0: -145.0}, -100.0, [FIT.stiff_torque_share, 1.0]),
        (0.05, 1.0, {FIT.stiff_torque_share: -90.0, 1.0: -85.0}, -100.0, []),  # its own linear model promises no more
    ],
)
def test_a_step_is_kept_that_beats_what_was_reached(
    monkeypatch: pytest.MonkeyPatch,
    ahead: float,
    level: float,
    ends: dict[float, float | None],
    found: float,
    tried: list[float],
) -> None:
    at = SimpleNamespace(shooting=UNLIMITED, cross_products=CrossProducts(np.zeros((1, 1, 1)), 0, 0))
    begun, shares = fit(-100.0, ahead, level, sensitivities=at), []

    def descend(design: Any, atoms: Any, score: Any, share: float) -> Any:
        shares.append(share)
        end = ends[share]
        return (
            at
            if end is None
            else SimpleNamespace(
                end=end, cross_products=CrossProducts(np.zeros((1, 1, 1)), 0, 0), shooting=0, point=end
            )
        )

    monkeypatch.setattr(fit_steps, "descend_gauss_newton", descend)
    monkeypatch.setattr(
        fit_steps, "start_fit_at", lambda shooting, words, atoms, point, near, clean, beside: fit(point)
    )
    moved = advance_fit(begun, None)  # type: ignore[arg-type]
    assert moved.score.evidence == found and shares == tried
    assert moved.has_converged == (found == -100.0)
    assert advance_fit(fit(-100.0, has_converged=True), None).score.evidence == -100.0  # type: ignore[arg-type]


def test_a_fit_that_hardly_gets_better_stands(monkeypatch: pytest.MonkeyPatch) -> None:
    there: Any = SimpleNamespace(cross_products=CrossProducts(np.zeros((1, 1, 1)), 0, 0), shooting=0, point=0)
    monkeypatch.setattr(fit_steps, "descend_gauss_newton", lambda *given: there)
    for gain in (0.5 * FIT.least_evidence_step, 2 * FIT.least_evidence_step):
        monkeypatch.setattr(fit_steps, "start_fit_at", lambda *given, end=-100.0 + gain: fit(end))
        assert advance_fit(fit(-100.0, 0.5), None).has_converged == (gain < FIT.least_evidence_step)  # type: ignore[arg-type]


def test_what_is_only_promised_and_never_reached_is_not_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """A step may end where a linear model promises much that the steps after it do not come to."""
    way = iter([(-95.0, 3.0), (-40.0, 200.0), (-60.0, 190.0)])
    monkeypatch.setattr(hypothesis_race, "advance_fit", lambda one, words: fit(*next(way)))
    found = hypothesis_race.continue_fit(fit(-100.0, 1.0), None, 3, 1.0)  # type: ignore[arg-type]
    assert (found.score.evidence, found.evidence_here) == (-95.0, -98.0)
    realised = iter([(-40.0, 200.0), (-41.0, 10.0), (-41.0, 0.5), (-41.0, 0.5)])
    monkeypatch.setattr(hypothesis_race, "advance_fit", lambda one, words: fit(*next(realised)))
    assert hypothesis_race.continue_fit(fit(-100.0), None, 8, 1.0).evidence_here == -41.5  # type: ignore[arg-type]


class Runner(SimpleNamespace):
    """A fit that stands, with nothing to let go of."""

    has_columns, has_converged, has_kept_columns = True, True, False
    misfit_temperature, noise_only_evidence = 1.0, 0.0
    misfit = property(lambda self: -self.evidence_here)
    sensitivities = SimpleNamespace(shooting=UNLIMITED, drop_products=lambda: None)

    def without_columns(self) -> Any:
        return self


def runners(ends: dict[str, float]) -> Any:
    """A field by name and evidence."""
    return [
        Runner(effects=tuple(n), names=n, score=SimpleNamespace(evidence=e), evidence_here=e) for n, e in ends.items()
    ]


@pytest.mark.parametrize(
    ("lead", "other", "rounds"),
    [
        (4.5 * SEARCH.close_call_margin, 1.6 * SEARCH.close_call_margin, 3),
        (4.5 * SEARCH.close_call_margin, 1.4 * SEARCH.close_call_margin, 1),
        (1.2 * SEARCH.close_call_margin, 0.3 * SEARCH.close_call_margin, 3),
    ],
)
def test_who_trails_by_little_is_fitted_to_the_end(
    monkeypatch: pytest.MonkeyPatch, lead: float, other: float, rounds: int
) -> None:
    """Where all are close, a third of what the best gains over none parts nobody."""
    fitted: list[str] = []

    def further(words: Any, when: str, one: Any) -> Any:
        fitted.append(one.names)
        return one

    monkeypatch.setattr(hypothesis_race, "advance_with_note", further)
    ends = {"": 0.0, "leading": lead, "other": other}
    monkeypatch.setattr(hypothesis_race, "_is_outdone", lambda none, lead: False)
    found = run_race(runners(ends), None, (3, 3, 3), lambda word: None)  # type: ignore[arg-type]
    assert [f.names for f in found] == ["leading", "other", ""]
    assert fitted.count("other") == rounds


def test_who_promises_next_to_nothing_beside_the_leader_is_not_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    fitted: list[str] = []
    monkeypatch.setattr(hypothesis_race, "advance_with_note", lambda words, when, one: fitted.append(one.names) or one)
    ends = {
        "": 0.0,
        "leading": 30 * SEARCH.close_call_margin,
        "some": 4 * SEARCH.close_call_margin,
        "faint": 2 * SEARCH.close_call_margin,
    }
    monkeypatch.setattr(hypothesis_race, "_is_outdone", lambda none, lead: False)
    found = run_race(runners(ends), None, (4, 4, 4), lambda word: None)  # type: ignore[arg-type]
    assert set(fitted) == {"", "leading", "some"}
    assert [f.names for f in found] == ["leading", "some", "faint", ""]


def test_what_promises_a_small_part_of_what_another_one_does_is_not_begun(monkeypatch: pytest.MonkeyPatch) -> None:
    most = 100.0
    gains = {
        "leading": most,
        "some": 1.1 * SEARCH.least_promise_share * most,
        "faint": 0.9 * SEARCH.least_promise_share * most,
    }
    words: Any = SimpleNamespace(
        members=[SimpleNamespace(name=name) for name in gains], is_compatible=lambda *given: True
    )
    at: Any = SimpleNamespace(shooting=SimpleNamespace(arm=None, budget=TimeBudget()))
    scored: Any = [SimpleNamespace(effects=(), evidence=-7.0, posterior=SimpleNamespace(s=0.1))]
    scored += [SimpleNamespace(effects=(k,), evidence=-7.0 + gain) for k, gain in enumerate(gains.values())]
    monkeypatch.setattr(hypothesis_race, "start_fit", lambda at, words, atoms, near, start: atoms)
    assert gains["faint"] > SEARCH.least_evidence_gain
    assert start_promising(at, words, scored, {}, (), 9, SEARCH.least_evidence_gain) == [(0,), (1,)]


def test_sets_that_begin_by_themselves_take_no_place_from_what_is_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    fitted: list[str] = []
    monkeypatch.setattr(hypothesis_race, "advance_with_note", lambda words, when, one: fitted.append(one.names) or one)
    field = runners(
        {
            "ab": 10 * SEARCH.close_call_margin,
            "abc": 9.9 * SEARCH.close_call_margin,
            "a": 9.8 * SEARCH.close_call_margin,
            "b": 9.7 * SEARCH.close_call_margin,
        }
    )
    run_race(field, None, (1, 1), lambda word: None)  # type: ignore[arg-type]
    assert {name: fitted.count(name) for name in ("ab", "abc", "a", "b")} == {"ab": 2, "abc": 2, "a": 2, "b": 1}


@pytest.mark.parametrize(("ahead", "leads"), [(0.9, "a"), (1.1, "ab")])
def test_a_set_leads_only_if_it_is_ahead_by_more_than_the_prior_takes(ahead: float, leads: str) -> None:
    class Whole(Runner):
        has_columns = True

        def without_columns(self) -> Any:
            return Runner(**vars(self), has_columns=False)

    ends = {"ab": ahead * SEARCH.effect_penalty, "a": 0.0, "": -100.0}
    field: Any = [
        Whole(effects=tuple(n), names=n, score=SimpleNamespace(evidence=e), evidence_here=e) for n, e in ends.items()
    ]
    found = drop_undeserved(field)
    assert [f.names for f in found] == list(ends)  # none is lost
    assert first_with_columns(found).names == leads


@pytest.mark.parametrize(("lacks", "rounds"), [(0.9 * SEARCH.outdone_ratio, 3), (1.1 * SEARCH.outdone_ratio, 0)])
def test_none_is_not_fitted_further_where_it_promises_to_leave_many_times_what_the_best_has_reached(
    monkeypatch: pytest.MonkeyPatch, lacks: float, rounds: int
) -> None:
    fitted: list[str] = []
    monkeypatch.setattr(hypothesis_race, "advance_with_note", lambda words, when, one: fitted.append(one.names) or one)
    field = runners({"": -2000.0 * lacks, "leading": -2000.0})
    found = run_race(field, None, (3, 3, 3), lambda word: None)  # type: ignore[arg-type]
    assert [f.names for f in found] == ["leading", ""]
    assert fitted.count("leading") == 3 and fitted.count("") == rounds


def test_a_tilt_is_tried_at_its_sizes_and_a_ripple_is_not() -> None:
    """Dry friction makes a small tilt no small matter; of a sine and a cosine of a known order a slope says all."""
    names = ["tilt_x", "tilt_y", "ripple_sine_1", "ripple_cosine_1", "ripple_order_1"]
    described = {name: SimpleNamespace(low=-10.0, high=10.0, is_motor_order="order" in name) for name in names}
    parameters = SimpleNamespace(described=described, clip_to_bounds=np.array, place=names.index)
    arm = SimpleNamespace(parameters=parameters)
    atoms = (
        Candidate(EFFECTS["gravity_tilt"], 0, ("tilt_x", "tilt_y"), {}, True),
        Candidate(EFFECTS["torque_ripple"], 1, ("ripple_sine_1", "ripple_cosine_1"), {"ripple_order_1": 2.0}, True),
    )
    columns = tuple(Column(name, k, 0.0, 1.0, 0.05, k // 2, False) for k, name in enumerate(names[:4]))
    words = CandidateSet(atoms, columns)
    at: Any = SimpleNamespace(
        shooting=SimpleNamespace(arm=arm),
        point=SimpleNamespace(p=np.zeros(5), initial_states=np.zeros((1, 2))),
        candidates=words,
    )
    tried = [point.p[:2] for point in multistart._displace_candidate(at, words, 0, atoms[0])]
    assert {tuple(np.sign(p)) for p in tried} == {(1, 0), (-1, 0), (0, 1), (0, -1)}
    assert max(np.abs(p).max() for p in tried) == max(SEARCH.scanned_sizes)
    assert not multistart._displace_candidate(at, words, 1, atoms[1])


def test_what_rounding_leaves_is_no_evidence() -> None:
    """Columns that flew apart by 10¹² noises cancel to nothing, or to less: that must not beat an honest fit."""
    linear = shaken(0.3)
    honest = solve_with_scales(linear, np.full(3, 0.1), 0.3)
    rng = np.random.default_rng(3)
    wild = np.stack([a.T @ a for a in rng.normal(size=(40, 60, 3)) * [1e12, 1e12, 1.0]])
    theta = np.array([1e3, -1e3, 0.0])
    b = wild @ theta
    reduced = NormalEquations(ReducedProducts.from_whole(wild), b, b @ theta * (1.0 - 1e-15), 0.0, np.full(40, 58))
    assert reduced.chi2(theta).min() > 1e12
    for bounds in (None, (np.full(3, -1.0), np.full(3, 1.0))):
        assert apply_laplace(
            reduced.sum_windows(np.ones(40)), np.full(3, 1e6), 0.3, np.ones(40), bounds, 1.0
        ).evidence < min(honest.evidence, -1e12)


@pytest.mark.parametrize(
    ("steps", "close"),
    [
        ([-3.5], False),  # two more such steps would not do
        ([-2.5, -2.4], False),
        ([-2.5, -1.5, -1.2], False),
        ([-2.5, -1.5, -0.9], True),
        ([0.5, 0.5, 0.5], True),  # where the lead ought to have come to
    ],
)
def test_what_begins_where_the_lead_stands_ends_where_it_does_not_come_close(
    monkeypatch: pytest.MonkeyPatch, steps: list[float], close: bool
) -> None:
    def runner(evidence: float) -> Any:
        score, given_up = (
            SimpleNamespace(evidence=SEARCH.close_call_margin * evidence),
            SimpleNamespace(has_columns=False),
        )
        given = {"names": ("one",), "misfit_temperature": 1.0, "has_columns": True, "without_columns": lambda: given_up}
        return SimpleNamespace(effects=(0,), score=score, evidence_here=score.evidence, **given)

    walk = [runner(step) for step in steps]
    monkeypatch.setattr(close_calls, "advance_with_note", lambda words, when, one: walk.pop(0))
    begin: Any = (lambda lead, words, atoms: runner(-4.0), (0,))
    found = close_calls.fit_from_leader(runner(0.0), None, begin)  # type: ignore[arg-type]
    assert found.has_columns == close and not walk
