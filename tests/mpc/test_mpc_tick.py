"""The tick of the predictive controller: the run-time contract, line by line, and the ladder of fallbacks."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from mpc_arms import built

from hdagen.arm.build_loader import PlantError
from hdagen.mpc.predictive_controller import MPC
from hdagen.mpc.wall import Wall

H = 1e-3
NAN = float("nan")


class Loop:
    """A controller at an arm that stands still."""

    def __init__(self) -> None:
        self.arm, c = built()
        self.k = MPC(self.arm, c)
        self.q = np.array([0.6, -1.2])  # within the walls
        tip = self.arm.evaluate("points", q=self.q)["points"][-2:]
        self.k.path[:] = np.r_[tip, 0.0, 0.0]
        self.theta = self.q * 100.0
        self.now, self.last = 0.0, np.zeros(2)
        self.rate = np.array([50.0, 50.0]) * H

    def tick(self, late: float = 0.0, stamp: float | None = None, **given: object) -> int:
        self.now += H + late
        still = dict.fromkeys(("motor_velocity", "joint_velocity", "tip_force"), (0.0, 0.0))
        values = {"motor_position": self.theta, "joint_position": self.q, **still, **given}
        status = self.k.tick(self.now, stamp=self.now if stamp is None else stamp, **values)  # type: ignore[arg-type]
        torque = self.k.torque
        assert np.isfinite(torque).all()
        assert (np.abs(torque) <= 0.7875 + 1e-12).all()
        assert (np.abs(torque - self.last) <= self.rate * (1 + 1e-9)).all()
        assert len(self.k.sentence(status)) > 10
        self.last = torque.copy()
        return status


@pytest.fixture
def loop() -> Loop:
    made = Loop()
    for _ in range(5):
        assert made.tick() == 0
    return made


@pytest.mark.parametrize(
    "channel", ["motor_position", "joint_position", "motor_velocity", "joint_velocity", "tip_force"]
)
@pytest.mark.parametrize("value", [NAN, float("inf")])
def test_a_measurement_that_is_no_number_is_refused_and_latched(loop: Loop, channel: str, value: float) -> None:
    given: dict[str, Any] = {channel: (0.0, value)}
    assert loop.tick(**given) == -20
    loop.tick(motor_position=(NAN, NAN))  # the first fault is kept, with what came in
    fault = loop.k.read_fault()
    assert fault is not None
    assert fault.status == -20
    assert fault.later_faults == 1
    assert np.isnan(fault.measurement).sum() + np.isinf(fault.measurement).sum() == 1
    assert np.array_equal(fault.reference, loop.k.reference)
    assert loop.tick() == -1
    assert loop.k.report().rung == "on the ramp to the safe torque"


def test_a_path_that_is_no_number_is_refused(loop: Loop) -> None:
    loop.k.path[3, 1] = NAN
    assert loop.tick() == -20


def test_late_early_and_backward_ticks_are_refused(loop: Loop) -> None:
    assert loop.tick(late=5 * H) == -13
    assert Loop().tick() == 0
    again = Loop()
    again.tick()
    again.now -= 1.5 * H
    assert again.tick() == -11


def test_a_repeated_measurement_is_said_then_refused(loop: Loop) -> None:
    stamp = loop.now
    assert [loop.tick(stamp=stamp) for _ in range(5)] == [4, 4, 4, 4, -32]


@pytest.mark.parametrize("late, status", [(0, 0), (1, 0), (8, 0), (9, 26), (50, 26), (-1, 26)])
def test_a_late_measurement_is_carried_over_as_far_as_it_goes_and_then_said(late: int, status: int) -> None:
    """Eight ticks are carried over with the torques sent meanwhile; what is older, or from the future, is said."""
    loop = Loop()
    assert [loop.tick(stamp=loop.now + H - late * H) for _ in range(20)] == [status] * 20
    assert "older than eight ticks" in loop.k.sentence(26)


def test_a_jump_of_an_encoder_is_refused(loop: Loop) -> None:
    assert loop.tick(joint_position=loop.q + 0.5) == -31


def test_the_ladder_shifts_the_plan_twice_then_impedes_then_latches(loop: Loop) -> None:
    kept = loop.k.path.copy()
    loop.k.path[:] = 1e30  # finite, and no solver takes it
    assert [loop.tick() for _ in range(10)] == [22, 22, 23, 23, 23, 23, 23, 23, 23, -320]
    assert loop.k.report().rung == "on the ramp to the safe torque"
    loop.k.path[:] = kept
    fault = loop.k.read_fault()
    assert fault is not None
    assert loop.tick() == -1  # it stays latched though the path is good again


def test_the_ladder_sends_the_shifted_plan_then_the_impedance(loop: Loop) -> None:
    """What is sent on each rung: the last plan's mean over the node that begins a period later, twice; then stiffness
    and damping at the motor's inertia about where the motors were, over what holds the arm."""
    loop.k.path[:, :2] += 0.001  # so that the plan moves
    for _ in range(3):
        assert loop.tick() in (0, 2)
    plan, anchor = loop.k.report().planned_torque, loop.k.report().state_estimate
    loop.k.prepare()
    loop.k.path[:] = 1e30
    for status in (22, 22):
        moved = plan.copy()
        moved[:-1] += H / 0.01 * (plan[1:] - plan[:-1])
        assert loop.tick() == status
        assert np.abs(loop.k.torque - moved[0]).max() < 1e-12
        plan = moved
        loop.k.prepare()
    places, speeds = ([loop.arm.index(f"motor_{what}_{j}") for j in (1, 2)] for what in ("position", "velocity"))
    for _ in range(7):
        hold, last = -loop.k.report().disturbance, loop.last  # a horizontal arm that nothing pushes
        assert loop.tick(motor_position=loop.theta + np.array([0.02, -0.02])) == 23
        x, inertia, bandwidth = loop.k.report().state_estimate, 1.289e-4, 20.0
        pull = inertia * bandwidth**2 * (anchor - x)[places] - 2 * inertia * bandwidth * x[speeds]
        assert np.abs(pull).max() > 1e-3
        step = np.clip(hold + pull - last, -loop.rate, loop.rate)
        assert np.abs(loop.k.torque - last - step).max() < 1e-12
    assert (np.abs(step) < 0.9 * loop.rate).all()  # the impedance itself in the end, not the way to it


