"""Logs of real machines, converted by the examples' scripts as a user runs them: what they hold, what triage says of
them, and that their replays are of the size that the machines' own models reach."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import real_machines
from real_bam import closed_loop
from real_examples import EXAMPLES, ROOT, recorded, run
from recorded_machines import CASES, Case

from gen.effects import ALL
from gen.robot.load_robot import load
from hdagen.arm.compiled_arm import Arm
from hdagen.data_quality.log_triage import Triage, triage
from hdagen.log.measured_log import Log, read
from hdagen.prediction.window_replay import replay

KUKA_GAP = 0.01  # rad; the replays below err by 1.5 to 7.3 mrad at the joint


@pytest.fixture(scope="module")
def arm(build: Callable) -> Callable[[str], Arm]:
    """arm(preset or text) -> a fresh Arm."""
    return lambda robot: Arm(build(robot).folder)


def looked_at(log: Log, robot: dict[str, Any]) -> Triage:
    return triage(log, [joint["drive"]["ratio"] for joint in robot["joint"]])


def robot_of(path: Path) -> dict[str, Any]:
    return tomllib.loads(path.read_text(encoding="utf-8"))


# -- BAM's XL330 ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def servo(data_dir: Path) -> list[Path]:
    """The sixteen raw logs."""
    files = recorded(data_dir, "bam/xl330_2026-01/raw/*.json")
    assert len(files) == 16
    return files


@pytest.fixture(scope="module")
def pendulum(servo: list[Path], tmp_path_factory: pytest.TempPathFactory) -> dict[Path, Log]:
    """Three of them converted: gain 100 sine, 400 with the motor off on the way, 800 up and down."""
    out = tmp_path_factory.mktemp("bam")
    chosen = [servo[0], servo[9], servo[14]]
    for path in chosen:
        run("bam/convert.py", path, out / f"{path.stem}.parquet")
    return {path: read(out / f"{path.stem}.parquet") for path in chosen}


def entries(path: Path, name: str) -> np.ndarray:
    return np.array([float(row[name]) for row in json.loads(path.read_text())["entries"]])


def test_the_pendulum_s_angle_and_torque_are_those_of_the_raw_log(pendulum: dict[Path, Log]) -> None:
    for path, log in pendulum.items():
        angle = entries(path, "position")
        np.testing.assert_allclose(log["joint_position_1"] - angle, 0.01795252374733891 - np.pi / 2, atol=1e-12)
        np.testing.assert_array_equal(log.time, entries(path, "timestamp"))
        counts, on = entries(path, "load"), entries(path, "torque_enable") > 0
        duty = np.where(counts > 32767, counts - 65536, counts) / 885
        speed = np.gradient(np.convolve(angle, np.ones(5) / 5, "same"), log.time)
        rough = 0.32321138819018436 / 4.7636501514851926 * (7.4 * duty - 0.32321138819018436 * speed) / 288.35
        inner = slice(10, -10)
        off = (log["motor_torque_command_1"] - rough)[inner][on[inner]]
        assert np.sqrt(np.mean(off**2)) < 0.15 * np.sqrt(np.mean(rough[inner][on[inner]] ** 2))
        idle = ~on & ~np.append(on[1:], False) & ~np.insert(on[:-1], 0, False)
        assert not log["motor_torque_command_1"][idle].any() and not log["motor_torque_1"][idle].any()
    assert any((entries(path, "torque_enable") == 0).any() for path in pendulum)


def test_the_measured_torque_is_the_command_a_row_later_but_for_the_supply(pendulum: dict[Path, Log]) -> None:
    for path, log in pendulum.items():
        ratio = entries(path, "input_volts") / 7.4
        command, measured = log["motor_torque_command_1"][:-1], log["motor_torque_1"][1:]
        assert np.corrcoef(command, measured)[0, 1] > 0.97
        level = (ratio[:-1] + ratio[1:]) / 2
        near = np.abs(level - 1) < 0.01
        far = np.abs(level - 1) > 0.08
        near_gap, far_gap = (np.abs(measured - command)[rows].mean() for rows in (near, far))
        assert far_gap > 2 * near_gap


def test_the_duty_follows_the_servo_s_law(servo: list[Path]) -> None:
    for path in servo:
        counts, on = entries(path, "load"), entries(path, "torque_enable") > 0
        duty = np.where(counts > 32767, counts - 65536, counts) / 885
        gain = json.loads(path.read_text())["kp"] * 4096 / (2 * np.pi) / (256 * 885)
        law = np.clip(gain * (entries(path, "goal_position") - entries(path, "position")), -1, 1)
        assert np.corrcoef(duty[on], law[on])[0, 1] > 0.999
        assert np.polyfit(law[on], duty[on], 1)[0] == pytest.approx(1.0, abs=0.035)


def test_an_interpolated_log_and_another_servo_s_are_refused(servo: list[Path], tmp_path: Path) -> None:
    smooth = servo[0].parents[1] / "processed" / servo[0].name
    assert "take the raw log" in run("bam/convert.py", smooth, tmp_path / "no.parquet", fails=True)
    other = tmp_path / "other.json"
    other.write_text(json.dumps(json.loads(servo[0].read_text()) | {"motor": "mx64"}))
    assert "knows the xl330 alone" in run("bam/convert.py", other, tmp_path / "no.parquet", fails=True)
    assert not (tmp_path / "no.parquet").exists()


def test_the_pendulum_s_logs_can_be_used_and_replayed(pendulum: dict[Path, Log], arm: Callable) -> None:
    path = EXAMPLES / "bam" / "robot.toml"
    found = []
    for log in pendulum.values():
        assert looked_at(log, robot_of(path)).refusals == ()
        one = replay(arm(path.read_text()), log, 0.25)
        found.append(one.errors["joint_position_1"])
    assert max(found) < 0.2  # rad, in open loop; the torque of M1 is itself a fit of the closed loop


def test_in_closed_loop_the_pendulum_errs_as_bam_s_own_first_model_does(
    servo: list[Path], data_dir: Path, build: Callable
) -> None:
    robot = (EXAMPLES / "bam" / "robot.toml").read_text()
    said = run("bam/closed_loop.py", *servo, builds=build(robot).folder.parent)
    errors = [float(line.split()[1]) for line in said.splitlines()]
    parameters = {
        m: json.loads(recorded(data_dir, f"bam/params_af22604/{m}.json")[0].read_text()) for m in ("m1", "m6")
    }
    own = {m: [closed_loop(path, p) for path in servo] for m, p in parameters.items()}
    np.testing.assert_allclose(errors[:-1], own["m1"], atol=1.5e-3)
    assert np.mean(own["m1"]) == pytest.approx(0.061, abs=5e-4)
    assert errors[-1] == pytest.approx(np.mean(own["m1"]), abs=5e-4)
    assert np.mean(own["m6"]) == pytest.approx(0.0565, abs=0.002)  # the bar; 0.058 with steps of a row


# -- Kinova Gen3 ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def gen3(data_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[int, Log]:
    """The seven runs at constant speed, by joint."""
    out = tmp_path_factory.mktemp("kinova")
    files = recorded(data_dir, "kinova_gen3_sedki/jointwise_motion/joint_?_trapez.csv")
    assert len(files) == 7
    for joint, path in enumerate(files, 1):
        run("kinova/convert.py", path, joint, out / f"{joint}.parquet")
    return {joint: read(out / f"{joint}.parquet") for joint in range(1, 8)}


def cycles(log: Log, order: float) -> tuple[float, float]:
    """Largest torque at the joint (N m) within 2 of ``order`` cycles a joint turn at constant speed, and the median of
    its neighbourhood, 8 to 40 cycles away."""
    q, torque = log["joint_position_1"], 100 * log["motor_torque_1"]
    rate = np.gradient(np.convolve(q, np.ones(25) / 25, "same"), log.time)
    going = np.abs(rate - np.median(rate)) < 0.05
    place = np.argsort(q[going], kind="stable")
    angle = np.arange(q[going].min() + 0.05, q[going].max() - 0.05, 2 * np.pi / 20_000)
    even = np.interp(angle, q[going][place], torque[going][place])
    even = (even - np.polynomial.Polynomial.fit(angle, even, 5)(angle)) * np.hanning(len(angle))

    def line(k: float) -> float:
        return 2 * float(np.abs(np.exp(-1j * k * angle) @ even)) / np.hanning(len(angle)).sum()

    away = [line(order + side * k) for k in range(8, 41) for side in (-1, 1)]
    return max(line(order + k) for k in np.arange(-2, 2.1, 0.25)), float(np.median(away))


@pytest.mark.parametrize("joint", range(1, 8))
def test_a_kinova_joint_s_log_is_whole_and_can_be_used(joint: int, gen3: dict[int, Log]) -> None:
    log, path = gen3[joint], EXAMPLES / "kinova" / f"joint_{joint}.toml"
    assert load(path).name.endswith(f"joint {joint}")
    assert log.n_joints == 1 and log.period == pytest.approx(1e-3)
    assert np.ptp(np.diff(log.time)) < 1e-9  # no row is missing between the first and the last
    assert all(np.abs(values).max() < 400 for values in log.columns.values())
    assert looked_at(log, robot_of(path)).refusals == ()


@pytest.mark.parametrize("joint", [2, 4, 7])
def test_a_kinova_joint_is_replayed_within_a_hundredth(joint: int, gen3: dict[int, Log], arm: Callable) -> None:
    robot = arm((EXAMPLES / "kinova" / f"joint_{joint}.toml").read_text())
    found = replay(robot, gen3[joint], 0.25)
    assert found.errors["joint_position_1"] < 0.01 * np.ptp(gen3[joint]["joint_position_1"])


def test_the_rows_that_the_kinova_never_wrote_are_cut(gen3: dict[int, Log], data_dir: Path) -> None:
    path = recorded(data_dir, "kinova_gen3_sedki/jointwise_motion/joint_5_trapez.csv")[0]
    logged = np.genfromtxt(path, delimiter=",", names=True)
    assert max(np.nanmax(np.abs(logged[name])) for name in logged.dtype.names or ()) > 1e100
    assert len(logged) - 20 < len(gen3[5]) < len(logged)
    np.testing.assert_allclose(gen3[5]["motor_torque_1"], 5.852 * logged["Cur5"][: len(gen3[5])] / 100, rtol=1e-3)


@pytest.mark.parametrize(
    "joint, order, least", [(4, 100, 0.15), (4, 200, 0.08), (7, 1200, 0.8), (5, 1200, 0.2), (6, 1400, 0.15)]
)
def test_the_gear_s_and_the_motor_s_cycles_stand_out_of_the_current(
    joint: int, order: int, least: float, gen3: dict[int, Log]
) -> None:
    line, beside = cycles(gen3[joint], order)
    assert line > least and line > 3 * beside


@pytest.mark.parametrize(("joint", "cycles", "low", "high"), [(4, 1, 0.0, 0.2), (5, 12, 0.7, 1.3), (7, 12, 0.7, 1.3)])
def test_what_a_loop_makes_up_for_does_not_swing_the_joint(
    joint: int, cycles: int, low: float, high: float, data_dir: Path, tmp_path: Path
) -> None:
    path = recorded(data_dir, f"kinova_gen3_sedki/jointwise_motion/joint_{joint}_trapez.csv")[0]
    run("kinova/convert.py", path, joint, tmp_path / "log.parquet")
    robot = EXAMPLES / "kinova" / f"joint_{joint}.toml"
    said = run("kinova/cycles.py", robot, tmp_path / "log.parquet", cycles)
    order, _, torque, beside, angle, _, alone = said.splitlines()[-1].replace("(", "").replace(")", "").split()
    assert float(order) == cycles and float(torque) > 5 * float(beside)
    assert low <= float(angle) / float(alone) < high


@pytest.mark.parametrize(
    "joint, orders", [(1, {24}), (2, {14, 24}), (3, {14}), (4, {1, 14, 24}), (5, {12, 14, 28}), (7, {7, 12, 14, 28})]
)
def test_triage_names_the_orders(joint: int, orders: set[int], gen3: dict[int, Log]) -> None:
    seen = looked_at(gen3[joint], robot_of(EXAMPLES / "kinova" / f"joint_{joint}.toml"))
    (sentence,) = [f.sentence for f in seen.findings if f.name == "cycles"]
    assert orders <= {int(k) for k in re.findall(r"(\d+) \([0-9.e-]+ N m\)", sentence)} <= {1, 2, 7, 12, 14, 24, 27, 28}


# -- KUKA KR300 -------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def kr300(data_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, int], Log]:
    """Axes 1 to 3 of runs A, B, C."""
    out = tmp_path_factory.mktemp("kuka")
    files = recorded(data_dir, "kuka_kr300/data/recorded_trajectories/*/data.mat")
    assert len(files) == 3
    logs = {}
    for path in files:
        letter = re.search(r" FF ([ABC]) ", path.parent.name)
        assert letter
        for axis in (1, 2, 3):
            run("kuka/convert.py", path, axis, out / f"{letter[1]}{axis}.parquet")
            logs[letter[1], axis] = read(out / f"{letter[1]}{axis}.parquet")
    return logs


def test_the_kuka_s_encoders_differ_by_three_milliseconds_on_all_axes(kr300: dict[tuple[str, int], Log]) -> None:
    late = []
    for (_, axis), log in kr300.items():
        ratio = robot_of(EXAMPLES / "kuka" / f"axis_{axis}.toml")["joint"][0]["drive"]["ratio"]
        motor = log["motor_position_1"] / ratio
        speed, difference = np.gradient(motor, log.time), motor - log["joint_position_1"]
        columns = np.stack([speed, np.ones_like(speed)], 1)
        (seconds, offset), *_ = np.linalg.lstsq(columns, difference, rcond=None)
        rest = difference - columns @ [seconds, offset]
        assert rest.var() < 0.1 * difference.var()  # hardly anything but speed is in it
        late.append(seconds)
    assert len(late) == 9
    assert min(late) > 2.5e-3
    assert max(late) < 3.4e-3


@pytest.mark.parametrize("axis", [1, 2, 3])
def test_a_kuka_axis_can_be_used_and_its_torsion_is_too_small(
    axis: int, kr300: dict[tuple[str, int], Log], arm: Callable
) -> None:
    path = EXAMPLES / "kuka" / f"axis_{axis}.toml"
    drive = robot_of(path)["joint"][0]["drive"]
    for letter in "ABC":
        log = kr300[letter, axis]
        assert looked_at(log, robot_of(path)).refusals == ()
        found = replay(arm(path.read_text()), log, 0.25)
        assert found.errors["joint_position_1"] < KUKA_GAP
        torsion = found.columns["motor_position_1"] / drive["ratio"] - found.columns["joint_position_1"]
        seen = log["motor_position_1"] / drive["ratio"] - log["joint_position_1"]
        assert torsion.std() < 0.5 * seen.std()


# -- DFKI double pendulum ---------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def dfki(data_dir: Path) -> dict[str, Log]:
    """The ten runs with both torques, by the time of day in their names."""
    files = recorded(data_dir, "dfki_double_pendulum/experiment_records/design_C.1/sys_id/20230629/*/trajectory.csv")
    assert len(files) == 10
    map_ = EXAMPLES / "dfki" / "columns_both_torques.toml"
    return {path.parent.name[-6:]: read(path, map_, 2) for path in files}


def test_the_double_pendulum_s_measured_torque_lags_and_is_smaller(dfki: dict[str, Log]) -> None:
    found = triage(dfki["143524"], (6.0, 6.0))
    assert found.refusals == ()
    assert 0.010 < found.lags["motor_torque_1"] < 0.022 and 0.020 < found.lags["motor_torque_2"] < 0.034
    for run_ in ("154220", "154548"):  # the fast ones: most of what is commanded never comes
        for j in (1, 2):
            command, measured = dfki[run_][f"motor_torque_command_{j}"], dfki[run_][f"motor_torque_{j}"]
            assert 0.55 < np.ptp(measured) / np.ptp(command) < 0.75


# -- DFKI simple pendulum ---------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def simple(data_dir: Path) -> dict[str, Log]:
    """The measured motions, by name."""
    map_ = EXAMPLES / "dfki_simple" / "columns.toml"
    files = recorded(data_dir, "dfki_simple_pendulum/*_measured.csv")
    assert len(files) == 7
    return {path.stem.removesuffix("_measured"): read(path, map_, 1) for path in files}


def test_the_simple_pendulum_s_torque_is_the_motor_s_and_every_row_is_kept(
    simple: dict[str, Log], data_dir: Path
) -> None:
    for name, log in simple.items():
        (path,) = recorded(data_dir, f"dfki_simple_pendulum/{name}_measured.csv")
        logged = np.genfromtxt(path, delimiter=",", names=True)
        np.testing.assert_array_equal(log.time, logged["time"])
        np.testing.assert_array_equal(log["joint_position_1"], logged["position"])
        np.testing.assert_allclose(log["motor_torque_1"], logged["torque"] / 6, rtol=1e-12)
        assert abs(log["joint_position_1"][0]) < 0.002  # all begin hanging


@pytest.mark.parametrize("name", ["direct_collocation", "ddp"])
def test_the_weight_s_own_inertia_replays_what_the_published_one_does_not(
    name: str, simple: dict[str, Log], arm: Callable
) -> None:
    folder, log = EXAMPLES / "dfki_simple", simple[name]
    assert looked_at(log, robot_of(folder / "robot.toml")).refusals == ()
    stated = (folder / "robot.toml").read_text()
    rubbed = stated.replace("coulomb_friction = 0.0", "coulomb_friction = 0.03")
    assert rubbed != stated
    free, dry, published = (
        replay(arm(text), log, 0.5).errors["joint_position_1"]
        for text in (stated, rubbed, (folder / "published.toml").read_text())
    )
    assert published == pytest.approx({"direct_collocation": 0.85, "ddp": 0.41}[name], rel=0.1)  # rad, as listed
    assert free < published / 5
    assert dry < 0.6 * free


def test_a_heavier_weight_alone_does_not_explain_the_swings_with_it(simple: dict[str, Log], arm: Callable) -> None:
    """What else is missing there nobody has said, so that no payload can be asked for."""
    light = (EXAMPLES / "dfki_simple" / "robot.toml").read_text()
    heavy = light.replace("mass = 0.6755", "mass = 1.0").replace("0.168875", "0.25")
    errors = [
        replay(arm(text), simple["energy_shaping_1kg"], 0.5).errors["joint_position_1"] for text in (light, heavy)
    ]
    assert errors[0] > errors[1] > 0.8 * errors[0] > 0.15


# -- all of them ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_a_case_of_the_real_machines_is_converted(
    case: Case, data_dir: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    try:
        inputs = real_machines.convert(case, data_dir / "real", tmp_path)
    except FileNotFoundError as error:
        pytest.skip(str(error))
    assert [len(inputs.logs), len(inputs.hold_out)] == ([12, 4] if case.name == "bam" else [1, len(case.hold_out)])
    joints = case.logs[0].joints
    for path in (*inputs.logs, *inputs.hold_out):
        assert read(path).n_joints == joints
    assert len(load(inputs.robot).joints) == joints
    names = {name.split("@")[0] for part in (*case.answer, case.wrong) for name in part}
    assert names <= {effect.name for effect in ALL}


def test_bam_s_gain_of_400_is_held_out(data_dir: Path) -> None:
    (bam,) = (case for case in CASES if case.name == "bam")
    held, known = (
        [path for one in recordings for path in recorded(data_dir, one.pattern)]
        for recordings in (bam.hold_out, bam.logs)
    )
    assert {json.loads(path.read_text())["kp"] for path in held} == {400}
    assert {json.loads(path.read_text())["kp"] for path in known} == {100, 200, 800}


def test_recordings_that_are_not_there_are_said_to_be_missing(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="no recorded logs: nothing matches .*DATA_EMPS.mat"):
        real_machines.convert(CASES[0], tmp_path, tmp_path / "out")


# -- PACE's case ------------------------------------------------------------------------------------------------------

SPRING = """flexspline_stiffness = 2600.0
flexspline_stiffening = 1e-6
wave_generator_stiffness = 1e9
wave_generator_stiffening = 0.001
torsional_damping = 1.5"""


@pytest.fixture(scope="module")
def leg(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the simulated logs."""
    out = tmp_path_factory.mktemp("pace")
    run("pace/make_logs.py", out)
    return out


