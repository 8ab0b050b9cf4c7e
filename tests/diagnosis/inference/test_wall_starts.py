"""Where walls may stand: each alone near an end of the range, the outermost ones together, seen ones first."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from compiled import Compiled
from replayed import FLEXIBLE, SEVERAL, simulated

from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.data.split import LogPortion
from hdagen.diagnosis.data.windows import WindowedRecord, cut_windows
from hdagen.diagnosis.initialization.initialization_settings import INITIALIZATION
from hdagen.diagnosis.initialization.wall_starts import list_wall_starts
from hdagen.prediction.measurement_model import read_joint_angles

ABOVE, BELOW = "contact_above_1", "contact_below_1"


@pytest.fixture(scope="module")
def moved(build: Callable[..., Compiled]) -> tuple[Arm, WindowedRecord]:
    arm = Arm(build(FLEXIBLE, effects=SEVERAL).folder)
    return arm, cut_windows(arm, LogPortion.all_rows(simulated(arm)), 0.05)


def test_each_wall_further_in_stands_alone(moved: tuple[Arm, WindowedRecord]) -> None:
    arm, record = moved
    angle = read_joint_angles(arm, record.log)[record.visible_rows, 0]
    starts = list_wall_starts(arm, record, {})
    above, below = np.array(starts[ABOVE]), np.array(starts[BELOW])
    meets = (angle.max() > above, angle.min() < below)
    further_in = len(INITIALIZATION.wall_tail_shares) - 1
    assert len(above) == len(below) == 1 + 2 * further_in
    assert meets[0][0] and meets[1][0]
    assert (meets[0][1:] ^ meets[1][1:]).all()
    assert meets[0][1:].sum() == meets[1][1:].sum() == further_in
    tails = [float(np.mean(angle > edge)) for edge in above[meets[0]]]
    assert tails == pytest.approx(INITIALIZATION.wall_tail_shares, abs=0.01)


def test_a_wall_out_of_reach_is_beyond_what_a_wrong_model_moves_through(moved: tuple[Arm, WindowedRecord]) -> None:
    arm, record = moved
    angle = read_joint_angles(arm, record.log)[record.visible_rows, 0]
    starts = list_wall_starts(arm, record, {})
    reach = max(starts[ABOVE]) - angle.max()
    assert reach > np.ptp(angle) or max(starts[ABOVE]) == arm.parameters.described[ABOVE].high


def test_a_wall_that_the_encoders_show_comes_first(moved: tuple[Arm, WindowedRecord]) -> None:
    arm, record = moved
    plain, seen = list_wall_starts(arm, record, {}), list_wall_starts(arm, record, {ABOVE: 0.123})
    assert seen[ABOVE] == (0.123, *plain[ABOVE])
    assert seen[BELOW] == (plain[BELOW][0], *plain[BELOW])
    assert seen["contact_above_2"] == plain["contact_above_2"]
