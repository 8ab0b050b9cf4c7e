"""Rows that the logger got wrong are told with numbers and taken out: currents that no drive gives, readings that are
off for a row, or those of the row before once more. What is coarse, at rest or wraps is none of these."""

from __future__ import annotations

import numpy as np
import pytest
from damage import changed, frozen, repeated, set_anew, spiked, times

from hdagen.arm.compiled_arm import Arm
from hdagen.data_quality.log_profile import LogProfile
from hdagen.data_quality.log_repair import repair_log
from hdagen.data_quality.outliers import find_outliers
from hdagen.log.data_table import LogError
from hdagen.log.measured_log import Log


def test_a_spike_of_current_is_told_with_its_numbers(good: Log, arm: Arm) -> None:
    """One row says nothing of a column's unit, and a whole column in mA has no row that is out of line."""
    log, repairs, _ = repair_log(spiked("motor_current_1", 1e5, 1000)(good), arm)
    (said,) = (one for one in repairs if one.name == "spike")
    assert said.joint == 1 and said.sentence.startswith(
        "motor_current_1 reaches 1e+05 A in 1 row(s), first in row 1001"
    )
    assert "states at most 10 A" in said.sentence and len(log) == len(good) - 1
    small = spiked("motor_current_1", 40.0, 1000, 1001, 1002)(good)
    assert "reaches 40 A in 3 row(s)" in repair_log(small, arm)[1][0].sentence
    both = times(1e3, "motor_current_1", "motor_current_command_1")(spiked("motor_current_1", 1e5, 1000)(good))
    log, repairs, _ = repair_log(both, arm)
    assert {one.name for one in repairs} == {"spike", "milliamperes", "dropped"}
    assert np.abs(log["motor_current_1"]).max() < 11


def test_a_repeated_row_is_told_of_every_channel_and_a_frozen_encoder_of_its_own(good: Log, arm: Arm) -> None:
    """Rows repeated in motion are found, and so are those at rest: the logger does that."""
    damaged = repeated(0.03)(good)
    lost = np.append(False, np.all([np.diff(v) == 0 for v in damaged.columns.values()], axis=0))
    log, repairs, _ = repair_log(damaged, arm)
    assert [(one.name, one.joint) for one in repairs if one.name != "dropped"] == [("stale", 0)]
    np.testing.assert_array_equal(log.time, good.time[~lost])
    said = repair_log(frozen("motor_position_2", 0.3, 0.06)(good), arm)[1][0]
    assert (said.name, said.joint) == ("stale", 2)
    assert said.sentence.startswith("motor_position_2 repeats the row before in 179 row(s), 179 on end at most, ")
    assert "first in row 902 (0.902 s), while" in said.sentence


def test_a_frozen_encoder_is_told_by_the_other_one_where_it_comes_back_to_the_same_angle() -> None:
    """No leap at the end: the reading goes on from where it stood."""
    time = np.arange(2000) / 1000
    angle = 0.5 * np.sin(2 * np.pi * time)
    stood = np.where((time >= 1.1) & (time < 1.4), angle[1100], angle)
    whole = Log(time, {"joint_position_1": angle, "motor_position_1": 100 * angle}, 1, "made")
    assert list(find_outliers(LogProfile(whole), [None])) == []
    (found,) = find_outliers(LogProfile(changed(whole, joint_position_1=stood)), [None])
    assert (found.name, found.joint) == ("stale", 1)
    np.testing.assert_array_equal(np.flatnonzero(found.rows), np.arange(1101, 1400))
    alone = Log(time, {"joint_position_1": stood}, 1, "made")
    assert list(find_outliers(LogProfile(alone), [None])) == []  # one encoder alone may as well be a joint that sticks


@pytest.mark.parametrize("step", [1e-4, 1e-3])
def test_a_coarse_encoder_stands_still_between_its_steps(step: float, good: Log, arm: Arm) -> None:
    coarse = {name: np.rint(v / step) * step for name, v in good.columns.items() if name.startswith("joint_position_")}
    assert any((np.diff(v) == 0).sum() > 300 for v in coarse.values())
    assert repair_log(changed(good, **coarse), arm)[1] == []


def test_a_lost_turn_is_given_back_and_a_place_that_was_set_anew_is_refused(good: Log, arm: Arm) -> None:
    log, repairs, _ = repair_log(set_anew("motor_position_1", 1200, -2 * np.pi)(good), arm)
    assert [one.name for one in repairs] == ["wrapped"] and "1 time(s), first after row 1200" in repairs[0].sentence
    np.testing.assert_allclose(log["motor_position_1"], good["motor_position_1"], atol=1e-12)
    with pytest.raises(LogError, match=r"joint_position_2 jumps by 0\.0\d+ in one row, 1 time.* set anew"):
        repair_log(set_anew("joint_position_2", 1200, 0.05)(good), arm)
    log, repairs, _ = repair_log(
        set_anew("joint_position_2", 1201, -0.05)(set_anew("joint_position_2", 1200, 0.05)(good)), arm
    )
    assert repairs[0].name == "glitch" and "joint_position_2 leaps by up to 0.0" in repairs[0].sentence
    assert 1200 not in np.searchsorted(good.time, log.time) and len(log) == len(good) - 1
