"""The bench: its bars, its judgement, and that every contestant computes the same thing. No time is asserted."""

from __future__ import annotations

import argparse
import json
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from kept_builds import find_builds

from gen.builder import function_timing
from gen.builder.build import assemble_library
from gen.builder.build import build_robot as make
from gen.robot.load_robot import load as describe
from hdagen.__main__ import main
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import load
from hdagen.bench import benchmark, simulator_race
from hdagen.cli import bench as bench_command

FILES = {
    robot: tomllib.loads((Path(benchmark.__file__).parent / file).read_text())
    for robot, file in benchmark.BAR_FILES.items()
}
BARS = FILES["paper"]


def figures(share: float, robot: str = "paper") -> dict[str, np.ndarray]:
    """Numbers that beat every bar by ``share`` (below 1: that miss it)."""
    return {
        name: np.full(5, entry["bar"] * share if entry["bound"] == "least" else entry["bar"] / share)
        for name, entry in FILES[robot].items()
    }


# -- bars -------------------------------------------------------------------------------------------------------------


def test_every_bar_says_what_it_asks() -> None:
    assert {robot: len(bars) for robot, bars in FILES.items()} == {"paper": 13, "panda": 6}
    for entry in (*BARS.values(), *FILES["panda"].values()):
        assert entry["bar"] > 0
        assert entry["bound"] in ("least", "most")
        assert entry["unit"]


def test_bars_are_judged_both_ways() -> None:
    for robot in FILES:
        assert all(bar.met for bar in benchmark._judge_requirements(robot, figures(1.01, robot), 8)[0])
        assert not any(bar.met for bar in benchmark._judge_requirements(robot, figures(0.99, robot), 8)[0])


def test_a_simulator_that_is_not_installed_is_named_and_judges_nothing() -> None:
    reached = figures(1.01, "panda")
    del reached["step_against_mujoco"]
    bars, absent = benchmark._judge_requirements("panda", reached, 8)
    assert absent == ("MuJoCo",)
    assert {bar.name for bar in bars} == set(reached)


def test_simulators_are_compared_in_the_rounds_of_one_run() -> None:
    """Less the call of Pinocchio; of a simulator that was not timed there is no figure."""
    times = {
        simulator_race.OURS: np.array([1.0, 2.0]),
        simulator_race.OURS_WITH_DERIVATIVES: np.array([5.0, 5.0]),
        simulator_race.PINOCCHIO_ABA: np.array([11.0, 21.0]),
        simulator_race.PINOCCHIO_CALL: np.array([1.0, 1.0]),
    }
    found = simulator_race.compare_simulators(times, np.array([4.0, 4.0]))
    assert found["forward_dynamics_against_pinocchio"].tolist() == [10.0, 10.0]
    assert found["derivatives_against_pinocchio"].tolist() == [0.5, 0.25]
    assert "step_against_mujoco" not in found
    times[simulator_race.MUJOCO_STEP] = np.array([12.0, 16.0])
    found = simulator_race.compare_simulators(times, np.array([4.0, 4.0]))
    assert found["step_against_mujoco"].tolist() == [3.0, 4.0]
    assert found.keys() | {"batch_against_native_step"} == FILES["panda"].keys()


def test_the_bar_of_wide_vectors_is_not_judged_on_narrow_ones() -> None:
    narrow = {bar.name: bar.met for bar in benchmark._judge_requirements("paper", figures(0.5), 4)[0]}
    assert narrow.pop("batch_against_native_step") is None
    assert not any(narrow.values())


def test_a_bar_without_a_figure_is_not_passed_over() -> None:
    numbers = figures(2.0)
    del numbers["library_size"]
    with pytest.raises(KeyError, match="library_size"):
        benchmark._judge_requirements("paper", numbers, 8)


