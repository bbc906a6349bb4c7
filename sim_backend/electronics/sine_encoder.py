"""A sine encoder and the comparators behind it: motor angle -> edges of the two square lines.

The encoder gives a sine and a cosine of phase phi = lines x motor angle, one period a line:

    a = sine_offset   + sine_gain   sin(phi)              + noise
    b = cosine_offset + cosine_gain cos(phi + phase_error) + noise

Each goes to a comparator with hysteresis: its square line rises where the signal passes +hysteresis upwards and falls
where it passes -hysteresis downwards (the thesis takes the sines from the analogue servo board and squares them before
the counter).

Edges of a line are numbered along phi: number 0 is the rise at phi = 0 (of line A), 1 the fall at pi, 2 the next rise
... ``passed`` is the number of the last edge that the line is past, so that the level is high where it is even.
Hysteresis makes ``passed`` depend on the past: forwards edge k is passed at a phase alpha_k, backwards it is taken back
at beta_k < alpha_k, so that

    passed <- min(max(passed, lowest), highest),   lowest = max{k: alpha_k <= phi},  highest = max{k: beta_k <= phi}

which is the play (backlash) operator (Krasnosel'skii and Pokrovskii, "Systems with hysteresis", 1989, section 2) on a
staircase. highest - lowest is 0 or 1, which is what lets ``follow`` evaluate it on whole arrays.

Every function works on arrays whose last axis is the encoders (one per joint).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from sim_backend.electronics.noise import LARGEST

Counts = NDArray[np.int64]


@dataclass(frozen=True)
class SineEncoder:
    """n encoders; every field but ``lines`` and ``phase_error`` in the same unit as the gain (V), shape (n,).

    lines        periods a motor revolution
    noise        standard deviation of the noise on each line
    hysteresis   half the comparator's width: it switches at +hysteresis and -hysteresis
    """

    lines: Array
    sine_gain: Array
    cosine_gain: Array
    sine_offset: Array
    cosine_offset: Array
    phase_error: Array  # rad
    noise: Array
    hysteresis: Array

    def __post_init__(self) -> None:
        """ValueError where a sine would not pass its comparator's thresholds in every period, noise and all."""
        for name, gain, offset in (
            ("sine", self.sine_gain, self.sine_offset),
            ("cosine", self.cosine_gain, self.cosine_offset),
        ):
            reach = gain - np.abs(offset) - self.hysteresis - LARGEST * self.noise
            if (reach <= 0).any():
                joint = int(np.argmin(reach)) + 1
                raise ValueError(
                    f"encoder {joint}: the {name} does not reach its comparator's thresholds;"
                    f" gain must be above |offset| + hysteresis + {LARGEST} noise"
                )


@dataclass(frozen=True)
class Line:
    """One square-wave line of n encoders; the phase of its sine is the encoder's phase + ``shift``.

    Offset and hysteresis are in units of the gain.
    """

    shift: Array
    offset: Array
    hysteresis: Array
    noise: Array


def lines_of(encoder: SineEncoder) -> tuple[Line, Line]:
    """Lines A (the sine) and B (the cosine, as a sine a quarter period ahead)."""
    a = Line(
        np.zeros_like(encoder.sine_gain),
        encoder.sine_offset / encoder.sine_gain,
        encoder.hysteresis / encoder.sine_gain,
        encoder.noise / encoder.sine_gain,
    )
    b = Line(
        encoder.phase_error + np.pi / 2,
        encoder.cosine_offset / encoder.cosine_gain,
        encoder.hysteresis / encoder.cosine_gain,
        encoder.noise / encoder.cosine_gain,
    )
    return a, b


def phase(encoder: SineEncoder, motor_angle: Array) -> Array:
    """Phase phi, rad, at motor angles (..., n) rad."""
    return encoder.lines * motor_angle


def switching(line: Line, noise: Array) -> tuple[Array, Array]:
    """Phases of the line's own sine at which it switches near 0, for noise (..., n) in standard deviations.

    rise  (..., n) rad: where it rises, moving forwards; mirrored at pi / 2, where it rises moving backwards
    fall  (..., n) rad: where it falls, moving backwards; mirrored, where it falls moving forwards
    """
    level = line.offset + line.noise * noise
    return np.arcsin(line.hysteresis - level), np.arcsin(-line.hysteresis - level)


def place(line: Line, phi: Array) -> tuple[Counts, Array]:
    """Position of encoder phases phi (..., n) relative to a line's edges.

    It is the number of the edge before the period's rise, and rad from the period's zero.

    Periods are cut a quarter before their zero, so that each holds one rise (near 0) and one fall (near pi).
    """
    shifted = phi + line.shift
    period = np.floor(shifted * (0.5 / np.pi) + 0.25)
    return (2 * period - 1).astype(np.int64), shifted - 2.0 * np.pi * period


def bounds(before: Counts, within: Array, rise: Array, fall: Array) -> tuple[Counts, Counts]:
    """Lowest and highest (see above), (..., n) int64, at ``place`` with the thresholds of ``switching``."""
    lowest = before + (within >= rise) + (within >= np.pi - fall)
    highest = before + (within >= fall) + (within >= np.pi - rise)
    return lowest, highest


def follow(lowest: Counts, highest: Counts, passed: Counts) -> Counts:
    """The play operator (hysteresis) along axis 0.

    passed[i] = min(max(passed[i - 1], lowest[i]), highest[i]); passed[-1] (n,) is given.

    lowest, highest (m, n) with highest - lowest 0 or 1. Row i forgets the past except where it and row i - 1 are inside
    the hysteresis of one and the same edge: there the value is carried on, all else follows from the two rows alone.
    """
    if len(lowest) == 0:
        return np.empty_like(lowest)
    before = np.concatenate([passed[None], lowest[:-1]])
    carried = np.empty(lowest.shape, bool)
    carried[0] = False
    carried[1:] = (lowest[1:] == lowest[:-1]) & (highest[1:] == highest[:-1])
    carried &= highest > lowest
    value = np.minimum(np.maximum(before, lowest), highest)
    if not carried.any():
        return value
    source = np.where(carried, 0, np.arange(len(lowest))[:, None])
    np.maximum.accumulate(source, axis=0, out=source)
    return np.take_along_axis(value, source, axis=0)
