"""Controllers: the run-time contract of every tick, through Python and through C, law by law."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from arms import SMALL
from compiled import Compiled
from guard_library import CODE

from gen.builder.gains_table import make_gains_table
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.control.guard_limits import Guard, Safe
from hdagen.control.guarded_controller import Controller

LAWS = ("position", "impedance_cartesian", "impedance_joint", "admittance_cartesian", "admittance_joint")
GUARD = Guard(Safe.ZERO)
MANUAL = (Path(__file__).parents[2] / "docs" / "guides" / "control.md").read_text(encoding="utf-8")
Q = np.array([0.6, 0.6])


@pytest.fixture(scope="module")
def arm(build: Callable[..., Compiled]) -> Arm:
    return Arm(build("paper").folder)


class Loop:
    """A controller whose ticks come in time, from an arm that rests at its reference, unless told."""

    def __init__(self, arm: Arm, law: str = "impedance_cartesian", guard: Guard = GUARD, **gains: float) -> None:
        self.controller = Controller(arm, law, guard, gains)
        tip = arm.evaluate("points", q=Q)["points"][-2:]
        names = self.controller.reference_names
        self.reference = np.zeros(len(names))
        self.reference[: len(names) // 3] = tip if names[0].startswith("tip") else Q
        self.measured: dict[str, Any] = {"motor_position": 100 * Q, "joint_position": Q, "tip_force": np.zeros(2)}
        self.now = 5.0

    def tick(self, reference: Any = None, stamp: float | None = None, after: float = 1e-3, **measured: Any) -> int:
        """The status of the next tick."""
        self.now += after
        wanted = self.reference if reference is None else reference
        return self.controller.tick(self.now, wanted, stamp, **{**self.measured, **measured})

    def ticks(self, count: int, **measured: Any) -> int:
        for _ in range(count):
            status = self.tick(**measured)
        return status

    def memory(self) -> bytes:
        """The law's memory within the context: what a refused tick must not move."""
        return self.controller._context.tobytes()


@pytest.fixture
def loop(arm: Arm) -> Loop:
    made = Loop(arm)
    assert made.ticks(5) == 0
    return made


# -- each line of the contract ----------------------------------------------------------------------------------------

CHANNELS = ("motor_position", "motor_velocity", "joint_position", "joint_velocity", "motor_torque", "tip_force")


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_every_measured_and_wanted_number_must_be_finite(arm: Arm, law: str, value: float) -> None:
    for channel in (*CHANNELS, "reference"):
        loop = Loop(arm, law)
        assert loop.tick() == 0
        good = loop.reference if channel == "reference" else getattr(loop.controller, channel)
        for k in range(len(good)):
            loop = Loop(arm, law)
            loop.ticks(2)
            bad: Any = np.array(good)
            bad[k] = value
            before = loop.controller.torque.copy()
            assert loop.tick(**{channel: bad}) == CODE["HDA_FAULT_INPUT_FINITE"], (channel, k)
            assert np.isfinite(loop.controller.torque).all()
            assert np.all(np.abs(loop.controller.torque - before) <= 50.0 * 1e-3 * (1 + 1e-12))
            fault = loop.controller.read_fault()
            assert fault is not None
            told = fault.reference if channel == "reference" else fault.measurement
            assert np.array_equal(told[~np.isfinite(told)], [value], equal_nan=True)


