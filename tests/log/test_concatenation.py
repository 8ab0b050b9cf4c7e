"""Several logs as one: every row once, no window over a join, and what cannot be taken together is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from replayed import simulated

from hdagen.arm.compiled_arm import load
from hdagen.data_quality.log_repair import split_at_long_gaps
from hdagen.log.concatenation import PAUSE_BETWEEN_LOGS, concatenate_logs
from hdagen.log.data_table import LogError
from hdagen.log.measured_log import Log
from hdagen.prediction.window_replay import replay


@pytest.fixture(scope="module")
def logs() -> list[Log]:
    """Two motions of the preset."""
    arm = load("paper")
    return [simulated(arm, 0.8, seed=0), simulated(arm, 1.2, seed=5)]


def test_every_row_is_there_once_and_the_join_is_a_gap(logs: list[Log]) -> None:
    both = concatenate_logs(logs)
    assert len(both) == sum(map(len, logs))
    for name in logs[0].columns:
        np.testing.assert_array_equal(both[name], np.concatenate([log[name] for log in logs]))
    assert split_at_long_gaps(both.time) == [(0, len(logs[0])), (len(logs[0]), len(both))]
    assert both.time[len(logs[0])] - both.time[len(logs[0]) - 1] == pytest.approx(PAUSE_BETWEEN_LOGS)
    assert concatenate_logs(logs[:1]) is logs[0]


def test_a_window_begins_with_each_log_and_the_errors_are_those_of_the_logs(logs: list[Log]) -> None:
    arm = load("paper")
    both, each = replay(arm, concatenate_logs(logs)), [replay(arm, log) for log in logs]
    assert len(logs[0]) in both.starts
    for name, error in both.errors.items():
        apart = np.sqrt(np.average([one.errors[name] ** 2 for one in each], weights=[len(log) for log in logs]))
        assert error == pytest.approx(apart, rel=0.2, abs=both.noise[name])


def test_a_channel_that_one_log_lacks_is_left_out_and_said(logs: list[Log]) -> None:
    less = replace(logs[1], columns={k: v for k, v in logs[1].columns.items() if k != "motor_current_2"})
    both = concatenate_logs([logs[0], less])
    assert "motor_current_2" not in both and "motor_current_1" in both
    assert any("left out: motor_current_2" in note for note in both.notes)


def test_a_log_at_two_thirds_of_the_rate_is_taken_along(logs: list[Log]) -> None:
    slower = replace(logs[1], time=logs[1].time * 1.5)
    assert len(concatenate_logs([logs[0], slower])) == len(logs[0]) + len(slower)


def test_logs_of_other_machines_or_rates_are_refused(logs: list[Log]) -> None:
    slow = logs[1].rows(0, 1200)
    slow = replace(slow, time=slow.time * 4)
    one = {name: values for name, values in logs[0].columns.items() if name.endswith("_1")}
    with pytest.raises(LogError, match="one rate") as raised:
        concatenate_logs([logs[0], slow, replace(logs[0], columns=one, n_joints=1)])
    assert len(raised.value.problems) == 2
