"""Work on many things in threads: numpy and the compiled library release the interpreter's lock while they compute."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import Any, TypeVar

from hdagen.support.child_processes import INTERRUPT_PATIENCE, interrupt_child_processes

THREAD_COUNT = 2

Given = TypeVar("Given")
Made = TypeVar("Made")


def map_in_threads(work: Callable[[Given], Made], things: Iterable[Given]) -> list[Made]:
    """Call a function on each of many things, in two threads.

    Each thing is released when its turn has come, so that large ones that nobody else holds are freed. An interrupt
    from the keyboard is passed on to the child processes for which the threads wait, again and again until they end: an
    imported package can swallow it.

    Args:
        work: The function; it must be safe to call from several threads.
        things: Its arguments.

    Returns:
        The results, in the order of ``things``.

    """
    waiting = dict(enumerate(things))
    with ThreadPoolExecutor(THREAD_COUNT) as pool:
        turns = [pool.submit(lambda k: work(waiting.pop(k)), k) for k in list(waiting)]
        try:
            return [turn.result() for turn in turns]
        except BaseException as error:
            running = [turn for turn in turns if not turn.cancel()]
            if isinstance(error, KeyboardInterrupt):
                _interrupt_until_done(running)
            raise


def _interrupt_until_done(turns: list[Future[Any]]) -> None:
    """Interrupt the child processes, and those that swallowed it once more, until the threads have ended."""
    interrupt_child_processes()
    while wait(turns, INTERRUPT_PATIENCE).not_done:
        interrupt_child_processes()
