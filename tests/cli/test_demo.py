"""`hdagen demo`: the pushed tip stays near the ideal, and the check can fail; page and shipped log are whole."""

from __future__ import annotations

import argparse
import dataclasses
import importlib.util
import json
import os
import signal
import subprocess
import sys
import tomllib
from pathlib import Path
from types import ModuleType
from typing import Any

import chromium
import numpy as np
import pytest
from hostile_names import NAME, check_escaped
from kept_builds import find_builds

from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import load
from hdagen.cli import demo as demo_command
from hdagen.demo import demo_page, demo_runs, shipped_logs
from hdagen.log import measured_log

ROOT = Path(__file__).resolve().parents[2]
LOG = ROOT / "hdagen" / "data" / "mujoco_log.parquet"
SCRIPT = ROOT / "docs" / "examples" / "mujoco_log" / "make_log.py"


@pytest.fixture(scope="module")
def user(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """What differs in the environment of a user who has the package and no measured logs."""
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    none = tmp_path_factory.mktemp("none")
    return {"HDAGEN_BUILD": str(find_builds()), "HDAGEN_DATA": str(none), "PYTHONPATH": path}


@pytest.fixture(scope="module")
def shown(user: dict[str, str]) -> demo_runs.DemoResult:
    with pytest.MonkeyPatch.context() as patch:
        for name, value in user.items():
            patch.setenv(name, value)
        return demo_runs.run_demo()


@pytest.fixture
def here(tmp_path: Path, user: dict[str, str], monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty current directory of that user."""
    monkeypatch.chdir(tmp_path)
    for name, value in user.items():
        monkeypatch.setenv(name, value)
    return tmp_path


def command(*words: str) -> int:
    top = argparse.ArgumentParser()
    demo_command.add_parser(top.add_subparsers())
    return demo_command.run(top.parse_args(["demo", *words]))


# -- the tip and the ideal --------------------------------------------------------------------------------------------


def test_the_pushed_tip_stays_within_a_tenth_of_the_largest_ideal_displacement(shown: demo_runs.DemoResult) -> None:
    assert [one.law for one in shown.circle_runs] == ["impedance_cartesian", "admittance_cartesian"]
    for one in shown.circle_runs:
        static = 15.0 / one.gains["stiffness_x"]
        assert static < one.largest_ideal < 1.2 * static  # the push is felt, and overshoots as B and K say
        assert one.gap.max() <= 0.10 * one.largest_ideal
        assert np.linalg.norm(one.tip_displacement, axis=1).max() > 0.9 * one.largest_ideal  # the tip itself gave way
        assert (one.simulation.status >= 0).all()
        assert one.meets_bar
    assert shown.meets_bar


@pytest.mark.parametrize(
    ("law", "gains"),
    [
        ("impedance_cartesian", {"observer_bandwidth": 0.0}),
        # the position loop holds against friction by its stiffness, so that has to be low for friction to show
        ("admittance_cartesian", {"observer_bandwidth": 0.0, "bandwidth": 10.0}),
    ],
)
def test_without_friction_compensation_the_bar_is_missed(
    shown: demo_runs.DemoResult, law: str, gains: dict[str, float]
) -> None:
    followed = demo_runs.follow_circle(shown.arm, law, gains)
    assert followed.gap.max() > 0.10 * followed.largest_ideal
    assert not followed.meets_bar


def test_friction_and_pushes_are_on(shown: demo_runs.DemoResult) -> None:
    for one in shown.circle_runs:
        rows = one.reference.time
        felt = one.simulation.push
        assert (felt[(rows >= 3) & (rows < 4)] == (15, 0)).all()
        assert (felt[(rows >= 6) & (rows < 7)] == (0, 15)).all()
        assert np.abs(felt).sum() == 15 * 2000
    speed = shown.uncompensated_run.simulation.state[:, [shown.arm.index(f"motor_velocity_{j}") for j in (1, 2)]]
    assert (speed[1:] == 0).any(axis=0).all()  # set-valued friction sticks exactly, smooth friction never does


def test_a_missed_bar_is_said_and_is_exit_code_1(
    shown: demo_runs.DemoResult, here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    missed = demo_runs.DemoResult(
        shown.arm, (shown.uncompensated_run,), shown.uncompensated_run, shown.torque_estimates, shown.replays
    )
    monkeypatch.setattr(demo_runs, "run_demo", lambda *_, **__: missed)
    assert command() == 1
    assert "The bar is missed" in capsys.readouterr().out
    assert "misses the bar" in (here / "hdagen-demo.html").read_text("utf-8")


def test_names_that_are_html_are_text(shown: demo_runs.DemoResult, tmp_path: Path) -> None:
    (replayed,) = shown.replays
    odd = dataclasses.replace(
        replayed, name=NAME, notes=(NAME,), joints=tuple(dataclasses.replace(c, name=NAME) for c in replayed.joints)
    )
    demo_page.write_demo_page(tmp_path / "page.html", dataclasses.replace(shown, replays=(odd,)))
    check_escaped((tmp_path / "page.html").read_text(encoding="utf-8"), 3)


# -- estimate and replay ----------------------------------------------------------------------------------------------


def test_the_torque_is_estimated_from_the_log_alone(shown: demo_runs.DemoResult) -> None:
    estimated, true = shown.torque_estimates, shown.circle_runs[0].simulation.joint_torque
    rms = np.sqrt(np.mean(true**2, axis=0))
    assert (estimated.rms_error(estimated.series_estimate) < 0.1 * rms).all()
    assert (estimated.rms_error(estimated.dynamic_estimate) < 0.6 * rms).all()
    assert (estimated.rms_error(estimated.series_estimate) > 0).all()  # encoders count, so it cannot be exact
    blind = demo_runs.estimate_torques(shown.arm, _without(shown.circle_runs[0], "motor_position"))
    assert (blind.rms_error(blind.series_estimate) > rms).all()


def _without(followed: demo_runs.CircleRun, channel: str) -> demo_runs.CircleRun:
    """The same with ``channel`` of the log standing still at its first value."""
    logged = followed.simulation.log
    columns = {
        name: np.full_like(values, values[0]) if name.startswith(channel) else values
        for name, values in logged.columns.items()
    }
    simulation = dataclasses.replace(followed.simulation, log=dataclasses.replace(logged, columns=columns))
    return dataclasses.replace(followed, simulation=simulation)


def test_the_shipped_log_is_replayed_with_a_small_gap_that_is_one(shown: demo_runs.DemoResult) -> None:
    (replayed,) = shown.replays
    assert not replayed.is_measured
    for channel in replayed.joints:
        resolution = shown.arm.robot["joints"][0]["sensor"]["joint_encoder_resolution"]
        assert (
            10 * resolution < channel.rms_residual < 0.01 * channel.motion_rms
        )  # no copy of itself, and under 1 % of the motion


def test_emps_is_replayed_where_its_data_are(data_dir: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HDAGEN_DATA", str(data_dir))
    folder = shipped_logs.find_data_folder()
    if folder is None:
        pytest.skip(f"no EMPS: {data_dir} has no {shipped_logs.EMPS_FILE}")
    replayed = shipped_logs.replay_emps_log(load("emps"), folder)
    assert replayed.is_measured
    assert [channel.unit for channel in replayed.joints] == ["m"]
    assert replayed.joints[0].rms_residual < 0.25e-3  # m, issue's figure for identification


def test_emps_columns_are_those_of_the_example() -> None:
    packaged = (ROOT / "hdagen" / "data" / "emps_columns.toml").read_bytes()
    assert packaged == (ROOT / "docs" / "examples" / "emps" / "columns.toml").read_bytes()


# -- the log that ships -----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def make_log() -> ModuleType:
    pytest.importorskip("mujoco", reason="MuJoCo, of the test extra, makes the log")
    spec = importlib.util.spec_from_file_location("make_log", SCRIPT)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_script_makes_the_log_that_ships(make_log: ModuleType) -> None:
    joints = tomllib.loads(make_log.ROBOT.read_text("utf-8"))["joint"]
    again, stored = make_log.simulate(joints), measured_log.read(LOG, joints=2)
    assert set(again) == {"time", *stored.columns}
    for name, values in again.items():
        # another processor rounds otherwise, and a count of an encoder or a mA may fall on the other side
        size = np.sqrt(np.mean((stored[name] - stored[name].mean()) ** 2))
        assert np.sqrt(np.mean((values - stored[name]) ** 2)) <= 1e-3 * size, name


def test_another_seed_makes_other_noise_and_the_same_motion(make_log: ModuleType) -> None:
    joints = tomllib.loads(make_log.ROBOT.read_text("utf-8"))["joint"]
    again, stored = make_log.simulate(joints, make_log.SEED + 1), measured_log.read(LOG, joints=2)
    assert not np.array_equal(again["motor_current_1"], stored["motor_current_1"])
    assert np.array_equal(again["joint_position_1"], stored["joint_position_1"])


def test_the_shipped_log_is_small_and_says_that_it_is_simulated() -> None:
    assert LOG.stat().st_size < 1.5e6
    assert "SIMULATED" in (LOG.parent / "README.md").read_text("utf-8")


# -- the page ---------------------------------------------------------------------------------------------------------


def test_the_page_is_small_and_the_same_each_time(
    here: Path, shown: demo_runs.DemoResult, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command("--out", "one.html") == 0
    capsys.readouterr()
    assert command("--out", "two.html", "--json") == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed.pop("machine")["casadi"]
    assert printed == {"page": "two.html", **demo_runs.summarize_demo(shown)}
    one = (here / "one.html").read_bytes()
    assert one == (here / "two.html").read_bytes()
    assert len(one) < 5e6
    assert str(here) not in one.decode() and str(ROOT) not in one.decode()
    assert sorted(path.name for path in here.iterdir()) == ["one.html", "two.html"]


def test_the_page_says_its_numbers_and_what_is_simulated(shown: demo_runs.DemoResult, tmp_path: Path) -> None:
    demo_page.write_demo_page(tmp_path / "page.html", shown)
    text = (tmp_path / "page.html").read_text("utf-8")
    for one in shown.circle_runs:
        assert f"{100 * one.gap_share:.1f}\N{NO-BREAK SPACE}%" in demo_page.format_demo_verdict(shown)
    assert "This log is simulated, not measured" in text
    assert demo_page.format_demo_verdict(shown) in text


@pytest.mark.skipif(
    chromium.PROGRAM is None,
    reason="no Chromium is installed; `apt-get install chromium` brings what this test looks with",
)
@pytest.mark.parametrize("width", [400, 1100])
def test_the_page_opens_in_silence(shown: demo_runs.DemoResult, tmp_path: Path, width: int) -> None:
    path = tmp_path / "page.html"
    demo_page.write_demo_page(path, shown)
    with chromium.browser() as tab:
        tab.call("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=False)
        tab.open(path.as_uri())
        assert tab.run("document.querySelectorAll('figure').length") >= 9
        assert tab.run("document.documentElement.scrollWidth") <= width
        before = tab.run("document.querySelector('input[type=range]').value")
        tab.run("[...document.querySelectorAll('button')].find(b => b.textContent.includes('Play')).click()")
        tab.run("new Promise(done => setTimeout(done, 500))")
        assert tab.run("document.querySelector('input[type=range]').value") != before  # the arm moves
        assert tab.messages == []
        assert tab.requests == [path.as_uri()]


# -- what goes wrong --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("out", [".", "missing/page.html"])
def test_a_place_that_cannot_be_written_is_refused_before_the_work(
    here: Path, monkeypatch: pytest.MonkeyPatch, out: str
) -> None:
    monkeypatch.setattr(demo_runs, "run_demo", lambda *_, **__: pytest.fail("the work was begun"))
    with pytest.raises(PlantError, match="--out"):
        command("--out", out)


@pytest.mark.parametrize(
    ("module", "name"),
    [
        (demo_runs, "estimate_torques"),
        (demo_runs, "replay_shipped_log"),
        (demo_page, "format_demo_verdict"),
        (os, "replace"),
    ],
)
def test_an_interrupt_leaves_nothing_half_written(
    here: Path, shown: demo_runs.DemoResult, monkeypatch: pytest.MonkeyPatch, module: Any, name: str
) -> None:
    (here / "page.html").write_text("an earlier page")

    def interrupt(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(module, name, interrupt)
        with pytest.raises(KeyboardInterrupt):
            command("--out", "page.html")
    assert [path.name for path in here.iterdir()] == ["page.html"]
    assert (here / "page.html").read_text() == "an earlier page"


def test_control_c_ends_with_130(here: Path, shown: demo_runs.DemoResult) -> None:
    words = [sys.executable, "-m", "hdagen", "demo", "--out", "page.html"]
    with subprocess.Popen(words, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        heard = ""
        while "simulating impedance" not in heard:
            heard = process.stderr.readline()
            assert heard, "the demo ended before it was interrupted"
        process.send_signal(signal.SIGINT)
        said = process.stderr.read()
        assert process.wait(30) == 130
    assert "Traceback" not in said
    assert list(here.iterdir()) == []
