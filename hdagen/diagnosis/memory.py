"""Memory that is kept for the next array.

A diagnosis makes arrays of a few sizes by the hundred, in threads. What glibc gives back to the system at once comes
anew in pages that must be cleared, one thread at a time: a tenth of the time. What is larger than all but a few of them
goes back all the same, as kept in pieces it would not fit the next.
"""

from __future__ import annotations

import contextlib
import ctypes

LARGE = 1 << 24  # bytes, from which an array is mapped by itself and given back
KEPT = 1 << 30  # bytes of free memory at most that are kept
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # malloc.h


def kept() -> None:
    """Have memory kept from now on; nothing where the C library does not know how."""
    with contextlib.suppress(OSError, AttributeError):
        library = ctypes.CDLL(None)
        library.mallopt(_M_MMAP_THRESHOLD, LARGE)
        library.mallopt(_M_TRIM_THRESHOLD, KEPT)
