"""How the C library's malloc keeps freed memory.

A diagnosis makes arrays of a few sizes by the hundred, in threads. By default glibc keeps large ones in pieces that the
next ones do not fit, which takes a third more memory. It returns small ones at once, so that the next ones come in
pages that must be cleared, one thread at a time. That takes a tenth of the time.
"""

from __future__ import annotations

import contextlib
import ctypes

MMAP_THRESHOLD = 1 << 20  # bytes, from which an array is mapped by itself and returned to the system
TRIM_THRESHOLD = 1 << 26  # bytes of free memory that are kept for the next arrays
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # malloc.h


def tune_malloc() -> None:
    """Set malloc's thresholds for the rest of the process; do nothing where the C library does not know them."""
    with contextlib.suppress(OSError, AttributeError):
        library = ctypes.CDLL(None)
        library.mallopt(_M_MMAP_THRESHOLD, MMAP_THRESHOLD)
        library.mallopt(_M_TRIM_THRESHOLD, TRIM_THRESHOLD)
