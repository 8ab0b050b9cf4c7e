"""A speed that contradicts the angle it belongs to is scaled where the factor is plain, else left out, and said."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from hdagen.arm.compiled_arm import Arm
from hdagen.data_quality.log_repair import repair_for_replay, repair_log
from hdagen.data_quality.log_triage import triage_for_robot
from hdagen.diagnosis.report.sentences import _say_repairs
from hdagen.log.measured_log import Log, write

NAME = "joint_velocity_2"


def with_speed(log: Log, times: float) -> Log:
    """The log with a speed of joint 2, ``times`` what it is."""
    speed = np.gradient(log["joint_position_2"], log.time)
    noise = 0.01 * np.std(speed) * np.random.default_rng(0).standard_normal(len(speed))
    return Log(log.time, {**log.columns, NAME: times * (speed + noise)}, log.n_joints, "with a speed")


@pytest.mark.parametrize(
    ("times", "says", "scaled"),
    [
        (0.1, "it is 0.1 times its derivative.*Read here with scale = 10 under", True),
        (30 / np.pi, "it is 9.55 times.*Read here with scale = 0.10471", True),
        (0.37, "it is 0.37 times.*Read here with ignore", False),
        (1.4, "it is 1.4 times.*Read here with ignore", False),
    ],
)
def test_a_speed_that_contradicts_its_angle(times: float, says: str, scaled: bool, good: Log, arm: Arm) -> None:
    mended, repairs, _ = repair_log(with_speed(good, times), arm)
    [sentence] = [one.sentence for one in repairs if one.name == "contradicted"]
    assert re.search(says, sentence), sentence
    if scaled:
        assert mended[NAME] == pytest.approx(with_speed(good, 1.0)[NAME], rel=1e-6)
    else:
        assert NAME not in mended
    alone, said, _ = repair_for_replay(with_speed(good, times), arm)
    assert [one.sentence for one in said] == [sentence] and (NAME in alone) is scaled
    assert any(
        "contradicts joint_position_2" in one for one in triage_for_robot(with_speed(good, times), arm.robot).warnings
    )


def test_a_speed_that_agrees_is_kept(good: Log, arm: Arm) -> None:
    mended, repairs, _ = repair_log(with_speed(good, 1.0), arm)
    assert NAME in mended and not [one for one in repairs if one.name == "contradicted"]
    assert repair_for_replay(good, arm)[0] is good


def test_another_joint_s_speed_is_left_out(good: Log, arm: Arm) -> None:
    other = np.gradient(good["joint_position_1"], good.time)
    mended, repairs, _ = repair_log(Log(good.time, {**good.columns, NAME: other}, 2, "mixed up"), arm)
    assert NAME not in mended and [one.name for one in repairs] == ["contradicted"]


def test_what_was_left_out_stands_in_the_headline() -> None:
    repaired = [{"name": "contradicted", "what": "joint_velocity_2 contradicts joint_position_2."}, {"name": "dropped"}]
    assert _say_repairs({"data": {"repaired": repaired}}) == "joint_velocity_2 contradicts joint_position_2."
    assert _say_repairs({}) == ""


def test_a_replay_does_not_start_with_it(
    good: Log, arm: Arm, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from hdagen.__main__ import main

    write(with_speed(good, 0.37), tmp_path / "log.parquet")
    assert main(["replay", "paper", str(tmp_path / "log.parquet"), "--json"]) in (0, None)
    assert "Read here with ignore" in capsys.readouterr().out


@pytest.mark.parametrize("rate", [1e-3, -1e-3])
def test_two_clocks_that_drift_apart_are_brought_together(rate: float, good: Log, arm: Arm) -> None:
    since = good.time - good.time.mean()
    seen = np.clip(good.time - rate * since, good.time[0], good.time[-1])
    step = arm.robot["joints"][1]["sensor"]["joint_encoder_resolution"] or 1e-6
    late = np.round(CubicSpline(good.time, good["joint_position_2"])(seen) / step) * step
    apart = Log(good.time, {**good.columns, "joint_position_2": late}, 2, "two clocks")
    for mended, repairs in (repair_log(apart, arm)[:2], repair_for_replay(apart, arm)[:2]):
        [one] = [one for one in repairs if one.name == "drift"]
        assert one.joint == 2 and ("later" if rate > 0 else "earlier") in one.sentence and "ppm apart" in one.sentence
        off = [np.std(each["joint_position_2"] - good["joint_position_2"]) for each in (apart, mended)]
        assert off[1] < 0.2 * off[0]
    assert repair_for_replay(good, arm)[1] == []
