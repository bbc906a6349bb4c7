"""Noise as a function of its index: the same value whoever asks, in whatever order and however time is cut into blocks.

A counter-based generator: SplitMix64 (Steele, Lea and Flood, "Fast splittable pseudorandom number generators", OOPSLA
2014) evaluated at any index, and a table of the normal distribution. numpy's generators are sequential, and would tie a
sample's noise to how many samples were asked for before it.
"""

from __future__ import annotations

import hashlib
from functools import cache
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

_STEP = np.uint64(0x9E3779B97F4A7C15)
"""2^64 / golden ratio."""
_FIRST = np.uint64(0xBF58476D1CE4E5B9)
_SECOND = np.uint64(0x94D049BB133111EB)
_S30, _S27, _S31, _S12 = (np.uint64(bits) for bits in (30, 27, 31, 12))
_SHIFTS = tuple(np.uint64(bits) for bits in (0, 16, 32, 48))
_LOW16 = np.uint64(0xFFFF)

LARGEST = 4.4
"""No normal is larger; what a design has to leave room for."""


def keys(seed: int, stream: str, channels: int) -> NDArray[np.uint64]:
    """(channels,) uint64: one key per channel of a named stream, unrelated for different seeds, names and channels."""
    digest = hashlib.blake2b(f"{seed}/{stream}".encode(), digest_size=8).digest()
    return _mix(np.arange(channels, dtype=np.uint64) * _STEP + np.uint64(int.from_bytes(digest, "little")))


def normals(key: NDArray[np.uint64], index: NDArray[np.int64], number: int) -> list[NDArray[np.float64]]:
    """``number`` (at most 4) independent standard normal values for every key and index, which broadcast.

    Each takes 16 bits, and so one of 65536 equally likely values; |value| < ``LARGEST``.
    """
    bits = _mix(index.astype(np.uint64) * _STEP + key)
    table = _quantiles()
    return [table[(bits >> shift) & _LOW16] for shift in _SHIFTS[:number]]


def uniforms(key: NDArray[np.uint64], index: NDArray[np.int64]) -> NDArray[np.float64]:
    """One uniform in (0, 1) for every key and index, shaped as ``key`` and ``index`` broadcast."""
    bits = _mix(index.astype(np.uint64) * _STEP + key) >> _S12
    return (bits.astype(np.float64) + 0.5) * 2.0**-52


@cache
def _quantiles() -> NDArray[np.float64]:
    """(65536,) standard normal at the middles of equally likely intervals, scaled to variance 1."""
    upper = np.array([NormalDist().inv_cdf((k + 0.5) / 65536) for k in range(32768, 65536)])
    values = np.concatenate([-upper[::-1], upper])
    return values / values.std()


def _mix(z: NDArray[np.uint64]) -> NDArray[np.uint64]:
    z = (z ^ (z >> _S30)) * _FIRST
    z = (z ^ (z >> _S27)) * _SECOND
    return z ^ (z >> _S31)
