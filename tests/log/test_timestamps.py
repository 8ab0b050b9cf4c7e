"""The clock of a log is judged by its encoders: the better one is used, and what it leaves uncertain is noise."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from replayed import FLEXIBLE, simulated

from hdagen.arm.compiled_arm import Arm
from hdagen.data_quality.log_triage import triage
from hdagen.diagnosis.data.split import LogPortion
from hdagen.diagnosis.data.windows import cut_windows
from hdagen.log import measured_log as logs
from hdagen.log.data_table import LogError
from hdagen.log.measured_log import Log
from hdagen.log.timestamps import Clock, compute_timing_noise, fit_even_instants, judge_clock, spread_repeated_stamps
from hdagen.prediction.measurement_model import Readings
from hdagen.prediction.window_replay import replay

SECONDS = 8.0
RESOLUTIONS = {"motor_position_1": 1.5e-3, "joint_position_1": 6e-6}  # rad
RATIO = 100.0


def paths(time: np.ndarray) -> dict[str, np.ndarray]:
    """What both encoders of a joint read at ``time`` (T,), s."""
    angle = 0.6 * np.sin(2 * np.pi * 0.7 * time) + 0.2 * np.sin(2 * np.pi * 2.3 * time)
    turned = {"motor_position_1": RATIO * angle, "joint_position_1": angle}
    return {name: np.round(values / RESOLUTIONS[name]) * RESOLUTIONS[name] for name, values in turned.items()}


def rows(period: float, lost: float = 0.0) -> np.ndarray:
    """When rows were sampled, a share of them ``lost``."""
    number = np.arange(round(SECONDS / period))
    rng = np.random.default_rng(3)
    return np.sort(rng.choice(number, round(len(number) * (1 - lost)), replace=False)) * period


def off(clock: Clock, true: np.ndarray) -> float:
    """Standard deviation of a clock's error, s, but for its rate, which the stamps say to a few parts in a million."""
    return float(np.std(clock.time - np.polyval(np.polyfit(true, clock.time, 1), true)))


@pytest.mark.parametrize("lost", [0.0, 0.002])
@pytest.mark.parametrize(("period", "jitter"), [(1e-3, 2e-5), (1e-3, 2e-4), (2e-3, 3e-4), (1e-2, 1e-3)])
def test_stamps_that_jitter_about_an_even_period_are_left(period: float, jitter: float, lost: float) -> None:
    true = rows(period, lost)
    stamps = np.sort(true + jitter * np.random.default_rng(1).standard_normal(len(true)))
    clock = judge_clock(stamps, paths(true))
    assert off(clock, true) < 0.1 * jitter
    assert f"about an even period of {1e3 * period:.4g} ms" in clock.note and "which is taken" in clock.note


def test_jitter_as_large_as_the_period_is_left() -> None:
    true = rows(1e-3)
    stamps = np.sort(true + 1e-3 * np.random.default_rng(1).standard_normal(len(true)))
    assert off(judge_clock(stamps, paths(true)), true) < 5e-5


@pytest.mark.parametrize("lost", [0.0, 0.002])
def test_an_even_clock_stays_to_the_last_bit(lost: float) -> None:
    true = rows(1e-3, lost)
    clock = judge_clock(true, paths(true))
    assert clock.time is true and clock.uncertainty == 0.0 and not clock.note


def test_rows_that_are_uneven_stay_where_they_are_stamped() -> None:
    true = rows(1e-3)
    true = true + np.random.default_rng(2).uniform(-3e-4, 3e-4, len(true))
    clock = judge_clock(true, paths(true))
    assert clock.time is true and clock.uncertainty == 0.0


@pytest.mark.parametrize("period", [1e-3, 1e-2])
def test_what_no_clock_mends_is_known_as_noise(period: float) -> None:
    rng = np.random.default_rng(2)
    true = rows(period)
    true = true + rng.uniform(-0.3, 0.3, len(true)) * period
    clock = judge_clock(true + 5e-5 * rng.standard_normal(len(true)), paths(true))
    assert clock.uncertainty == pytest.approx(5e-5, rel=0.1)
    assert "which counts as noise" in clock.note


def test_where_nothing_moves_the_stamps_alone_tell() -> None:
    rng = np.random.default_rng(1)
    true = rows(1e-3)
    stamps = true + 2e-5 * rng.standard_normal(len(true))
    still = {"joint_position_1": np.zeros(len(true)), "joint_position_2": np.full(len(true), np.nan)}
    for positions in (still, {}):
        clock = judge_clock(stamps, positions)
        assert off(clock, true) < 1e-6 and "nothing moves by which to judge" in clock.note
    late = np.cumsum(rng.uniform(0.5e-3, 1.5e-3, len(true)))  # a row that is late makes all that follow late
    rounded = np.round(true, 6)
    assert judge_clock(late, still).time is late and judge_clock(rounded, still).time is rounded


def test_nonsense_in_an_encoder_is_no_clocks() -> None:
    true = rows(1e-3)
    for share in (0.1, 0.5, 0.9, 1.0):
        spoilt = paths(true)
        first = round(len(true) * (1 - share))
        for values in spoilt.values():
            values[first:] = np.std(values) * np.random.default_rng(0).standard_normal(len(values) - first)
        clock = judge_clock(true, spoilt)
        assert clock.time is true and clock.uncertainty == 0.0


