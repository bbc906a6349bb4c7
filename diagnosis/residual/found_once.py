"""What samples alone say, found once for the same bytes: steps of a diagnosis ask for the same angles a dozen times."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import wraps

import numpy as np

from arm_io.types import Array

KEPT = 1024
"""Answers that each function keeps in memory."""


def found_once(find: Callable[[Array], float]) -> Callable[[Array], float]:
    """``find`` of samples (m,), whose answers are kept by the bytes of the samples."""
    found: dict[bytes, float] = {}

    @wraps(find)
    def kept(values: Array) -> float:
        same = hashlib.blake2b(np.asarray(values, float).tobytes(), digest_size=16).digest()
        if same not in found:
            if len(found) >= KEPT:
                found.pop(next(iter(found)), None)
            found[same] = find(values)
        return found[same]

    return kept
