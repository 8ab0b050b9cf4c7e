"""Work on many things in threads: numpy and the compiled library release the interpreter's lock while they compute."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from hdagen.support.child_processes import interrupt_child_processes

THREAD_COUNT = 2

Given = TypeVar("Given")
Made = TypeVar("Made")


def map_in_threads(work: Callable[[Given], Made], things: Iterable[Given]) -> list[Made]:
    """Call a function on each of many things, in two threads.

    Each thing is released when its turn has come, so that large ones that nobody else holds are freed. An interrupt
    from the keyboard is passed on to the child processes for which the threads wait.

    Args:
        work: The function; it must be safe to call from several threads.
        things: Its arguments.

    Returns:
        The results, in the order of ``things``.

    """
    waiting = dict(enumerate(things))
    with ThreadPoolExecutor(THREAD_COUNT) as pool:
        try:
            return list(pool.map(lambda k: work(waiting.pop(k)), list(waiting)))
        except KeyboardInterrupt:
            interrupt_child_processes()
            raise
