"""An analogue-to-digital converter: volts at the input -> codes -> the volts that a driver reports."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array


@dataclass(frozen=True)
class Converter:
    """bits; range (low, high) V; offset V and noise V (standard deviation) referred to the input."""

    bits: int
    low: float
    high: float
    offset: float = 0.0
    noise: float = 0.0

    @property
    def step(self) -> float:
        """V of one code: (high - low) / 2^bits; 4.88 mV for 12 bit over +-10 V."""
        return (self.high - self.low) / (1 << self.bits)


def codes(converter: Converter, volts: Array, noise: Array) -> NDArray[np.int64]:
    """Codes 0 ... 2^bits - 1 for volts of any shape, rounded to the nearest; noise in standard deviations."""
    level = (volts + converter.offset + converter.noise * noise - converter.low) / converter.step
    return np.clip(np.rint(level), 0, (1 << converter.bits) - 1).astype(np.int64)


def reported(converter: Converter, code: NDArray[np.int64]) -> Array:
    """V that codes of any shape stand for."""
    return converter.low + converter.step * code.astype(np.float64)


def saturated(converter: Converter, code: NDArray[np.int64]) -> NDArray[np.bool_]:
    """True for codes, of any shape, at either end of the range, where the true voltage may lie outside it."""
    return (code == 0) | (code == (1 << converter.bits) - 1)
