"""Filters forwards and backwards, as scipy's ``sosfiltfilt``, to the last bit.

scipy solves for the initial states of the sections at every call, which takes as long as filtering some thousand rows:
they depend on the sections alone, and are kept here.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy import signal

from arm_io.types import Array


def zero_phase(sections: Array, values: Array, *, pad: int | None = None) -> Array:
    """Values (m,) or (m, n), filtered along the first axis by second-order ``sections`` (k, 6), forwards and back.

    pad: rows by which the ends are continued, odd about the first and the last; by default as many as scipy takes.
    """
    sections = np.asarray(sections, float)
    pad = _default_pad(sections) if pad is None else pad
    if pad >= len(values):
        raise ValueError(f"{len(values)} rows cannot be continued by {pad}")
    rows = np.ascontiguousarray(np.asarray(values, float).T)
    ends = (
        2 * rows[..., :1] - rows[..., pad:0:-1],
        2 * rows[..., -1:] - rows[..., -2 : -(pad + 2) : -1],
    )
    continued = np.concatenate([ends[0], rows, ends[1]], axis=-1) if pad else rows
    states = _states(sections.tobytes()).reshape(len(sections), *[1] * (rows.ndim - 1), 2)
    forwards, _ = signal.sosfilt(sections, continued, zi=states * continued[..., :1])
    backwards, _ = signal.sosfilt(sections, forwards[..., ::-1], zi=states * forwards[..., -1:])
    smooth = backwards[..., ::-1]
    return np.asarray((smooth[..., pad:-pad] if pad else smooth).T, float)


def _default_pad(sections: Array) -> int:
    """That of ``sosfiltfilt``: three times the length of the filter, without the zeros that one section leaves."""
    return 3 * int(2 * len(sections) + 1 - min(np.sum(sections[:, 2] == 0.0), np.sum(sections[:, 5] == 0.0)))


@lru_cache(maxsize=256)
def _states(sections: bytes) -> Array:
    """(k, 2) states of the sections at rest on a constant 1."""
    states: Array = signal.sosfilt_zi(np.frombuffer(sections).reshape(-1, 6))
    return states