@pytest.mark.parametrize(
    "name, wrong",
    [
        ("HDA_FAULT_PERIOD_SHORT", {"after": 2e-4}),
        ("HDA_FAULT_PERIOD_LONG", {"after": 5e-3}),
        ("HDA_FAULT_TIME_BACKWARD", {"after": 0.0}),
        ("HDA_FAULT_TIME_BACKWARD", {"after": -1e-3}),
        ("HDA_FAULT_TIME_FINITE", {"after": np.nan}),
        ("HDA_FAULT_TIME_FINITE", {"stamp": np.inf}),
        ("HDA_FAULT_STAMP_BACKWARD", {"stamp": 1.0}),
        ("HDA_FAULT_MOTOR_JUMP", {"motor_position": 100 * Q + np.array([0.0, 2.0])}),
        ("HDA_FAULT_JOINT_JUMP", {"joint_position": Q + np.array([0.05, 0.0])}),
        ("HDA_FAULT_RESULT_FINITE", {"tip_force": [1e308, -1e308]}),
    ],
)
def test_what_comes_wrong_is_refused_and_kept(loop: Loop, name: str, wrong: dict[str, Any]) -> None:
    assert loop.tick(**wrong) == CODE[name]
    fault = loop.controller.read_fault()
    assert fault is not None and fault.status == CODE[name] and fault.sentence.endswith(".")
    for channel in set(wrong) & set(CHANNELS):
        place = 1 + 2 * CHANNELS.index(channel)
        assert np.array_equal(fault.measurement[place : place + 2], wrong[channel])
    assert loop.controller.read_fault() is None


def test_old_measurements_degrade_and_then_refuse(loop: Loop) -> None:
    stamp = loop.now
    seen = [loop.tick(stamp=stamp) for _ in range(5)]
    assert seen == [CODE["HDA_MEASUREMENT_REPEATED"]] * 4 + [CODE["HDA_FAULT_STALE_STAMP"]]


def test_the_first_fault_is_sticky_and_counts_the_others(loop: Loop) -> None:
    first = loop.tick(joint_position=[np.nan, 0.6])
    assert loop.tick(motor_position=[np.nan, 60.0]) == first
    assert loop.tick() == first, "a good tick does not forgive"
    fault = loop.controller.read_fault()
    assert fault is not None and fault.status == first and fault.later_faults >= 1
    assert np.isnan(fault.measurement[5]) and fault.measurement[1] == 60.0
    assert loop.tick() == CODE["HDA_LATCHED"]


def test_recover_is_explicit_needs_a_fresh_measurement_and_makes_no_jump(arm: Arm) -> None:
    loop = Loop(arm, "impedance_cartesian")
    controller, rest = loop.controller, loop.measured
    loop.ticks(50, tip_force=[8.0, 0.0])
    loop.tick(joint_position=[np.nan, 0.6])
    assert controller.recover(loop.now + 1e-4, **rest) == CODE["HDA_RECOVER_UNREAD"]
    controller.read_fault()
    assert controller.recover(loop.now + 1e-4, **rest) == CODE["HDA_RECOVER_EARLY"]
    loop.ticks(200)
    assert controller.recover(loop.now + 1e-4, stamp=loop.now, **rest) == CODE["HDA_RECOVER_STALE"]
    jumped = {**rest, "joint_position": Q + 0.1}
    assert controller.recover(loop.now + 1e-4, **jumped) == CODE["HDA_RECOVER_JUMP"]
    assert controller.recover(loop.now + 0.5, **rest) == CODE["HDA_RECOVER_TIME"]
    assert controller.recover(loop.now + 1e-4, **rest) == 0
    before = controller.torque.copy()
    assert loop.tick(tip_force=[30.0, 0.0]) > 0, "limited"
    assert np.abs(controller.torque - before).max() <= 50.0 * 1e-3 * (1 + 1e-12)


def test_the_laws_memory_restarts_only_by_recover(arm: Arm) -> None:
    """An admittance that was pushed aside forgets its way in recover, keeps it through good ticks and new gains."""
    loop = Loop(arm, "admittance_joint")
    loop.ticks(300, tip_force=[0.0, 3.0])
    yielded = loop.controller.torque.copy()
    loop.controller.configure(GUARD, {"stiffness_1": 31.0})
    loop.tick(tip_force=[0.0, 3.0])
    assert np.abs(loop.controller.torque - yielded).max() < 0.02, "new gains keep the memory"
    context = loop.controller._context.copy()
    with pytest.raises(PlantError):
        loop.controller.configure(GUARD, {"stiffness_1": -1.0})
    with pytest.raises(PlantError):
        loop.controller.configure(Guard(Safe.HOLD), {"stiffness_1": 35.0})
    assert np.array_equal(context, loop.controller._context)
    assert loop.controller.gains["stiffness_1"] == 31.0 and loop.controller.guard == GUARD
    loop.tick(joint_position=[np.nan, 0.6])
    with pytest.raises(PlantError, match="latched"):
        loop.controller.configure(GUARD, {})
    loop.controller.read_fault()
    loop.ticks(200)
    assert loop.controller.recover(loop.now + 1e-4, **loop.measured) == 0
    loop.ticks(3)
    assert np.abs(loop.controller.torque).max() < 0.05, "anew, at its reference, nothing is asked"


