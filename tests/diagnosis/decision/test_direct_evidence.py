"""What is surely missing beside something unknown: truths put between the encoders are read off, and nothing is not."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from catalogue import EFFECTS

from hdagen.arm.arm_parameters import Parameter
from hdagen.diagnosis.decision.direct_evidence import DirectEvidence, _find_encoder_effects, add_direct_evidence
from hdagen.diagnosis.decision.direct_evidence import add_motor_torque as within
from hdagen.diagnosis.decision.direct_evidence_settings import DIRECT_EVIDENCE
from hdagen.diagnosis.decision.posterior import Decision, Hypothesis
from hdagen.diagnosis.initialization.encoder_regression import EncoderDifference

RATE, STIFFNESS = 1000.0, 8000.0  # Hz, N m/rad
USUAL = {
    "encoder_bias": (1e-3, -1.0, 1.0),
    "eccentricity_sine": (3e-4, -0.1, 0.1),
    "eccentricity_cosine": (3e-4, -0.1, 0.1),
    "sensor_delay": (2e-3, -0.01, 0.02),
}
TERMS = {
    "encoder_bias": ("encoder_bias", "constant"),
    "eccentricity_sine": ("encoder_eccentricity", "joint_sine"),
    "eccentricity_cosine": ("encoder_eccentricity", "joint_cosine"),
    "sensor_delay": ("sensor_delay", "joint_speed"),
}


def parameter(name: str) -> Parameter:
    typical, low, high = USUAL[name]
    fields = {"name": f"{name}_1", "unit": "1", "nominal": 0.0, "low": low, "high": high, "meaning": "", "joint": 1}
    effect, term = TERMS[name]
    rest = {
        "effect": effect,
        "role": "amplitude",
        "tolerance": 0.0,
        "reference_size": 0.0,
        "starts": (),
        "encoder_term": term,
    }
    return Parameter(**fields, **rest, typical=typical)  # type: ignore[arg-type]


def between(seed: int, strange: float = 3.0, **truth: float) -> EncoderDifference:
    """A joint that moves for 10 s under a torque that no model tells, its encoders apart by what is ``truth`` and by
    the torsion, with counts of noise."""
    rng, t = np.random.default_rng(seed), np.arange(10_000) / RATE
    waves = [0.4 * rng.uniform() * np.sin(2 * np.pi * rng.uniform(0.1, 1.5) * t + rng.uniform(0, 6)) for _ in range(4)]
    q = np.sum(waves, axis=0)
    v, acceleration = np.gradient(q, t), np.gradient(np.gradient(q, t), t)
    unknown = strange * np.sign(np.sin(7.3 * q)) * np.tanh(v)  # acts on the link, so that the springs feel it
    torque = 0.3 * acceleration + 6.0 * np.cos(q)
    columns = {
        "encoder_bias": -np.ones_like(q),
        "eccentricity_sine": -np.sin(q),
        "eccentricity_cosine": -np.cos(q),
        "sensor_delay": v,
    }
    twist = (torque + unknown) / STIFFNESS + 1e-6 * rng.normal(size=len(t))
    for name, size in truth.items():
        twist += size * columns[name]
    borne = np.stack([torque / STIFFNESS, torque, np.gradient(torque, t)], 1)
    every = np.ones(len(t), bool)
    terms = np.stack(list(columns.values()), 1)
    driven = (torque + unknown + 0.02 * rng.normal(size=len(t)))[:, None]
    return EncoderDifference(1, tuple(map(parameter, columns)), twist, terms, borne, driven, every, every, q, torque)


@pytest.mark.parametrize("seed", range(4))
def test_an_age_is_read_off_though_the_torque_is_not_known(seed: int) -> None:
    found = {one.name: one for one in _find_encoder_effects(EFFECTS, within(between(seed, sensor_delay=3e-3)))}
    told = found["sensor_delay@1"]
    assert told.remaining_share < DIRECT_EVIDENCE.largest_remaining_share
    assert told.parameters["sensor_delay_1"] == pytest.approx(3e-3, rel=0.3)  # the torque goes with the speed, too
    assert all(
        one.remaining_share > DIRECT_EVIDENCE.largest_remaining_share
        for name, one in found.items()
        if name != "sensor_delay@1"
    )


def test_an_eccentricity_beside_an_age_is_read_off_too() -> None:
    found = {
        one.name: one
        for one in _find_encoder_effects(EFFECTS, within(between(7, 0.1, sensor_delay=3e-3, eccentricity_sine=1.1e-3)))
    }
    assert {name for name, one in found.items() if one.remaining_share < DIRECT_EVIDENCE.largest_remaining_share} >= {
        "sensor_delay@1",
        "encoder_eccentricity@1",
    }
    assert found["encoder_eccentricity@1"].parameters["eccentricity_sine_1"] == pytest.approx(1.1e-3, rel=0.2)


@pytest.mark.parametrize("seed", range(4))
def test_a_cable_is_no_eccentricity(seed: int) -> None:
    """A pull that goes with the angle twists the joint as an encoder off centre would seem to; the motor feels it."""
    one = between(seed, 0.1)
    pulled = replace(
        one, twist=one.twist + 6.0 * one.angle / STIFFNESS, motor_terms=one.motor_terms + 6.0 * one.angle[:, None]
    )
    assert [
        found
        for found in _find_encoder_effects(EFFECTS, pulled)
        if found.remaining_share < DIRECT_EVIDENCE.largest_remaining_share
    ]
    assert not [
        found
        for found in _find_encoder_effects(EFFECTS, within(pulled))
        if found.remaining_share < DIRECT_EVIDENCE.largest_remaining_share
    ]


@pytest.mark.parametrize("seed", range(8))
def test_where_there_is_nothing_nothing_is_read_off(seed: int) -> None:
    """The torque that is not known twists the joint by a third of a milliradian, and no encoder errs."""
    assert not [
        one
        for one in _find_encoder_effects(EFFECTS, within(between(seed)))
        if one.remaining_share < DIRECT_EVIDENCE.largest_remaining_share
    ]


def test_what_is_too_small_to_count_is_not_named() -> None:
    assert not [
        one
        for one in _find_encoder_effects(EFFECTS, within(between(3, sensor_delay=3e-4)))
        if one.name == "sensor_delay@1"
    ]


PLACES = {
    "joint_damping@1": "transmission",
    "sensor_delay@1": "sensor",
    "encoder_eccentricity@1": "sensor",
    "encoder_eccentricity@2": "sensor",
    "cable_spring@1": "link",
    "coulomb_friction@1": "motor",
    "command_delay@1": "input",
    "current_loop_lag@1": "input",
}
DELAY = DirectEvidence("sensor_delay@1", {"sensor_delay_1": 3e-3}, 0.1)


def decision(said: str, **probable: float) -> Decision:
    """Of these sets of effects, joined by "and", with their probabilities; all but what is unknown were fitted."""
    atoms = [SimpleNamespace(name=name, place=place) for name, place in PLACES.items()]
    fits: dict[str, Any] = {name: SimpleNamespace(names=name) for name in probable}
    for fit in fits.values():
        fit.sensitivities = SimpleNamespace(candidates=SimpleNamespace(members=atoms))

    def named(key: str) -> tuple[str, ...]:
        names = key.replace("_at_", "@").split("_and_") if key != "none" else []
        return tuple(sorted(names))

    hypotheses = [
        Hypothesis(named(key), p, None if key.startswith("unknown") else fits[key]) for key, p in probable.items()
    ]
    return Decision(tuple(hypotheses), named(said), probable[said], probable[said], next(iter(fits.values())))


def test_the_decision_names_it_beside_what_is_unknown() -> None:
    given = decision("unknown_at_1", unknown_at_1=0.7, joint_damping_at_1=0.3)
    found = add_direct_evidence(given, [DELAY])
    assert found.verdict == ("sensor_delay@1", "unknown@1") and found.is_unknown and not found.is_sure
    assert found.hypotheses[0].names == found.verdict and found.hypotheses[0].is_unknown
    assert found.marginal_probability("sensor_delay@1") == pytest.approx(0.7)
    assert found.direct_evidence == {"sensor_delay@1": {"sensor_delay_1": 3e-3}}
    assert add_direct_evidence(given, []) is given


def test_a_set_that_was_fitted_with_it_is_said_and_probabilities_stay_as_calibrated() -> None:
    given = decision(
        "cable_spring_at_1", cable_spring_at_1=0.9, cable_spring_at_1_and_encoder_eccentricity_at_2=0.06, none=0.04
    )
    found = add_direct_evidence(given, [DirectEvidence("encoder_eccentricity@2", {"eccentricity_sine_2": 4e-4}, 0.1)])
    assert found.verdict == ("cable_spring@1", "encoder_eccentricity@2")
    assert found.best is given.hypotheses[1].fit and not found.direct_evidence
    assert [h.probability for h in found.hypotheses] == pytest.approx([0.9, 0.1])


@pytest.mark.parametrize(
    ("verdict", "seen", "added"),
    [
        ("cable_spring_at_1", "encoder_eccentricity@1", False),  # a pull that goes with the angle looks alike
        ("cable_spring_at_1", "encoder_eccentricity@2", True),
        ("coulomb_friction_at_1", "sensor_delay@1", True),
        ("command_delay_at_1", "current_loop_lag@1", False),  # either stands for the other
        ("coulomb_friction_at_1", "command_delay@1", True),
        ("unknown_at_1", "encoder_eccentricity@1", False),
        ("unknown_at_1", "sensor_delay@1", True),
        ("none", "command_delay@1", True),
    ],
)
def test_what_shows_at_the_same_place_stands_for_it(verdict: str, seen: str, added: bool) -> None:
    given = decision(verdict, **{verdict: 0.9, "joint_damping_at_1": 0.1})
    found = add_direct_evidence(given, [DirectEvidence(seen, {}, 0.1, seen.startswith("encoder"))])
    assert (seen in found.verdict) is added
    assert sum(h.probability for h in found.hypotheses) == pytest.approx(1.0)


def test_what_is_read_off_is_told_without_its_joint_in_the_names() -> None:
    one = DirectEvidence("sensor_delay@2", {"sensor_delay_2": 3e-3}, 0.1)
    parameters = {"sensor_delay": 3e-3}
    assert one.content == {"effect": "sensor_delay", "joint": 2, "parameters": parameters, "left": 0.1}
