"""`hdagen paper`: its names, its files, the files that it leaves alone, its errors; docs/project/paper.md."""

from __future__ import annotations

import importlib.util
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from compiled import Compiled
from hostile_names import NAME, check_escaped

from hdagen.__main__ import INTERRUPTED, USAGE, main
from hdagen.cli import paper as paper_command
from hdagen.log.measured_log import read
from hdagen.paper import document_tables, figure_production, figure_store, paper_page
from hdagen.paper.drawing import draw_result
from hdagen.paper.figure_catalogue import PAPER_FIGURES, find_figures
from hdagen.paper.prototype.figure_result import Axes, Claim, Curve, Grid, Map, Result
from hdagen.paper.prototype.virtual_prototype import PROTOTYPE, TABLE_1, THREE_JOINTS

ROOT = Path(__file__).parents[2]
DRAWS = importlib.util.find_spec("matplotlib") is not None
needs_matplotlib = pytest.mark.skipif(not DRAWS, reason="matplotlib draws the figures; the extra `paper` brings it")


PROGRAM = """
import sys
from hdagen.__main__ import main
from hdagen.paper import figure_production
figure_production.THREE_JOINTS = figure_production.PROTOTYPE
sys.exit(main(sys.argv[1:]))
"""  # the command without the arm of three joints, which takes long to build and is in one figure of the campaign alone