def test_the_watchdog_ramps_to_zero_when_ticks_stop(arm: Arm) -> None:
    loop = Loop(arm)
    loop.ticks(40, tip_force=[8.0, 0.0])
    sent = loop.controller.torque.copy()
    assert np.abs(sent).max() > 0.1
    assert loop.controller.watchdog(loop.now + 5e-3) == 0 and np.array_equal(loop.controller.torque, sent)
    late = loop.now + 0.03
    for k in range(60):
        before = loop.controller.torque.copy()
        assert loop.controller.watchdog(late + k * 1e-3) == CODE["HDA_FAULT_WATCHDOG"]
        assert np.abs(loop.controller.torque - before).max() <= 50.0 * 1e-3 * (1 + 1e-12)
    assert np.array_equal(loop.controller.torque, [0.0, 0.0])


def test_restart_begins_as_if_just_made(arm: Arm) -> None:
    loop, fresh = (
        Loop(arm, "admittance_cartesian", stiffness_x=700.0),
        Loop(arm, "admittance_cartesian", stiffness_x=700.0),
    )
    loop.ticks(20, tip_force=[5.0, 0.0])
    loop.tick(tip_force=[np.nan, 0.0])
    loop.controller.restart()
    assert np.array_equal(loop.controller._context, fresh.controller._context)
    assert loop.controller.read_fault() is None


def test_parameters_are_those_of_the_configuration(build: Callable[..., Compiled]) -> None:
    """A plant that changes afterwards does not change its controller, not by restart either."""
    plant = Arm(build("paper").folder)
    controller = Controller(plant, "position", GUARD)
    before = controller._context.copy()
    plant.parameters["mass_1"] *= 1.1
    controller.restart()
    assert np.array_equal(before, controller._context)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("q", [(0.0, 0.0), (0.3, np.pi), (1.0, -np.pi), (0.3, 1e-9)])
def test_singular_poses_stay_finite(arm: Arm, law: str, q: tuple[float, float]) -> None:
    loop = Loop(arm, law)
    loop.measured |= {"joint_position": np.array(q), "motor_position": 100 * np.array(q)}
    for _ in range(50):
        assert loop.tick(tip_force=[3.0, -2.0]) >= 0
        assert np.isfinite(loop.controller.torque).all()


# -- misuse from Python -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "guard, words",
    [
        (Guard("zero"), "safe is one of Safe.ZERO"),  # type: ignore[arg-type]
        (Guard(Safe.DAMPING), "safe_damping"),
        (Guard(Safe.HOLD, safe_damping=(1e-3, 1e-3)), "safe_stiffness"),
        (replace(GUARD, period=1.0), "gain period is 1.0 s; possible is 1e-05 to 0.1"),
        (replace(GUARD, period=np.nan), "gain period is nan"),
        (replace(GUARD, period_share=(2.0, 0.5)), "period_min <= period"),
        (replace(GUARD, period_share=(1.0,)), "period_share is two numbers"),  # type: ignore[arg-type]
        (replace(GUARD, watchdog=1e-4), "watchdog"),
        (replace(GUARD, force_limit=0.0), "force_limit"),
        (replace(GUARD, torque_limit=(0.3,)), "torque_limit takes 2 numbers"),
        (replace(GUARD, torque_limit=0.3), "torque_limit takes 2 numbers"),  # type: ignore[arg-type]
        (replace(GUARD, torque_rate=(1.0, np.nan)), "torque_rate takes 2 numbers"),
        (replace(GUARD, torque_rate=(1.0, -1.0)), "torque_rate"),
        (replace(GUARD, joint_jump=("a", "b")), "joint_jump takes 2 numbers"),  # type: ignore[arg-type]
        (replace(GUARD, stale_stamp_ticks=0), "stale_stamp_ticks is a whole number"),
        (replace(GUARD, stale_bits_ticks=2**40), "stale_bits_ticks is a whole number"),
    ],
)
def test_a_wrong_guard_is_one_sentence(arm: Arm, guard: Guard, words: str) -> None:
    with pytest.raises(PlantError, match=words) as caught:
        Controller(arm, "position", guard)
    assert len(str(caught.value).splitlines()) == 1


