"""`hdagen simulate` for an arm in space: paths, waypoints, figures, and arguments that are refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import space_robots
from compiled import Compiled

from hdagen.__main__ import main
from hdagen.log.measured_log import read

FIGURES = ("largest_gap", "largest_turn_gap", "largest_ideal_displacement")


@pytest.fixture(scope="module")
def folder(build: Callable[..., Compiled]) -> str:
    return str(build(space_robots.seven_joint_arm()).folder)


def simulate(folder: str, out: Path, *arguments: str) -> int:
    posture = [str(q) for q in space_robots.SEVEN_POSTURE]
    return main(
        ["simulate", folder, "--built", "--seconds", "0.8", "--posture", *posture, "--out", str(out), *arguments]
    )


@pytest.mark.parametrize("arguments", [[], ["--path", "lissajous", "--controller", "admittance_cartesian"]])
def test_a_pushed_tip_yields_as_it_should(
    folder: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str]
) -> None:
    out = tmp_path / "log.parquet"
    push = ["--push", "0.2", "0.6", "0", "0", "-15", "0.5", "0", "1"]
    assert simulate(folder, out, *arguments, *push, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["against"] == "the ideal mass-damper-spring motion" and found["ticks_refused"] == 0
    largest, turned, ideal = (found[name] for name in FIGURES)
    assert largest < 0.1 * ideal and 0.02 < ideal < 0.04 and turned < 0.01
    assert read(out)["tip_moment_z"].max() == 1.0


def test_its_figures_are_printed_in_words(folder: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    waypoints = tmp_path / "points.csv"
    waypoints.write_text("time,x,y,z\n0,0.59,0.11,0.3\n0.5,0.55,0.15,0.3\n")
    assert simulate(folder, tmp_path / "log.csv", "--waypoints", str(waypoints)) == 0
    said = capsys.readouterr().out
    assert "500 rows of seven joints under impedance_cartesian" in said
    assert "tip against the ideal mass-damper-spring motion" in said and "its orientation: " in said
    assert simulate(folder, tmp_path / "log.csv", "--path", "multisine") == 0
    said = capsys.readouterr().out
    assert "under impedance_joint" in said and "joints against the joints' motion" in said


@pytest.mark.parametrize(
    "arguments, sentence",
    [
        (["--posture", "1", "2"], "--posture takes 7 finite numbers"),
        (["--center", "0.1", "0.2"], "--center is of the circle of an arm in the plane"),
        (["--path", "line", "--waypoints", "a.csv"], "in place of --path"),
        (["--path", "line", "--direction", "1", "0"], "3 finite numbers"),
        (["--path", "swing", "--controller", "impedance_cartesian"], "follows the tip"),
        (["--push", "0", "1", "2"], "--push takes FROM TO"),
        (["--gain", "posture_8=0"], "no gain named posture_8"),
    ],
)
def test_what_is_not_possible_is_said(
    folder: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], sentence: str
) -> None:
    out = tmp_path / "log.parquet"
    assert simulate(folder, out, *arguments) == 2
    assert sentence in capsys.readouterr().err and not out.exists()


def test_fewer_joints_swing_unless_a_path_is_stated(build: Callable[..., Compiled], tmp_path: Path) -> None:
    folder, out = str(build(space_robots.four_joint_arm()).folder), tmp_path / "log.parquet"
    common = ["simulate", folder, "--built", "--seconds", "0.3", "--out", str(out)]
    assert main(common) == 0
    assert "joint_position_reference_4" in read(out).columns
    assert main([*common, "--path", "line", "--radius", "0.01"]) == 0
    tips = read(out)
    assert "joint_position_reference_4" not in tips.columns and np.isfinite(tips["joint_position_4"]).all()
