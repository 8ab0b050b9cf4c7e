"""`hdagen simulate --controller mpc` and `hdagen mpc`: what they print and write, and the page that explains a run."""

from __future__ import annotations

import json
from pathlib import Path

import chromium
import numpy as np
import pytest
from hostile_names import NAME, check_escaped
from kept_builds import find_builds

from hdagen.__main__ import USAGE, main
from hdagen.log.measured_log import read as read_log
from hdagen.mpc import explanation_page
from hdagen.mpc.tick_record import read_record

TOML = """[limits]
tip_speed = 0.15
[[wall]]
normal = [1.0, 0.0]
offset = 0.265
stiffness = 2e4
force = 20.0
[[wall]]
normal = [0.0, 1.0]
offset = 0.07
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log of the circle pushed against a wall, its record beside it, and its page."""
    place = tmp_path_factory.mktemp("run")
    (place / "controller.toml").write_text(TOML)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HDAGEN_BUILD", str(find_builds()))
        simulate = ["simulate", "paper", "--controller", "mpc", "--config", str(place / "controller.toml")]
        simulate += ["--push", "0.3", "0.9", "25", "0", "--seconds", "1.5", "--center", "0.2", "0"]
        assert main([*simulate, "--out", str(place / "run.parquet")]) == 0
        assert main(["mpc", "explain", str(place / "run.parquet")]) == 0
    return place


def test_the_log_is_a_log_and_the_record_says_what_the_controller_did(run: Path) -> None:
    log, record = read_log(run / "run.parquet"), read_record(run / "run.parquet")
    assert len(log) == len(record["time"]) == 1500
    assert np.array_equal(log.time, record["time"])
    assert (record["rung"] == 0).all()
    assert record["active_wall"][300:900].max() >= 3
    target = np.hypot(*(record[f"target_{axis}"] - record[f"path_{axis}"] for axis in "xy"))
    off = np.hypot(*(record[f"tip_{axis}"] - record[f"target_{axis}"] for axis in "xy"))
    assert target[:290].max() < 1e-3  # nothing pushes yet
    assert target[600:900].max() > 0.03  # the push moves mass, damper and spring
    assert np.median(off[:290]) < 2e-4
    assert off[600:900].max() > 0.01  # which the wall does not let through
    assert record["tip_x"].max() < 0.265 + 20.0 / 2e4 + 1e-3
    missed = np.hypot(*(record[f"tip_{axis}"] - record[f"predicted_{axis}"] for axis in "xy"))
    assert np.nanmedian(missed[150:290]) < 1e-3
    assert (record["prepare_time"][5:] > 0).all()


def test_the_page_shows_motion_limits_and_times(run: Path) -> None:
    text = (run / "run.html").read_text(encoding="utf-8")
    for words in (
        "The tip in the plane",
        "Predicted and real motion",
        "Active limits over time",
        "How many ticks take",
    ):
        assert words in text
    assert "0 ticks were not on the plan" in text
    assert "Rung of the ladder" not in text


@pytest.mark.skipif(chromium.PROGRAM is None, reason="Chromium is not installed here; it shows the page")
def test_a_browser_shows_the_page_without_a_word(run: Path) -> None:
    with chromium.browser() as page:
        page.open((run / "run.html").as_uri())
        assert page.run("document.querySelectorAll('figure svg').length") >= 5
        assert page.messages == []
        assert all(request.startswith(("file:", "data:")) for request in page.requests)


def test_names_that_are_html_are_text(run: Path, tmp_path: Path) -> None:
    explanation_page.write_record_page(tmp_path / "page.html", NAME, read_record(run / "run.parquet"))
    check_escaped((tmp_path / "page.html").read_text(encoding="utf-8"), 2)


def test_a_log_without_a_record_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["mpc", "explain", str(tmp_path / "none.parquet")]) > 1
    assert "writes the predictive controller's record of a log" in capsys.readouterr().err


@pytest.mark.parametrize(
    "asked, words",
    [([], "found none"), (["table", "--reference"], "found table and reference"), (["explain"], "takes a log")],
)
def test_one_thing_is_asked_at_a_time(asked: list[str], words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["mpc", *asked]) == USAGE
    assert words in capsys.readouterr().err


def test_a_file_in_place_of_the_folder_of_runs_ends_the_command_before_a_build(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "runs").touch()
    monkeypatch.setattr("hdagen.mpc.benchmark.law_comparison.compare_controllers", pytest.fail)
    assert main(["mpc", "table", "--runs", "2", "--out", str(tmp_path / "runs")]) > 1
    assert "is a file; give a folder" in capsys.readouterr().err


def test_gains_of_other_controllers_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "--controller", "mpc", "--gain", "stiffness_x=5"]) == USAGE
    assert "takes --config controller.toml" in capsys.readouterr().err


def test_a_configuration_that_does_not_fit_ends_the_command_before_a_build(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("HDAGEN_BUILD", str(tmp_path / "builds"))
    (tmp_path / "c.toml").write_text("[limits]\njoint_low = 2.7\n")
    assert main(["simulate", "--controller", "mpc", "--config", str(tmp_path / "c.toml")]) == USAGE
    said = capsys.readouterr().err
    assert said.count("\n") == 2  # one sentence a joint
    assert not (tmp_path / "builds").exists()


def test_the_tables_configuration_is_printed_for_c(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "c.toml").write_text(TOML)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HDAGEN_BUILD", str(find_builds()))
        assert main(["mpc", "header", "--config", str(tmp_path / "c.toml"), "--profile", "portable"]) == 0
    text = capsys.readouterr().out
    assert text.startswith("static const double mpc_settings[] = {0.0, 0.0001, 4000.0,")
    assert json.loads("[" + text.split("mpc_ratio[] = {")[1].split("}")[0] + "]") == [100.0, 100.0]
