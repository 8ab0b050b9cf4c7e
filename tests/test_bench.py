"""The bench: its bars, its judgement, and that every contestant computes the same thing. No time is asserted."""

from __future__ import annotations

import argparse
import json
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gen import timing
from hdagen import bench, bench_command
from hdagen.plant import load

BARS = tomllib.loads((Path(bench.__file__).parent / "bars.toml").read_text())


def figures(share: float) -> dict[str, np.ndarray]:
    """Numbers that beat every bar by ``share`` (below 1: that miss it)."""
    return {
        name: np.full(5, entry["bar"] * share if entry["bound"] == "least" else entry["bar"] / share)
        for name, entry in BARS.items()
    }


def test_every_bar_says_what_it_asks() -> None:
    assert len(BARS) == 13
    for entry in BARS.values():
        assert entry["bar"] > 0
        assert entry["bound"] in ("least", "most")
        assert entry["unit"]


def test_bars_are_judged_both_ways() -> None:
    assert all(bar.met for bar in bench._judged(figures(1.01), 8))
    assert not any(bar.met for bar in bench._judged(figures(0.99), 8))


def test_the_bar_of_wide_vectors_is_not_judged_on_narrow_ones() -> None:
    narrow = {bar.name: bar.met for bar in bench._judged(figures(0.5), 4)}
    assert narrow.pop("batch_against_native_step") is None
    assert not any(narrow.values())


def test_a_bar_without_a_figure_is_not_passed_over() -> None:
    numbers = figures(2.0)
    del numbers["library_size"]
    with pytest.raises(KeyError, match="library_size"):
        bench._judged(numbers, 8)


@pytest.mark.parametrize(("share", "code"), [(1.1, 0), (0.9, 1)])
def test_a_missed_bar_is_exit_code_1(
    share: float, code: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def measured(rounds: int, stage: Callable[[str], None]) -> bench.Bench:
        stage(f"{rounds} rounds")
        values = [3.0, 1.0, 2.0]
        one = bench._timing("rhs", values, dict.fromkeys(bench.WHO, values))
        return bench.Bench((one,), bench._judged(figures(share), 8), {"processor": "one"})

    monkeypatch.setattr(bench, "bench", measured)
    assert bench_command.run(argparse.Namespace(quick=True, json=True)) == code
    said = json.loads(capsys.readouterr().out)
    assert {bar["name"] for bar in said["bars"]} == set(BARS)
    assert said["timings"][0]["median"] == 2.0
    assert bench_command.run(argparse.Namespace(quick=True, json=False)) == code
    assert ("missed" in capsys.readouterr().out) == bool(code)


def test_contestants_run_the_same_functions_and_take_turns(tmp_path: Path) -> None:
    found = timing.measure("emps", tmp_path, rounds=3)
    assert {"rhs", "step", "rhs_jacobian", "outputs", "impedance_joint_tick"} <= set(found)
    for times in found.values():
        assert set(times) == set(bench.WHO)
        assert all(len(rounds) == 3 and min(rounds) > 0 for rounds in times.values())


def test_the_timed_step_is_the_compiled_step(tmp_path: Path) -> None:
    from gen.build import assembled
    from gen.robot import load as describe

    made, _, _ = assembled("emps", describe("emps"), ())
    arm = load("emps", out=tmp_path)
    given = timing.states(made.graphs.model, 50)
    theirs = np.array(timing.step_graph(made)(given["x"].T, given["u"].T, arm.c, arm.step_size)).T
    ours = np.array([arm.step(x, u) for x, u in zip(given["x"], given["u"], strict=True)])
    assert np.array_equal(ours, theirs)


def test_loops_fill_every_bar_that_rests_on_them(tmp_path: Path) -> None:
    loops = bench._loops(load("emps", out=tmp_path), rounds=2)
    bars = loops.pop("bars")
    assert set(bars) == {"batch_against_native_step", "python_call_over_empty_call", "rollout_against_its_loop"}
    assert all(len(values) == 2 for values in loops.values())
