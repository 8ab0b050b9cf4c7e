"""A cold build of seven flexible joints with every effect, against one of seven rigid joints."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from space_robots import flexible_panda

ROOT = Path(__file__).parents[2]
RIGID_SECONDS, FLEXIBLE_SECONDS = 20.0, 90.0  # that the two builds may take on two processors
LARGEST_LIBRARY = 3e6  # bytes
PROGRAM = """
import json, resource, sys
from gen.__main__ import main
code = main(["build", *sys.argv[1:]])
own, compilers = (resource.getrusage(whose) for whose in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
print(json.dumps([used.ru_utime + used.ru_stime for used in (own, compilers)]))
sys.exit(code)
"""


def build_cold(out: Path, *words: str) -> tuple[float, Path]:
    """Processor time of a build from nothing, s, where two processors share the compiling; and its folder."""
    command = [sys.executable, "-c", PROGRAM, *words, "--out", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=True)
    folder, times = done.stdout.splitlines()
    own, compilers = json.loads(times)
    return own + compilers / 2, Path(folder)


@pytest.mark.campaign
def test_seven_flexible_joints_with_every_effect_build_in_time(tmp_path: Path) -> None:
    """Against the rigid arm in the same run, for a busy or a slow machine takes longer for both."""
    robot = tmp_path / "robot.toml"
    robot.write_text(flexible_panda(7))
    rigid, _ = build_cold(tmp_path / "rigid", "panda")
    flexible, folder = build_cold(tmp_path / "flexible", str(robot), "--effects", "all")
    assert flexible / rigid <= FLEXIBLE_SECONDS / RIGID_SECONDS
    manifest = json.loads((folder / "manifest.json").read_text())
    assert len(manifest["flexible"]) == 7 and len(manifest["effects"]) >= 35
    assert (folder / manifest["library"]).stat().st_size <= LARGEST_LIBRARY
