"""Work on many things in threads: what is numpy or the compiled library lets go of the interpreter."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

THREADS = 2

Given = TypeVar("Given")
Made = TypeVar("Made")


def together(work: Callable[[Given], Made], things: Iterable[Given]) -> list[Made]:
    """``work`` on each of ``things``, in their order; each is let go of when its turn has come, so that large ones that
    nobody else holds do not stay."""
    waiting = dict(enumerate(things))
    with ThreadPoolExecutor(THREADS) as pool:
        return list(pool.map(lambda k: work(waiting.pop(k)), list(waiting)))
