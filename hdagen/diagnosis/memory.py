"""Memory that goes back to the system when an array is let go of.

glibc maps a large array by itself, until one of up to 32 MB is freed; from then on it keeps such blocks for reuse, in
pieces that the next arrays do not fit. A diagnosis makes arrays of a few sizes by the hundred, and would hold a third
more memory than it uses.
"""

from __future__ import annotations

import contextlib
import ctypes

LARGE = 1 << 20  # bytes, from which an array is mapped by itself
_M_MMAP_THRESHOLD = -3  # malloc.h


def returned() -> None:
    """Have large arrays mapped by themselves from now on; nothing where the C library does not know how."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).mallopt(_M_MMAP_THRESHOLD, LARGE)
