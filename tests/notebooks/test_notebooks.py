"""The notebooks of docs/notebooks run as scripts, quickly, and leave nothing behind."""

from __future__ import annotations

import os
import re
import resource
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.py"))
MOST_SECONDS = 60.0  # of a processor, for a notebook with the builds that it needs


def spent() -> float:
    """Processor time of all finished child processes, s."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def test_there_are_three() -> None:
    assert [path.stem for path in NOTEBOOKS] == ["diagnose_a_log", "read_a_verdict", "simulate_and_control"]


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_and_leaves_nothing(notebook: Path, tmp_path: Path) -> None:
    places = {name: tmp_path / name for name in ("home", "scratch", "here")}
    for place in places.values():
        place.mkdir()
    environment = os.environ | {
        "PYTHONPATH": str(ROOT),
        "HOME": str(places["home"]),
        "TMPDIR": str(places["scratch"]),
        "OMP_NUM_THREADS": "1",
    }
    before = spent()
    done = subprocess.run(
        [sys.executable, "-B", "-W", "error", str(notebook)],
        cwd=places["here"],
        env=environment,
        capture_output=True,
        text=True,
        timeout=900,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert spent() - before < MOST_SECONDS
    assert done.stdout.strip()
    assert [str(path) for place in places.values() for path in place.rglob("*")] == []


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_cells_of_text_and_code(notebook: Path) -> None:
    """The percent format: a first cell of text with a title, and cells that each begin with a marker."""
    cells = re.split(r"^# %%", notebook.read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert cells[0] == "" and cells[1].startswith(" [markdown]\n# # ")
    for cell in cells[1:]:
        marker, *lines = cell.rstrip().splitlines()
        assert marker in ("", " [markdown]") and lines
        if marker:
            assert all(line.startswith("#") for line in lines)
