"""Logs of which a diagnosis cannot tell what is missing: it says so, with the reason and the motion that would tell."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from catalogue import EFFECTS
from replayed import FLEXIBLE, simulated
from test_result_shapes import CHANNEL, FRICTION, content

from hdagen.arm.compiled_arm import Arm
from hdagen.blind.realities.arm_reality import simulate_world
from hdagen.blind.realities.arm_world import ArmWorld
from hdagen.blind.realities.two_joint_arms import SCATTERED_PARAMETERS, TwoJointArm, draw_robots, draw_true_parameters
from hdagen.blind.realities.two_joint_motion import Motion, draw_rich_motion
from hdagen.data_quality.log_preparation import _find_still_joints
from hdagen.data_quality.log_repair import repair_log
from hdagen.diagnosis.data.split import LogPortion
from hdagen.diagnosis.holdout import contradicting_holdout
from hdagen.diagnosis.holdout.contradicting_holdout import find_contradiction
from hdagen.diagnosis.holdout.single_moments import find_single_moments
from hdagen.diagnosis.holdout.unseen_motion import HoldoutMotion
from hdagen.diagnosis.pipeline import diagnose
from hdagen.diagnosis.report.confounding import explain_confounding
from hdagen.diagnosis.report.sentences import say_contradiction, write_verdict
from hdagen.log.channel_statistics import compute_channel_statistics
from hdagen.log.data_table import LogError
from hdagen.log.measured_log import Log
from hdagen.prediction.window_replay import Replay

ROWS, WINDOW, SIZES = 8000, 250, np.array([1.0, 1.2])
NOISE = {f"{side}_position_{j}": 1e-3 for j in (1, 2) for side in ("motor", "joint")}
LOG = Log(1e-3 * np.arange(ROWS), {name: np.zeros(ROWS) for name in NOISE}, 2, "test")
FILE, WHOLE = "the robot file's model", "the model that tells the log"


def replay(first: float, second: float) -> Replay:
    """A replay whose joints err by these multiples of the noise, in the second half of the log by a little more."""
    each = SIZES[np.arange(ROWS) * len(SIZES) // ROWS]
    columns = {name: NOISE[name] * each * (first if name.endswith("1") else second) for name in NOISE}
    errors = {name: float(np.sqrt(np.mean(values**2))) for name, values in columns.items()}
    return Replay(columns, np.zeros((ROWS, 1)), errors, NOISE, {}, np.arange(0, ROWS, WINDOW), 0, ())


def contradicted(
    monkeypatch: pytest.MonkeyPatch,
    own: tuple[float, float] = (0.05, 0.05),
    other: tuple[float, float] = (1.0, 1.05),
    flexible: tuple[float, float] = (1.0, 1.0),
    before: float = 300.0,
) -> dict[str, Any] | None:
    """What is found where the model that tells the log leaves the share ``own`` of each joint's error on the log and
    ``other`` on the hold-out, of which a flexible correction leaves ``flexible``."""

    def left(shares: tuple[float, float]) -> Replay:
        return replay(*(before * share for share in shares))

    monkeypatch.setattr(contradicting_holdout, "build_fitted_arm", lambda _: WHOLE)
    robot: Any = FILE
    decision: Any = SimpleNamespace(verdict=(FRICTION,))
    hold_out = HoldoutMotion(
        LogPortion.all_rows(LOG), lambda _: left(other), left((1, 1)), left((1, 1)), left(flexible)
    )
    seen: Mapping[Any, Replay] = {FILE: left((1, 1)), WHOLE: left(own)}
    return find_contradiction(robot, decision, LogPortion.all_rows(LOG), seen.__getitem__, hold_out)


# -- a hold-out of another machine ------------------------------------------------------------------------------------


def test_a_hold_out_of_which_nothing_is_told_contradicts_a_log_that_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    found = contradicted(monkeypatch)
    assert found == {"verdict": [FRICTION], "closed": pytest.approx(0.95, abs=0.01), "left": pytest.approx(1.025, 0.01)}


@pytest.mark.parametrize(
    "spoken",
    [
        {"own": (0.5, 0.5)},  # something unknown may be in both
        {"other": (0.8, 1.0)},  # one joint is told better there
        {"flexible": (1.0, 0.8)},  # what the log shows comes back there, though no effect has its form
        {"before": 9.0},  # what is left there is near the noise
    ],
)
def test_what_speaks_for_the_same_machine_is_no_contradiction(
    spoken: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert contradicted(monkeypatch, **spoken) is None


@pytest.mark.parametrize("verdict", [[], [FRICTION]])
def test_a_contradiction_is_said_with_its_reason_and_what_would_tell(verdict: list[str]) -> None:
    why = {"verdict": verdict, "closed": 0.95, "left": 1.02}
    gap = {"before": 300.0, "after": 300.0, "floor": 1.0, "flexible": 300.0, "achievable": 300.0, "shrink": 0.0}
    shown = content([], [[FRICTION], []], contradicted=why, gap=gap | {"interval": None, "by_channel": CHANNEL})
    said = write_verdict(shown)
    assert said.startswith("What is missing cannot be told, as log and hold-out contradict each other.")
    assert say_contradiction(why) in said and "95 % of its own gap and leaves 102 % of the hold-out's" in said
    assert "do not seem to be of the same machine" in said and "hdagen excite" in said
    assert ("Coulomb friction on joint 1" in say_contradiction(why)) is bool(verdict)
    assert explain_confounding(EFFECTS, shown).startswith(
        "No effect is named; the log alone says: Coulomb friction on joint 1 (0.80)"
    )


# -- a joint that does not move, and none that does -------------------------------------------------------------------


def test_a_joint_is_still_where_no_encoder_of_any_log_moves() -> None:
    time = np.arange(2000) * 1e-3
    moves, rests = 0.3 * np.sin(2 * math.pi * time), 1e-4 * np.sin(2 * math.pi * time)

    def seen(**columns: np.ndarray) -> Any:
        return SimpleNamespace(channels=[compute_channel_statistics(name, values) for name, values in columns.items()])

    arm: Any = SimpleNamespace(n=2)
    first = seen(motor_position_1=moves, joint_position_1=rests, motor_position_2=rests, motor_current_2=moves)
    assert _find_still_joints(arm, [first]) == [2]
    assert _find_still_joints(arm, [first, seen(motor_position_1=rests, joint_position_2=moves)]) == []
    assert _find_still_joints(arm, [seen(motor_position_1=rests)]) == [1, 2]


def test_a_still_joint_is_said_with_the_motion_that_would_tell() -> None:
    moving = content([FRICTION], [[FRICTION]])
    assert "not move" not in write_verdict(moving | {"data": {"still": []}})
    said = write_verdict(moving | {"data": {"still": [2]}})
    assert "Joint 2 does not move in the log" in said and "hdagen excite robot.toml --joint 2" in said
    assert "Joints 1, 2 do not move" in write_verdict(moving | {"data": {"still": [1, 2]}})


def test_a_log_at_rest_is_refused_with_the_motion_that_would_tell(build: Callable) -> None:
    arm = Arm(build(FLEXIBLE).folder)
    log = simulated(arm)
    still = {
        name: values.mean() + 0.0 * values if "position" in name else values for name, values in log.columns.items()
    }
    with pytest.raises(LogError, match=r"no joint moves, so what is missing cannot be told.*as hdagen excite"):
        repair_log(Log(log.time, still, 2, "at rest"), arm)


# -- what acts once ---------------------------------------------------------------------------------------------------


def bursts(first: Mapping[int, float], left: float = 4.0) -> Replay:
    """A replay whose first joint errs by ``left`` times the noise, and by other multiples in some seconds."""
    found = replay(left, left)
    for name in ("motor_position_1", "joint_position_1"):
        for second, multiple in first.items():
            found.columns[name][1000 * second : 1000 * (second + 1)] = multiple * NOISE[name]
    return found


@pytest.mark.parametrize(
    ("left", "said"),
    [
        ({3: 200.0}, True),
        ({3: 200.0, 4: 150.0}, True),  # it goes on into the next second
        ({3: 200.0, 6: 150.0}, False),  # it comes again
        ({3: 200.0, 1: 800.0, 5: 400.0}, False),  # something is left everywhere
        ({3: 9.0}, False),  # it is near the noise
        ({}, False),
    ],
)
def test_what_is_left_at_one_moment_is_found(left: dict[int, float], said: bool) -> None:
    found = find_single_moments(bursts({3: 500.0}, 300.0), bursts(left, 1.0), LogPortion.all_rows(LOG), [LOG])
    assert bool(found) is said
    if said:
        assert found == [
            {"joint": 1, "log": "test", "span": [3.0, pytest.approx(3.999)], "noise": pytest.approx(200.0)}
        ]


def test_what_is_closed_there_is_not_left_and_one_encoder_is_not_enough() -> None:
    whole = LogPortion.all_rows(LOG)
    assert find_single_moments(bursts({3: 800.0}), bursts({3: 200.0}), whole, [LOG]) == []
    good = bursts({3: 200.0})
    good.columns["joint_position_1"][:] = 0.0
    assert find_single_moments(bursts({3: 500.0}), good, whole, [LOG]) == []


def test_the_log_of_a_moment_is_named_in_its_own_time() -> None:
    half = ROWS // 2
    logs = [replace(LOG.rows(0, half), source="one"), replace(LOG.rows(half, ROWS), source="two")]
    found = find_single_moments(bursts({5: 500.0}), bursts({5: 200.0}), LogPortion.all_rows(LOG), logs)
    assert [(one["log"], one["span"][0]) for one in found] == [("two", pytest.approx(logs[1].time[1000]))]


def test_a_moment_is_said_with_what_would_tell() -> None:
    once = [{"joint": 1, "log": "log.csv", "span": [0.0, 0.999], "noise": 300.0}]
    said = write_verdict(content([], [[], [FRICTION]], moments=once))
    assert "lies within one second (joint 1, 0 to 0.999 s of log.csv): what acts once cannot be told" in said
    assert "several times" in said


# -- the whole --------------------------------------------------------------------------------------------------------

ROBOT = draw_robots("bad input")[0]
RIPPLE = {"torque_ripple": {"order": 6.0, "torque": 0.01, "phase": 0.3, "second_order": 12.0, "second_torque": 0.003}}
RIPPLE["torque_ripple"]["second_phase"] = 1.0


def log(joints: Any, motion: Motion, noise: int, effects: Any = RIPPLE) -> Log:
    """What joints with these base parameters log, with ``effects`` at the first."""
    columns = simulate_world(ArmWorld(joints, (effects, {}), {}, ROBOT.gravity), ROBOT.joints, motion, noise)
    return Log(columns.pop("time"), columns, 2, "reality")


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    path = tmp_path / "robot.toml"
    path.write_text(ROBOT.toml())
    return path


def other_machine(robot: TwoJointArm) -> list[dict[str, float]]:
    """Of the same type, its parameters 15 to 20 % off."""
    rng = np.random.default_rng(3)
    off = [{key: rng.choice([-1, 1]) * rng.uniform(0.15, 0.2) for key in SCATTERED_PARAMETERS} for _ in robot.joints]
    return [
        {**one, **{k: one[k] * (1 + float(d)) for k, d in o.items()}} for one, o in zip(robot.joints, off, strict=True)
    ]


@pytest.mark.campaign
def test_a_hold_out_of_another_machine_of_the_type_is_no_judge(robot: Path) -> None:
    own = log(draw_true_parameters(ROBOT, 5), draw_rich_motion(1, 8.0), 1)
    other = log(other_machine(ROBOT), draw_rich_motion(2, 6.0), 2)
    said = diagnose(robot, [own], [other]).content
    assert said["verdict"] == [] and not said["sure"] and said["parameters"] == {}
    assert said["contradicted"]["verdict"] == ["torque_ripple@1"]
    assert say_contradiction(said["contradicted"]) in said["data"]["warnings"]


@pytest.mark.campaign
def test_a_joint_that_does_not_move_takes_nothing_from_the_other(robot: Path) -> None:
    motion = draw_rich_motion(1, 8.0)
    path, speed = motion.position * [1.0, 0.0], motion.velocity * [1.0, 0.0]
    own = log(draw_true_parameters(ROBOT, 5), Motion(motion.time, path, speed, 0.0 * motion.force), 1)
    said = diagnose(robot, [own]).content
    assert said["verdict"] == ["torque_ripple@1"] and said["data"]["still"] == [2]
    friction = {f"{name}_friction@2" for name in ("coulomb", "viscous", "stribeck", "asymmetric", "load_dependent")}
    assert friction <= set(said["undetectable"])
