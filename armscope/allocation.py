"""How a command that computes for seconds, and then ends, takes memory."""

from __future__ import annotations

import ctypes
import gc
import sys

TRIM_THRESHOLD, MMAP_THRESHOLD = -1, -3
"""M_TRIM_THRESHOLD and M_MMAP_THRESHOLD of mallopt(3)."""
KEPT, LARGEST = 1 << 28, 1 << 25
"""Bytes of freed memory that are kept for the next array, and of the largest array that is taken from them."""
OBJECTS = 50_000
"""More containers than at the last collection, from which rings of them are searched for."""


def for_computation() -> None:
    """Keeps freed memory for later arrays, and runs the garbage collector less often.

    Arrays of megabytes come and go in thousands: the kernel clears every page that it hands out, which was a tenth of
    the time of a diagnosis. Imports make a hundred thousand objects that stay.
    """
    gc.set_threshold(OBJECTS)
    if sys.platform == "linux" and hasattr(libc := ctypes.CDLL(None), "mallopt"):
        libc.mallopt(MMAP_THRESHOLD, LARGEST)
        libc.mallopt(TRIM_THRESHOLD, KEPT)
