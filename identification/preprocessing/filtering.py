"""Filters forwards and backwards, as scipy's ``sosfiltfilt``, to the last bit.

scipy filters one series after the other, and each row waits for the one before: here several wait beside each other.
It solves for the initial states of the sections at every call, which takes as long as filtering some thousand rows:
they depend on the sections alone, and are kept here.
"""

from __future__ import annotations

from functools import cache, lru_cache

import numpy as np
from scipy import signal

from arm_io.types import Array
from arm_model.symbolic import Expr, Steps, Tape, steps_of

SERIES_TOGETHER = 8
"""Series that are filtered side by side."""


@lru_cache(maxsize=256)
def butterworth(order: int, cut: float) -> Array:
    """(k, 6) second-order sections of a low-pass with a gain of 1/sqrt(2) at ``cut``, of half the rate of the rows.

    Read-only: all callers share them. A cut above 0.98 is 0.98.
    """
    sections: Array = signal.butter(order, min(cut, 0.98), output="sos")
    sections.setflags(write=False)
    return sections


def zero_phase(sections: Array, values: Array, *, pad: int | None = None) -> Array:
    """Values (m, ...), filtered along the first axis by second-order ``sections`` (k, 6), forwards and back.

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
    smooth = _both_ways(sections, continued.reshape(-1, continued.shape[-1])).reshape(continued.shape)
    return np.asarray((smooth[..., pad:-pad] if pad else smooth).T, float)


def _both_ways(sections: Array, rows: Array) -> Array:
    """Series (n, m), filtered forwards and back; the states begin as if the first value had always been."""
    numbers, at_rest = np.delete(sections, 3, axis=1).ravel(), _states(sections.tobytes()).ravel()
    smooth = []
    for beside in np.split(rows, range(SERIES_TOGETHER, len(rows), SERIES_TOGETHER)):
        cascade = _cascade(len(sections), len(beside))
        forwards = cascade(numbers, beside[:, :1] * at_rest, beside)
        smooth.append(cascade(numbers, forwards[:, -1:] * at_rest, forwards, backwards=True))
    return np.concatenate(smooth) if len(smooth) > 1 else smooth[0]


@cache
def _cascade(sections: int, series: int) -> Steps:
    """Second-order sections one after the other, each in transposed direct form II, as scipy's ``sosfilt``."""
    tape = Tape()
    value, following, numbers = tape.input("value"), dict[str, Expr](), list[str]()
    for k in range(sections):
        names = [f"{name}{k}" for name in ("b0", "b1", "b2", "a1", "a2")]
        b0, b1, b2, a1, a2 = map(tape.input, names)
        given, value = value, b0 * value + tape.input(f"first{k}")
        following[f"first{k}"] = b1 * given - a1 * value + tape.input(f"second{k}")
        following[f"second{k}"] = b2 * given - a2 * value
        numbers += names
    return steps_of(tape, value, following, columns=["value"], numbers=numbers, series=series)


def _default_pad(sections: Array) -> int:
    """That of ``sosfiltfilt``: three times the length of the filter, without the zeros that one section leaves."""
    return 3 * int(2 * len(sections) + 1 - min(np.sum(sections[:, 2] == 0.0), np.sum(sections[:, 5] == 0.0)))


@lru_cache(maxsize=256)
def _states(sections: bytes) -> Array:
    """(k, 2) states of the sections at rest on a constant 1."""
    states: Array = signal.sosfilt_zi(np.frombuffer(sections).reshape(-1, 6))
    return states
