"""How little of everything a log has, and which ripple is in it though it has a little of everything."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from compiled import Compiled
from replayed import FLEXIBLE, simulated

from hdagen.adoption.verdict import applied
from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.data.gap import gap
from hdagen.diagnosis.data.split import Portion
from hdagen.diagnosis.data.windows import record
from hdagen.diagnosis.decision.verdict_content import hypothetical
from hdagen.diagnosis.inference.candidate_priors import SHARES
from hdagen.diagnosis.inference.local_fit import Fitted, sharing
from hdagen.diagnosis.inference.multiple_shooting import Shooting
from hdagen.diagnosis.inference.sensitivities import TEMPERATURE
from hdagen.diagnosis.initialization.candidate_list import dictionary
from hdagen.diagnosis.initialization.initial_guess import Suggested, suggested
from hdagen.diagnosis.search.null_model import nothing
from hdagen.diagnosis.search.ripple_order import heard, with_orders
from hdagen.prediction.window_replay import replay

Builder = Callable[..., Compiled]
EFFECTS = ("torque_ripple", "cable_spring", "current_bias", "encoder_eccentricity", "asymmetric_friction", "stiffness")
ORDER, RIPPLE = 9.0, 1.0  # and its size, usual ones


def none(build: Builder, share: float, ripple: float = 0.0) -> tuple[Fitted, Suggested]:
    """No effect meant, fitted to a log with every effect at ``share`` of its usual size, to one side or the other."""
    arm = Arm(build(FLEXIBLE, effects=EFFECTS).folder)
    words = dictionary(arm, Suggested({}, {}, {}))
    rng, truth, names = np.random.default_rng(5), arm.p.copy(), list(arm.parameters.described)
    for c in words.columns:
        if c.atom >= 0 and words.atoms[c.atom].first:
            truth[c.index] = c.center + share * rng.choice([-1.0, 1.0]) * c.unit
    truth[names.index("ripple_order_1")] = ORDER
    truth[names.index("ripple_sine_1")] += ripple * arm.parameters.described["ripple_sine_1"].typical
    log = simulated(arm.at(truth))
    shooting = Shooting(arm, record(arm, Portion(log, np.ones(len(log), bool)), 0.05))
    hints = suggested(arm, shooting.record)
    return nothing(shooting, dictionary(arm, hints)), hints


@pytest.mark.parametrize(("share", "found"), [(0.0, SHARES[-1:]), (SHARES[0], SHARES[:2])])
def test_a_log_says_how_little_of_everything_it_has(build: Builder, share: float, found: tuple[float, ...]) -> None:
    fit = none(build, share)[0]
    assert fit.design.words.share in found
    each = {s: sharing(fit, s).score.at.evidence for s in SHARES}
    assert max(each, key=lambda s: each[s]) == fit.design.words.share


def test_a_ripple_s_order_is_found_though_a_little_of_everything_is_there(build: Builder) -> None:
    fit, hints = none(build, 0.5 * SHARES[0], RIPPLE)
    usual = fit.design.shooting.arm.parameters.described["ripple_order_1"].starts
    assert ORDER not in usual
    assert with_orders(fit, hints).shapes["ripple_order_1"][0] == ORDER
    calm, hints = none(build, 0.0)
    assert ORDER not in with_orders(calm, hints).shapes["ripple_order_1"]


def test_with_no_effect_meant_base_parameters_bring_the_model_nearer(build: Builder) -> None:
    """What a flexible correction stands on: they alone, whatever is tolerated beside them."""
    arm = Arm(build(FLEXIBLE, effects=EFFECTS).folder)
    truth, names = arm.p.copy(), list(arm.parameters.described)
    truth[names.index("mass_2")] *= 1.04
    log, held = (simulated(arm.at(truth), seed=seed) for seed in (1, 2))
    shooting = Shooting(arm, record(arm, Portion.whole(log), 0.05))
    fit = nothing(shooting, dictionary(arm, suggested(arm, shooting.record)))
    plain, base = Arm(build(FLEXIBLE).folder), hypothetical(fit, ())
    assert not base.effects and base.base["mass_2"] == pytest.approx(truth[names.index("mass_2")], rel=0.02)
    before, after = (replay(one, held) for one in (plain, applied(plain, base)[0]))
    found = gap(before, after, Portion.whole(held))
    assert found["after"] < 0.5 * found["before"]


def test_an_order_that_is_heard_is_one_more_atom(build: Builder) -> None:
    fit, hints = none(build, 0.0, RIPPLE)
    usual = dictionary(fit.design.shooting.arm, hints)
    words = heard(fit, usual)
    assert words.atoms[:-1] == usual.atoms and words.columns[: len(usual.columns)] == usual.columns
    assert (words.atoms[-1].name, dict(words.atoms[-1].shapes)) == ("torque_ripple@1", {"ripple_order_1": ORDER})
    own = [c.parameter for c in words.columns if c.atom == len(words.atoms) - 1]
    assert own == [c.parameter for c in usual.columns if usual.atoms[c.atom].name == "torque_ripple@1"][: len(own)]
    assert not any(c.base for c in words.columns[len(usual.columns) :]) and own
    assert heard(fit, words) is words  # it is known now
    calm, hints = none(build, 0.0)
    usual = dictionary(calm.design.shooting.arm, hints)
    assert heard(calm, usual) is usual


def test_another_share_is_the_same_there_and_back_with_or_without_columns(build: Builder) -> None:
    fit = none(build, SHARES[0])[0]
    words = fit.design.words
    there = words.sharing(SHARES[-1])
    assert there.share == SHARES[-1] and (there.spike <= words.spike).all() and (there.spike < words.spike).any()
    np.testing.assert_allclose(there.sharing(words.share).spike, words.spike, rtol=1e-9)
    rest = [c for c in words.columns if c.atom < 0]
    assert [c for c in there.columns if c.atom < 0] == rest
    for share in SHARES:
        whole, bare = sharing(fit, share), sharing(fit.bare(), share)
        assert whole.whole and not bare.whole and bare.design.words.share == share
        assert bare.clean - bare.score.evidence == pytest.approx(fit.clean - fit.score.evidence, abs=1e-6)
        s, kappa2 = whole.score.at.s, whole.score.at.kappa2
        if share == words.share:
            assert whole.score.evidence == pytest.approx(fit.score.evidence, abs=0.5)
            assert bare.score.evidence == pytest.approx(fit.score.evidence, abs=1e-6)
        elif s == fit.score.at.s:
            assert bare.score.evidence == pytest.approx(whole.score.evidence, abs=2.0)
        assert kappa2.shape == fit.score.at.kappa2.shape and whole.evidence(TEMPERATURE) == pytest.approx(whole.reached)


@pytest.mark.parametrize("share", SHARES)
def test_a_wall_that_no_one_meant_is_tolerated_as_a_cable_is(build: Builder, share: float) -> None:
    arm = Arm(build(FLEXIBLE, effects=("contact", "cable_spring")).folder)
    words = dictionary(arm, Suggested({}, {}, {})).sharing(share)
    widths = {c.parameter: c.spike * c.unit for c in words.columns if c.atom >= 0 and words.atoms[c.atom].first}
    assert widths["contact_stiffness_above_1"] == pytest.approx(widths["cable_stiffness_1"])
    assert widths["cable_stiffness_1"] == pytest.approx(share * arm.parameters.described["cable_stiffness_1"].typical)
    assert arm.parameters.described["contact_stiffness_above_1"].typical > 30 * widths["contact_stiffness_above_1"]
