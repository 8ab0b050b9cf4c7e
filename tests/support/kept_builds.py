"""The folder of the builds of tests: kept from run to run and shared by workers, checkouts and branches.

A build is found by a hash of everything that decides its content, `gen`'s own files among it, and is checked whenever
it is taken; so a kept one is the one that would be built now. Two that want the same build wait for each other: it is
made once.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from functools import cache
from pathlib import Path

MOST_BUILDS = 600  # that are kept, the newest; a run makes about 200


@cache
def find_builds() -> Path:
    """The folder, which belongs to this user alone: in the user's cache, else with the temporary files."""
    folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "hdagen-tests"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError:
        folder = Path(tempfile.gettempdir()) / f"hdagen-tests-{os.getuid()}"
        folder.mkdir(mode=0o700, exist_ok=True)
    return folder


def remove_old_builds() -> None:
    """Throw away the oldest beyond MOST_BUILDS."""
    builds = [path for path in find_builds().iterdir() if path.is_dir() and not path.name.startswith(".")]
    for old in sorted(builds, key=lambda path: path.stat().st_mtime)[:-MOST_BUILDS]:
        shutil.rmtree(old, ignore_errors=True)
