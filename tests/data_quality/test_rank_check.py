"""Nothing is fitted by more terms than the data hold."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hdagen.arm.arrays import Array
from hdagen.data_quality.finding import RobotFacts
from hdagen.data_quality.log_profile import LogProfile
from hdagen.data_quality.positions import find_encoder_skews
from hdagen.data_quality.rank_check import find_resolved_orders, is_determined
from hdagen.diagnosis.data.windows import _measure_following_noise
from hdagen.diagnosis.report import residual_maps
from hdagen.diagnosis.residuals.residual_trace import ResidualTrace
from hdagen.diagnosis.search import ripple_order
from hdagen.log.measured_log import Log

TURN = 2 * np.pi


def test_a_fit_needs_several_rows_a_term() -> None:
    assert is_determined(np.zeros((50, 10))) and not is_determined(np.zeros((49, 10)))


@pytest.mark.parametrize(
    ("turns", "rows", "finest"),
    [(1 / 6, 5000, 0), (0.95, 5000, 0), (1.0, 5000, 24), (30.0, 5000, 24), (30.0, 60, 5), (30.0, 8, 0)],
)
def test_orders_are_fitted_to_whole_turns_with_rows_enough(turns: float, rows: int, finest: int) -> None:
    angle = 3.0 + turns * TURN * np.linspace(0, 1, rows) ** 1.1
    assert find_resolved_orders(angle, range(1, 25)) == list(range(1, finest + 1))


def test_orders_finer_than_what_was_not_seen_of_a_turn_are_left_out() -> None:
    angle = np.arange(0, 4 * TURN, 1e-3)
    seen = angle[np.mod(angle, TURN) > 0.5]  # a rush through half a radian of each turn
    assert find_resolved_orders(seen, range(1, 25)) == list(range(1, 7))


def spun(turns: float) -> tuple[Any, ResidualTrace]:
    """What is missing, 6 N m of noise with a slow course, of a motor that has gone so far."""
    rng, time = np.random.default_rng(1), np.linspace(0, 10, 5000)
    angle = turns * TURN * 0.5 * (1 - np.cos(time))
    missing = 6.0 * np.convolve(rng.normal(size=5049), np.ones(50) / 50**0.5, "valid")
    sight = SimpleNamespace(motion=SimpleNamespace(read_state=lambda name, joint: angle))
    return sight, ResidualTrace("torque missing at motor 1", "N m", missing, missing, missing, np.ones(5000, bool))


def test_torque_by_order_is_left_out_below_one_turn_of_the_motor(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[Array] = []
    monkeypatch.setattr(
        residual_maps, "draw_panels", lambda title, x, shown, **_: drawn.append(shown[0].series[0].y) or title
    )
    sight, seen = spun(1 / 6)
    assert residual_maps._plot_over_orders(sight, 1, seen) == []
    sight, seen = spun(3.0)
    assert residual_maps._plot_over_orders(sight, 1, seen) == [
        "Missing torque of joint 1 by order of the motor's angle"
    ]
    assert len(drawn[0]) == 24 and drawn[0].max() < 6.0  # N m


def test_a_ripple_is_sought_among_orders_of_which_a_cycle_was_run_through() -> None:
    angle = np.linspace(0.0, TURN / 6, 400)
    log = Log(1e-3 * np.arange(400), {"motor_position_1": angle}, 1, "made")
    record = SimpleNamespace(
        log=log, window_edges=np.array([[k, k + 50] for k in range(0, 400, 50)]), selected_windows=np.arange(8)
    )
    arm = SimpleNamespace(parameters={"ratio_1": 1.0})
    shooting: Any = SimpleNamespace(record=record, arm=arm)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ripple_order, "count_torque_steps", lambda _: 2)
        tried, waves = ripple_order._mean_waves(shooting, 1)
    assert tried[0] == 6 and len(waves) == len(tried)


@pytest.mark.parametrize("rows", [30, 60, 5000])
def test_a_sensor_of_torque_is_not_held_for_better_than_it_is_in_a_short_log(rows: int) -> None:
    """What 51 commands of the past cannot be, but 60 rows would be explained by."""
    rng = np.random.default_rng(2)
    time = 1e-3 * np.arange(rows)
    beside = 0.5 * np.cos(TURN * 20.0 * time)
    command = rng.normal(size=rows)
    log = Log(time, {"motor_torque_command_1": command, "motor_torque_1": command + beside}, 1, "made")
    told = _measure_following_noise(log, "motor_torque_1", np.ones(rows, bool))
    assert told > 0.7 * np.std(beside)


def test_a_few_rows_tell_no_skew() -> None:
    time = 1e-3 * np.arange(60)
    angle = np.sin(9 * time)
    columns = {"motor_position_1": 100 * angle, "joint_position_1": np.sin(9 * (time - 0.01))}
    log = Log(time, columns, 1, "made")
    assert find_encoder_skews(LogProfile(log), RobotFacts((100.0,), {}, (None,), (None,), (False,)), None) == []
