"""The next motion: limits are kept, effects are told apart by as much as predicted, what cannot be is refused."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from pathlib import Path

import arms
import numpy as np
import pytest
from compiled import Compiled
from replayed import ONE
from uncompiled import UncompiledArm

from hdagen.__main__ import main
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm, load
from hdagen.control.guard_limits import Guard, Safe
from hdagen.control.guarded_controller import Controller
from hdagen.control.reference_motion import Reference
from hdagen.diagnosis.initialization.encoder_regression import EncoderDifference
from hdagen.excitation.least_motion import LEAST_ENCODER_STEPS, count_run_steps
from hdagen.excitation.motion_limits import choose_middle_posture, narrow_limits
from hdagen.excitation.motion_shapes import list_motions
from hdagen.excitation.optimal_motion import (
    LEAST_SEPARATION,
    PREDICTION_FACTOR,
    Excitation,
    build_linear_model,
    excite,
    predict_separations,
    score_effects,
)
from hdagen.excitation.safe_motion import LIMIT_MARGIN, SafeRun, follow_reference, shrink_to_limits, with_parameters
from hdagen.log.data_table import read_parquet
from hdagen.simulation.simulated_sensors import Sensors
from hdagen.simulation.simulator import run

SECONDS = 3.0
MIXED, SLOW = "multisine, reversals, holds", "slow reversals of falling amplitude"
TYPICAL = {  # usual sizes by effect, as the robot's numbers and the effects' sources give them
    "viscous_friction": {"viscous_friction_1": 3e-4},
    "thermal_friction": {"thermal_share_1": 0.3},
    "stribeck_friction": {"stribeck_torque_1": 0.4 * 0.03},
    "presliding_friction": {"presliding_share_1": 1.0},
    "command_delay": {"command_delay_1": 0.003},
    "current_loop_lag": {"current_lag_1": 0.002},
    "torque_constant": {"torque_constant_1": 0.05 * 1.15},
    "payload": {"payload_mass_1": 0.3},
}


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Arm:
    file = tmp_path_factory.mktemp("one") / "one.toml"
    file.write_text(ONE)
    return load(file, "native", ("all",))


@pytest.fixture
def robot(arm: Arm, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The robot file of the arm, whose build is at hand."""
    file = tmp_path_factory.mktemp("robot") / "one.toml"
    file.write_text(ONE)
    return str(file)


@pytest.fixture(scope="module")
def found(arm: Arm) -> Excitation:
    return excite(arm, ("stribeck_friction", "presliding_friction"), duration=SECONDS)


def kept(arm: Arm, name: str, **limits: tuple[float, ...]) -> SafeRun:
    bounds = narrow_limits(arm, limits)
    motion = next(m for m in list_motions(arm, 1, SECONDS, 1e-3) if m.name == name)
    made = shrink_to_limits(arm, [], bounds, motion, choose_middle_posture(arm, bounds), 1e-3)
    assert isinstance(made, SafeRun), made
    return made


def measured(arm: Arm, made: SafeRun, pair: tuple[str, str], true: str, states: bool = True) -> float:
    """Nats by which a log of an arm with ``true`` speaks for it; windows begin at its own states, or as measured."""
    result, _ = follow_reference(arm, with_parameters(arm, TYPICAL[true]), made.reference, narrow_limits(arm))
    assert result is not None
    names = [f"{name}@1" for name in pair]
    at = build_linear_model(arm, result.log, names, result.state if states else None)
    evidence = score_effects(at.linear_model(1.0), at.candidates, names)
    other = pair[1 - pair.index(true)]
    return evidence[f"{true}@1"] - evidence[f"{other}@1"]