@pytest.mark.parametrize(("period", "coarse"), [(1.5e-3, 1e-3), (1e-3, 2e-3), (2e-3, 1e-2), (1e-3, 1e-2)])
def test_stamps_of_a_coarse_clock_are_spread_over_the_whole(period: float, coarse: float) -> None:
    true = rows(period)
    stamps = np.floor(true / coarse + 1e-9) * coarse
    repeats = np.any(np.diff(stamps) == 0)
    assert repeats == (coarse > period)
    clock = spread_repeated_stamps(stamps) if repeats else judge_clock(stamps, paths(true))
    assert clock is not None
    assert off(clock, true) < 1e-5


def test_rows_written_twice_are_no_coarse_clock() -> None:
    true = rows(1e-3)
    twice = np.random.default_rng(1).random(len(true)) < 0.15
    assert spread_repeated_stamps(np.sort(np.append(true, true[twice]))) is None
    assert spread_repeated_stamps(np.sort(np.append(true, true[5:8]))) is None


def test_missing_rows_are_left_out_of_even_time() -> None:
    true = rows(2e-3, 0.01)
    stamps = true + 1e-4 * np.random.default_rng(1).standard_normal(len(true))
    assert np.diff(fit_even_instants(stamps)) == pytest.approx(np.diff(true), abs=1e-6)


def written(folder: Path, log: Log, stamps: np.ndarray) -> Path:
    path = folder / "log.parquet"
    logs.write({"time": stamps, **log.columns}, path)
    return path


def test_a_replay_uses_the_better_clock_and_writes_the_logs_own(build: Callable, tmp_path: Path) -> None:
    arm = Arm(build(FLEXIBLE).folder)
    log = simulated(arm, 3.0)
    stamps = log.time + 3e-5 * np.random.default_rng(1).standard_normal(len(log))
    read = logs.read(written(tmp_path, log, stamps))
    assert read.stamps is not None and read.period == pytest.approx(1e-3, rel=1e-5)
    assert np.array_equal(read.logged_time, stamps)
    assert any("is taken" in note for note in read.notes)
    found = replay(arm, read)
    assert np.array_equal(found.columns["time"], stamps)
    assert found.gap < 1.1 * replay(arm, log).gap
    assert found.gap < 0.7 * replay(arm, Log(stamps, log.columns, 2, "as stamped")).gap
    seen = triage(read, [100.0, 100.0])
    assert seen.is_even and seen.jitter > 3e-5
    again = tmp_path / "again.csv"
    logs.write(read, again)
    assert np.array_equal(logs.read(again).logged_time, stamps)
    part = read.rows(100, 200)
    assert part.stamps is not None and np.array_equal(part.stamps, stamps[100:200])


def test_a_log_of_coarse_stamps_is_read(build: Callable, tmp_path: Path) -> None:
    arm = Arm(build(FLEXIBLE).folder)
    log = simulated(arm, 3.0)
    stamps = np.floor(log.time / 1e-2 + 1e-9) * 1e-2
    read = logs.read(written(tmp_path, log, stamps))
    assert read.period == pytest.approx(1e-3, rel=1e-3)
    assert any("steps of 10 ms and repeat: rows are taken as 1 ms apart" in note for note in read.notes)
    assert np.array_equal(replay(arm, read).columns["time"], stamps)
    few = log.rows(0, 12)
    with pytest.raises(LogError, match="give the period"):
        logs.read(written(tmp_path, few, stamps[:12]))


def test_an_uncertain_clock_weighs_fast_motion_less(build: Callable) -> None:
    arm = Arm(build(FLEXIBLE).folder)
    log = simulated(arm, 1.2)
    off_by = 1e-4
    known, vague = log, Log(log.time, log.columns, 2, "vague", time_uncertainty=off_by)
    seen = [cut_windows(arm, LogPortion.all_rows(one), 0.05) for one in (known, vague)]
    place = seen[0].names.index("joint_position_1")
    speed = np.abs(np.gradient(log["joint_position_1"], log.time))
    assert compute_timing_noise(log.time, log["joint_position_1"], off_by) == pytest.approx(off_by * speed)
    grown = seen[1].sample_noise[:, place] ** 2 - seen[0].sample_noise[:, place] ** 2
    shown = seen[0].rows[np.concatenate(seen[0].sampled_rows)]
    assert grown == pytest.approx((off_by * speed[shown]) ** 2, rel=1e-6, abs=1e-18)
    mean = np.sqrt(np.mean(speed**2)) * off_by
    assert seen[1].noise[place] == pytest.approx(np.hypot(seen[0].noise[place], mean))
    assert replay(arm, vague).noise["joint_position_1"] == pytest.approx(seen[1].noise[place])
    before = [Readings.from_log(arm, one).noise_before(600) for one in (known, vague)]
    own = Readings.from_log(arm, log).names.index("joint_position_1")
    assert before[1][own] > 2 * before[0][own]
