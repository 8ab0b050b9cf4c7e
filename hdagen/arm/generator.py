"""The generator `gen` as a child process: hdagen never imports it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from hdagen.arm.running_builds import PROGRESS_MARK, tell_build_stage
from hdagen.support.child_processes import INTERRUPT_PATIENCE, start_child_process


@dataclass(frozen=True)
class GeneratorRun:
    """The outcome of a run of the generator.

    Attributes:
        code: Its exit code.
        lines: The lines that it printed.
        messages: The lines of its standard error.

    """

    code: int
    lines: tuple[str, ...]
    messages: tuple[str, ...]


def run_generator(*arguments: str, module: str = "gen") -> GeneratorRun:
    """Run the generator in a child process.

    Its message that a build begins is passed on to standard error at once, its stages to who listens to builds.

    Args:
        arguments: The words of its command line.
        module: The module to run, `gen` or one of its modules with a `main`.

    Returns:
        The outcome.

    Raises:
        OSError: The child process cannot be started.

    """
    command = [sys.executable, "-P", "-m", module, *arguments]
    beside = os.pathsep.join(filter(None, (str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH"))))
    # its output goes to a file: of two pipes of which only one is read, each can wait for the other
    with (
        tempfile.TemporaryFile("w+") as printed,
        start_child_process(
            command,
            stdin=subprocess.DEVNULL,
            stdout=printed,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
            env={**os.environ, "PYTHONPATH": beside},
        ) as child,
    ):
        messages = []
        try:
            for line in child.stderr or ():
                if line.startswith(PROGRESS_MARK):
                    tell_build_stage(child.pid, line.removeprefix(PROGRESS_MARK).rstrip())
                    continue
                messages.append(line.rstrip())
                if line.startswith("building"):
                    print(line.rstrip(), file=sys.stderr, flush=True)
            child.wait()
        except KeyboardInterrupt:
            child.send_signal(signal.SIGINT)
            with suppress(subprocess.TimeoutExpired):
                child.wait(INTERRUPT_PATIENCE)
            raise
        finally:
            tell_build_stage(child.pid, "")
        printed.seek(0)
        return GeneratorRun(child.returncode, tuple(printed.read().splitlines()), tuple(messages))
