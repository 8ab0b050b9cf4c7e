"""Repair: each mistake is mended or refused, on whatever log; a sound log is left as it is."""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Callable
from pathlib import Path

import arms
import numpy as np
import pytest
from damage import LESSENED, MENDED, REFUSED, changed, cut, dropped, holes, kept, later, sparse, stuck, times, without
from real_examples import EXAMPLES, recorded, run
from replayed import FLEXIBLE, JOINT, NOISE, SENSORS
from uncompiled import load_uncompiled

from hdagen.arm.compiled_arm import Arm
from hdagen.data_quality.log_preparation import prepare_logs
from hdagen.data_quality.log_repair import repair_log, split_at_long_gaps
from hdagen.data_quality.log_triage import triage_for_robot
from hdagen.diagnosis.data.split import LogPortion
from hdagen.diagnosis.data.windows import cut_windows
from hdagen.log.data_table import LogError
from hdagen.log.measured_log import Log, read, write


@pytest.fixture(scope="module")
def made(data_dir: Path, build: Callable) -> list[tuple[Log, Arm]]:
    """Every made log with its arm."""
    found, arms_by_text = [], {}
    paths = sorted((data_dir / "made").glob("*/case-*/*.parquet"))
    for path in sorted(paths, key=lambda path: (int(path.parent.name[-3:]) % 7, path)):  # neighbours are of all kinds
        text = (path.parent / "robot.toml").read_text()
        if text not in arms_by_text:
            arms_by_text[text] = Arm(build(text).folder)
        found.append((read(path, joints=2), arms_by_text[text]))
    if not found:
        pytest.skip("there are no made logs")
    return found


def same(log: Log, before: Log, rows: slice = slice(20, -20)) -> bool:
    """Whether the columns are those before, but for whole turns of a wrapped encoder and rounding."""
    for name, values in log.columns.items():
        size = np.ptp(before[name])
        offset = np.round((values[50] - before[name][50]) / (2 * math.pi)) * 2 * math.pi
        if len(values) != len(before) and np.array_equal(log.time, before.time[: len(values)]):
            before = before.rows(0, len(values))
        if not np.allclose(values[rows] - offset, before[name][rows], rtol=0, atol=1e-9 * max(size, 1.0)):
            return False
    return log.columns.keys() == before.columns.keys()


def test_a_sound_log_is_left_as_it_is(good: Log, arm: Arm) -> None:
    log, repairs, _ = repair_log(good, arm)
    assert repairs == [] and log.columns is good.columns and log.notes == good.notes


@pytest.mark.parametrize("part", [4, pytest.param(1, marks=pytest.mark.campaign)])
def test_no_made_log_is_refused_or_mended(made: list[tuple[Log, Arm]], part: int) -> None:
    for log, arm in made[::part]:
        assert repair_log(log, arm)[1] == [], log.source


@pytest.mark.parametrize("what", MENDED)
def test_what_leaves_no_choice_is_mended(what: str, good: Log, arm: Arm) -> None:
    damage, names = MENDED[what]
    log, repairs, seen = repair_log(damage(good), arm)
    assert {one.name for one in repairs} == names
    assert same(log, good)
    assert seen.findings == triage_for_robot(log, arm.robot).findings
    assert all(one.sentence in log.notes and one.sentence.endswith(".") for one in repairs)
    assert all("columns.toml" in one.sentence and "Read here with" in one.sentence for one in repairs)


@pytest.mark.parametrize("what", LESSENED)
def test_rows_and_columns_that_are_no_use_are_left_out_and_said(what: str, good: Log, arm: Arm) -> None:
    damage, names = LESSENED[what]
    log, repairs, _ = repair_log(damage(good), arm)
    assert {one.name for one in repairs} == names
    assert all(np.isfinite(values).all() for values in log.columns.values())
    left = np.isin(good.time, log.time)
    assert len(log) > 0.9 * len(good)
    assert all(np.array_equal(log[name], good[name][left]) for name in log.columns if name != "motor_current_1")


@pytest.mark.parametrize("what", REFUSED)
def test_what_only_its_owner_can_mend_is_refused(what: str, good: Log, arm: Arm) -> None:
    damage, word = REFUSED[what]
    with pytest.raises(LogError, match=word) as raised:
        repair_log(damage(good), arm)
    assert all(problem.startswith("simulated: ") and problem.endswith(".") for problem in raised.value.problems)


