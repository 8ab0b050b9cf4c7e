"""The rows that a gap is counted over, as diagnosis.json names them; a replay counted over them gives the same gap."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from replayed import FLEXIBLE, diagnosis, erring, simulated

from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm, load
from hdagen.cli import replay as replay_command
from hdagen.diagnosis.data.held_out_gap import choose_closest_replay, compute_gap_bounds, evaluate_gap
from hdagen.diagnosis.data.held_out_rows import count_rows, name_rows
from hdagen.diagnosis.data.split import LogPortion, split_logs
from hdagen.log.concatenation import concatenate_logs
from hdagen.log.data_table import LogError
from hdagen.log.measured_log import Log, read, write
from hdagen.prediction.window_replay import replay


@pytest.fixture(scope="module")
def logs() -> list[Log]:
    """Two logs of joint 1 alone, and a model that errs by more in some rows than in others."""
    rng = np.random.default_rng(1)
    names = ("motor_position_1", "joint_position_1", "motor_current_1")
    return [
        Log(5.0 + 1e-3 * np.arange(rows), {name: rng.normal(size=rows) for name in names}, 1, f"/somewhere/{k}.csv")
        for k, rows in enumerate((9000, 7000))
    ]


def content(told: dict[str, Any], rows: list[dict[str, Any]]) -> Any:
    """What a diagnosis.json holds of it, written and read."""
    return json.loads(json.dumps({"gap": told, "data": {"hold_out": rows}}))


def test_a_replay_counted_over_the_rows_that_are_named_has_the_gap_of_the_diagnosis(logs: list[Log]) -> None:
    log = logs[0]
    _, held = split_logs([log], [])
    before, after = erring(log, 9.0, 1), erring(log, 3.0, 2)
    held = held.without_windows((250 * int(np.flatnonzero(held.rows)[0] // 250),), before.starts)
    told = evaluate_gap(before, after, held)
    said = content(told, name_rows(held, [log]))
    (one,) = said["data"]["hold_out"]
    assert one["rows"] == held.rows.sum() and len(one["spans"]) == len(held.spans)
    for found, value in ((before, told["before"]), (after, told["after"])):
        assert count_rows(found, log, said, "d.json").gap == pytest.approx(value, rel=1e-9)
        assert found.gap != pytest.approx(value, rel=1e-6)  # the whole log has another
    moved = replace(log, source="elsewhere/0.csv")
    assert count_rows(after, moved, said, "d.json").gap == pytest.approx(told["after"], rel=1e-9)


def test_of_several_logs_each_has_its_own_rows_in_its_own_time(logs: list[Log]) -> None:
    whole = concatenate_logs(logs)
    held = LogPortion(whole, np.arange(len(whole)) % 5000 > 4000)
    before = erring(whole, 9.0, 1)
    rows = name_rows(held, logs)
    said = content(evaluate_gap(before, before, held), rows)
    assert [one["log"] for one in rows] == [log.source for log in logs]
    assert sum(one["rows"] for one in rows) == held.rows.sum()
    first = 0
    for log in logs:
        part = slice(first, first + len(log))
        own = erring(log, 1.0, 0)
        own = replace(own, columns={name: values[part] for name, values in before.columns.items()})
        kept = held.rows[part]
        each = [np.sqrt(np.mean((own.columns[name] - log[name])[kept] ** 2)) / 1e-3 for name in log.columns]
        assert count_rows(own, log, said, "d.json").gap == pytest.approx(np.exp(np.mean(np.log(each))))
        first += len(log)


def test_another_log_other_rows_and_an_old_diagnosis_are_refused(logs: list[Log]) -> None:
    log = logs[0]
    _, held = split_logs([log], [])
    found = erring(log, 2.0, 1)
    said = content(evaluate_gap(found, found, held), name_rows(held, [log]))
    with pytest.raises(PlantError, match=r"counts no rows of /somewhere/1.csv; possible is /somewhere/0.csv"):
        count_rows(erring(logs[1], 2.0, 1), logs[1], said, "d.json")
    late = Log(log.time + 0.5, log.columns, 1, log.source)
    with pytest.raises(LogError, match=r"it is not the log that was held out"):
        count_rows(erring(late, 2.0, 1), late, said, "d.json")
    lacking = Log(log.time, {k: v for k, v in log.columns.items() if k != "joint_position_1"}, 1, log.source)
    with pytest.raises(LogError, match=r"joint_position_1 is counted and not logged"):
        count_rows(erring(lacking, 2.0, 1), lacking, said, "d.json")
    unsaid: list[dict[str, Any]] = [{}, {"data": []}]
    for wrong in (*unsaid, {**said, "data": {"hold_out": [{"log": 1}]}}, {**said, "gap": {"by_channel": 3}}):
        with pytest.raises(PlantError, match=r"does not say which rows were held out; diagnose again"):
            count_rows(found, log, wrong, "d.json")


def test_the_command_counts_the_rows_of_a_diagnosis(
    build: Callable, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("HDAGEN_BUILD", str(build(FLEXIBLE).folder.parent))
    arm = Arm(build(FLEXIBLE, "portable").folder)
    simple = simulated(arm, 3.0)
    write(simple, tmp_path / "log.parquet")
    (tmp_path / "robot.toml").write_text(FLEXIBLE)
    log = replace(simple, source=str(tmp_path / "log.parquet"))
    arm.parameters["mass_1"] *= 1.05
    _, held = split_logs([log], [])
    found = replay(arm, log)
    told = evaluate_gap(found, found, held)
    mass = {"mass_1": {"value": arm.parameters["mass_1"], "std": 0.1}}
    said = diagnosis(verdict=[], causes=[], parameters=mass) | content(told, name_rows(held, [log]))
    (tmp_path / "diagnosis.json").write_text(json.dumps(said))
    figures = run(tmp_path, capsys, "--with", tmp_path / "diagnosis.json", "--rows-of", tmp_path / "diagnosis.json")
    assert figures["gap"] == pytest.approx(told["after"], rel=1e-9)
    assert any(f"counted over {held.rows.sum()} of {len(log)} rows" in note for note in figures["notes"])
    assert run(tmp_path, capsys, "--with", tmp_path / "diagnosis.json")["gap"] != pytest.approx(told["after"], rel=1e-6)


def run(folder: Path, capsys: pytest.CaptureFixture[str], *more: str | Path) -> dict[str, Any]:
    """What `hdagen replay --json` prints."""
    import argparse

    parser = argparse.ArgumentParser()
    replay_command.add_parser(parser.add_subparsers())
    arguments = ["replay", folder / "robot.toml", folder / "log.parquet", "--json", *more]
    assert replay_command.run(parser.parse_args([str(one) for one in arguments])) == 0
    return dict(json.loads(capsys.readouterr().out))


def test_nothing_that_was_fitted_closes_more_than_is_achievable(logs: list[Log]) -> None:
    log = logs[0]
    held = LogPortion.all_rows(log)
    before, alone, correction = erring(log, 9.0, 1), erring(log, 3.0, 2), erring(log, 7.0, 3)
    assert (
        choose_closest_replay([before, alone, correction], held) is alone
    )  # a correction that spoils what it begins with
    told = evaluate_gap(before, erring(log, 4.0, 4), held, correction)
    assert told["flexible"] == pytest.approx(7.0, rel=0.02) and told["achievable"] == told["after"]
    rungs = [{"effects": [], "gap": 3.0}, {"effects": [], "gap": 9.0}, {"effects": ["payload@2"], "gap": 2.5}]
    told |= compute_gap_bounds(told, rungs, [])
    assert told["flexible"] == 3.0 and told["achievable"] == 2.5  # base parameters alone are within the correction
    told |= compute_gap_bounds(told, rungs, [{"gap": 2.0}])
    assert told["achievable"] == 2.0


@pytest.mark.parametrize("kind", ["single", "task"])
def test_the_gap_of_a_made_log_is_counted_in_the_noise_of_its_sensors(kind: str, data_dir: Path) -> None:
    """Which the logs are made with; counted here without a word of the robot file's."""
    case = data_dir / "made" / kind / "case-000"
    if not case.is_dir():
        pytest.skip("there are no made logs")
    noise = {"motor_current": 0.01, "motor_position": 2 * np.pi / 4096 / 12**0.5}
    noise["joint_position"] = 2 * np.pi / 2**20 / 12**0.5
    log = read(case / "hold_out.parquet")
    found = replay(load(case / "robot.toml"), log)
    errs = [
        np.sqrt(np.mean((found.columns[f"{base}_{j}"] - log[f"{base}_{j}"]) ** 2)) / one
        for base, one in noise.items()
        for j in (1, 2)
    ]
    assert found.gap == pytest.approx(float(np.exp(np.mean(np.log(errs)))), rel=0.01)
    assert evaluate_gap(found, found, LogPortion.all_rows(log))["before"] == pytest.approx(found.gap, rel=1e-9)
