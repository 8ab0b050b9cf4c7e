"""No log is judged by its own rows: what a hold-out shares with the log, however it was cut, is left out, and where
nothing else is there it is refused; another recording of the same motion is not."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from time import perf_counter

import numpy as np
import pytest
from damage import changed, dropped, kept, times, without, wrapped
from replayed import JOINT, MOTOR, NOISE, simulated

from hdagen.arm.compiled_arm import Arm
from hdagen.data_quality.log_preparation import prepare_logs
from hdagen.data_quality.shared_motion import find_shared_motion
from hdagen.diagnosis.data.split import split_logs
from hdagen.log.channel_statistics import compute_channel_statistics
from hdagen.log.data_table import LogError
from hdagen.log.measured_log import Log, read

# a log that is no other recording: how it is made of the log
SHARED: dict[str, Callable[[Log], Log]] = {
    "the log itself": lambda log: log,
    "its end": lambda log: log.rows(1800, len(log)),
    "its end, timed anew": lambda log: Log(log.time[:1200], log.rows(1800, 3000).columns, 2, "simulated"),
    "every second row": lambda log: kept(log, np.arange(len(log)) % 2 == 0),
    "every third row of its end": lambda log: kept(
        log, np.arange(len(log)) % 3 + 3 * (np.arange(len(log)) < 1200) == 1
    ),
    "rows lost": dropped(0.05),
    "another current": lambda log: changed(log, motor_current_1=log["motor_current_1"] + 1e-6),
    "a column less": lambda log: without(log, "motor_current"),
    "an encoder less": lambda log: without(log, "motor_position"),
    "in milliamperes": times(
        1e3, *(f"{base}_{j}" for base in ("motor_current", "motor_current_command") for j in (1, 2))
    ),
    "in degrees": times(180 / math.pi, "motor_position_1", "joint_position_1"),
    "wrapped, its end": lambda log: wrapped("motor_position_1")(log.rows(1800, len(log))),
    "in single precision": lambda log: changed(
        log, **{n: v.astype(np.float32).astype(float) for n, v in log.columns.items()}
    ),
}


@pytest.mark.parametrize("what", SHARED)
def test_a_hold_out_whose_rows_are_the_logs_is_refused(what: str, good: Log, arm: Arm) -> None:
    with pytest.raises(LogError, match="the hold-out is the log itself or a part of it") as raised:
        prepare_logs(arm, [good], [SHARED[what](good)])
    assert len(raised.value.problems) == 1 and raised.value.problems[0].endswith("give another motion.")


@pytest.mark.parametrize("what", SHARED)
def test_of_a_hold_out_that_holds_the_log_what_is_more_is_left(what: str, good: Log, arm: Arm) -> None:
    log = SHARED[what](good)
    if "its end" not in what:
        with pytest.raises(LogError, match="the hold-out is the log itself or a part of it"):
            prepare_logs(arm, [log], [good])
        return
    _, (held,), (all_, fresh), data = prepare_logs(arm, [log], [good])
    (said,) = (one for one in data["repaired"] if one["name"] == "shared")
    end = 1200 if "third" in what else 1800
    assert all_.all() and fresh[: end - 20].all() and not fresh[end + 4 : -4].any()
    assert "are the same motion, from 1." in said["what"] and len(held) == len(good)
    shown, counted = split_logs([log], [held], [all_, fresh])
    assert shown.rows.all() and (counted.rows == fresh).all()


def test_rows_that_two_logs_share_are_left_out_and_the_rest_is_the_hold_out(arm: Arm) -> None:
    """Two recordings of a simulated machine that rests and starts from one posture alike: their beginning is one."""
    log, other = simulated(arm, 3.0, seed=1), simulated(arm, 3.0, seed=2)
    apart = np.clip((log.time - 0.18) / 0.5, 0.0, 1.0) ** 3
    steps = {"motor_position": MOTOR, "joint_position": JOINT}
    alike = {name: values + apart * (other[name] - values) for name, values in log.columns.items()}
    for name in (name for name in alike if "position" in name):
        step = steps[name[:-2]]
        alike[name] = np.round(alike[name] / step) * step
    both = Log(log.time, alike, 2, "held")
    for one, other in ((log, both), (kept(log, np.arange(len(log)) % 2 == 0), both)):
        _, _, (_, fresh), data = prepare_logs(arm, [one], [other])
        assert not fresh[2:170].any() and fresh[350:].all()
        assert [each["name"] for each in data["repaired"]] == ["shared"]
    _, _, (first, second), _ = prepare_logs(arm, [log, both], [])
    shown, counted = split_logs([log, both], [], [first, second])
    assert first.all() and not (shown.rows | counted.rows)[len(log) + 2 : len(log) + 170].any()  # they count once
    assert not (shown.rows & counted.rows).any()


def test_another_recording_of_the_same_motion_is_a_hold_out(good: Log, arm: Arm) -> None:
    """Between two recordings encoders differ by a count here and there, and not at all while the joints rest."""
    rng = np.random.default_rng(4)
    resting = np.repeat(np.arange(len(good)), np.where(np.arange(len(good)) == 0, 400, 1))[: len(good)]

    def rested(log: Log, shaken: float) -> Log:
        columns = {name: values[resting] for name, values in log.columns.items()}
        for name in (name for name in columns if "_position_" in name):
            step = MOTOR if "motor" in name else JOINT
            moved = columns[name] + shaken * step * rng.standard_normal(len(log)) * (np.diff(resting, prepend=0) != 0)
            columns[name] = np.round(moved / step) * step
        for name in ("motor_current_1", "motor_current_2"):
            columns[name] = columns[name] + NOISE * rng.standard_normal(len(log))
        return Log(log.time, columns, log.n_joints, log.source)

    prepare_logs(arm, [rested(good, 0.0)], [rested(good, 1.0)])
    with pytest.raises(LogError, match="the hold-out is the log itself"):
        prepare_logs(arm, [rested(good, 0.0)], [rested(good, 0.0)])


def test_a_joint_that_is_held_at_zero_hides_no_shared_recording(good: Log) -> None:
    held = changed(good, motor_position_2=np.zeros(len(good)), joint_position_2=np.zeros(len(good)))
    assert find_shared_motion(
        held, held.rows(1800, 3000), {"motor_position_1": MOTOR / 4, "joint_position_1": JOINT / 4}
    )


def test_no_made_log_is_taken_for_its_hold_out(data_dir: Path) -> None:
    paths = sorted((data_dir / "made").glob("*/case-*/log.parquet"))
    if not paths:
        pytest.skip("there are no made logs")
    for path in paths:
        log, held = (read(path.with_name(name), joints=2) for name in ("log.parquet", "hold_out.parquet"))
        noise = {
            channel.name: channel.noise
            for channel in map(compute_channel_statistics, log.columns, log.columns.values())
        }
        assert not find_shared_motion(log, held, noise), path
        assert find_shared_motion(log, log.rows(4000, len(log)), noise), path


def test_a_shared_recording_is_looked_for_quickly() -> None:
    """A minute of two joints at 1 kHz; in the worst case none is there and one joint rests."""
    time = np.arange(60_000) * 1e-3
    rng = np.random.default_rng(5)
    pair = []
    for _ in range(2):
        angle = np.sin(np.outer(time, [1.7, 2.3]) + rng.uniform(0, 6, 2))
        angle[:, 0] *= time > 30
        columns = {f"joint_position_{j}": np.round(angle[:, j - 1] / JOINT) * JOINT for j in (1, 2)}
        columns |= {f"motor_position_{j}": np.round(100 * angle[:, j - 1] / MOTOR) * MOTOR for j in (1, 2)}
        pair.append(Log(time, columns, 2, "made"))
    noise = dict.fromkeys(pair[0].columns, JOINT / 4)

    def looked() -> None:
        assert not find_shared_motion(pair[0], pair[1], noise)

    def described() -> None:
        for log in pair:
            for name, values in log.columns.items():
                compute_channel_statistics(name, values)

    assert lasts(looked) < 4 * lasts(described)


def lasts(work: Callable[[], None]) -> float:
    """The shortest of three runs, s."""
    found = []
    for _ in range(3):
        start = perf_counter()
        work()
        found.append(perf_counter() - start)
    return min(found)