# -- the prediction ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "pair",
    [
        ("stribeck_friction", "presliding_friction"),
        ("command_delay", "current_loop_lag"),
        ("viscous_friction", "thermal_friction"),
        ("torque_constant", "payload"),
    ],
)
def test_logs_are_told_apart_by_as_much_as_was_predicted(arm: Arm, pair: tuple[str, str]) -> None:
    names = [f"{name}@1" for name in pair]
    for name, limits in (("fine reversals", {}), (SLOW, {"speed": (0.1,)})):
        made = kept(arm, name, **limits)
        (predicted,) = predict_separations(arm, names, made).values()
        seen = min(measured(arm, made, pair, true) for true in pair)
        if predicted >= LEAST_SEPARATION:
            assert predicted / PREDICTION_FACTOR < seen < predicted * PREDICTION_FACTOR, (name, predicted, seen)
        else:
            assert seen < LEAST_SEPARATION * PREDICTION_FACTOR, (name, predicted, seen)


def test_the_motion_that_is_predicted_to_be_better_is_better(arm: Arm) -> None:
    """Two frictions near rest: order of four motions, from little to plenty."""
    pair = ("stribeck_friction", "presliding_friction")
    predicted: list[float] = []
    seen: list[float] = []
    for name, limits in (("fine reversals", {}), ("multisine to 25 Hz", {}), (SLOW, {"speed": (0.1,)}), (MIXED, {})):
        made = kept(arm, name, **limits)
        predicted += predict_separations(arm, [f"{n}@1" for n in pair], made).values()
        seen.append(min(measured(arm, made, pair, true) for true in pair))
    assert max(predicted) > 4 * min(predicted) > 0
    assert np.argsort(predicted).tolist() == np.argsort(seen).tolist(), (predicted, seen)


def test_states_as_encoders_measure_them_change_little(arm: Arm) -> None:
    pair = ("command_delay", "current_loop_lag")
    made = kept(arm, SLOW)
    for true in pair:
        known, read = (measured(arm, made, pair, true, states) for states in (True, False))
        assert read == pytest.approx(known, rel=0.2)


def test_the_same_arm_gives_the_same_motion_to_the_bit(arm: Arm, found: Excitation) -> None:
    again = excite(arm, ("stribeck_friction@1", "presliding_friction@1"), duration=SECONDS)
    assert [t.separations for t in again.tried_motions] == [t.separations for t in found.tried_motions]
    assert np.array_equal(again.reference.position, found.reference.position)


def test_the_best_motion_comes_first_and_says_whether_it_is_enough(found: Excitation) -> None:
    nats = [t.smallest_separation for t in found.tried_motions]
    assert len(nats) >= 9 and nats == sorted(nats, reverse=True)
    assert found.is_separating == (nats[0] >= LEAST_SEPARATION * PREDICTION_FACTOR)
    assert nats[0] > 1.2 * min(n for n in nats if n > -np.inf)


def test_without_an_effect_the_model_leaves_the_sensors_noise_alone(arm: Arm) -> None:
    result = kept(arm, SLOW).simulation
    left = build_linear_model(arm, result.log, ["payload@1"], result.state).residual
    assert np.sqrt((left**2).mean(0)) == pytest.approx(np.ones(left.shape[1]), abs=0.1)


# -- limits -----------------------------------------------------------------------------------------------------------


def reached(arm: Arm, reference: Reference, **sizes: float) -> dict[str, float]:
    """Largest position, speed, torque and current of a run that only simulate knows of; with an effect in the arm."""
    controller = Controller(arm, "position", Guard(Safe.ZERO))
    sensors = Sensors(force_noise=0.0)  # there is no push
    result = run(with_parameters(arm, sizes), controller, reference, sensors=sensors, start=reference.position[0])
    assert (result.status >= 0).all()
    found = {"position": result.state[:, arm.index("joint_position_1")]}
    found["speed"] = result.state[:, arm.index("joint_velocity_1")]
    found |= {"torque": result.joint_torque, "current": result.log["motor_current_command_1"]}
    return {name: float(np.abs(x).max()) for name, x in found.items()} | {
        "tip_y": float(np.abs(result.tip[:, 1]).max())
    }


