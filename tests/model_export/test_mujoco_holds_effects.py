"""Each effect that MuJoCo can hold, put into a log by our own model, closes the log's gap in MuJoCo as well."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from compiled import Compiled
from replayed import FLEXIBLE, simulated

from gen.effects import ALL
from hdagen.adoption.verdict import apply_verdict, read_verdict
from hdagen.arm.compiled_arm import Arm
from hdagen.model_export.corrected_robot import CorrectedRobot
from hdagen.model_export.joint_numbers import HELD_EFFECTS, list_unheld_effects
from hdagen.model_export.mjcf_writer import write
from hdagen.model_export.mujoco_proof import Proof, ProofLog

EFFECTS = tuple(sorted(HELD_EFFECTS - {"coulomb_friction", "viscous_friction", "joint_damping", "missing_compliance"}))
UNHELD = "stribeck_friction"
LEAST_SHARE = 0.9  # of the fall of our own gap
CASES: dict[str, dict[str, float]] = {  # factors of base parameters, values of the effects' own
    "coulomb_friction": {"coulomb_friction_1": 2.0, "coulomb_friction_2": 1.5},
    "viscous_friction": {"viscous_friction_1": 5.0},
    "quadratic_friction": {"quadratic_friction_1": 3e-6},
    "asymmetric_friction": {"asymmetric_torque_1": 0.0075},
    "current_bias": {"bias_1": 0.009},
    "torque_constant": {"torque_constant_1": 1.15},
    "current_saturation": {"saturation_inverse_1": 0.4},
    "current_loop_lag": {"current_lag_1": 0.003},
    "command_delay": {"command_delay_1": 0.0033},
    "payload": {"payload_mass_2": 0.3},
    "gravity_tilt": {"tilt_x": 0.8},
    "cable_spring": {"cable_stiffness_1": 3.0, "cable_rest_1": 0.3},
    "contact": {"contact_stiffness_below_1": 400.0, "contact_below_1": -1.57, "contact_damping_1": 0.0},
    "backlash": {"backlash_angle_1": 0.0008},
    "stiffness": {"stiffness_level_1": 0.7},
    "motor_inertia": {"motor_inertia_1": 1.5},
    "mass": {"mass_2": 1.2, "inertia_2": 1.2},
}


@pytest.fixture(scope="module")
def arm(build: Callable[..., Compiled]) -> Arm:
    return Arm(build(FLEXIBLE, effects=(*EFFECTS, UNHELD)).folder)


def prove_case(arm: Arm, case: dict[str, float], out: Path) -> Proof:
    """The proof of an export whose verdict is the truth of the log."""
    true = arm.with_parameters(arm.p)
    for name, value in case.items():
        is_factor = arm.parameters.described[name].role == "base"
        true.parameters[name] = value * (arm.parameters[name] if is_factor else 1.0)
    robot = CorrectedRobot("robot.toml", arm, true)
    proof = write(robot, out, prove=ProofLog(simulated(true), None, (), False)).proof
    assert proof is not None
    return proof


@pytest.mark.parametrize("name", CASES)
def test_mujoco_closes_nine_tenths_of_what_our_model_closes(arm: Arm, name: str, tmp_path: Path) -> None:
    proof = prove_case(arm, CASES[name], tmp_path / "robot.xml")
    before, after = proof.gaps[2:]
    assert before > 10 * after  # the effect shows, and our model explains it
    assert proof.closed_share is not None and proof.closed_share >= LEAST_SHARE, proof


def test_an_export_of_the_wrong_numbers_does_not_hold(arm: Arm, tmp_path: Path) -> None:
    """The log knows nothing of the correction: MuJoCo goes away from it, as our model does."""
    true = arm.with_parameters(arm.p)
    true.parameters["coulomb_friction_1"] *= 2
    proof = write(
        CorrectedRobot("robot.toml", arm, true), tmp_path / "robot.xml", prove=ProofLog(simulated(arm), None, (), False)
    ).proof
    assert proof is not None and proof.closed_share is None
    assert proof.gaps[1] > 5 * proof.gaps[0]
    assert "nothing to prove" in proof.sentence


def test_without_friction_mujoco_errs_hardly_more_than_our_model(arm: Arm, tmp_path: Path) -> None:
    smooth = arm.with_parameters(arm.p)
    smooth.parameters.update(coulomb_friction_1=0.0, coulomb_friction_2=0.0)
    robot = CorrectedRobot("robot.toml", smooth, smooth)
    proof = write(robot, tmp_path / "robot.xml", prove=ProofLog(simulated(smooth), None, (), False)).proof
    assert proof is not None
    assert proof.gaps[1] < 1.5 * proof.gaps[3]


def test_the_remainder_of_what_mujoco_lacks_is_stated(arm: Arm, tmp_path: Path) -> None:
    """A payload, which it holds, and a Stribeck curve, which it does not: the share that stays there is within a factor
    of 1.5 of the stated one."""
    causes = [
        {"effect": "payload", "joint": 2, "parameters": {"payload_mass": {"value": 0.1}}},
        {
            "effect": UNHELD,
            "joint": 1,
            "parameters": {
                "stribeck_torque": {"value": 0.012},
                "stribeck_speed": {"value": 15.0},
                "stribeck_sharpness": {"value": 2.0},
            },
        },
    ]
    names = [f"{cause['effect']}@{cause['joint']}" for cause in causes]
    stated = read_verdict({"schema": 2, "verdict": names, "causes": causes})
    true = apply_verdict(arm, stated)[0]
    robot = CorrectedRobot("robot.toml", arm, true, stated)
    written = write(robot, tmp_path / "robot.xml", prove=ProofLog(simulated(true), None, (), False))
    assert written.proof is not None
    gaps, share = written.proof.gaps, written.proof.left_shares[f"{UNHELD}@1"]
    remainder = (gaps[1] - gaps[3]) / (gaps[2] - gaps[3])
    assert share > 0.1
    assert share / 1.5 < remainder < 1.5 * share
    assert f"{100 * share:.0f} %" in written.left_out[f"{UNHELD}@1"]
    assert "payload@2" not in written.left_out


OTHERS = (
    *("stribeck_friction", "load_dependent_friction", "position_dependent_friction", "presliding_friction"),
    *("torque_ripple", "kinematic_error", "kinematic_torsion", "transmission_hysteresis", "link_flexibility"),
    *("thermal_friction", "voltage_sag", "base_compliance", "encoder_eccentricity", "encoder_bias"),
)


@pytest.mark.campaign
@pytest.mark.parametrize("name", OTHERS)
def test_the_stated_remainder_holds_on_another_motion(
    name: str, build: Callable[..., Compiled], tmp_path: Path
) -> None:
    """Of each effect at its usual size beside a payload, within a factor of 2; of most within 1.5."""
    everything = Arm(build(FLEXIBLE, effects=tuple(effect.name for effect in ALL)).folder)
    described = everything.parameters.described
    effect = next(one for one in everything.manifest["effects"] if one["name"] == name)
    values = {key: described[f"{key}_1"].nominal for key in effect["shapes"]}
    for key in effect["amplitudes"]:
        values[key] = described[f"{key}_1"].nominal + (described[f"{key}_1"].typical or 0.0)
    parameters = {key: {"value": value} for key, value in values.items()}
    causes = [
        {"effect": "payload", "joint": 2, "parameters": {"payload_mass": {"value": 0.1}}},
        {"effect": name, "joint": 1, "parameters": parameters},
    ]
    stated = read_verdict({"schema": 2, "verdict": ["payload@2", f"{name}@1"], "causes": causes})
    true = apply_verdict(everything, stated)[0]
    robot, proofs = CorrectedRobot("robot.toml", everything, true, stated), []
    for seed in (0, 5):
        log = ProofLog(simulated(true, seed=seed), None, (), False)
        proofs.append(write(robot, tmp_path / f"robot_{seed}.xml", prove=log).proof)
    assert proofs[0] is not None and proofs[1] is not None
    share, gaps = proofs[0].left_shares[f"{name}@1"], proofs[1].gaps
    remainder = (gaps[1] - gaps[3]) / (gaps[2] - gaps[3])
    print(f"{name}: stated {share:.3f}, left on another motion {remainder:.3f}")
    assert share / 2.0 < remainder < 2.0 * share


def test_effects_that_mujoco_lacks_divide_what_it_leaves(arm: Arm, tmp_path: Path) -> None:
    shapes = {"stribeck_speed": {"value": 15.0}, "stribeck_sharpness": {"value": 2.0}}
    causes = [
        {"effect": UNHELD, "joint": j, "parameters": {"stribeck_torque": {"value": torque}, **shapes}}
        for j, torque in ((1, 0.012), (2, 0.006))
    ]
    stated = read_verdict({"schema": 2, "verdict": [f"{UNHELD}@1", f"{UNHELD}@2"], "causes": causes})
    true = apply_verdict(arm, stated)[0]
    robot = CorrectedRobot("robot.toml", arm, true, stated)
    proof = write(robot, tmp_path / "robot.xml", prove=ProofLog(simulated(true), None, (), False)).proof
    assert proof is not None
    left, _, after = proof.gaps[1:]
    before = proof.gaps[2]
    assert sum(proof.left_shares.values()) == pytest.approx(min((left - after) / (before - after), 1.0))
    assert min(proof.left_shares.values()) > 0.0


def test_what_mujoco_lacks_is_known(arm: Arm) -> None:
    assert list_unheld_effects(arm) == []
    assert {effect["name"] for effect in arm.manifest["effects"]} >= set(EFFECTS)
