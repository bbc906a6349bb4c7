"""The strongest spectral line of a current near a mains frequency, and whether it behaves as the mains does."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import signal

from arm_io.types import Array
from identification.preprocessing import zero_phase

MAINS = (50.0, 60.0)
"""Hz."""
AROUND = 1.0
"""Hz from a mains frequency within which the line is searched."""
BAND = (45.0, 65.0)
"""Hz: band in which the floor around the line is estimated."""
HIGH_PASS = 30.0
"""Hz: lower edge of the band in which the line is fitted, so that the motion does not enter it."""
OVER_FLOOR = 40.0
"""Power of a line over the median of its neighbours; white noise exceeds 40 once in e^28 bins."""
AS_STRONG = 0.25
"""Power of a line over that of the strongest, from which it counts as another beside it."""
BLOCK = 0.5
"""s over which the amplitude of the line is followed."""
STANDS = 0.5
"""Share of its amplitude that a line must have while the arm stands."""
SURE = 5.0
"""Std of the noise that it must exceed then."""
HANN_AMPLITUDE = 35 / 18
"""int w^4 / (int w^2)^2 of a Hann window w over a duration of 1."""
HANN_PULSATION = 28.1
"""int w^2 t^2 / (int w t^2)^2 of that window, t from its middle."""
NEIGHBOURHOOD = (5.0, 7.0)
"""Hz from the line, on either side, where the noise of its amplitude is taken."""


@dataclass(frozen=True, kw_only=True)
class Line:
    """The strongest line near the mains: frequency Hz, amplitude A, its power over the floor, phase rad at t = 0.

    frequency_std, amplitude_std, phase_std  by the noise of ``BAND`` (``_deviations``)
    before, after  A rms in ``BAND`` with and without it
    comparable     lines about as strong elsewhere in ``BAND``, not near the mains
    modulation     variance of its power from block to block over the square of its mean, beyond that of noise: 0 of a
                   constant amplitude, 0.5 of one that follows a sine, 2 of one that follows a random motion
    modulation_std its standard deviation
    at_rest        whether it is there while the arm stands, before it moves (``present_at_rest``); None: it never does
    """

    frequency: float = 0.0
    amplitude: float = 0.0
    over_floor: float = 0.0
    phase: float = 0.0
    frequency_std: float = np.inf
    amplitude_std: float = np.inf
    phase_std: float = np.inf
    before: float = 0.0
    after: float = 0.0
    comparable: int = 0
    modulation: float = 0.0
    modulation_std: float = np.inf
    at_rest: bool | None = None


def line_near_mains(t: Array, current: Array, still: slice | None = None) -> Line:
    """The line of a current (m,) A at t (m,) s; zeros where there is none, as where the rate is too low.

    still: rows in which the arm stands.

    Of a line below ``OVER_FLOOR``, frequency and ``over_floor`` alone.
    """
    dt = float(np.median(np.diff(t)))
    window = signal.windows.hann(len(t))
    frequency, power = _in_band((current - current.mean()) * window, dt)
    from_mains = np.min(np.abs(frequency[:, None] - np.array(MAINS)), axis=1)
    peaks, _ = signal.find_peaks(power)
    peaks = peaks[from_mains[peaks] < AROUND]
    if len(peaks) == 0:
        return Line()
    top = int(peaks[np.argmax(power[peaks])])
    over_floor = float(power[top] / np.median(power))
    if over_floor < OVER_FLOOR:
        return Line(frequency=float(frequency[top]), over_floor=over_floor)
    f = float(frequency[top]) + _to_peak(power, top) * float(frequency[1] - frequency[0])
    line, high = waves(f, t), above(current, dt)
    a, b = np.linalg.lstsq(above(line, dt) * window[:, None], high * window, rcond=None)[0]
    edges = [min(2 * edge * dt, limit) for edge, limit in zip(BAND, (0.98, 0.99))]
    near_mains = signal.butter(4, edges, "bandpass", output="sos")
    fitted = line @ np.array([a, b])
    before, after = (float(np.std(zero_phase(near_mains, values))) for values in (current, current - fitted))
    modulation, modulation_std = _modulation(high, t, f)
    frequency_std, amplitude_std, phase_std = _deviations(
        float(np.hypot(a, b)), after**2 / ((edges[1] - edges[0]) / (2 * dt)), t
    )
    return Line(
        frequency_std=frequency_std,
        amplitude_std=amplitude_std,
        phase_std=phase_std,
        frequency=f,
        amplitude=float(np.hypot(a, b)),
        over_floor=over_floor,
        phase=float(np.arctan2(b, a)),
        before=before,
        after=after,
        comparable=_comparable_lines(power, from_mains > AROUND, float(power[top])),
        modulation=modulation,
        modulation_std=modulation_std,
        at_rest=None if still is None else present_at_rest(high[still], line[still], float(np.hypot(a, b))),
    )


def _deviations(amplitude: float, density: float, t: Array) -> tuple[float, float, float]:
    """Std of frequency Hz, amplitude A and phase rad at t = 0 of a line, in noise of a density (A^2/Hz) at t (m,) s.

    Of a fit weighted by a Hann window. Without it, the density over the duration is the variance of the amplitude
    (Rife & Boorstyn, Single-tone parameter estimation from discrete-time observations, IEEE T-IT 20(5), 1974).
    """
    duration = float(t[-1] - t[0])
    least = density / duration
    pulsation = least * HANN_PULSATION / (amplitude * duration) ** 2
    middle = float(t[0] + t[-1]) / 2
    phase = least * HANN_AMPLITUDE / amplitude**2 + pulsation * middle**2
    return float(np.sqrt(pulsation) / (2 * np.pi)), float(np.sqrt(least * HANN_AMPLITUDE)), float(np.sqrt(phase))


def present_at_rest(values: Array, line: Array, amplitude: float) -> bool:
    """Whether values (m,) A of a standing arm, above HIGH_PASS, have a line (m, 2) of about this amplitude (A)."""
    size = np.linalg.lstsq(line, values, rcond=None)[0]
    std = float(np.std(values - line @ size)) * np.sqrt(2.0 / len(values))
    return float(np.hypot(*size)) > max(STANDS * amplitude, SURE * std)


def _in_band(values: Array, dt: float) -> tuple[Array, Array]:
    """Frequencies of ``BAND`` (k,) Hz at a quarter of the resolution of values (m,), and the power of each."""
    step = 1.0 / (4 * len(values) * dt)
    first, last = math.ceil(BAND[0] / step), min(math.floor(BAND[1] / step), 2 * len(values))
    if last < first:
        return np.zeros(0), np.zeros(0)
    # the band alone: the transform of all frequencies of a prime number of rows takes ten times as long
    spectrum = _transform(len(values), first, last)(values)
    return np.asarray(step * np.arange(first, last + 1), float), np.asarray(np.abs(spectrum) ** 2, float)


@lru_cache(maxsize=4)  # the same for every joint
def _transform(rows: int, first: int, last: int) -> signal.CZT:
    """Of values (rows,), the lines ``first`` to ``last`` of a spectrum of four times as many rows."""
    turn = 2j * np.pi / (4 * rows)
    return signal.CZT(rows, last - first + 1, np.exp(-turn), np.exp(turn * first))


def waves(frequency: float, t: Array) -> Array:
    """(m, 2): sine and cosine at ``frequency`` Hz."""
    angle = 2 * np.pi * frequency * t
    return np.column_stack([np.sin(angle), np.cos(angle)])


def above(values: Array, dt: float) -> Array:
    """(m,) or (m, k): columns above HIGH_PASS."""
    sections = signal.butter(4, min(HIGH_PASS * 2 * dt, 0.9), "highpass", output="sos")
    return zero_phase(sections, values)


def _to_peak(power: Array, top: int) -> float:
    """Bins from ``top`` to the peak: of a parabola through the logarithms of the power beside it."""
    if power[top - 1 : top + 2].min() <= 0.0:
        return 0.0
    below, at, higher = np.log(power[top - 1 : top + 2])
    return float((below - higher) / (2 * (below - 2 * at + higher))) if at > min(below, higher) else 0.0


def _comparable_lines(power: Array, elsewhere: Array, strongest: float) -> int:
    """Peaks of a spectrum (k,) ``elsewhere`` (k,) that are lines, and about as strong as the one near the mains."""
    least = max(AS_STRONG * strongest, OVER_FLOOR * float(np.median(power)))
    peaks, _ = signal.find_peaks(power, height=least)
    return int(np.sum(elsewhere[peaks]))


def _modulation(values: Array, t: Array, frequency: float) -> tuple[float, float]:
    """``Line.modulation`` and its std, of values (m,) above HIGH_PASS."""
    rows = max(1, round(BLOCK * (len(t) - 1) / float(t[-1] - t[0])))
    count = len(t) // rows
    if count < 4:
        return 0.0, np.inf
    window = np.tile(signal.windows.hann(rows), (count, 1))

    def powers(at: float) -> Array:
        turned = (values * np.exp(-2j * np.pi * at * t))[: count * rows].reshape(count, rows)
        return np.asarray(np.abs(np.mean(window * turned, axis=1)) ** 2)

    noise = float(np.mean([powers(frequency + side * off) for off in NEIGHBOURHOOD for side in (-1.0, 1.0)]))
    of_line = powers(frequency)
    mean = float(of_line.mean()) - noise
    if mean <= 0.0:
        return 0.0, np.inf
    by_noise = noise**2 + 2 * mean * noise
    variance = float(of_line.var(ddof=1))
    return (variance - by_noise) / mean**2, float(np.sqrt(8.0 / count)) * by_noise / mean**2
