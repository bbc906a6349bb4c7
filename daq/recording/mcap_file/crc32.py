"""CRC-32 of a whole from the CRC-32 of its parts, without reading it again.

By zlib's conditioning, crc(A B) = shift(crc(A), |B|) xor crc(B), where ``shift`` multiplies by x^(8 |B|) modulo the
generator (Mark Adler, zlib's crc32_combine). A sum over many parts is then one xor of independent shifts, all made at
once.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

_GENERATOR = 0xEDB88320
"""Of CRC-32 (IEEE 802.3), bits reflected: the highest bit is x^0."""


def crc32_of_parts(crcs: NDArray[np.uint32], lengths: NDArray[np.int64]) -> int:
    """The CRC-32 of parts end to end, from the CRC-32 (n,) and the length (n,) in bytes of each."""
    behind = np.concatenate([np.cumsum(lengths[::-1])[::-1][1:], [0]]).astype(np.int64)
    shifted, level = np.array(crcs, np.uint32), 0
    while behind.any():
        odd = (behind & 1).astype(bool)
        shifted[odd] = _shifted(shifted[odd], level)
        behind >>= 1
        level += 1
    return int(np.bitwise_xor.reduce(shifted))


def _shifted(values: NDArray[np.uint32], level: int) -> NDArray[np.uint32]:
    """Each polynomial times x^(8 * 2^level): linear, so it is the xor of what becomes of each of its bytes."""
    result = np.zeros_like(values)
    for byte, table in enumerate(_tables(level)):
        result ^= table[values >> np.uint32(8 * byte) & np.uint32(255)]
    return result


@lru_cache(maxsize=64)
def _tables(level: int) -> NDArray[np.uint32]:
    """(4, 256) what becomes of each value of each byte."""
    factor = 1 << 23
    for _ in range(level):
        factor = _product(factor, factor)
    tables = np.zeros((4, 256), np.uint32)
    for bit in range(32):
        table, low = tables[bit // 8], 1 << bit % 8
        table[low : 2 * low] = table[:low] ^ np.uint32(_product(1 << bit, factor))
    return tables


def _product(a: int, b: int) -> int:
    """Two polynomials modulo the generator."""
    product = 0
    for bit in range(31, -1, -1):
        if a >> bit & 1:
            product ^= b
        b = b >> 1 ^ (_GENERATOR if b & 1 else 0)
    return product
