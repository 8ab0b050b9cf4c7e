"""A few rows of a current that no drive gives are the logger's error: told, and taken out like rows without a value."""

from __future__ import annotations

import numpy as np
from damage import spiked, times

from hdagen.log import Log
from hdagen.plant import Arm
from hdagen.repair import repair


def test_a_spike_of_current_is_told_with_its_numbers(good: Log, arm: Arm) -> None:
    """One row says nothing of a column's unit, and a whole column in mA has no row that is out of line."""
    log, repairs, _ = repair(spiked("motor_current_1", 1e5, 1000)(good), arm)
    (said,) = (one for one in repairs if one.name == "spike")
    assert said.joint == 1 and said.sentence.startswith(
        "motor_current_1 reaches 1e+05 A in 1 row(s), first in row 1001"
    )
    assert "states at most 10 A" in said.sentence and len(log) == len(good) - 1
    small = spiked("motor_current_1", 40.0, 1000, 1001, 1002)(good)
    assert "reaches 40 A in 3 row(s)" in repair(small, arm)[1][0].sentence
    both = times(1e3, "motor_current_1", "motor_current_command_1")(spiked("motor_current_1", 1e5, 1000)(good))
    log, repairs, _ = repair(both, arm)
    assert {one.name for one in repairs} == {"spike", "milliamperes", "dropped"}
    assert np.abs(log["motor_current_1"]).max() < 11