def test_a_good_tick_in_between_starts_the_ladder_anew(loop: Loop) -> None:
    kept = loop.k.path.copy()
    for _ in range(2):
        loop.k.path[:] = 1e30
        assert [loop.tick() for _ in range(4)] == [22, 22, 23, 23]
        loop.k.path[:] = kept
        assert loop.tick() in (0, 20)


def test_only_recover_leaves_the_latch_and_without_a_jump(loop: Loop) -> None:
    assert loop.tick(motor_position=(NAN, 0.0)) == -20
    assert loop.k.recover(loop.now, loop.now, motor_position=loop.theta, joint_position=loop.q) == -202  # unread
    loop.k.read_fault()
    for _ in range(200):
        assert loop.tick() == -1
    loop.now += 0.5 * H
    fresh: dict[str, Any] = {"motor_position": loop.theta, "joint_position": loop.q, "tip_force": (0.0, 0.0)}
    assert loop.k.recover(loop.now, loop.now, **fresh) == 0
    for _ in range(20):
        assert loop.tick() >= 0


def test_a_start_outside_a_limit_and_a_wall_through_the_tip_are_legal_and_said(loop: Loop) -> None:
    arm, c = built()
    tip = arm.evaluate("points", q=loop.q)["points"][-2:]
    walls = (Wall((1.0, 0.0), float(tip[0]) - 0.02), Wall((0.0, 1.0), float(tip[1]) - 0.01))
    loop.k.configure_with(c.with_changes(walls))
    seen = []
    for _ in range(31):
        seen.append(loop.tick())
        loop.k.prepare()
    assert set(seen) <= {1, 20, 24}
    assert seen.count(24) > 20
    loop.tick()
    report = loop.k.report()
    assert 0.015 < report.violated["wall"] < 0.025
    assert report.active["wall"] > 0


def test_a_reference_out_of_reach_is_followed_as_far_as_it_goes(loop: Loop) -> None:
    loop.k.path[:, :2] = (5.0, 5.0)
    seen = {loop.tick() for _ in range(50)}
    assert seen <= {1, 2, 20, 25}
    assert 25 in seen


def test_a_force_limit_holds_whatever_is_asked(loop: Loop) -> None:
    """The guard's limit of the static tip force stands over the plan: no torque presses more, and it is said."""
    arm, c = built()
    limit = 1.5
    loop.k.configure_with(c.with_changes(fallback__force_limit=limit))
    loop.k.path[:, :2] += (0.03, -0.03)
    J = arm.evaluate("tip_jacobian", q=loop.q, v=np.zeros(2))["J"].reshape(2, 2).T
    statuses, pressed = [], []
    for _ in range(60):
        statuses.append(loop.tick())
        pressed.append(float(np.linalg.norm(np.linalg.solve(J.T, 100.0 * loop.k.torque))))
        loop.k.prepare()
    assert max(pressed) <= limit * (1 + 1e-9)
    assert max(pressed) > 0.9 * limit
    assert statuses.count(3) > 5


def test_limits_move_while_it_runs_and_refused_ones_change_nothing(loop: Loop) -> None:
    loop.k.move_limits(tip_speed=0.05)
    assert loop.tick() in (0, 20)
    with pytest.raises(PlantError, match="tip_speed"):
        loop.k.move_limits(tip_speed=-1.0)
    assert loop.k.configuration["limits.tip_speed"] == 0.05


def test_the_watchdog_ramps_down_where_no_tick_comes(loop: Loop) -> None:
    for _ in range(200):
        loop.now += 0.03
        status = loop.k.watchdog(loop.now)
        assert status < 0
    assert np.abs(loop.k.torque).max() == 0.0


def test_ticks_before_a_configuration_send_zero() -> None:
    arm, c = built()
    k = MPC(arm, c)
    k._context[:] = 0
    assert k.tick(0.0, motor_position=(0, 0), joint_position=(0, 0)) == -3 or k.tick(0.0) < 0
    assert np.abs(k.torque).max() == 0.0


def test_preparing_before_or_in_the_tick_gives_the_same_torque() -> None:
    one, other = Loop(), Loop()
    for k in range(40):
        force = (5.0 * (k > 10), 0.0)
        assert one.tick(tip_force=force) == other.tick(tip_force=force)
        one.k.prepare()
        assert np.array_equal(one.k.torque, other.k.torque)
