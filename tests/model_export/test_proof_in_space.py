"""An arm in space, with an effect each: the corrected model closes in MuJoCo what it closes in our own replay."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest
import space_robots
from compiled import Compiled
from described_arms import describe_arm

from gen.presets import find_presets
from hdagen.arm.compiled_arm import Arm
from hdagen.control.guard_limits import Guard, Safe
from hdagen.control.guarded_controller import Controller
from hdagen.control.joint_swing import swing_joints
from hdagen.log.measured_log import Log
from hdagen.model_export import mujoco_proof
from hdagen.model_export.corrected_robot import CorrectedRobot
from hdagen.model_export.mjcf_writer import write
from hdagen.model_export.mujoco_proof import Proof, ProofLog
from hdagen.model_import.chain_reduction import ChainRequest
from hdagen.model_import.robot_writing import import_model
from hdagen.simulation.simulator import Sensors, run

COUNT = 2 * np.pi / 2**18  # rad, of the encoders
SENSOR = f"\n[joint.sensor]\njoint_encoder_resolution = {COUNT}\nmotor_encoder_resolution = {COUNT}\n"
LIMITS = """[joint.limits]
position = [-1.5, 1.5]
speed = 3.0
torque = 200.0
motor_torque_rate = 20000.0
[joint.sensor]"""
EFFECTS = ("cable_spring", "command_delay", "current_bias", "gravity_tilt", "payload")
LEAST_SHARE = 0.9  # of the fall of our own gap
PERIOD = 1e-3  # s
CASES = {
    "coulomb_friction": {"coulomb_friction_2": 1.2},
    "viscous_friction": {"viscous_friction_1": 3.0},
    "motor_inertia": {"motor_inertia_2": 0.25},
    "payload": {"payload_mass_{n}": 0.4, "payload_x_{n}": 0.05},
    "gravity_tilt": {"tilt_roll": 0.08, "tilt_pitch": -0.05},
    "cable_spring": {"cable_stiffness_1": 8.0, "cable_rest_1": 0.2},
    "current_bias": {"bias_2": 0.8},
    "command_delay": {"command_delay_1": 0.004},
}
LINK = {"mass_2": 1.3, "center_of_mass_x_2": 1.2, "inertia_yy_2": 1.1}  # factors


def write_robot(kinds: str, seed: int) -> str:
    """A chain with friction and encoders."""
    return space_robots.chain(kinds, seed).replace("coulomb_friction = 0.0", f"coulomb_friction = 0.4{SENSOR}")


def log_motion(arm: Arm, seconds: float, seed: int = 2) -> Log:
    """The log of a motion about a posture whose weight is held, with pushes at the tip."""
    rng, n = np.random.default_rng(seed), arm.n
    time = PERIOD * np.arange(1, round(seconds / PERIOD) + 1)
    rest = arm.rest(np.zeros(n))
    u = np.zeros((len(time), arm.nu))
    weight = arm.evaluate("gravity_torque", q=np.zeros(n))["g"]
    waves = np.sin(2 * np.pi * time[:, None, None] * rng.uniform(0.5, 3.0, (n, 3)) + rng.uniform(0, 6, (n, 3)))
    u[:, :n] = weight + (4.0 * waves).sum(axis=2)
    u[200:400, n:] = [6.0, -4.0, 5.0, 0.5, -0.3, 0.4]
    mean, _ = arm.apply_input_stage(u[:, :n], np.full(len(time), PERIOD), weight)
    x = arm.rollout(rest, np.hstack([mean, u[:, n:]])[:-1], np.diff(time), exact=True)
    columns = {name: u[:, k] for k, name in enumerate(arm.input_names) if k >= n}
    for j in range(1, n + 1):
        q = x[:, arm.index(f"joint_position_{j}")]
        columns[f"motor_torque_command_{j}"] = u[:, j - 1]
        columns[f"motor_position_{j}"] = columns[f"joint_position_{j}"] = np.round(q / COUNT) * COUNT
    return Log(time, {name: np.ascontiguousarray(values) for name, values in columns.items()}, n, "simulated")


def log_swings(true: Arm, arm: Arm, seconds: float) -> Log:
    """The log of an impedance law that swings the joints of an arm which is not quite the one it knows.

    Noise of a force sensor would drive light joints in the replay further than a link does.
    """
    law = Controller(arm, "impedance_joint", Guard(Safe.ZERO))
    return run(true, law, swing_joints(arm, 2.0, seconds), sensors=Sensors(force_noise=0.0)).log


def prove_case(arm: Arm, values: dict[str, float], out: Path, seconds: float, is_driven: bool = False) -> Proof:
    """The proof of an export whose verdict is the truth of the log."""
    true = arm.with_parameters(arm.p)
    true.parameters.update({name.format(n=arm.n): value for name, value in values.items()})
    measured = log_swings(true, arm, seconds) if is_driven else log_motion(true, seconds)
    log = ProofLog(measured, None, (), False)
    proof = write(CorrectedRobot("robot.toml", arm, true), out, prove=log).proof
    assert proof is not None
    print(f"MuJoCo {proof.gaps[0]:.4g} -> {proof.gaps[1]:.4g}, ours {proof.gaps[2]:.4g} -> {proof.gaps[3]:.4g}")
    return proof


def find_values(arm: Arm, name: str) -> dict[str, float]:
    """The parameters of a case; those of a link are factors."""
    return CASES.get(name) or {key: factor * arm.parameters[key] for key, factor in LINK.items()}


@pytest.fixture(scope="module")
def arm(build: Callable[..., Compiled]) -> Arm:
    return Arm(build(write_robot("RRR", 21), effects=EFFECTS).folder)


@pytest.mark.parametrize("name", [*CASES, "link"])
def test_mujoco_closes_nine_tenths_of_what_our_model_closes(arm: Arm, name: str, tmp_path: Path) -> None:
    proof = prove_case(arm, find_values(arm, name), tmp_path / "robot.xml", 0.8)
    assert proof.gaps[2] > 5 * proof.gaps[3]  # the effect shows, and our model explains it
    assert proof.closed_share is not None and proof.closed_share >= LEAST_SHARE


def test_a_model_of_the_user_closes_it_as_well(arm: Arm, tmp_path: Path) -> None:
    """Friction, a link and a payload, put into a model that is there."""
    mine, out, true = tmp_path / "mine.xml", tmp_path / "corrected.xml", arm.with_parameters(arm.p)
    write(CorrectedRobot("robot.toml", arm, arm), mine)
    before = mine.read_text()
    true.parameters.update(find_values(arm, "link") | {"coulomb_friction_2": 1.2, "payload_mass_3": 0.4})
    log = ProofLog(log_motion(true, 0.8), None, (), False)
    done = write(CorrectedRobot("robot.toml", arm, true), out, into=mine, prove=log)
    assert not done.left_out and done.proof is not None
    assert done.proof.closed_share is not None and done.proof.closed_share >= LEAST_SHARE
    assert mine.read_text() == before and 'name="payload"' not in out.read_text()


@pytest.mark.campaign
@pytest.mark.parametrize("kinds, seed", [("RRRRRR", 22), ("RRRRRRR", 23)])
@pytest.mark.parametrize("name", ["coulomb_friction", "payload", "link"])
def test_mujoco_closes_it_with_six_and_seven_joints(
    build: Callable[..., Compiled], kinds: str, seed: int, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The logs are not repaired: where other joints move a light one, the look at each joint alone doubts its sign."""
    monkeypatch.setattr(mujoco_proof, "_repair_log", lambda given, arm: given)
    text = write_robot(kinds, seed).replace("[joint.sensor]", LIMITS)
    arm = Arm(build(text, effects=EFFECTS).folder)
    proof = prove_case(arm, find_values(arm, name), tmp_path / "robot.xml", 2.0, is_driven=True)
    assert proof.gaps[2] > 5 * proof.gaps[3]
    assert proof.closed_share is not None and proof.closed_share >= LEAST_SHARE


