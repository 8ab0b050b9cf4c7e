"""Base parameters as a verdict states them: a model without nuisance effects takes them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from catalogue import EFFECTS
from compiled import Compiled
from replayed import FLEXIBLE, simulated

from hdagen.adoption.verdict import MOST_TOLERANCES, apply_verdict, read_verdict
from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.data.held_out_gap import evaluate_gap
from hdagen.diagnosis.data.split import LogPortion
from hdagen.diagnosis.data.windows import cut_windows
from hdagen.diagnosis.decision.parameter_estimates import (
    _compute_conditional_deviations,
    _refit_without_nuisances,
    estimate_base_parameters,
)
from hdagen.diagnosis.inference.candidate_priors import Candidate, CandidateSet, Column
from hdagen.diagnosis.inference.local_fit import Fit
from hdagen.diagnosis.inference.multiple_shooting import MultipleShooting
from hdagen.diagnosis.initialization.candidate_list import build_candidates
from hdagen.diagnosis.initialization.initial_guess import guess_from_log
from hdagen.diagnosis.search.null_model import fit_without_effects
from hdagen.prediction.window_replay import replay

Builder = Callable[..., Compiled]
BASE, NUISANCES, NAMED = ("mass_1", "inertia_1"), ("bias_1", "cable_stiffness_1", "load_share_1"), "payload_mass_1"
EFFECT_OF = {"bias_1": "current_bias", "cable_stiffness_1": "cable_spring", "load_share_1": "load_dependent_friction"}
EFFECT_OF |= {NAMED: "payload"}
WIDTH = 0.2  # spike width


def make_fit(theta: np.ndarray, covariance: np.ndarray) -> Any:
    """A fit with a payload, two base parameters and three nuisance effects, of a posterior about ``theta``."""
    names = (*BASE, *NUISANCES, NAMED)
    members = tuple(Candidate(EFFECTS[effect], 1, (name,), {}, True, False) for name, effect in EFFECT_OF.items())
    place = {name: k for k, name in enumerate(EFFECT_OF)}
    columns = tuple(Column(name, k, 0.0, 1.0, WIDTH, place.get(name, -1), name in BASE) for k, name in enumerate(names))
    described = {
        name: SimpleNamespace(tolerance=0.1 * (name in BASE), equivalent=None, low=-50.0, high=50.0) for name in names
    }
    active = frozenset({members[place[NAMED]].name})
    arm = SimpleNamespace(parameters=SimpleNamespace(described=described))
    sensitivities = SimpleNamespace(
        candidates=CandidateSet(members, columns, active),
        shooting=SimpleNamespace(arm=arm),
        point=SimpleNamespace(p=theta),
    )
    return SimpleNamespace(effects=(place[NAMED],), sensitivities=sensitivities, posterior=(theta, covariance))


def refit_without_nuisances(fit: Any) -> np.ndarray:
    """The change of each parameter in θ, by the standard deviations of the fit's own posterior."""
    return _refit_without_nuisances(fit, _compute_conditional_deviations(fit.posterior[1]))


def draw_posterior(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """θ (6), and a covariance of correlated parameters."""
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((6, 6)) * 0.1 * WIDTH
    return rng.uniform(-0.3, 0.3, 6) * WIDTH, root @ root.T + 1e-4 * np.eye(6)


@pytest.mark.parametrize("seed", range(5))
def test_base_parameters_are_those_of_the_posterior_under_the_condition_that_no_nuisance_is_there(seed: int) -> None:
    theta, covariance = draw_posterior(seed)
    held, base = [2, 3, 4, 5], [0, 1]  # nuisance effects and the named one
    alone = 1.0 / np.sqrt(np.diagonal(np.linalg.inv(covariance)))  # standard deviations, all else fixed
    theta[2:5] = np.array([3.0, 1.5, -2.5]) * alone[2:5]
    change = np.array([-theta[2], 0.0, -theta[4], 0.0])  # the second is not shown, and the named one keeps its size
    expected = covariance[np.ix_(base, held)] @ np.linalg.solve(covariance[np.ix_(held, held)], change)
    found = refit_without_nuisances(make_fit(theta, covariance))
    assert found[base] == pytest.approx(expected, rel=1e-6) and not found[held].any()


@pytest.mark.parametrize("share", [0.5, -0.5, 5.0, -5.0])
def test_base_parameters_move_no_farther_than_a_verdict_may(share: float) -> None:
    """A nuisance effect of two spike widths stands for ``share`` times as much of the mass."""
    theta, root = np.zeros(6), 1e-2 * WIDTH * np.eye(6)
    theta[2], root[0, 2] = 2.0 * WIDTH, -share * root[2, 2]
    mass = (theta + refit_without_nuisances(make_fit(theta, root @ root.T)))[0]
    assert mass == pytest.approx(np.clip(2.0 * share, -MOST_TOLERANCES, MOST_TOLERANCES) * WIDTH, rel=1e-3)


def state(parameters: Mapping[str, Any]) -> Any:
    """The verdict that names nothing, with base parameters."""
    return read_verdict({"schema": 2, "verdict": [], "causes": [], "parameters": parameters})


def test_a_model_without_nuisance_effects_predicts_with_base_parameters_that_take_their_part(build: Builder) -> None:
    """A payload and the mass of its link show nearly the same; no verdict names a payload within tolerance."""
    arm = Arm(build(FLEXIBLE, effects=("payload", "current_bias", "load_dependent_friction")).folder)
    truth, names = arm.p.copy(), list(arm.parameters.described)
    truth[names.index("mass_2")] *= 1.06
    truth[names.index("center_of_mass_2")] *= 1.05
    log, held = (simulated(arm.with_parameters(truth), seed=seed) for seed in (1, 2))
    shooting = MultipleShooting(arm, cut_windows(arm, LogPortion.all_rows(log), 0.05))
    fit: Fit = fit_without_effects(shooting, build_candidates(arm, guess_from_log(arm, shooting.record)))
    plain, taken = Arm(build(FLEXIBLE).folder), estimate_base_parameters(fit)
    values = dict(zip(names, fit.sensitivities.point.p, strict=True))
    apart = {name: one | {"value": values[name]} for name, one in taken.items()}
    before, *replays = (
        replay(one, held) for one in (plain, *(apply_verdict(plain, state(some))[0] for some in (taken, apart)))
    )
    left, left_apart = (evaluate_gap(before, one, LogPortion.all_rows(held))["after"] for one in replays)
    assert left < 0.8 * left_apart
