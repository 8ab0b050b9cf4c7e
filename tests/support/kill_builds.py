"""Builds that are killed at random moments, one after the other; prints what was found as JSON.

kill_builds.py ROBOT OUT COUNT SEED SECONDS makes COUNT kills at most, begun within SECONDS.

It forks itself when all is imported and the equations are assembled, so that kills fall into the writing of files.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import sys
import time
from pathlib import Path

from gen.builder import build as builds
from gen.builder import build_files  # noqa: F401 - a fork finds it imported
from gen.robot.load_robot import load


def started(robot: str, out: Path) -> int:
    """The process that builds; it says nothing."""
    child = os.fork()
    if child:
        return child
    code = 1
    try:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
        builds.build_robot(robot, "portable", out)
        code = 0
    finally:
        os._exit(code)


def await_part(out: Path, seconds: float) -> None:
    """Until a folder is being made, or the time is over."""
    until = time.monotonic() + seconds
    while time.monotonic() < until and not any(builds.PARTIAL_BUILD_PREFIX in path.name for path in out.iterdir()):
        time.sleep(1e-4)


def main(robot: str, out: Path, count: int, seed: int, seconds: float) -> dict[str, int]:
    """Counts of kills, of those in mid-build, of builds that stood whole, of what was wrong."""
    rng, found = random.Random(seed), dict.fromkeys(("kills", "leftovers", "whole", "broken", "uncleaned", "failed"), 0)
    folder, name, _ = builds.locate_build(robot, "portable", out)
    made = builds.assemble_library(robot, load(robot), ())
    builds.assemble_library = lambda *_: made
    begun = time.monotonic()
    _, status = os.waitpid(started(robot, out), 0)
    took, found["failed"] = time.monotonic() - begun, int(status != 0)
    shutil.rmtree(folder)
    while found["kills"] < count and time.monotonic() < begun + seconds:
        child = started(robot, out)
        if found["kills"] % 2:  # every other one surely while files are written, however busy the machine is
            await_part(out, 5 * took)
        time.sleep(rng.uniform(0.0, took))
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        found["kills"] += 1
        found["leftovers"] += any(builds.PARTIAL_BUILD_PREFIX in path.name for path in out.iterdir())
        whole = builds.is_intact(folder, name)
        found["whole"] += whole
        found["broken"] += folder.exists() and not whole
        if whole or found["kills"] % 20 == 0:
            _, status = os.waitpid(started(robot, out), 0)
            found["failed"] += status != 0 or not builds.is_intact(folder, name)
            found["uncleaned"] += not whole and {p.name for p in out.iterdir()} - {".objects"} != {".lock", folder.name}
            shutil.rmtree(folder)
    return found


if __name__ == "__main__":
    print(json.dumps(main(sys.argv[1], Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]), float(sys.argv[5]))))
