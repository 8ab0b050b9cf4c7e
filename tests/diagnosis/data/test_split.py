"""What is held out: how much, where, and that a fit knows nothing of it."""

from pathlib import Path

import numpy as np
import pytest
from replayed import ONE, simulated

from hdagen.arm.compiled_arm import load
from hdagen.diagnosis.data.data_settings import DATA
from hdagen.diagnosis.data.split import LogPortion, mark_holdout_blocks, split_in_halves, split_logs
from hdagen.diagnosis.data.windows import cut_windows
from hdagen.diagnosis.inference.linearization import compute_sensitivities
from hdagen.diagnosis.inference.multiple_shooting import MultipleShooting
from hdagen.diagnosis.inference.sensitivities import OperatingPoint
from hdagen.diagnosis.initialization.candidate_list import build_candidates
from hdagen.diagnosis.initialization.initial_guess import guess_from_log
from hdagen.log.measured_log import Log

REACH = 0.03  # s


@pytest.mark.parametrize("length", [1.0, 10.0, 61.0])
def test_a_fifth_is_held_out_a_block_in_each_span(length: float) -> None:
    time = 3.0 + np.arange(0.0, length, 1e-3)
    held = mark_holdout_blocks(time)
    assert held.mean() == pytest.approx(DATA.holdout_share, abs=0.01)
    count = max(DATA.fewest_holdout_spans, round(length / DATA.holdout_span))
    found = LogPortion(Log(time, {"motor_position_1": time}, 1, "made"), held).spans
    assert len(found) == count
    span = (time[-1] - time[0]) / count
    for k, (begin, end) in enumerate(found):
        assert time[0] + k * span <= begin < end <= time[0] + (k + 1) * span + 1e-9


def test_a_motion_that_repeats_is_seen_in_every_phase() -> None:
    time = np.arange(0.0, 60.0, 1e-3)
    for period in (0.5, 1.0, 2.5, 5.0, 10.0):
        phase = np.floor(time / period % 1.0 * 20)
        seen = [float(np.mean(~mark_holdout_blocks(time)[phase == k])) for k in range(20)]
        assert min(seen) > 0.5


def test_logs_are_parted_each_by_itself_and_a_hold_out_is_held_out_whole() -> None:
    logs = [simulated(load("paper"), length, seed=k) for k, length in enumerate((3.0, 1.5))]
    shown, held = split_logs(logs, [])
    assert (shown.rows ^ held.rows).all() and shown.log is held.log
    assert held.rows[: len(logs[0])].tolist() == mark_holdout_blocks(logs[0].time).tolist()
    shown, held = split_logs(logs[:1], logs[1:])
    assert shown.rows.all() and held.rows.all() and held.log is logs[1]


@pytest.mark.parametrize("seconds", [0.9, 2.0, 7.5])
def test_what_decides_is_not_what_is_reported(seconds: float) -> None:
    log = Log(np.arange(0.0, seconds, 1e-3) + 3.0, {}, 1, "test")
    fresh = log.time > 3.1
    judged, reported = split_in_halves(LogPortion(log, fresh))
    if seconds < 1.0:
        assert (judged.rows == fresh).all() and (reported.rows == fresh).all()
        return
    assert not (judged.rows & reported.rows).any() and ((judged.rows | reported.rows) == fresh).all()
    assert all(end - begin < 1.0 for one in (judged, reported) for begin, end in one.spans)


def test_what_is_held_out_is_unknown_to_the_fit(tmp_path: Path) -> None:
    (tmp_path / "one.toml").write_text(ONE)
    plain, arm = load(tmp_path / "one.toml"), load(tmp_path / "one.toml", "native", ("all",))
    log = simulated(plain, 4.0, seed=3)
    shown, held = split_logs([log], [])
    deep = held.rows.copy()  # hidden, and further from what is shown than a smoothing reaches
    for begin, end in held.spans:
        deep &= ~((log.time >= begin) & (log.time < begin + REACH)) & ~((log.time > end - REACH) & (log.time <= end))
    assert 0.5 * held.rows.sum() < deep.sum()
    rng = np.random.default_rng(4)
    wrong = {k: v + deep * rng.normal(0.0, 1e-3, len(v)) for k, v in log.columns.items() if "position" in k}
    other = Log(log.time, dict(log.columns) | wrong, log.n_joints, log.source)
    assert set(wrong) == {"motor_position_1", "joint_position_1"}
    found = [cut_windows(arm, LogPortion(each, shown.rows), 0.05) for each in (log, other)]
    suggestions = [guess_from_log(arm, one) for one in found]
    assert suggestions[0] == suggestions[1]
    words = build_candidates(arm, suggestions[0]).always_fitted
    lines = [
        compute_sensitivities(
            MultipleShooting(arm, one),
            words,
            OperatingPoint(arm.p, MultipleShooting(arm, one).measured_initial_states(arm.p)),
        )
        for one in found
    ]
    assert (found[0].noise == found[1].noise).all() and len(found[0].selected_windows) < len(found[0].starts)
    assert (lines[0].residual == lines[1].residual).all() and (lines[0].columns == lines[1].columns).all()
