"""README and docs state what the last runs measured, and every bar as it was reached."""

from __future__ import annotations

import copy
import tomllib
from importlib import resources
from pathlib import Path
from typing import Any

import pytest

from hdagen.bench import measured_tables, published_figures
from hdagen.bench.benchmark import BAR_FILES, BenchRequirement

ROOT = Path(__file__).parents[1]
DOCUMENTS = published_figures.list_documents(ROOT)


@pytest.fixture(scope="module")
def found() -> dict[str, Any]:
    return published_figures.read_sources(ROOT)


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_a_document_is_what_the_last_runs_make_it(path: Path, found: dict[str, Any]) -> None:
    text = path.read_text(encoding="utf-8")
    assert published_figures.update_tables(text, found) == text, (
        "call `python -m hdagen.bench.published_figures` in the project's folder"
    )


def test_every_table_stands_somewhere() -> None:
    text = "".join(path.read_text(encoding="utf-8") for path in DOCUMENTS)
    assert [name for name in published_figures.DOCUMENT_TABLES if f"<!-- {name}: begin -->" not in text] == []


@pytest.mark.parametrize(("source", "robot"), [("bench", "paper"), ("panda", "panda")])
def test_the_bars_of_the_last_run_are_those_of_today(source: str, robot: str, found: dict[str, Any]) -> None:
    asked = tomllib.loads((resources.files("hdagen.bench") / BAR_FILES[robot]).read_text())
    bars = {bar["name"]: BenchRequirement(**bar) for bar in found[source]["bars"]}
    assert {name: (bar.bar, bar.bound, bar.unit) for name, bar in bars.items()} == {
        name: (entry["bar"], entry["bound"], entry["unit"]) for name, entry in asked.items()
    }, f"call {published_figures.SOURCES[source]}, then `python -m hdagen.bench.published_figures`"
    for bar in bars.values():
        reached = bar.reached >= bar.bar if bar.bound == "least" else bar.reached <= bar.bar
        assert bar.met in (reached, None)


def test_a_missed_bar_stands_there_as_missed(found: dict[str, Any]) -> None:
    changed = copy.deepcopy(found)
    (bar,) = (bar for bar in changed["bench"]["bars"] if bar["name"] == "python_call_over_empty_call")
    bar |= {"bar": 150.0, "reached": 165.0, "met": False}
    for table in (measured_tables.build_reached_table, measured_tables.build_bench_tables):
        (line,) = (line for line in table(changed).splitlines() if "165" in line)
        assert "at most 150 ns" in line
        assert "**missed by 10 %**" in line
    bar |= {"reached": 140.0, "met": True}
    (line,) = (
        line
        for line in measured_tables.build_bench_tables(changed).splitlines()
        if "python_call_over_empty_call" in line
    )
    assert "missed" not in line


def test_a_real_machine_s_page_says_what_is_there_and_what_remains(found: dict[str, Any]) -> None:
    friction = {"coulomb_friction": {"value": 20.877, "std": 0.66, "unit": "N m"}}
    case = {
        "machine": "a slide",
        "page": "emps",
        "answer": "coulomb_friction@1",
        "verdict": ["coulomb_friction@1", "unknown@1"],
        "sure": False,
        "before": 1634.4,
        "after": 157.29,
        "achievable": 12.34,
        "closed": 0.9106,
        "named": True,
        "sizes": {"coulomb_friction@1": friction},
    }
    changed = dict(found) | {
        "real": {"cases": [case, case | {"page": "bam", "verdict": [], "named": False}], "bars": []}
    }
    *_, line = published_figures.DOCUMENT_TABLES["real emps"](changed).splitlines()
    assert line == (
        "| a slide | coulomb_friction@1 | `coulomb_friction@1` (20.9 ± 0.7 N m) | `unknown@1` | no "
        "| 1634 | 157 | 12.3 | 91 % |"
    )
    *_, line = published_figures.DOCUMENT_TABLES["real bam"](changed).splitlines()
    assert line.startswith("| a slide | coulomb_friction@1: **missed** | nothing named |  | no |")


def test_a_figure_says_where_and_when_it_was_measured(found: dict[str, Any]) -> None:
    changed = copy.deepcopy(found)
    changed["bench"]["machine"] |= {"date": "2031-02-03", "load": "0.1"}
    assert "2031-02-03" in measured_tables.build_reached_table(
        changed
    ) and ", idle;" in measured_tables.build_reached_table(changed)
    changed["bench"]["machine"]["load"] = "7.3"
    assert "7.3 other programs" in measured_tables.build_reached_table(changed)


def test_a_marker_alone_is_refused(found: dict[str, Any]) -> None:
    assert published_figures.update_tables("no marker", found) == "no marker"
    with pytest.raises(ValueError, match="stand in this order"):
        published_figures.update_tables("<!-- blind: begin -->\nand the rest of the document", found)


def test_the_command_prints_what_it_changed(
    found: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert published_figures.main() == 2
    assert "there is no such file" in capsys.readouterr().err
    for path, _ in published_figures.SOURCES.values():
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_bytes((ROOT / path).read_bytes())
    (tmp_path / "README.md").write_text("before\n<!-- blind: begin -->\nold\n<!-- blind: end -->\nafter\n")
    assert published_figures.main() == 0
    assert capsys.readouterr().out == "README.md\n"
    text = (tmp_path / "README.md").read_text()
    assert text.startswith("before\n<!-- blind: begin -->\n| measured on |") and text.endswith("end -->\nafter\n")
    assert published_figures.main() == 0
    assert capsys.readouterr().out == ""


def test_the_page_of_the_real_machine_says_the_same(found: dict[str, Any]) -> None:
    text = (ROOT / "docs" / "examples" / "emps" / "README.md").read_text(encoding="utf-8")
    (replayed,) = (line for line in text.splitlines() if line.startswith("| replay |"))
    (forces,) = (line for line in text.splitlines() if line.startswith("| force error |"))
    for log, cell in (("identification", 2), ("pulses", 3)):
        assert replayed.split("|")[cell].strip() == f"{1e3 * found[log]['errors']['joint_position_1']:.3f} mm"
        assert forces.split("|")[cell].strip().startswith(f"{100 * found[log]['force_error'][0]:.1f} %")