def write_panda(folder: Path) -> Path:
    """The preset as an MJCF in MuJoCo's own writing, as a user would have it."""
    write(describe_arm(find_presets()["panda"].read_text()), folder / "export.xml")
    spec = mujoco.MjSpec.from_file(str(folder / "export.xml"))
    spec.compile()
    (folder / "panda.xml").write_text(spec.to_xml())
    return folder / "panda.xml"


@pytest.mark.campaign
@pytest.mark.parametrize("name", ["coulomb_friction", "viscous_friction", "link"])
def test_mujoco_closes_it_in_a_panda_of_mjcf(
    build: Callable[..., Compiled], name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The arm is the import of the file into which its correction is written."""
    monkeypatch.setattr(mujoco_proof, "_repair_log", lambda given, arm: given)
    mine, out = write_panda(tmp_path), tmp_path / "corrected.xml"
    text = import_model(str(mine), ChainRequest(tip="tip")).text
    arm = Arm(build(text.replace("[joint.limits]", f"{SENSOR}[joint.limits]")).folder)
    true = arm.with_parameters(arm.p)
    true.parameters.update(find_values(arm, name))
    log = ProofLog(log_swings(true, arm, 2.0), None, (), False)  # within its limits, which MuJoCo enforces
    done = write(CorrectedRobot(str(mine), arm, true), out, into=mine, prove=log)
    assert done.proof is not None and not done.left_out
    assert done.proof.gaps[2] > 5 * done.proof.gaps[3]
    assert done.proof.closed_share is not None and done.proof.closed_share >= LEAST_SHARE


def test_what_mujoco_warns_of_is_told_and_leaves_no_file(
    arm: Arm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """A model of the user whose spring is too stiff for its step: MuJoCo finds accelerations beyond all sense."""
    monkeypatch.chdir(tmp_path)
    mine, out, true = tmp_path / "mine.xml", tmp_path / "corrected.xml", arm.with_parameters(arm.p)
    write(CorrectedRobot("robot.toml", arm, arm), mine)
    mine.write_text(
        mine.read_text().replace('<joint name="axis_1"', '<joint name="axis_1" stiffness="1e12" springref="1"')
    )
    true.parameters["coulomb_friction_2"] = 1.2
    proof = write(
        CorrectedRobot("robot.toml", arm, true), out, into=mine, prove=ProofLog(log_motion(true, 0.2), None, (), False)
    ).proof
    assert proof is not None and any(note.startswith("MuJoCo warns: ") for note in proof.notes)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["corrected.xml", "mine.xml"]
    assert capfd.readouterr() == ("", "")
