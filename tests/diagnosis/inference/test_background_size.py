"""How little of everything a log has, and which ripple is in it though it has a little of everything."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from compiled import Compiled
from replayed import FLEXIBLE, SEVERAL, simulated

from hdagen.adoption.verdict import apply_verdict
from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.data.held_out_gap import evaluate_gap
from hdagen.diagnosis.data.split import LogPortion
from hdagen.diagnosis.data.windows import cut_windows
from hdagen.diagnosis.decision.verdict_content import build_hypothetical_verdict
from hdagen.diagnosis.inference.candidate_settings import CANDIDATES
from hdagen.diagnosis.inference.likelihood_settings import LIKELIHOOD
from hdagen.diagnosis.inference.local_fit import Fit, rescale_spikes
from hdagen.diagnosis.inference.multiple_shooting import MultipleShooting
from hdagen.diagnosis.initialization.candidate_list import build_candidates
from hdagen.diagnosis.initialization.initial_guess import InitialGuess, guess_from_log
from hdagen.diagnosis.search.null_model import fit_without_effects
from hdagen.diagnosis.search.ripple_order import add_ripple_orders, suggest_ripple_orders
from hdagen.prediction.window_replay import replay

Builder = Callable[..., Compiled]
Background = Callable[..., tuple[Fit, InitialGuess]]
EFFECTS = ("torque_ripple", "cable_spring", "current_bias", "encoder_eccentricity", "asymmetric_friction", "stiffness")
ORDER, RIPPLE = 9.0, 1.0  # and its size, usual ones


def fit_background(build: Builder, share: float, ripple: float) -> tuple[Fit, InitialGuess]:
    """No effect meant, fitted to a log with every effect at ``share`` of its usual size, to one side or the other."""
    arm = Arm(build(FLEXIBLE, effects=EFFECTS).folder)
    words = build_candidates(arm, InitialGuess({}, {}, {}))
    rng, truth, names = np.random.default_rng(5), arm.p.copy(), list(arm.parameters.described)
    for c in words.columns:
        if c.candidate >= 0 and words.members[c.candidate].has_default_shapes:
            truth[c.index] = c.center + share * rng.choice([-1.0, 1.0]) * c.unit
    truth[names.index("ripple_order_1")] = ORDER
    truth[names.index("ripple_sine_1")] += ripple * float(arm.parameters.described["ripple_sine_1"].typical or 0.0)
    log = simulated(arm.with_parameters(truth))
    shooting = MultipleShooting(arm, cut_windows(arm, LogPortion(log, np.ones(len(log), bool)), 0.05))
    hints = guess_from_log(arm, shooting.record)
    return fit_without_effects(shooting, build_candidates(arm, hints)), hints


@pytest.fixture(scope="module")
def none(build: Builder) -> Background:
    """none(share, ripple=0.0) -> the fit of `fit_background`, made once."""
    return cache(lambda share, ripple=0.0: fit_background(build, share, ripple))


@pytest.mark.parametrize(
    ("share", "found"), [(0.0, CANDIDATES.spike_scales[-1:]), (CANDIDATES.spike_scales[0], CANDIDATES.spike_scales[:2])]
)
def test_a_log_says_how_little_of_everything_it_has(none: Background, share: float, found: tuple[float, ...]) -> None:
    fit = none(share)[0]
    assert fit.sensitivities.candidates.spike_scale in found
    each = {s: rescale_spikes(fit, s).score.posterior.evidence for s in CANDIDATES.spike_scales}
    assert max(each, key=lambda s: each[s]) == fit.sensitivities.candidates.spike_scale


def test_a_ripple_s_order_is_found_though_a_little_of_everything_is_there(none: Background) -> None:
    fit, hints = none(0.5 * CANDIDATES.spike_scales[0], RIPPLE)
    usual = fit.sensitivities.shooting.arm.parameters.described["ripple_order_1"].starts
    assert ORDER not in usual
    assert suggest_ripple_orders(fit, hints).shapes["ripple_order_1"][0] == ORDER
    calm, hints = none(0.0)
    assert ORDER not in suggest_ripple_orders(calm, hints).shapes["ripple_order_1"]


def test_with_no_effect_meant_base_parameters_bring_the_model_nearer(build: Builder) -> None:
    """What a flexible correction stands on: they alone, whatever is tolerated beside them."""
    arm = Arm(build(FLEXIBLE, effects=EFFECTS).folder)
    truth, names = arm.p.copy(), list(arm.parameters.described)
    truth[names.index("mass_2")] *= 1.04
    log, held = (simulated(arm.with_parameters(truth), seed=seed) for seed in (1, 2))
    shooting = MultipleShooting(arm, cut_windows(arm, LogPortion.all_rows(log), 0.05))
    fit = fit_without_effects(shooting, build_candidates(arm, guess_from_log(arm, shooting.record)))
    plain, base = Arm(build(FLEXIBLE).folder), build_hypothetical_verdict(fit, ())
    assert not base.effects and base.base_parameters["mass_2"] == pytest.approx(truth[names.index("mass_2")], rel=0.02)
    before, after = (replay(one, held) for one in (plain, apply_verdict(plain, base)[0]))
    found = evaluate_gap(before, after, LogPortion.all_rows(held))
    assert found["after"] < 0.5 * found["before"]


def test_an_order_that_is_heard_is_one_more_atom(none: Background) -> None:
    fit, hints = none(0.0, RIPPLE)
    usual = build_candidates(fit.sensitivities.shooting.arm, hints)
    words = add_ripple_orders(fit, usual)
    assert words.members[:-1] == usual.members and words.columns[: len(usual.columns)] == usual.columns
    assert (words.members[-1].name, dict(words.members[-1].shapes)) == ("torque_ripple@1", {"ripple_order_1": ORDER})
    own = [c.parameter for c in words.columns if c.candidate == len(words.members) - 1]
    assert (
        own == [c.parameter for c in usual.columns if usual.members[c.candidate].name == "torque_ripple@1"][: len(own)]
    )
    assert not any(c.in_every_hypothesis for c in words.columns[len(usual.columns) :]) and own
    assert add_ripple_orders(fit, words) is words  # it is known now
    calm, hints = none(0.0)
    usual = build_candidates(calm.sensitivities.shooting.arm, hints)
    assert add_ripple_orders(calm, usual) is usual


def test_another_share_is_the_same_there_and_back_with_or_without_columns(none: Background) -> None:
    fit = none(CANDIDATES.spike_scales[0])[0]
    words = fit.sensitivities.candidates
    there = words.with_spike_scale(CANDIDATES.spike_scales[-1])
    assert (
        there.spike_scale == CANDIDATES.spike_scales[-1]
        and (there.spike_widths <= words.spike_widths).all()
        and (there.spike_widths < words.spike_widths).any()
    )
    np.testing.assert_allclose(there.with_spike_scale(words.spike_scale).spike_widths, words.spike_widths, rtol=1e-9)
    rest = [c for c in words.columns if c.candidate < 0]
    assert [c for c in there.columns if c.candidate < 0] == rest
    for share in CANDIDATES.spike_scales:
        whole, bare = rescale_spikes(fit, share), rescale_spikes(fit.without_columns(), share)
        assert whole.has_columns and not bare.has_columns and bare.sensitivities.candidates.spike_scale == share
        assert bare.noise_only_evidence - bare.score.evidence == pytest.approx(
            fit.noise_only_evidence - fit.score.evidence, abs=1e-6
        )
        s, kappa2 = whole.score.posterior.s, whole.score.posterior.kappa2
        if share == words.spike_scale:
            assert whole.score.evidence == pytest.approx(fit.score.evidence, abs=0.5)
            assert bare.score.evidence == pytest.approx(fit.score.evidence, abs=1e-6)
        elif s == fit.score.posterior.s:
            assert bare.score.evidence == pytest.approx(whole.score.evidence, abs=2.0)
        assert kappa2.shape == fit.score.posterior.kappa2.shape and whole.tempered_evidence(
            LIKELIHOOD.likelihood_temperature
        ) == pytest.approx(whole.evidence_here)


@pytest.mark.parametrize("share", CANDIDATES.spike_scales)
def test_a_wall_that_no_one_meant_is_tolerated_as_a_cable_is(build: Builder, share: float) -> None:
    arm = Arm(build(FLEXIBLE, effects=SEVERAL).folder)
    words = build_candidates(arm, InitialGuess({}, {}, {})).with_spike_scale(share)
    widths = {
        c.parameter: c.spike_width * c.unit
        for c in words.columns
        if c.candidate >= 0 and words.members[c.candidate].has_default_shapes
    }
    assert widths["contact_stiffness_above_1"] == pytest.approx(widths["cable_stiffness_1"])
    described = arm.parameters.described
    cable, wall = (float(described[name].typical or 0.0) for name in ("cable_stiffness_1", "contact_stiffness_above_1"))
    assert widths["cable_stiffness_1"] == pytest.approx(share * cable)
    assert wall > 30 * widths["contact_stiffness_above_1"]