def test_the_robot_file_s_limits_are_kept_with_a_margin(arm: Arm, found: Excitation) -> None:
    most = {"position": 1.5, "speed": 2.0, "torque": 60.0, "current": 10.0}
    for tried in found.tried_motions:
        assert tried.safe_run is not None or tried.drop_reason
        if tried.safe_run is None:
            continue
        nominal = reached(arm, tried.safe_run.reference)
        for name, limit in most.items():
            assert nominal[name] <= LIMIT_MARGIN * limit, (tried.name, name)
            assert tried.safe_run.limit_shares[f"{name}_1"] >= nominal[name] / limit - 1e-9
    for effect in ("viscous_friction", "thermal_friction"):
        whole = reached(arm, found.reference, **TYPICAL[effect])
        assert all(whole[name] <= limit for name, limit in most.items()), (effect, whole)


def test_narrower_limits_and_a_workspace_are_kept(arm: Arm) -> None:
    made = kept(arm, SLOW, speed=(0.3,), current_1=(4.0,), position=(-0.2, 0.9), tip_y=(-0.1, 0.1), tip_x=(0.0, 1.0))
    whole = reached(arm, made.reference)
    assert whole["speed"] <= 0.27 and whole["current"] <= 3.6 and whole["tip_y"] <= 0.09
    assert made.limit_shares["speed_1"] > 0.3 or made.limit_shares["tip_y"] > 0.3  # small for a limit's sake only


def test_a_motion_begins_and_ends_at_rest_without_a_jump(arm: Arm) -> None:
    for motion in list_motions(arm, 1, 10.0, 1e-3):
        rate = np.gradient(motion.shape, 1e-3, axis=0)
        assert np.abs(motion.shape[[0, -1]]).max() < 1e-6 and np.abs(rate[[0, -1]]).max() < 1e-2, motion.name
        assert 0.01 < np.abs(motion.shape).max() <= 1.05, motion.name
        assert np.abs(np.diff(motion.shape, axis=0)).max() < 0.2, motion.name


def test_what_the_file_does_not_state_is_assumed_and_said(build: Callable[..., Compiled]) -> None:
    bare = Arm(build(arms.SMALL).folder)
    limits = narrow_limits(bare)
    assert {note.split()[0] for note in limits.notes} == {"position", "speed", "torque", "current"}
    assert np.diff(limits.position)[0, 0] == pytest.approx(1.0)
    told = narrow_limits(bare, {"position_1": (0.0, 0.4), "speed": (1.0,)})
    assert {note.split()[0] for note in told.notes} == {"torque", "current"}