@pytest.fixture
def builds(build: Any, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The builds of the arms, where the command looks for them."""
    made: list[Compiled] = [build(robot, "native") for robot in (PROTOTYPE, TABLE_1)]
    monkeypatch.setenv("HDAGEN_BUILD", str(made[0].folder.parent))
    return made[0].folder.parent


@pytest.fixture
def alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are made in this process, and without the arm of three joints; interrupted ones are made by workers."""
    monkeypatch.setattr(figure_production, "count_processors", lambda: 1)
    monkeypatch.setattr(figure_production, "THREE_JOINTS", PROTOTYPE)


def made(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


# -- names ------------------------------------------------------------------------------------------------------------


def test_every_figure_and_table_of_the_paper_is_there() -> None:
    wanted = {f"fig{n}" for n in ("3b", 8, 9, 11, 12, 14, 15, 16, 17, 18, 19, 20, 21)} | {
        f"table{n}" for n in range(1, 6)
    }
    assert wanted <= {figure.name for figure in PAPER_FIGURES}
    assert len({figure.name for figure in PAPER_FIGURES}) == len(PAPER_FIGURES)


def test_list_names_them(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["paper", "list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == [figure.name for figure in PAPER_FIGURES]


def test_an_unknown_name_lists_what_exists(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["paper", "Fig. 11", "figure", "fig8", "--out", str(tmp_path / "out")]) == USAGE
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 2 and "'Fig. 11' (did you mean fig11?); there are table1," in said[0] and "and all." in said[0]
    assert not (tmp_path / "out").exists()


def test_all_is_every_figure_and_a_name_twice_is_one() -> None:
    assert find_figures(["all"]) == PAPER_FIGURES
    assert [figure.name for figure in find_figures(["fig8", "table1", "fig8"])] == ["fig8", "table1"]


def test_a_missing_extra_says_how_to_install_it(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *rest: None if name == "matplotlib" else find(name, *rest)
    )
    assert main(["paper", "table1", "--out", str(tmp_path / "out")]) == USAGE
    assert "pip install 'hdagen[paper]'" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_file_is_no_folder(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "out").write_text("")
    assert main(["paper", "table1", "--out", str(tmp_path / "out")]) == USAGE
    assert "is a file; give a folder." in capsys.readouterr().err


# -- files ------------------------------------------------------------------------------------------------------------


@needs_matplotlib
@pytest.mark.usefixtures("alone")
def test_a_figure_is_written_whole_and_left_alone(
    builds: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    out = tmp_path / "out"
    assert main(["paper", "fig3b", "--out", str(out)]) == 0
    assert "the paper says: torque against torsion" in capsys.readouterr().out
    logs = {f"fig3b_{end}.{kind}" for end in ("loaded", "springs_alone") for kind in ("parquet", "toml")}
    files = {"fig3b.svg", "fig3b.png", "fig3b.json", "sections/fig3b.json"} | logs
    assert made(out) == files
    content = json.loads((out / "fig3b.json").read_text())
    assert content["logs"]["fig3b_loaded.parquet"] == "fig3b_loaded.toml" and content["claims"][0]["holds"] is True
    assert (out / "fig3b.png").read_bytes().startswith(b"\x89PNG") and b"<svg" in (out / "fig3b.svg").read_bytes()
    log = read(out / "fig3b_loaded.parquet", joints=2)
    assert np.abs(log["joint_torque_1"]).max() > 11
    before = {file: (out / file).stat().st_mtime_ns for file in files}
    assert main(["paper", "fig3b", "--out", str(out)]) == 0
    assert "0 made, 1 left as they were" in capsys.readouterr().out
    assert {file: (out / file).stat().st_mtime_ns for file in files} == before
    (out / "fig3b.svg").write_text("damaged")
    assert main(["paper", "fig3b", "--out", str(out)]) == 0
    assert b"<svg" in (out / "fig3b.svg").read_bytes()
    second = json.loads((out / "fig3b.json").read_text())
    assert second["files"] == content["files"], "the same figure, byte for byte"


@needs_matplotlib
@pytest.mark.usefixtures("alone")
def test_an_interrupted_run_keeps_what_is_finished_and_goes_on(
    builds: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    drawn = draw_result

    def stop(result: Result) -> tuple[bytes, bytes]:
        if result.name == "fig8":
            raise KeyboardInterrupt
        return drawn(result)

    with monkeypatch.context() as patch:
        patch.setattr(figure_store, "draw_result", stop)
        assert main(["paper", "table1", "fig8", "--out", str(out)]) == INTERRUPTED
    assert {"table1.json", "table1.svg"} <= made(out) and "fig8.json" not in made(out)
    assert not [name for name in made(out) if name.startswith(".")]
    first = (out / "table1.json").stat().st_mtime_ns
    assert main(["paper", "table1", "fig8", "--out", str(out)]) == 0
    assert (out / "table1.json").stat().st_mtime_ns == first and "fig8.json" in made(out)


@needs_matplotlib
def test_every_kind_of_part_is_drawn_and_stands_on_the_page(tmp_path: Path) -> None:
    t = np.linspace(0, 1, 5000)
    parts: list[Axes | Map | Grid] = [
        Axes("one", "time (s)", "force (N)", [Curve("a", t, np.sin(9 * t)), Curve("b", t, t, "points")],
             bands=[(0.2, 0.4, "pushed")]),
        Axes("two", "x (m)", "y (m)", [Curve("", 0.2 + 0.05 * np.cos(t), 0.05 * np.sin(t))], equal=True,
             marks=[(0.2, 0, "here")]),
        Axes("three", "B (N s/m)", "share (1)", [Curve("s", [1, 10, 100], [1, 2, 3], "step")], log_x=True, log_y=True),
        Map("four", "M (kg)", "B (N s/m)", "settling (s)", [1, 2, 4], [1, 10, 100], [[1.0, np.nan], [3.0, 4.0]]),
        Grid("five", ("a", "b"), [("x", 1.5), ("y", None)]),
    ]  # fmt: skip
    result = Result("fig0", "All kinds", "Words.", parts, [Claim("it says", "it is", None, "<why>")], {"n": np.nan}, 3)
    content = figure_store.store_figure(tmp_path, result, "k", 0.0)
    assert content["numbers"] == {"n": None}
    again = figure_store.store_figure(tmp_path, result, "k", 0.0)
    assert again["files"] == content["files"]
    target = paper_page.write_page(tmp_path, [content], figure_store.read_sections(tmp_path, ["fig0"]))
    html = target.read_text(encoding="utf-8") + (tmp_path / "fig0.html").read_text(encoding="utf-8")
    assert 'href="fig0.html"' in html
    for words in ("All kinds", "it says", "&lt;why", "settling", "Errata", "K_w0 e^"):
        assert words in html, words
    assert "<why>" not in html


@needs_matplotlib
def test_words_that_are_html_are_text(tmp_path: Path) -> None:
    t = np.linspace(0, 1, 50)
    parts: list[Axes | Map | Grid] = [
        Axes(NAME, NAME, NAME, [Curve(NAME, t, t), Curve(f"{NAME}2", t, t, "points")], bands=[(0.2, 0.4, NAME)]),
        Axes(NAME, NAME, NAME, [Curve(NAME, t, t)], equal=True, marks=[(0.2, 0, NAME)]),
        Map(NAME, NAME, NAME, NAME, [1, 2, 4], [1, 10, 100], [[1.0, np.nan], [3.0, 4.0]]),
        Grid(NAME, (NAME, "b"), [(NAME, 1.5)]),
    ]
    result = Result("fig0", NAME, NAME, parts, [Claim(NAME, NAME, True, NAME)], {NAME: 1.0}, 3)
    target = paper_page.write_page(
        tmp_path,
        [figure_store.store_figure(tmp_path, result, "k", 0.0)],
        figure_store.read_sections(tmp_path, ["fig0"]),
    )
    check_escaped(target.read_text(encoding="utf-8"), 3)
    check_escaped((tmp_path / "fig0.html").read_text(encoding="utf-8"), 8)
    svg = (tmp_path / "fig0.svg").read_text(encoding="utf-8")
    assert "<script" not in svg and "<img" not in svg


def test_what_is_not_from_the_same_or_not_whole_is_made_again(tmp_path: Path) -> None:
    (tmp_path / "a.svg").write_text("x")
    kept: dict[str, Any] = {
        "schema": figure_store.FIGURE_SCHEMA,
        "inputs": "k",
        "files": {"a.svg": figure_store.digest_file(tmp_path / "a.svg")},
    }
    (tmp_path / "a.json").write_text(json.dumps(kept))
    assert figure_store.read_finished(tmp_path, "a", "k") == kept
    assert (
        figure_store.read_finished(tmp_path, "a", "other") is None
        and figure_store.read_finished(tmp_path, "b", "k") is None
    )
    (tmp_path / "a.svg").write_text("y")
    assert figure_store.read_finished(tmp_path, "a", "k") is None
    for damage in ("", "[]", '{"schema": 1}', '{"schema": 1, "inputs": "k", "files": {"gone": "0"}}'):
        (tmp_path / "a.json").write_text(damage)
        assert figure_store.read_finished(tmp_path, "a", "k") is None


# -- documents --------------------------------------------------------------------------------------------------------


def test_docs_paper_is_what_its_results_make() -> None:
    text = (ROOT / "docs" / "project" / "paper.md").read_text(encoding="utf-8")
    found = json.loads((ROOT / "docs" / "paper.json").read_text(encoding="utf-8"))
    assert document_tables.render_tables(found) in text
    assert [figure["name"] for figure in found] == [figure.name for figure in PAPER_FIGURES]
    assert document_tables.render_tables(found).count("| yes |") > 20 and "| no |" in document_tables.render_tables(
        found
    )


def test_the_document_s_tables_hold_claims_and_choices() -> None:
    claim = {"paper": "a | b", "here": "c", "holds": True, "why": ""}
    choice = {"question": "q", "taken": "t", "alternatives": "x"}
    text = document_tables.render_tables([{"name": "fig3b", "title": "T", "claims": [claim], "choices": [choice]}])
    assert "| Fig. 3 (b) | a / b | c | yes |  |" in text and "| Fig. 3 (b) | q | t | x |" in text


def test_results_keep_how_long_a_sweep_took() -> None:
    content = {"name": "maps11", "title": "T", "claims": [], "choices": [], "page": "…"}
    took = {"sets": 10_000, "sweep_seconds": 18.0, "sweep_processor_seconds": 24.0}
    (plain,), (swept,) = (
        json.loads(document_tables.collect_results([c])) for c in (content, content | {"numbers": took | {"x": 1}})
    )
    assert "sweep" not in plain and "page" not in plain
    assert swept["sweep"] == took


def test_the_errata_of_the_page_are_those_of_the_document() -> None:
    assert (ROOT / "hdagen" / "data" / "errata.md").read_text(encoding="utf-8") == (
        ROOT / "docs" / "method" / "errata.md"
    ).read_text(encoding="utf-8")
    rows = paper_page.read_errata()
    assert len(rows) > 15 and all(len(row) == 4 for row in rows) and rows[0][0] == "(4)"


def test_the_figures_are_rows_of_one_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(paper_page, "write_page", lambda *_: None)
    monkeypatch.setattr(figure_store, "read_sections", lambda *_: [])
    kept = {"claims": [], "choices": [], "numbers": {"rms": 0.2, "by_joint": [0.1, 0.3]}, "seconds": 1.5}
    paper_command._write_all_figures(tmp_path, [{"name": f"fig{k}", "title": f"Figure {k}", **kept} for k in (1, 2)])
    table = pq.read_table(tmp_path / "results.parquet").to_pylist()
    assert [(one["task"], one["title"], one["status"], one["seconds"]) for one in table] == [
        ("fig1", "Figure 1", "done", 1.5),
        ("fig2", "Figure 2", "done", 1.5),
    ]
    assert json.loads(table[0]["numbers"]) == kept["numbers"]


@pytest.mark.campaign
@needs_matplotlib
def test_all_of_it_and_the_claims_are_those_of_the_document(builds: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert main(["paper", "all", "--out", str(out)]) == 0
    assert (out / "index.html").stat().st_size > 1e6
    fresh = json.loads((out / "results.json").read_text())
    stated = json.loads((ROOT / "docs" / "paper.json").read_text())
    for now, then in zip(fresh, stated, strict=True):
        assert [(c["paper"], c["holds"]) for c in now["claims"]] == [(c["paper"], c["holds"]) for c in then["claims"]]
    for name in ("maps11", "maps12"):
        sweep = json.loads((out / f"{name}.json").read_text())["numbers"]
        assert sweep["sets"] == 10_000 and sweep["sweep_processor_seconds"] < 60, "30 s of two processors"
    for figure in PAPER_FIGURES:
        logs_are_replayed(out, json.loads((out / f"{figure.name}.json").read_text())["logs"], tmp_path)


def logs_are_replayed(out: Path, logs: dict[str, str], tmp_path: Path) -> None:
    """`hdagen replay` takes every log with the robot that its figure names, of more than six every third, and finds
    the joints again."""
    for log, robot in list(logs.items())[:: 1 if len(logs) <= 6 else 3]:
        file = str(out / robot) if robot.endswith(".toml") else robot
        target = tmp_path / "predicted.parquet"
        assert main(["replay", file, str(out / log), "--profile", "native", "--out", str(target)]) == 0, log
        seen, found = (
            read(path, joints=3 if robot == THREE_JOINTS or "joints3" in log else 2) for path in (out / log, target)
        )
        for j in (1, 2):
            assert rms_of(seen[f"joint_position_{j}"] - found[f"joint_position_{j}"]) < 1e-3, (log, j)


def rms_of(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


@needs_matplotlib
@pytest.mark.usefixtures("alone")
def test_logs_of_the_same_arm_have_one_robot_file(builds: Path, tmp_path: Path) -> None:
    assert main(["paper", "fig15", "--out", str(tmp_path)]) == 0
    logs = json.loads((tmp_path / "fig15.json").read_text())["logs"]
    assert logs["fig15_static.parquet"] == logs["fig15_moving.parquet"] != logs["fig15_moving_hall.parquet"]
    robots = {name for name in logs.values() if name.endswith(".toml")}
    assert len({(tmp_path / name).read_bytes() for name in robots}) == len(robots)
    assert {path.name for path in tmp_path.glob("*.toml")} == robots


def interrupted(folder: Path, builds: Path, after: float) -> subprocess.CompletedProcess[str]:
    """`hdagen paper` of several modules, interrupted as from a terminal: the whole group of processes."""
    command = [sys.executable, "-c", PROGRAM, "paper", "fig3b", "fig9", "fig14", "fig18", "--out", str(folder)]
    environment = {**os.environ, "HDAGEN_BUILD": str(builds)}
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment, start_new_session=True
    )
    deadline = time.monotonic() + 120
    while not (folder / "fig3b.json").exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    time.sleep(after)
    os.killpg(process.pid, signal.SIGINT)
    out, errors = process.communicate(timeout=120)
    return subprocess.CompletedProcess(command, process.returncode, out, errors)


@needs_matplotlib
@pytest.mark.usefixtures("alone")
@pytest.mark.parametrize("after", [0.0, pytest.param(0.4, marks=pytest.mark.campaign)])
def test_interrupted_with_workers_it_says_so_once_and_leaves_nothing_half(
    builds: Path, tmp_path: Path, after: float
) -> None:
    done = interrupted(tmp_path, builds, after)
    assert done.returncode == INTERRUPTED and "Traceback" not in done.stderr, done.stderr
    kept = {name for name in made(tmp_path) if name.endswith(".json") and "/" not in name}
    assert "fig3b.json" in kept and not [name for name in made(tmp_path) if Path(name).name.startswith(".")]
    first = {name: (tmp_path / name).stat().st_mtime_ns for name in kept}
    assert main(["paper", *(Path(name).stem for name in kept), "table1", "--out", str(tmp_path)]) == 0
    assert {name: (tmp_path / name).stat().st_mtime_ns for name in kept} == first
