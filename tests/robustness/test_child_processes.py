"""Child processes end with their parent, whatever ends it: an interrupt that only it hears, an error, a kill."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from arms import SMALL

from hdagen.support.child_processes import start_child_process

ROOT = Path(__file__).parents[2]
SLOW = """#!/bin/sh
case "$*" in *--version*) echo "slow 1.0"; exit 0;; *" -E "*) exec cc "$@";; esac
sleep 600 &
echo "$$ $!" >> {pids}
wait
"""  # a compiler whose own child does the work; the standard headers are preprocessed first, and alone


def lives(pid: int) -> bool:
    """Whether a process is there and not only waits to be asked for its exit code."""
    try:
        os.kill(pid, 0)
        return not Path("/proc").is_dir() or Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (ProcessLookupError, FileNotFoundError):
        return False


def await_true(what: Callable[[], bool]) -> bool:
    """Whether it comes true within a minute."""
    until = time.monotonic() + 60
    while not (found := what()) and time.monotonic() < until:
        time.sleep(0.02)
    return found


@pytest.fixture
def slow(tmp_path: Path) -> Callable[[], list[int]]:
    """A compiler without an end in ``tmp_path``/cc; gives the processes that it has begun."""
    compiler, pids = tmp_path / "cc", tmp_path / "pids"
    compiler.write_text(SLOW.format(pids=pids))
    compiler.chmod(0o755)
    return lambda: [int(pid) for pid in pids.read_text().split()] if pids.exists() else []


GEN = ("-m", "gen", "build")
HDAGEN = ("-c", "import sys, hdagen; hdagen.load_robot(sys.argv[1])")
DIAGNOSIS = ("-c", "import sys; from hdagen.diagnosis.data.models import load_models; load_models(sys.argv[1])")


@pytest.mark.parametrize("program", [GEN, HDAGEN, DIAGNOSIS], ids=["gen", "hdagen", "two builds in threads"])
@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_compilers_end_with_the_one_that_began_them(
    slow: Callable[[], list[int]], tmp_path: Path, program: tuple[str, ...], end: signal.Signals
) -> None:
    (tmp_path / "robot.toml").write_text(SMALL)
    own = {"CC": str(tmp_path / "cc"), "PYTHONPATH": str(ROOT), "HDAGEN_BUILD": str(tmp_path / "build")}
    command = [sys.executable, *program, str(tmp_path / "robot.toml")]
    with subprocess.Popen(command, cwd=tmp_path, env=os.environ | own, stderr=subprocess.DEVNULL) as parent:
        try:
            assert await_true(lambda: len(slow()) >= 4), "two compilers with a child each"
            parent.send_signal(end)
            parent.wait(60)
        finally:
            parent.kill()
    assert await_true(lambda: not any(map(lives, slow()))), "compilers were left behind"
    if end is signal.SIGINT:
        assert sorted(path.name for path in (tmp_path / "build").iterdir()) == [".lock"]


def test_a_group_ends_with_its_block(tmp_path: Path) -> None:
    program = ["/bin/sh", "-c", f"sleep 600 & echo $! > {tmp_path}/one; mv {tmp_path}/one {tmp_path}/pid; wait"]
    with pytest.raises(KeyError), start_child_process(program) as child:  # noqa: PT012
        assert await_true((tmp_path / "pid").exists)
        raise KeyError
    assert child.returncode == -signal.SIGKILL
    assert await_true(lambda: not lives(int((tmp_path / "pid").read_text())))
    with start_child_process(["true"]) as child:
        assert child.wait() == 0


SWALLOWED = """
import os, signal, sys
from hdagen.support.child_processes import start_child_process
from hdagen.support import parallel
parallel.INTERRUPT_PATIENCE = 0.5
deaf = "import time\\ntry:\\n    print(flush=True)\\n    time.sleep(600)\\nexcept: time.sleep(600)"
def wait_for_deaf_child(k):
    with start_child_process([sys.executable, "-c", deaf], stdout=-1, stderr=-3) as child:
        child.stdout.readline()
        if k:
            os.kill(os.getpid(), signal.SIGINT)
        return child.wait()
parallel.map_in_threads(wait_for_deaf_child, range(2))
"""


def test_an_interrupt_that_a_child_swallows_is_sent_again() -> None:
    with subprocess.Popen(
        [sys.executable, "-c", SWALLOWED], env=os.environ | {"PYTHONPATH": str(ROOT)}, stderr=subprocess.PIPE, text=True
    ) as parent:
        try:
            said = parent.communicate(timeout=60)[1]
        finally:
            parent.kill()
    assert parent.returncode == -signal.SIGINT
    assert said.rstrip().endswith("KeyboardInterrupt")