@pytest.mark.parametrize("name", ["log", "hold_out"])
def test_the_leg_s_gap_is_its_spring_and_nothing_else(name: str, leg: Path, arm: Callable) -> None:
    robot = (EXAMPLES / "pace" / "robot.toml").read_text()
    log = read(leg / f"{name}.parquet")
    assert looked_at(log, tomllib.loads(robot)).findings == ()
    rigid = replay(arm(robot), log).errors["joint_position_1"]
    flexible = replay(arm(robot.replace("rigid = true", SPRING)), log).errors["joint_position_1"]
    assert flexible < rigid / 30 and flexible < 5e-5


def test_the_leg_s_logs_with_one_encoder_are_the_same_motion(leg: Path) -> None:
    for name in ("", "_hold_out"):
        whole = read(leg / (f"{name[1:]}.parquet" if name else "log.parquet"))
        for kept, lost in (("motor", "joint"), ("joint", "motor")):
            part = read(leg / f"{kept}_only{name}.parquet")
            assert f"{lost}_position_1" not in part and set(part.columns) == set(whole.columns) - {f"{lost}_position_1"}
            np.testing.assert_array_equal(part[f"{kept}_position_1"], whole[f"{kept}_position_1"])


def test_the_leg_s_logs_are_made_the_same_again(leg: Path, tmp_path: Path) -> None:
    run("pace/make_logs.py", tmp_path)
    again, first = read(tmp_path / "log.parquet"), read(leg / "log.parquet")
    for name, values in first.columns.items():
        np.testing.assert_array_equal(again[name], values)
