"""The C library's heap, kept from fragmenting: for a process that handles blocks of rows for days."""

from __future__ import annotations

import ctypes

M_MMAP_THRESHOLD = -3
"""mallopt(3)."""
LARGE = 128 * 1024


def return_large_blocks() -> None:
    """From now on every block of 128 KiB or more goes back to the system when it is freed.

    glibc begins so, but raises the limit, up to 32 MiB, to whatever it has seen freed. Blocks of rows then lie in its
    heaps among small ones that live long: at 20 kHz some 60 MB of holes come together within half an hour
    (docs/endurance.md). A fixed limit ends that. Where the C library has no ``mallopt``, nothing happens.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(M_MMAP_THRESHOLD, LARGE)
