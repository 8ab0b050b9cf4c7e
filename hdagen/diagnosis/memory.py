"""What memory is kept for the next array, and what goes back to the system.

A diagnosis makes arrays of a few sizes by the hundred, in threads. glibc would keep large ones in pieces that the next
do not fit, a third more memory than is used, and give small ones back at once, to be had anew in pages that must be
cleared, one thread at a time: a tenth of the time.
"""

from __future__ import annotations

import contextlib
import ctypes

LARGE = 1 << 20  # bytes, from which an array is mapped by itself, and given back
KEPT = 1 << 26  # bytes of free memory, up to which the rest is kept
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # malloc.h


def kept() -> None:
    """Have it so from now on; nothing where the C library does not know how."""
    with contextlib.suppress(OSError, AttributeError):
        library = ctypes.CDLL(None)
        library.mallopt(_M_MMAP_THRESHOLD, LARGE)
        library.mallopt(_M_TRIM_THRESHOLD, KEPT)