@pytest.mark.parametrize("count", [1, pytest.param(3, marks=pytest.mark.campaign)])
@pytest.mark.parametrize("what", [*MENDED, *LESSENED, *REFUSED])
def test_no_damage_of_a_made_log_passes_in_silence(what: str, count: int, made: list[tuple[Log, Arm]]) -> None:
    """Each damage on so many logs, other ones for each, with whatever effect they have."""
    first = 11 * [*MENDED, *LESSENED, *REFUSED].index(what)
    for log, arm in (made[(first + 37 * k) % len(made)] for k in range(count)):
        if what in REFUSED:
            with pytest.raises(LogError):
                repair_log(REFUSED[what][0](log), arm)
            continue
        damage, names = (MENDED | LESSENED)[what]
        mended, repairs, _ = repair_log(damage(log), arm)
        assert {one.name for one in repairs} == names, (log.source, repairs)
        assert what in LESSENED or same(mended, log), log.source


@pytest.mark.campaign
@pytest.mark.parametrize("encoder", ["motor_position", "joint_position"])
@pytest.mark.parametrize("what", sorted({*MENDED, *LESSENED, *REFUSED} - {"joints swapped", "a command logged late"}))
def test_with_one_encoder_and_no_measured_current_no_damage_passes_in_silence(
    what: str, encoder: str, made: list[tuple[Log, Arm]]
) -> None:
    """The two that are left out cannot be told there: alike joints exchanged, and a command a few rows late."""
    damage = (MENDED | LESSENED | REFUSED)[what][0]
    others = {"motor_position", "joint_position"} - {encoder}
    for log, arm in made[:: len(made) // 8]:
        one = without(log, "motor_current", "joint_position_reference", *others)
        if what in ("motor encoder out of range", "joint encoder out of range") and encoder[:5] != what[:5]:
            continue
        spoilt = damage(one)
        if len(spoilt) == len(one) and all(np.array_equal(spoilt[name], one[name]) for name in one.columns):
            continue  # it concerns what is not logged
        try:
            assert repair_log(spoilt, arm)[1], log.source
        except LogError:
            assert what not in MENDED


def test_a_recording_that_was_cut_off_is_refused_and_a_drive_that_saturates_is_not(
    made: list[tuple[Log, Arm]],
) -> None:
    refused = 0
    for log, arm in made[::4]:
        try:
            repair_log(cut(0.5, "motor_current_command_1", "motor_current_1")(log), arm)
        except LogError as error:
            refused += "cut off" in str(error)
    assert refused > 0.6 * len(made[::4])  # the others hardly reach half of their largest current


def test_several_mistakes_at_once_are_all_mended(good: Log, arm: Arm) -> None:
    spoilt = times(180 / math.pi, "motor_position_1")(times(1e3, "motor_current_2", "motor_current_command_2")(good))
    log, repairs, _ = repair_log(spoilt, arm)
    assert {one.name for one in repairs} == {"degrees", "milliamperes"} and same(log, good)
    both_kinds = times(-1, "motor_current_1", "motor_current_command_1")(spoilt)
    with pytest.raises(LogError, match="reversed") as raised:
        repair_log(both_kinds, arm)
    assert "degrees" not in str(raised.value)


def test_milliamperes_are_seen_without_a_stated_current_by_the_inertia_they_ask_for(good: Log, build: Callable) -> None:
    arm = Arm(build(FLEXIBLE.replace("max_current = 10.0\n", "").replace("constant = 0.05", "constant = 2.5")).folder)
    alone = Log(good.time, {n: v for n, v in good.columns.items() if n != "motor_current_1"}, 2, "simulated")
    names = ("motor_current_command_1", "motor_current_2", "motor_current_command_2")
    small = times(1 / 50, *names)(alone)  # the robot file's drive has 50 times the torque per ampere
    assert all(np.abs(1e3 * small[name]).max() < 200 for name in names)
    log, repairs, _ = repair_log(times(1e3, *names)(small), arm)
    assert {one.name for one in repairs} == {"milliamperes"} and same(log, small)


def test_another_robot_s_file_is_refused(good: Log, build: Callable) -> None:
    for text, words in (
        (FLEXIBLE.replace("ratio = 100.0", "ratio = 50.0"), "the robot file states the ratio 50"),
        (FLEXIBLE.replace("torque_constant = 0.05", "torque_constant = 0.5"), "times the inertia of joint"),
        (FLEXIBLE.replace("motor_inertia = 0.00", "motor_inertia = 0.0"), "times the inertia of joint"),
    ):
        assert text != FLEXIBLE
        with pytest.raises(LogError, match=words):
            repair_log(good, Arm(build(text).folder))


@pytest.mark.parametrize("text", [arms.SMALL, arms.CHAINS["RPR"]], ids=["1", "3"])
def test_a_robot_with_another_number_of_joints_is_refused(good: Log, text: str, tmp_path: Path) -> None:
    robot = tmp_path / "robot.toml"
    robot.write_text(text)
    with pytest.raises(LogError, match="the log has 2 joint"):
        repair_log(good, load_uncompiled(robot))


def test_an_effect_is_not_taken_for_a_mistake(good: Log, arm: Arm) -> None:
    """A torque constant 40 % off, a delayed command, a late encoder, stiction: a diagnosis is to find them."""
    weak = times(0.6, "motor_current_1", "motor_current_command_1")(good)
    strong = times(1.4, "motor_current_1", "motor_current_command_1")(good)
    delayed = later(-6, "motor_current_command_1")(good)
    late = later(4, "joint_position_1", "joint_position_2")(good)
    sticks = changed(
        good, motor_current_1=good["motor_current_1"] + 0.5 * np.sign(np.gradient(good["motor_position_1"]))
    )
    for log in (weak, strong, delayed, late, sticks):
        assert repair_log(log, arm)[1] == []


def test_a_time_skew_is_handed_on_as_a_finding(good: Log, arm: Arm) -> None:
    found = triage_for_robot(later(4, "joint_position_1", "joint_position_2")(good), arm.robot)
    skews = [f.sentence for f in found.findings if f.name == "skew"]
    assert len(skews) == 2 and all("ms later than motor_position" in s and "clocks differ" in s for s in skews)
    both = later(8, *(f"{name}_{j}" for name in ("motor_current", "motor_current_command") for j in (1, 2)))(good)
    found = triage_for_robot(both, arm.robot)
    assert found.refusals == ()
    assert any("the motion is" in f.sentence and "ahead of" in f.sentence for f in found.findings if f.name == "skew")
    assert not [f for f in triage_for_robot(good, arm.robot).findings if f.name == "skew"]


def test_segments_are_cut_where_rows_are_missing_for_long(good: Log, arm: Arm) -> None:
    rows = np.ones(len(good), bool)
    rows[500:503] = False  # commands are held over these
    rows[1000:1200] = False
    rows[2000:2030] = False
    log, repairs, _ = repair_log(kept(good, rows), arm)
    assert split_at_long_gaps(log.time) == [(0, 997), (997, 1797), (1797, len(log))]
    assert "cut into 3 parts" in repairs[0].sentence
    assert split_at_long_gaps(good.time) == [(0, len(good))]
    assert split_at_long_gaps(np.arange(5) * 0.02) == [(0, 5)]  # a slow log has no gaps for being slow
    assert split_at_long_gaps(np.zeros(1)) == [(0, 1)]
    parts = np.ones(len(good), bool)
    parts[200:2700] = False  # 0.5 s are left
    with pytest.raises(LogError, match="without its gaps"):
        repair_log(kept(good, parts), arm)


def test_no_window_of_a_fit_reaches_over_a_long_gap(good: Log, arm: Arm) -> None:
    rows = np.ones(len(good), bool)
    rows[1010:1050] = False  # begins and ends within windows
    rows[2003:2005] = False
    log = kept(good, rows)
    seen = cut_windows(arm, LogPortion.all_rows(log), 0.05)
    spans = [np.diff(log.time[a:b]).max() for a, b in zip(seen.starts, seen.ends, strict=True)]
    assert max(spans) < 0.0035 and len(spans) > 50
    assert 1010 in seen.starts  # the first row after the gap


def test_a_value_that_repeats_counts_once(good: Log, arm: Arm) -> None:
    """Counts that do not change err alike: ten rows on one count tell no more than one. Their mean has then the noise
    that the channel has, however many rows there are."""
    held = np.repeat(np.arange(len(good) // 10 + 1), 10)[: len(good)] * 1e-3
    log = Log(good.time, {**good.columns, "motor_position_1": held}, good.n_joints, good.source)
    seen = cut_windows(arm, LogPortion.all_rows(log), 0.05)
    other = cut_windows(arm, LogPortion.all_rows(good), 0.05)
    at = seen.names.index("motor_position_1")
    share = (seen.sample_noise[:, at] / seen.noise[at]) ** 2
    rows = len(seen.sampled_rows[0])
    assert set(np.round(rows / share[share > 0]).astype(int)) <= {5, 6}  # counts in windows of 50 rows
    rest = [k for k in range(len(seen.names)) if k != at]
    np.testing.assert_array_equal(seen.sample_noise[:, rest], other.sample_noise[:, rest])
    current = seen.names.index("motor_current_1")
    np.testing.assert_array_equal(seen.sample_noise[:, current], seen.noise[current])  # that has noise of its own


def test_a_file_with_holes_is_read_for_repair_and_refused_otherwise(good: Log, arm: Arm, tmp_path: Path) -> None:
    path = tmp_path / "log.parquet"
    write(sparse("motor_temperature_1", 0.9)(changed_with_temperature(holes("joint_position_1", 700, 3)(good))), path)
    with pytest.raises(LogError, match="no value"):
        read(path, joints=2)
    log, repairs, _ = repair_log(read(path, joints=2, holes=True), arm)
    assert len(log) == len(good) - 3 and "motor_temperature_1" not in log
    assert [(one.name, one.joint) for one in repairs] == [("missing", 1), ("missing", 0), ("dropped", 0)]


def changed_with_temperature(log: Log) -> Log:
    """The log with a column that it did not have."""
    columns = log.columns | {"motor_temperature_1": np.linspace(300.0, 310.0, len(log))}
    return Log(log.time, columns, log.n_joints, log.source)


def test_a_needed_column_that_is_empty_is_refused(good: Log, arm: Arm) -> None:
    empty = sparse("motor_current_1", 1.0)(sparse("motor_current_command_1", 1.0)(good))
    with pytest.raises(LogError, match="joint 1 has none of motor_current_command_1, motor_current_1"):
        repair_log(empty, arm)


def test_a_joint_that_is_pulled_along_is_not_refused(good: Log, arm: Arm) -> None:
    """A command of 0 alone is a passive joint's; a measured current without any noise is none."""
    passive = stuck("motor_current_command_2")(times(0.0, "motor_current_command_2")(good))
    columns = {n: v for n, v in passive.columns.items() if n != "motor_current_2"}
    found = triage_for_robot(Log(good.time, columns, 2, "simulated"), arm.robot)
    assert found.refusals == () and any("a passive joint" in sentence for sentence in found.warnings)


def test_a_log_and_its_hold_out_are_prepared_together(good: Log, arm: Arm) -> None:
    first, last = good.rows(0, 1800), good.rows(1800, 3000)
    (log,), (held,), _, data = prepare_logs(arm, [times(1e3, "motor_current_2")(first)], [dropped(0.03)(last)])
    assert same(log, first) and len(held) < len(last)
    assert [(one["name"], one["joint"]) for one in data["repaired"]] == [("milliamperes", 2), ("dropped", 0)]
    assert data["rows"] == 1800 and data["dropped"] == 0 and data["refused"] == [] and data["lags"]
    assert any("3 % of the log" in sentence or "row(s) are missing" in sentence for sentence in data["warnings"])
    json.dumps(data, allow_nan=False)
    with pytest.raises(LogError, match="leave one of them out"):
        prepare_logs(arm, [first, first], [last])
    with pytest.raises(LogError) as raised:
        prepare_logs(arm, [times(-1, "motor_position_1")(first)], [last.rows(0, 300)])
    assert any("reversed" in problem for problem in raised.value.problems)
    assert any("lasts 0.299 s" in problem for problem in raised.value.problems)


@pytest.mark.parametrize("encoder", ["motor_position", "joint_position"])
def test_with_one_encoder_the_model_tells_a_stuck_one_and_an_input_that_is_missing(
    encoder: str, good: Log, arm: Arm
) -> None:
    one = without(good, "motor_current", "joint_position" if encoder == "motor_position" else "motor_position")
    assert repair_log(one, arm)[1] == []
    with pytest.raises(LogError, match="moves as only its drive can move it") as raised:
        repair_log(times(0.0, "motor_current_command_1")(one), arm)
    assert "joint 2" not in str(raised.value)
    with pytest.raises(LogError, match=f"{encoder}_2 stays at .* times the dry friction") as raised:
        repair_log(stuck(f"{encoder}_2")(one), arm)
    assert "joint 1" not in str(raised.value)
    braked = times(0.0, "motor_current_command_2")(stuck(f"{encoder}_2")(one))  # its drive is off
    assert repair_log(braked, arm)[1] == []


def test_a_pendulum_that_swings_without_a_motor_is_not_refused(build: Callable) -> None:
    """A coast-down: what moves it is its weight."""
    text = arms.arm("R", rigid="r", drive=f"torque_constant = 0.05\n{SENSORS}")
    text = text.replace("ratio = 20.0", "ratio = 4.0").replace("coulomb_friction = 0.03", "coulomb_friction = 0.003")
    swinging = Arm(build(text).folder)
    time = np.arange(6000) * 1e-3
    x = swinging.rollout(swinging.rest(np.array([-0.6])), np.zeros((5999, swinging.nu)), np.diff(time), exact=True)
    position = np.round(x[:, swinging.index("joint_position_1")] / JOINT) * JOINT
    log = Log(time, {"motor_current_command_1": np.zeros(6000), "joint_position_1": position}, 1, "coasting")
    assert np.ptp(position) > 0.5
    assert repair_log(log, swinging)[1] == []
    with pytest.raises(LogError, match="moves as only its drive can move it"):
        repair_log(changed(log, joint_position_1=np.round(0.3 * np.sin(15 * time) / JOINT) * JOINT), swinging)


def test_real_logs_are_neither_refused_nor_changed(data_dir: Path, build: Callable) -> None:
    examples = Path(__file__).resolve().parents[2] / "docs" / "examples"
    emps, dfki = data_dir / "real" / "emps", data_dir / "real" / "dfki_double_pendulum"
    if not emps.is_dir() or not dfki.is_dir():
        pytest.skip("the logs of EMPS and of the double pendulum are not there")
    stage = Arm(build("emps").folder)
    for file, columns in (("DATA_EMPS", "columns"), ("DATA_EMPS_PULSES", "columns_pulses")):
        assert repair_log(read(emps / f"{file}.mat", examples / "emps" / f"{columns}.toml"), stage)[1] == []
    pendulum = Arm(build("dfki_1_1").folder)  # without friction and rotor inertia
    for path in sorted(dfki.glob("**/trajectory.csv")):
        assert {one.name for one in repair_log(read(path, examples / "dfki" / "columns.toml"), pendulum)[1]} <= {
            "dropped"
        }


@pytest.mark.campaign
def test_no_log_of_the_examples_is_refused(data_dir: Path, build: Callable, tmp_path: Path) -> None:
    """Every real log as the scripts of docs/examples convert it, by the robot files that stand there."""
    cases: list[tuple[str, Path, Path | None]] = []
    for path in recorded(data_dir, "bam/xl330_2026-01/raw/*.json"):
        run("bam/convert.py", path, out := tmp_path / f"{path.stem}.parquet")
        cases.append(((EXAMPLES / "bam" / "robot.toml").read_text(), out, None))
    for joint, path in enumerate(recorded(data_dir, "kinova_gen3_sedki/jointwise_motion/joint_?_trapez.csv"), 1):
        run("kinova/convert.py", path, joint, out := tmp_path / f"kinova{joint}.parquet")
        cases.append(((EXAMPLES / "kinova" / f"joint_{joint}.toml").read_text(), out, None))
    for k, path in enumerate(recorded(data_dir, "kuka_kr300/data/recorded_trajectories/*/data.mat")):
        for axis in (1, 2, 3):
            run("kuka/convert.py", path, axis, out := tmp_path / f"kuka{axis}{k}.parquet")
            cases.append(((EXAMPLES / "kuka" / f"axis_{axis}.toml").read_text(), out, None))
    run("pace/make_logs.py", tmp_path)
    cases += [
        ((EXAMPLES / "pace" / "robot.toml").read_text(), tmp_path / f"{side}{name}.parquet", None)
        for side, name in (("", "log"), ("", "hold_out"), ("motor_only", ""), ("joint_only", "_hold_out"))
    ]
    emps = (EXAMPLES / "emps" / "without_friction.toml").read_text()
    for file, columns in (("DATA_EMPS", "columns"), ("DATA_EMPS_PULSES", "columns_pulses")):
        cases += [
            (emps, path, EXAMPLES / "emps" / f"{columns}.toml") for path in recorded(data_dir, f"emps/{file}.mat")
        ]
    for path in recorded(data_dir, "dfki_double_pendulum/**/trajectory.csv"):
        for columns in ("columns", "columns_both_torques"):
            cases.append(("dfki_1_1", path, EXAMPLES / "dfki" / f"{columns}.toml"))
    assert len(cases) >= 16 + 7 + 9 + 4 + 2 + 20
    for robot, path, map_ in cases:
        made = Arm(build(robot).folder)
        assert {one.name for one in repair_log(read(path, map_, holes=True), made)[1]} <= {"dropped"}, path


def test_the_noise_of_a_simulated_current_is_what_the_robot_file_says() -> None:
    assert tomllib.loads(FLEXIBLE)["joint"][0]["sensor"]["current_noise"] == NOISE


def test_losing_many_rows_is_refused_before_anything_else(good: Log, arm: Arm) -> None:
    with pytest.raises(LogError, match="of the rows are missing"):
        repair_log(dropped(0.15)(good), arm)
