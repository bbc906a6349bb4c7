"""Mains hum in the currents: a spectral line at 50 or 60 Hz, found in raw rows and subtracted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import signal

from arm_io.types import Array
from arm_model.effects.sensing import MAINS_HUM
from daq.recording import Recording
from diagnosis.cause import Estimate
from diagnosis.screening.event import Event, Gain

MAINS = (50.0, 60.0)
"""Hz: mains frequencies, to within 1 Hz."""
HUM_BAND = (45.0, 65.0)
"""Hz: band in which the floor around the line is estimated."""
HIGH_PASS = 30.0
"""Hz: lower edge of the band in which the line is fitted, so that the motion does not enter it."""
HUM_OVER_FLOOR = 40.0
"""Power of a line over the median of its neighbours; white noise exceeds 40 once in e^28 bins."""


@dataclass(frozen=True, kw_only=True)
class _Line:
    """The strongest line at the mains: frequency Hz, amplitude A, its power over the floor, phase rad at t = 0.

    Rms A in HUM_BAND with and without it.
    """

    frequency: float = 0.0
    amplitude: float = 0.0
    over_floor: float = 0.0
    phase: float = 0.0
    before: float = 0.0
    after: float = 0.0


def mains_hum(recordings: Sequence[Recording]) -> list[Event]:
    """A spectral line at mains frequency in the current of a joint, above the floor in every recording."""
    events = []
    for j in range(recordings[0].joints):
        lines = [_line(r.t, r.i[:, j]) for r in recordings]
        frequencies = np.array([line.frequency for line in lines])
        if min(line.over_floor for line in lines) < HUM_OVER_FLOOR or np.ptp(frequencies) > 1.0:
            continue
        amplitudes = np.array([line.amplitude for line in lines])
        spread = float(amplitudes.std() + 0.02 * amplitudes.mean())
        events.append(
            Event(
                effect=MAINS_HUM.name,
                joint=j + 1,
                parameters=[
                    Estimate("amplitude", float(amplitudes.mean()), spread, "A"),
                    Estimate("frequency", float(np.median(frequencies)), 0.05, "Hz"),
                    Estimate("phase", lines[0].phase, 0.2, "rad"),
                ],
                evidence=f"the current of joint {j + 1} has a spectral line at {np.median(frequencies):.2f} Hz in all "
                f"{len(recordings)} recordings",
                recordings=tuple(range(len(recordings))),
                gain=Gain(
                    before=float(np.mean([line.before**2 for line in lines]) ** 0.5),
                    after=float(np.mean([line.after**2 for line in lines]) ** 0.5),
                    unit="A",
                    joint=j + 1,
                ),
            )
        )
    return events


def without_hum(recording: Recording, events: Sequence[Event]) -> Array:
    """(n, J) A: the currents with the lines subtracted, each with its own phase in this recording."""
    current = recording.i.copy()
    for event in events:
        if event.effect != MAINS_HUM.name or event.joint is None:
            continue
        f = next(p.value for p in event.parameters if p.name == "frequency")
        column = current[:, event.joint - 1]
        waves = _waves(f, recording.t)
        current[:, event.joint - 1] = (
            column - waves @ np.linalg.lstsq(waves, _above(column, recording.dt), rcond=None)[0]
        )
    return current


def _line(t: Array, current: Array) -> _Line:
    dt = float(np.median(np.diff(t)))
    window = signal.windows.hann(len(t))
    spectrum = np.fft.rfft((current - current.mean()) * window, 4 * len(t))
    frequency = np.fft.rfftfreq(4 * len(t), dt)
    band = np.flatnonzero((frequency >= HUM_BAND[0]) & (frequency <= HUM_BAND[1]))
    if len(band) == 0:
        return _Line()
    power = np.abs(spectrum[band]) ** 2
    near = np.min(np.abs(frequency[band][:, None] - np.array(MAINS)), axis=1) < 1.0
    top = int(np.argmax(np.where(near, power, 0.0)))
    f = float(frequency[band[top]])
    waves = _waves(f, t)
    a, b = np.linalg.lstsq(waves * window[:, None], _above(current, dt) * window, rcond=None)[0]
    line = waves @ np.array([a, b])
    edges = [min(2 * edge * dt, most) for edge, most in zip(HUM_BAND, (0.98, 0.99))]
    near_mains = signal.butter(4, edges, "bandpass", output="sos")
    before, after = (float(np.std(signal.sosfiltfilt(near_mains, values))) for values in (current, current - line))
    return _Line(
        frequency=f,
        amplitude=float(np.hypot(a, b)),
        over_floor=float(power[top] / np.median(power)),
        phase=float(np.arctan2(b, a)),
        before=before,
        after=after,
    )


def _waves(frequency: float, t: Array) -> Array:
    """(m, 2): sine and cosine at ``frequency`` Hz."""
    angle = 2 * np.pi * frequency * t
    return np.column_stack([np.sin(angle), np.cos(angle)])


def _above(current: Array, dt: float) -> Array:
    """(m,) A: the current above HIGH_PASS."""
    sections = signal.butter(4, min(HIGH_PASS * 2 * dt, 0.9), "highpass", output="sos")
    return np.asarray(signal.sosfiltfilt(sections, current), float)