@pytest.mark.parametrize(("share", "code"), [(1.1, 0), (0.9, 1)])
def test_a_missed_bar_is_exit_code_1(
    share: float, code: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def measured(rounds: int, stage: Callable[[str], None], robot: str) -> benchmark.BenchResult:
        stage(f"{rounds} rounds")
        one = benchmark._summarize_loop("rollout", [3.0, 1.0, 2.0])
        contest = {who: {"row": [3.0, 1.0, 2.0], "single": [1.0, 2.0, 3.0, 4.0]} for who in benchmark.CONTESTANTS}
        two = benchmark._summarize_contest("rhs", contest)
        judged, _ = benchmark._judge_requirements("paper", figures(share), 8)
        return benchmark.BenchResult((one, two), judged, {"processor": "one"}, ("MuJoCo",))

    monkeypatch.setattr(benchmark, "run_bench", measured)
    assert bench_command.run(argparse.Namespace(quick=True, json=True, mpc=False, robot="paper")) == code
    said = json.loads(capsys.readouterr().out)
    assert {bar["name"] for bar in said["bars"]} == set(BARS)
    assert [t["row"] for t in said["timings"]] == [2.0, 2.0]
    assert said["timings"][1]["against"] == dict.fromkeys(benchmark.CONTESTANTS, 2.0)
    assert bench_command.run(argparse.Namespace(quick=True, json=False, mpc=False, robot="paper")) == code
    printed = capsys.readouterr().out
    assert ("missed" in printed) == bool(code)
    assert "not installed, so that nothing is compared with: MuJoCo" in printed
    assert "rhs" in printed


def test_of_another_robot_there_are_times_and_no_bars(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    contest = {who: {"row": [3.0], "single": [1.0, 2.0, 3.0, 4.0]} for who in benchmark.CONTESTANTS}
    asked = []

    def race(robot: str, rounds: int) -> dict[str, Any]:
        asked.append(robot)
        return {"rhs": contest, "step": contest}

    monkeypatch.setattr(benchmark, "_race_functions", race)
    monkeypatch.setattr(benchmark, "ROLLOUT_STEPS", 50)
    found = benchmark.run_bench(1, lambda words: None, "emps")
    assert asked == ["emps"] and found.bars == ()
    assert {"rhs", "arm.rollout"} <= {t.name for t in found.timings}
    monkeypatch.setattr(benchmark, "run_bench", lambda rounds, stage, robot: found)
    assert main(["bench", "emps", "--quick"]) == 0
    assert "bars are of paper and panda alone" in capsys.readouterr().out
    assert main(["bench", "emps", "--mpc"]) == 2


def test_a_noisy_run_is_called_so() -> None:
    ratios = figures(1.5)
    steady = benchmark.BenchResult((), benchmark._judge_requirements("paper", ratios, 8)[0], {})
    ratios["native_rhs_against_casadi_c"] = np.array([2.0, 3.0, 4.0, 5.0, 6.0])
    assert not steady.is_noisy
    assert benchmark.BenchResult((), benchmark._judge_requirements("paper", ratios, 8)[0], {}).is_noisy


def test_a_child_that_fails_says_why() -> None:
    with pytest.raises(PlantError, match="no_such_robot"):
        benchmark._run_gen("build", "--", "no_such_robot.toml")


# -- contestants ------------------------------------------------------------------------------------------------------


def test_contestants_take_turns_at_every_function() -> None:
    found = function_timing.measure_times("emps", find_builds(), rounds=3)
    assert {"prepare", "rhs", "step", "rhs_jacobian", "outputs", "impedance_joint_tick"} <= set(found)
    for contest in found.values():
        assert set(contest) == set(benchmark.CONTESTANTS)
        for times in contest.values():
            assert len(times["row"]) == 3
            assert min(times["row"]) > 0
            assert times["single"] == sorted(times["single"])


def test_contestants_compute_the_same() -> None:
    """Portable and CasADi's C to the bit of the interpreter's outputs, native within its bound."""
    made, _, _ = assemble_library("emps", describe("emps"), ())
    graphs = {f.name: f.graph for f in made.functions} | {"step": function_timing.make_step_graph(made)}
    builds = {profile: make("emps", profile, find_builds())[0] for profile in ("native", "portable")}
    p = np.array([[q.nominal for q in made.graphs.model.quantities]])
    c = np.array(graphs["prepare"](p.ravel())).T
    known = {
        **function_timing.sample_states(made.graphs.model, function_timing.CALLS_PER_ROW),
        "p": p,
        "c": c,
        "h": np.array([[1e-3]]),
    }
    with function_timing.open_rig(graphs, builds) as contest:
        for name, graph in graphs.items():
            inputs = function_timing.sample_inputs(name, graph, made, known)
            results = {}
            for who in function_timing.CONTESTANTS:
                outputs = [
                    np.full((function_timing.CALLS_PER_ROW, graph.numel_out(k)), 7.0) for k in range(graph.n_out())
                ]
                contest.make_sampler(who, name, graph, inputs, outputs)(function_timing.CALLS_PER_ROW, 1)
                results[who] = outputs
            for theirs, c_text, portable, native in zip(
                *(results[who] for who in ("interpreter", "casadi_c", "portable", "native")), strict=True
            ):
                assert np.array_equal(theirs, portable, equal_nan=True), name
                size = np.abs(np.nan_to_num(theirs)).max(axis=0) + 1e-300
                assert np.nan_to_num(np.abs(theirs - c_text) / size).max() < 1e-12, name
                assert np.nan_to_num(np.abs(theirs - native) / size).max() < (1e-9 if name == "prepare" else 1e-12), (
                    name
                )
                assert not (theirs == 7.0).any(), name  # everything was written


def test_the_timed_step_is_the_compiled_step() -> None:
    made, _, _ = assemble_library("emps", describe("emps"), ())
    arm = load("emps")
    given = function_timing.sample_states(made.graphs.model, 50)
    theirs = np.array(function_timing.make_step_graph(made)(given["x"].T, given["u"].T, arm.c, arm.step_size)).T
    ours = np.array([arm.step(x, u) for x, u in zip(given["x"], given["u"], strict=True)])
    assert np.array_equal(ours, theirs)


# -- loops ------------------------------------------------------------------------------------------------------------


def test_loops_fill_every_bar_that_rests_on_them() -> None:
    times, bars = benchmark._time_loops(load("emps"), rounds=2)
    assert set(bars) == {"batch_against_native_step", "python_call_over_empty_call", "rollout_against_its_loop"}
    assert all(len(values) == 2 for values in (*times.values(), *bars.values()))
    assert all((values > 0).all() for values in times.values())


def test_ticks_of_every_controller_run_without_a_fault() -> None:
    arm = load("paper_table1")
    assert len(benchmark._time_ticks(arm, rounds=1)) == len(arm.manifest["controllers"]) == 5


def test_bristles_of_the_robot_file_are_integrated_within_the_bar(tmp_path: Path) -> None:
    """They have the L-stable step, of which the bar and what it costs speak."""
    arm = load(benchmark._write_bristle_robot(tmp_path / "bristles.toml", 2))
    assert arm.manifest["stiff"] and "memory_step" not in arm.parameters
    assert [arm.parameters[f"presliding_share_{j}"] for j in (1, 2)] == [1.0, 1.0]
    assert benchmark._measure_link_error(arm) <= BARS["error_with_bristles"]["bar"]


@pytest.mark.campaign
def test_the_whole_bench_runs() -> None:
    found = benchmark.run_bench(2, lambda words: None)
    assert {bar.name for bar in found.bars} == set(BARS)
    exact = {bar.name: bar for bar in found.bars if bar.name.startswith("error")}
    assert all(bar.met for bar in exact.values())  # these are no times
    assert {"rhs", "step", "arm.rollout", "batch"} <= {t.name for t in found.timings}
