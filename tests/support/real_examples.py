"""The example scripts of real machines, run as a user runs them, and the recorded logs that they take."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "docs" / "examples"


def recorded(data_dir: Path, pattern: str) -> list[Path]:
    """The recorded files that match, sorted; skips where there is none."""
    files = sorted((data_dir / "real").glob(pattern))
    if not files:
        pytest.skip(f"no recorded logs: nothing matches {data_dir / 'real' / pattern}")
    return files


def run(script: str, *arguments: object, builds: Path | None = None, fails: bool = False) -> str:
    """What docs/examples/``script`` prints with these arguments, warnings as errors; what it complains of if it
    ``fails``."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)} | ({"HDAGEN_BUILD": str(builds)} if builds else {})
    command = [sys.executable, "-W", "error", str(EXAMPLES / script), *map(str, arguments)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=300)
    assert (done.returncode != 0) == fails, done.stderr
    return done.stderr if fails else done.stdout