def test_a_limit_told_of_one_joint_is_still_assumed_of_the_others_and_units_are_said(tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text(arms.CHAINS["RPR"])
    bare = UncompiledArm(tmp_path / "robot.toml")
    assumed = dict(
        note.removesuffix(" is assumed.").split(": no limit is stated; ") for note in narrow_limits(bare).notes
    )
    units = {what: value.split()[-1] for what, value in assumed.items() if not value.endswith("N m")}
    turning = {f"{kind} of joint {j}": unit for j in (1, 3) for kind, unit in (("position", "rad"), ("speed", "rad/s"))}
    sliding = {"position of joint 2": "m", "speed of joint 2": "m/s", "torque of joint 2": "N"}
    assert units == turning | sliding
    left = [note.split(":")[0] for note in narrow_limits(bare, {"position_2": (0.0, 0.04)}).notes]
    assert left == [what for what in assumed if what != "position of joint 2"]


# -- the command ------------------------------------------------------------------------------------------------------


def test_the_command_writes_a_reference_that_a_controller_follows(
    arm: Arm, robot: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "reference.parquet"
    arguments = ["excite", robot, "--separate", "command_delay, current_loop_lag", "--duration", "2"]
    assert main([*arguments, "--limits", "speed=0.5", "--out", str(out), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["separates"] is True and said["nats"] > 100 and said["effects"][0] == "command_delay@1"
    assert all(share <= 1 for share in said["tried"][0]["limits"].values())
    columns = read_parquet(out, lambda name: True).columns
    assert list(columns) == ["time", "joint_position_reference_1"]
    q = columns["joint_position_reference_1"][:, None]
    assert columns["time"] == pytest.approx(np.arange(2000) * 1e-3)
    v = np.gradient(q, 1e-3, axis=0)
    whole = reached(arm, Reference("joint", 1e-3, q, v, np.gradient(v, 1e-3, axis=0)))
    assert whole["speed"] <= 0.5 and whole["current"] <= 10.0


def test_the_table_names_every_motion(arm: Arm, robot: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "reference.csv"
    arguments = ["excite", robot, "--separate", "torque_constant,payload", "--duration", "2"]
    assert main([*arguments, "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "expected to separate: no" in said
    assert all(motion.name in said for motion in list_motions(arm, 1, 2.0, 1e-3))
    assert out.read_text().splitlines()[0] == "time,joint_position_reference_1"


REFUSED = {
    "unknown effect": (
        ["--separate", "stribeck,payload"],
        "no such effect (did you mean stribeck_friction@1?); there are asymmetric_friction@1",
    ),
    "misspelt alone": (["--separate", "stribeck"], "no such effect (did you mean stribeck_friction@1?)"),
    "twice": (["--separate", "payload,payload@1"], "same effect twice"),
    "one alone": (["--separate", "payload"], "one effect alone"),
    "no joint": (["--joint", "3"], "the robot has joints 1 to 1"),
    "joint 0": (["--joint", "0"], "the robot has joints 1 to 1"),
    "zero duration": (["--duration", "0"], "the duration is 0 s; possible is 2 to 120 s"),
    "nan duration": (["--duration", "nan"], "the duration is nan s"),
    "negative period": (["--period", "-0.001"], "the period is -0.001 s"),
    "too many rows": (["--duration", "60", "--period", "0.0005"], "the motion has 120000 rows; possible are 40000"),
    "too weak": (["--limits", "torque=3"], "the limits admit no motion: gravity alone takes"),
    "nothing": (["--limits", "speed=0"], "admits no motion"),
    "too slow": (["--duration", "2", "--limits", "speed=1e-5"], "the limits admit no motion"),
    "out of reach": (["--limits", "tip_x=5:6"], "the limits admit no motion: in none of"),
    "wider": (["--limits", "speed=20"], "above the robot file's 2"),
    "wider range": (["--limits", "position_1=-3:0"], "wider than the robot file's -1.5 to 1.5"),
    "backwards": (["--limits", "position=1:0"], "give LOW:HIGH, low first"),
    "no limit": (["--limits", "acceleration=3"], "no such limit; there are position, speed, torque, current"),
    "joint of a limit": (["--limits", "speed_7=1"], "no such limit"),
    "no number": (["--limits", "speed=fast"], "give NAME=VALUE"),
    "infinite": (["--limits", "speed=inf"], "give one number"),
    "suffix": (["--out", "reference.txt"], "possible are .csv and .parquet"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_cannot_be_is_refused_in_one_sentence(
    robot: str, what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    arguments, sentence = REFUSED[what]
    pair = [] if "--separate" in arguments else ["--separate", "stribeck_friction,presliding_friction"]
    assert main(["excite", robot, *pair, *arguments]) == 2
    lines = [line for line in capsys.readouterr().err.splitlines() if not line.lstrip()[:1].isdigit()]
    assert len(lines) == 1 and sentence in lines[0] and lines[0].endswith("."), lines
    assert list(tmp_path.iterdir()) == []


@pytest.fixture(scope="module")
def level_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The one joint where gravity does not act: friction and inertia alone are in the way."""
    file = tmp_path_factory.mktemp("level") / "level.toml"
    file.write_text(ONE.replace("gravity = [0.0, -9.81]", "gravity = [0.0, 0.0]"))
    return file


@pytest.fixture(scope="module")
def level(level_file: Path) -> Arm:
    return load(level_file, "native", ("all",))


STILL = {  # limits within which the joint rests, and the one that the sentence names, with its unit
    "speed=1e-9": r"speed_1 of at least \S+ rad/s \(1e-09 is given\)",
    "speed=3e-4": r"speed_1 of at least \S+ rad/s \(0.0003 is given\)",
    "torque=1e-6": r"torque_1 of at least \S+ N m \(1e-06 is given\)",
    "current=1e-6": r"current_1 of at least \S+ A \(1e-06 is given\)",
    "position=0:1e-9": r"a range of position_1 of at least \S+ rad \(1e-09 is given\)",
}


@pytest.mark.usefixtures("level")  # its build is at hand
@pytest.mark.parametrize("limit", STILL)
def test_limits_within_which_nothing_is_seen_to_move_are_refused_before_the_model_is_made(
    level_file: Path,
    limit: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        "hdagen.excitation.optimal_motion.predict_separations", lambda *_: pytest.fail("the costly part was begun")
    )
    pair = ["--separate", "stribeck_friction,presliding_friction", "--duration", "2"]
    assert main(["excite", str(level_file), *pair, "--limits", limit]) == 2
    lines = [line for line in capsys.readouterr().err.splitlines() if not line.lstrip()[:1].isdigit()]
    assert len(lines) == 1 and lines[0].endswith("; widen the limits."), lines
    assert lines[0].startswith(
        f"the limits admit no motion: one that moves joint 1 by {LEAST_ENCODER_STEPS} steps of its encoder"
    )
    assert re.search(STILL[limit], lines[0]), lines
    assert list(tmp_path.iterdir()) == []


def test_a_motion_that_is_small_but_seen_is_admitted(level: Arm) -> None:
    pair = ("command_delay", "current_loop_lag")
    found = excite(level, pair, duration=2.0, limits={"position": (-5e-4, 5e-4)})
    assert found.best_motion.safe_run is not None and found.best_motion.smallest_separation > 0
    assert count_run_steps(level, found.best_motion.safe_run.simulation)[0] >= LEAST_ENCODER_STEPS
    assert all(
        t.safe_run is None or count_run_steps(level, t.safe_run.simulation)[0] >= LEAST_ENCODER_STEPS
        for t in found.tried_motions
    )


def test_a_joint_that_bears_no_torque_tells_nothing_of_its_torsion() -> None:
    none, row = np.zeros(8, bool), np.zeros(8)
    still = EncoderDifference(1, (), row, np.zeros((8, 0)), np.zeros((8, 3)), np.zeros((8, 2)), none, ~none, row, row)
    assert still.regress_terms(np.zeros(0, bool), still.loaded_rows).tolist() == [0.0] * 3


def test_every_pair_of_a_joint_can_be_asked_for(build: Callable[..., Compiled]) -> None:
    some = Arm(build(ONE, "portable", ("stribeck_friction", "torque_ripple", "torque_sensor_gain")).folder)
    found = excite(some, duration=2.0)
    assert {"stribeck_friction@1", "torque_sensor_gain@1", "payload@1"} < set(found.effects)
    unseen = {name for name in found.effects if "torque_sensor" in name}
    assert len(found.best_motion.separations) == math.comb(len(set(found.effects) - unseen), 2)
    assert found.best_motion.merit == max(t.merit for t in found.tried_motions)


def test_limits_that_are_all_wrong_are_named_at_once(arm: Arm) -> None:
    with pytest.raises(PlantError) as refused:
        narrow_limits(arm, {"speed": (-1.0,), "tip_z": (0.0, 1.0), "position": (0.5,)})
    assert len(str(refused.value).splitlines()) == 3