def test_wrong_gains_are_all_named_at_once(arm: Arm) -> None:
    with pytest.raises(PlantError) as caught:
        Controller(
            arm, "impedance_cartesian", GUARD, {"mass_x": 0.0, "damping_z": 1.0, "stiffness_y": np.nan, "period": 2e-3}
        )
    lines = str(caught.value).splitlines()
    assert len(lines) == 4
    for name in ("mass_x", "damping_z", "stiffness_y", "period"):
        assert sum(name in line.split(";")[0] for line in lines) == 1
    with pytest.raises(PlantError, match="no controller named pid; there are position"):
        Controller(arm, "pid", GUARD)
    with pytest.raises(PlantError, match="gain mass_x is heavy"):
        Controller(arm, "impedance_cartesian", GUARD, {"mass_x": "heavy"})  # type: ignore[dict-item]


def test_an_arm_that_states_no_limits_asks_for_them(build: Callable[..., Compiled]) -> None:
    with pytest.raises(PlantError) as caught:
        Controller(Arm(build(SMALL).folder), "position", GUARD)
    lines = str(caught.value).splitlines()
    assert [line.split(":")[0] for line in lines] == ["torque_limit", "torque_rate"]
    assert all("the robot file does not state it" in line and "in [joint.limits] of each" in line for line in lines)


@pytest.mark.parametrize(
    "measured, words",
    [
        ({"gains": [1.0]}, "no measured channel is named gains; there are motor_position"),
        ({"joint_position": [0.6]}, "joint_position takes 2 numbers"),
        ({"joint_position": "ab"}, "joint_position takes 2 numbers"),
        ({"reference": [0.2]}, "reference takes 6 numbers"),
    ],
)
def test_misuse_of_a_tick_raises_and_leaves_the_measurement(loop: Loop, measured: dict[str, Any], words: str) -> None:
    before = loop.controller.measurement.copy()
    with pytest.raises(PlantError, match=words):
        loop.tick(**{"tip_force": [9.0, 9.0], **measured} if "reference" not in measured else measured)
    if "reference" not in measured:
        assert np.array_equal(loop.controller.measurement, before)


# -- the manual ------------------------------------------------------------------------------------------------------


def block(kind: str) -> str:
    """The manual's code of that kind."""
    return MANUAL.split(f"```{kind}\n")[1].split("```")[0]


def test_the_manuals_gains_are_the_laws_own() -> None:
    found = MANUAL.split("<!-- gains: python -m gen.builder.gains_table -->\n")[1].split("<!-- end of gains -->")[0]
    assert found == make_gains_table(), (
        "put what `python -m gen.builder.gains_table` prints between the two markers of docs/guides/control.md"
    )


def test_the_manuals_python_runs(build: Callable[..., Compiled], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HDAGEN_BUILD", str(build("paper").folder.parent))
    names: dict[str, Any] = {}
    exec(compile(block("python"), "docs/guides/control.md", "exec"), names)
    assert names["status"] >= 0 and names["torque"].shape == (2,)


def test_the_manuals_c_compiles(arm: Arm, tmp_path: Path) -> None:
    (tmp_path / "manual.c").write_text(block("c"))
    strict = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", f"-I{arm.folder}", "-fsyntax-only"]
    done = subprocess.run(["gcc", *strict, str(tmp_path / "manual.c")], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
