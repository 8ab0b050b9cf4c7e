"""Child processes that end with this one, however it ends."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from threading import Lock
from typing import Any

INTERRUPT_PATIENCE = 5.0  # s that an interrupted child has to remove its files and to end

# Leader of the process group; it kills the group when the pipe ends
_WATCHDOG_COMMAND = ("/bin/sh", "-c", "read -r end; kill -9 0")
_running_children = list[subprocess.Popen[Any]]()
_children_lock = Lock()


@contextmanager
def start_child_process(command: Sequence[str], **how: Any) -> Iterator[subprocess.Popen[Any]]:
    """Start a child process in a process group of its own, which is killed when the block ends.

    The group is killed as well when this process is killed: a shell in it waits for the end of a pipe that only this
    process holds. An interrupt from the keyboard does not reach the group.

    Args:
        command: The program and its arguments.
        how: Further arguments of `subprocess.Popen`.

    Yields:
        The child.

    Raises:
        OSError: The child cannot be started.

    """
    with subprocess.Popen(_WATCHDOG_COMMAND, stdin=subprocess.PIPE, process_group=0) as watch:
        try:
            with subprocess.Popen(command, process_group=watch.pid, **how) as child:
                with _children_lock:
                    _running_children.append(child)
                try:
                    yield child
                finally:
                    with _children_lock:
                        _running_children.remove(child)
                    if child.poll() is None:
                        os.killpg(watch.pid, signal.SIGKILL)
        finally:
            if watch.poll() is None:
                os.killpg(watch.pid, signal.SIGKILL)


def interrupt_child_processes() -> None:
    """Interrupt all child processes that run, as the keyboard would, so that threads which wait for them go on."""
    with _children_lock:
        for child in _running_children:
            child.send_signal(signal.SIGINT)
