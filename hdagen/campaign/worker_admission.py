"""Which workers of a cluster take tasks: those with the same installation as this process."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from hdagen.campaign.installation import describe_installation, explain_difference

if TYPE_CHECKING:
    from distributed import Client

LOOK_INTERVAL = 2.0  # s between looks for workers that came or left
LONELY_LOOK_INTERVAL = 0.2  # s between looks while no worker takes tasks


async def compare_worker(wanted: dict[str, str]) -> str:
    """Compare a worker's installation with the client's; runs on the worker, in its event loop.

    Args:
        wanted: The client's installation.

    Returns:
        How they differ; empty where they agree.

    """
    with suppress(ValueError):  # a worker whose event loop is not in its main thread
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal's interrupt is the client's to hear
    return explain_difference(wanted, describe_installation())


async def end_process() -> None:
    """End the worker's process, whatever its task does; runs on the worker, whose supervisor starts it again."""
    os._exit(1)


class Admission:
    """Admits the workers of a cluster as they come, and says a sentence for each that cannot take tasks."""

    def __init__(self, client: Client, say: Callable[[str], None]) -> None:
        self._client = client
        self._say = say
        self._known: set[str] = set()
        self._last_look = float("-inf")
        self.admitted: set[str] = set()
        self.refused: dict[str, str] = {}

    def look_if_due(self) -> None:
        """Look for workers where the last look is some time ago."""
        interval = LOOK_INTERVAL if self.admitted else LONELY_LOOK_INTERVAL
        if time.monotonic() - self._last_look >= interval:
            self.look_for_workers()

    def look_for_workers(self) -> None:
        """Admit or refuse the workers that came since the last look; forget those that left."""
        self._last_look = time.monotonic()
        present = set(self._client.nthreads())
        self._known &= present
        self.admitted &= present
        for address in self.refused.keys() - present:
            del self.refused[address]
        new = sorted(present - self._known)
        if not new:
            return
        wanted = describe_installation()
        answers: dict[str, Any] = self._client.run(compare_worker, wanted, workers=new, on_error="return")
        for address in new:
            answer = answers.get(address)
            if answer is None or isinstance(answer, OSError):  # it left meanwhile, or answers at the next look
                continue
            self._known.add(address)
            if answer == "":
                self.admitted.add(address)
                continue
            if isinstance(answer, Exception):  # of another class where it comes from the reading of the message
                answer = f"it cannot load hdagen ({answer}); install the same hdagen there"
            self._refuse(address, str(answer))

    def _refuse(self, address: str, why: str) -> None:
        self.refused[address] = why
        self._say(f"worker {address} takes no task: {why}.")

    def dismiss(self, address: str, why: str) -> None:
        """Give a worker no more tasks.

        Args:
            address: The worker.
            why: What it cannot do.

        """
        if address not in self.admitted:
            return
        self.admitted.discard(address)
        self._refuse(address, why)

    def is_lost(self, address: str) -> bool:
        """Tell whether a worker has left the cluster.

        Args:
            address: The worker.

        Returns:
            Whether it was gone at the last look.

        """
        return address not in self._known
