"""MuJoCo's warnings kept by the caller: by itself it writes them to MUJOCO_LOG.TXT in the folder where it runs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def collect_mujoco_warnings() -> Iterator[list[str]]:
    """Collect what MuJoCo warns of, so that it writes no file and prints nothing.

    Yields:
        The warnings so far, one printable line each, each once.

    """
    import mujoco

    told: list[str] = []

    def keep(text: str) -> None:
        line = " ".join(str(text).split())
        if line not in told:
            told.append(line)

    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(keep)
    try:
        yield told
    finally:
        mujoco.set_mju_user_warning(before)
