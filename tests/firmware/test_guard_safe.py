"""The run-time contract: what safe is, when it is reached, how it ends; the watchdog; the configuration."""

from __future__ import annotations

import ctypes as ct
import math
from typing import Any

import numpy as np
import pytest
from guard_library import CODE, DAMPING, HOLD, NAME, TICKS_MAX, UNLIMITED, VERSION, ZERO, Arm, Library, doubles

NAN, INF = math.nan, math.inf
LIMIT, STEP = 0.3, 0.03  # N m, N m in a tick of 1 ms: Library.config
KINDS = {"zero": ZERO, "damping": DAMPING, "hold": HOLD}


@pytest.fixture(scope="module", params=[2, 6])
def library(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Library:
    return Library(tmp_path_factory.mktemp("guard"), request.param)


def bound(arm: Arm) -> int:
    """hda_guard_safe_ticks of the arm's configuration."""
    return arm.library.c.hda_guard_safe_ticks(ct.byref(arm.guard.config))


def settled(arm: Arm, **changes: Any) -> Arm:
    """Latched, read, and safe."""
    arm.ticks(10, raw=1.0, **changes)
    arm.fail()
    arm.read()
    arm.ticks(bound(arm), **changes)
    return arm


# In the same tick the output is legal and moves toward safe; safe is reached in a bounded, stated number of ticks.


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("start", [-1.0, 1.0])
def test_safe_is_reached_within_the_stated_ticks(library: Library, kind: str, start: float) -> None:
    random = np.random.default_rng(7)
    for speed in (0.0, 3.0, 1e3):  # at 1e3 rad/s the law swings between its limits from tick to tick
        arm = library.arm(safe=KINDS[kind])
        arm.ticks(40, raw=start)
        arm.fail(start)
        for _ in range(bound(arm) - 1):
            before = np.array(arm.guard.sent)
            tick = arm.tick(motor_velocity=random.normal(size=library.n) * speed)
            assert (abs(tick.torque - before) <= STEP + 1e-16).all()
        for _ in range(20):
            tick = arm.tick(motor_velocity=random.normal(size=library.n) * speed)
            assert np.array_equal(tick.torque, np.array(arm.guard.target)), "nothing of the controller's torque is left"
        if kind == "zero":
            assert (tick.torque == 0.0).all()


def test_the_stated_ticks_are_needed_and_counted_from_the_limits(library: Library) -> None:
    """A clock that fails makes a tick count as period_min: zero takes limit / (rate period_min) ticks, no fewer."""
    arm = library.arm()
    assert bound(arm) == 2 + int(LIMIT / (30.0 * 0.5e-3)) == 22
    assert library.arm(safe=HOLD).guard.safe_bound == 2 + 80
    arm.ticks(40, raw=1.0)
    torques = [arm.tick(now=NAN).torque for _ in range(22)]
    assert (torques[18] > 0.0).all() and (torques[20] == 0.0).all()
    for slow in range(library.n):
        rate = np.where(np.arange(library.n) == slow, 3.0, 30.0)
        assert bound(library.arm(torque_rate=rate)) == 2 + 200, "the slowest joint counts"


# What safe means is chosen in the configuration; there is no default guess.


def test_safe_has_no_default(library: Library) -> None:
    for unset in (0, -1, 4, 2**31 - 1):
        assert Arm(library).configure(safe=unset) == CODE["HDA_CONFIG_SAFE"]
    arm = Arm(library)
    assert arm.tick(raw=1.0).end == "HDA_FAULT_UNCONFIGURED"
    assert (arm.end(1.0)[1] == 0.0).all()


def test_damping_opposes_the_velocity_and_is_clipped(library: Library) -> None:
    arm = settled(library.arm(safe=DAMPING))
    velocity = np.linspace(-4.0, 5.0, library.n)
    assert np.array_equal(arm.ticks(60, motor_velocity=velocity).torque, -0.01 * velocity)
    assert np.array_equal(arm.ticks(60, motor_velocity=1e9).torque, np.full(library.n, -LIMIT))


def test_hold_is_a_pd_about_the_position_of_the_fault(library: Library) -> None:
    arm = settled(library.arm(safe=HOLD), motor_position=0.2)
    torque = arm.ticks(60, motor_position=0.25, motor_velocity=1.0).torque
    assert np.allclose(torque, 2.0 * (0.2 - 0.25) - 0.01 * 1.0, rtol=1e-14)


def test_each_safe_state_falls_to_the_one_below_without_its_measurement(library: Library) -> None:
    def torque(**changes: Any) -> float:
        arm = settled(library.arm(safe=HOLD), motor_position=0.2, motor_velocity=2.0)
        arm.tick(motor_position=0.21)
        return float(arm.ticks(100, **changes).torque[0])

    arm = settled(library.arm(safe=HOLD), motor_position=0.2)
    assert math.isclose(torque(), 2.0 * (0.2 - 0.21) - 0.02)
    assert torque(joint_position={0: NAN}) == -0.02, "no position: damping"
    assert torque(joint_velocity={1: INF}) == -0.02
    arm = settled(library.arm(safe=HOLD), motor_position=0.2, motor_velocity=2.0)
    assert (arm.ticks(100, motor_velocity={1: NAN}).torque == 0.0).all(), "no velocity of one joint: zero for all"
    arm.measure(motor_velocity=2.0)
    assert (arm.ticks(100, motor_position=5.0).torque == -0.02).all(), "after a jump the position is not trusted again"
    assert (arm.ticks(100, motor_position=0.2).torque == -0.02).all()
    assert (arm.ticks(100, stamp=arm.now).torque == 0.0).all(), "a measurement that stands still is no velocity"
    assert (arm.ticks(100).torque == 0.0).all(), "... until recover"
    arm = settled(library.arm(safe=HOLD), motor_velocity=2.0)
    arm.tick(stamp=1.0)
    assert (arm.ticks(100).torque == 0.0).all(), "an old measurement is no velocity, until recover"


def test_hold_never_holds_a_position_that_was_not_measured(library: Library) -> None:
    arm = library.arm(safe=HOLD)
    arm.tick(motor_position=NAN)
    assert (arm.ticks(100, motor_position=3.0, motor_velocity=0.0).torque == 0.0).all()


def test_a_law_that_overflows_falls_to_zero_in_all_joints(library: Library) -> None:
    arm = settled(library.arm(safe=DAMPING, safe_damping=1e100))
    assert (arm.ticks(100, motor_velocity={0: 1e300, 1: 1.0}).torque == 0.0).all()


def test_a_later_fault_starts_from_its_own_law(library: Library) -> None:
    """Not from what the safe torque was at the end of an earlier one."""
    arm = settled(library.arm(safe=DAMPING), motor_velocity=20.0)
    assert arm.recover() == "HDA_FINE"
    arm.measure(motor_velocity=-20.0)
    arm.fail()
    assert (np.array(arm.guard.target) == 0.2).all()


# State is never reset silently. A latched hold ends only by an explicit recover, fresh measurements, no jump in torque.


def test_nothing_but_recover_ends_the_latch(library: Library) -> None:
    arm = settled(library.arm(safe=HOLD))
    before = bytes(arm.guard.config)
    assert arm.configure(safe=ZERO) == CODE["HDA_CONFIG_BUSY"]
    assert bytes(arm.guard.config) == before
    arm.read(), arm.watchdog(arm.now + 1e-3)
    assert arm.ticks(3000, raw=1.0).end == "HDA_LATCHED"
    assert arm.recover() == "HDA_FINE"
    assert arm.tick().end == "HDA_FINE"


REFUSALS: dict[str, dict[str, Any]] = {
    "HDA_RECOVER_TIME": {"now": NAN},
    "HDA_RECOVER_FINITE": {"motor_torque": {0: NAN}},
    "HDA_RECOVER_STALE": {"after": 0.0},
    "HDA_RECOVER_JUMP": {"motor_position": {1: 0.7}},
}


@pytest.mark.parametrize("name", REFUSALS)
def test_recover_refuses_what_is_not_a_fresh_valid_measurement(library: Library, name: str) -> None:
    arm = settled(library.arm(safe=HOLD))
    assert arm.recover(**REFUSALS[name]) == name
    arm.measure(motor_torque=0.0, motor_position=0.0)
    assert arm.tick().end == "HDA_LATCHED"
    assert arm.recover() == "HDA_FINE"


def test_recover_refuses_before_its_time(library: Library) -> None:
    arm = library.arm(safe=HOLD)
    assert arm.recover() == "HDA_RECOVER_NOTHING"
    arm.ticks(10, raw=1.0)
    arm.fail()
    assert arm.recover() == "HDA_RECOVER_UNREAD"
    arm.read()
    assert arm.recover() == "HDA_RECOVER_EARLY"
    arm.ticks(bound(arm) - 2)
    assert arm.recover() == "HDA_RECOVER_EARLY"
    arm.tick()
    assert arm.recover(now=arm.now - 1e-6) == "HDA_RECOVER_TIME"
    assert arm.recover(now=arm.now + 3e-3) == "HDA_RECOVER_TIME", "the ticks have stopped"
    assert NAME[library.c.hda_guard_recover(ct.byref(arm.guard), arm.now, None)] == "HDA_RECOVER_CALL"
    arm.begin()
    assert arm.recover() == "HDA_RECOVER_OPEN"
    arm.end()
    assert arm.recover() == "HDA_FINE"


def test_recover_makes_no_jump_in_torque(library: Library) -> None:
    arm = settled(library.arm(safe=DAMPING), motor_velocity=-20.0)
    held = arm.tick().torque
    assert np.allclose(held, 0.2)
    assert arm.recover() == "HDA_FINE"
    tick = arm.tick(raw=-1.0)
    assert tick.end == "HDA_TORQUE_LIMITED" and np.allclose(tick.torque, held - STEP, rtol=1e-12)


def test_recover_after_a_jump_takes_the_new_place_once_it_stands(library: Library) -> None:
    arm = settled(library.arm(safe=HOLD))
    arm.tick(motor_position=6.28)
    assert arm.read()[0] == "HDA_FAULT_MOTOR_JUMP"
    arm.ticks(5)
    assert arm.recover() == "HDA_FINE"
    assert arm.tick().end == "HDA_FINE"
    arm.fail()
    assert np.allclose(arm.ticks(100, motor_position=6.38).torque, -0.2), "and holds it: the position is trusted again"


def test_recover_counts_no_call_shorter_than_a_tick(library: Library) -> None:
    arm = library.arm()
    arm.ticks(20, raw=1.0)
    for k in range(2 * bound(arm)):
        arm.watchdog(arm.now + 5.1e-3 + k * 1e-5)
    arm.read()
    assert arm.recover() == "HDA_RECOVER_EARLY"


def test_a_refused_tick_does_not_read_the_controllers_torque(library: Library) -> None:
    arm = settled(library.arm())
    assert arm.tick(raw=None).end == arm.tick(raw=NAN).end == "HDA_LATCHED"
    assert arm.read()[0] == "HDA_FINE"


# The watchdog.


def test_the_watchdog_leaves_a_running_loop_alone(library: Library) -> None:
    arm = library.arm(safe=HOLD)
    assert arm.watchdog(1e9)[0] == "HDA_FINE", "no tick yet: nothing to watch, zero torque"
    arm.ticks(20, raw=0.1)
    for late in (0.0, 1e-3, 4.9e-3):
        name, torque = arm.watchdog(arm.now + late)
        assert name == "HDA_FINE" and (torque == 0.1).all()
    assert arm.tick(raw=0.1).end == "HDA_FINE"


@pytest.mark.parametrize("period", [1e-3, 0.25e-3, 7e-3])
def test_the_watchdog_ramps_to_zero_and_latches(library: Library, period: float) -> None:
    arm = library.arm(safe=HOLD, motor_jump=UNLIMITED)
    arm.ticks(20, raw=1.0, motor_position=0.1, motor_velocity=-5.0)
    now, before, took = arm.now + 5.1e-3, np.array(arm.guard.sent), 0
    while before.any():
        name, torque = arm.watchdog(now)
        allowed = STEP if not took else STEP * min(1.0, period / 1e-3)
        assert name == "HDA_FAULT_WATCHDOG" and (abs(torque - before) <= allowed + 1e-15).all()
        assert (torque < before).all(), "each call falls"
        now, before, took = now + period, torque, took + 1
        assert took <= bound(arm) * max(1.0, 0.5e-3 / period)
    arm.now = now
    assert arm.tick(raw=1.0, motor_position=0.1).end == "HDA_FAULT_WATCHDOG", "the loop that comes back is refused"
    name, fault = arm.read()
    assert name == "HDA_FAULT_WATCHDOG" and math.isclose(fault.now, 100.02 + 5.1e-3)
    assert fault.measurement.motor_position[0] == 0.1


@pytest.mark.parametrize("now, name", [(NAN, "TIME_FINITE"), (-INF, "TIME_FINITE"), (1.0, "TIME_BACKWARD")])
def test_a_watchdog_without_a_clock_heads_to_safe(library: Library, now: float, name: str) -> None:
    arm = library.arm()
    arm.ticks(20, raw=1.0)
    status, torque = arm.watchdog(now)
    assert status == f"HDA_FAULT_{name}" and np.allclose(torque, LIMIT - STEP / 2)


def test_a_tick_without_a_clock_does_not_blind_the_watchdog(library: Library) -> None:
    arm = library.arm()
    arm.ticks(20, raw=1.0)
    before = arm.tick(now=NAN).torque
    assert (arm.watchdog(arm.now + 6e-3)[1] < before).all()


def test_a_watchdog_amid_a_tick_wins_and_the_rate_still_holds(library: Library) -> None:
    arm = library.arm()
    arm.ticks(20, raw=1.0)
    assert arm.begin() == "HDA_FINE"
    _, torque = arm.watchdog(arm.now + 6e-3)
    assert np.allclose(torque, LIMIT - STEP)
    status, again = arm.end(1.0)
    assert status == "HDA_FAULT_WATCHDOG" and np.array_equal(again, torque), "the late controller's torque is not sent"


# The configuration.

PER_JOINT = {
    "torque_limit": "TORQUE_LIMIT",
    "torque_rate": "TORQUE_RATE",
    "motor_jump": "JUMP",
    "joint_jump": "JUMP",
    "safe_damping": "DAMPING",
    "safe_stiffness": "STIFFNESS",
}
SCALARS = {
    "period": "PERIOD",
    "period_min": "PERIOD",
    "period_max": "PERIOD",
    "watchdog": "WATCHDOG",
    "force_limit": "FORCE_LIMIT",
}
BAD_LIMITS = [NAN, -NAN, INF, -INF, -1.0, 0.0, -0.0, 5e-324, 1e101]


@pytest.mark.parametrize("value", BAD_LIMITS)
def test_a_bad_limit_is_refused_by_its_own_code_and_the_old_configuration_stays(library: Library, value: float) -> None:
    arm = library.arm(safe=HOLD)
    arm.ticks(5, raw=0.1)
    before = bytes(arm.guard)
    for name, code in SCALARS.items():
        assert arm.configure(safe=HOLD, **{name: value}) == CODE[f"HDA_CONFIG_{code}"], name
    for name, code in PER_JOINT.items():
        for j in range(library.n):
            values = np.where(np.arange(library.n) == j, value, 0.5)
            assert arm.configure(safe=HOLD, **{name: values}) == CODE[f"HDA_CONFIG_{code}"], (name, j)
    assert bytes(arm.guard) == before, "a refused update leaves every bit in place"
    assert arm.tick(raw=0.1).end == "HDA_FINE"


@pytest.mark.parametrize(
    "changes, code",
    [
        ({"version": VERSION + 1}, "VERSION"),
        ({"version": 0}, "VERSION"),
        ({"size": 0}, "SIZE"),
        ({"joints": 3}, "SIZE"),
        ({"period_min": 1.5e-3}, "PERIOD"),
        ({"period_max": 0.9e-3}, "PERIOD"),
        ({"watchdog": 1.9e-3}, "WATCHDOG"),
        ({"stale_stamp_ticks": 0}, "STALE"),
        ({"stale_bits_ticks": -5}, "STALE"),
        ({"torque_rate": 0.9 * LIMIT / (TICKS_MAX * 0.5e-3)}, "SLOW"),
        ({"torque_rate": 1e-90, "torque_limit": 1e90}, "SLOW"),
        ({"torque_limit": 0.05}, "SENT"),
    ],
)
def test_a_configuration_that_contradicts_is_refused(library: Library, changes: dict[str, Any], code: str) -> None:
    arm = library.arm()
    arm.ticks(5, raw=0.1)
    before = bytes(arm.guard)
    assert NAME[arm.configure(**changes)] == f"HDA_CONFIG_{code}"
    assert bytes(arm.guard) == before


def test_the_gains_of_a_safe_state_that_is_not_chosen_are_not_asked_for(library: Library) -> None:
    assert Arm(library).configure(safe=ZERO, safe_damping=NAN, safe_stiffness=NAN) == 0
    assert Arm(library).configure(safe=DAMPING, safe_stiffness=NAN) == 0


def test_an_accepted_update_keeps_the_state(library: Library) -> None:
    arm = library.arm()
    arm.ticks(5, raw=0.1)
    assert arm.configure(torque_limit=0.2, torque_rate=10.0) == CODE["HDA_FINE"]
    assert np.allclose(arm.tick(raw=1.0).torque, 0.11), "from the torque sent, at the new rate"


def test_the_first_configuration_clears_the_context(library: Library) -> None:
    arm = Arm(library)
    arm.guard.sent[0], arm.guard.latched, arm.guard.level = 9.0, 1, HOLD
    assert arm.configure() == CODE["HDA_FINE"]
    assert arm.tick(raw=0.001).end == "HDA_FINE"


def test_a_context_that_is_not_a_guard_is_refused(library: Library) -> None:
    assert library.c.hda_guard_configure(None, ct.byref(library.config())) == CODE["HDA_CONFIG_CALL"]
    assert library.c.hda_guard_configure(ct.byref(library.Guard()), None) == CODE["HDA_CONFIG_CALL"]
    arm = Arm(library)
    ct.memset(ct.byref(arm.guard), 0xA5, ct.sizeof(arm.guard))
    assert arm.configure() == CODE["HDA_CONFIG_CONTEXT"]
    tick = arm.tick(raw=1.0)
    assert (tick.begin, tick.end) == ("HDA_FAULT_CONTEXT",) * 2 and (tick.torque == 0.0).all()
    assert arm.watchdog(1.0)[0] == arm.read()[0] == arm.recover() == "HDA_FAULT_CONTEXT"


def test_null_pointers_are_faults_not_crashes(library: Library) -> None:
    arm, c = library.arm(), library.c
    arm.ticks(12, raw=1.0)
    assert NAME[c.hda_guard_begin(ct.byref(arm.guard), arm.now + 1e-3, None, None, 0)] == "HDA_FAULT_CALL"
    assert (arm.end(None)[1] < LIMIT).all()
    arm = library.arm()
    arm.begin()
    assert NAME[c.hda_guard_end(ct.byref(arm.guard), doubles(np.zeros(library.n)), None, None)] == "HDA_FAULT_CALL"
    arm = library.arm()
    arm.tick()
    assert NAME[c.hda_guard_watchdog(ct.byref(arm.guard), arm.now, None)] == "HDA_FAULT_CALL"
    arm = library.arm()
    assert arm.begin(reference=None, count=1) == "HDA_FAULT_CALL"
    assert arm.end(None)[0] == "HDA_FAULT_CALL"
    for call in (c.hda_guard_end(None, None, None, None), c.hda_guard_watchdog(None, 0.0, None)):
        assert NAME[call] == "HDA_FAULT_CONTEXT"


OVERWRITTEN = [("sent", NAN), ("sent", 1e9), ("torque_limit", NAN), ("torque_limit", INF), ("torque_rate", NAN)]


@pytest.mark.parametrize("field, value", OVERWRITTEN)
def test_the_last_assertion_sends_zero_when_memory_was_overwritten(library: Library, field: str, value: float) -> None:
    arm = library.arm()
    arm.ticks(12, raw=1.0)
    getattr(arm.guard if field == "sent" else arm.guard.config, field)[library.n - 1] = value
    tick = arm.tick(raw=1.0)
    assert tick.end == "HDA_FAULT_ASSERTION" and (tick.torque == 0.0).all()
