"""Mains hum in the currents: a spectral line at 50 or 60 Hz, found in raw rows and subtracted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import signal

from arm_io.types import Array
from arm_model import Arm
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
ONE_LINE = 1.0
"""Hz: largest difference of the frequencies of one line between recordings and joints: the mains drifts."""
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


def mains_hum(recordings: Sequence[Recording], arm: Arm) -> list[Event]:
    """Spectral lines at mains frequency in the currents of joints, above the floor in every recording.

    Lines of the setpoints of the arm's controller are none (``_of_setpoints``).

    One event of the whole rig where most currents show the line: what couples it in is common to them.
    """
    every = ([_line(r.t, r.i[:, j]) for r in recordings] for j in range(recordings[0].joints))
    found = {
        joint: lines
        for joint, lines in enumerate(every, 1)
        if min(line.over_floor for line in lines) >= HUM_OVER_FLOOR
        and np.ptp([line.frequency for line in lines]) <= ONE_LINE
        and not any(_of_setpoints(line.frequency, arm, r.dt) for line, r in zip(lines, recordings))
    }
    frequencies = [_frequency(lines) for lines in found.values()]
    if len(found) > max(1, recordings[0].joints / 2) and np.ptp(frequencies) <= ONE_LINE:
        return [_of_rig(found, recordings)]
    return [_of_joint(joint, lines) for joint, lines in found.items()]


def _of_setpoints(frequency: float, arm: Arm, dt: float) -> bool:
    """Whether sampling every dt s puts a line of the transients at setpoints within ONE_LINE of ``frequency`` Hz.

    Lines up to the first above the sampling rate count: the servos filter those further up, which are near any
    frequency.
    """
    if arm.controller is None:
        return False
    lines = np.arange(1, int(arm.controller.setpoint_period / dt) + 2) / arm.controller.setpoint_period
    seen = np.abs(lines - np.round(lines * dt) / dt)
    return bool(np.any(np.abs(seen - frequency) <= ONE_LINE))


def without_hum(recording: Recording, events: Sequence[Event]) -> Array:
    """(n, J) A: the currents with the lines subtracted, each with its own phase in this recording."""
    current = recording.i.copy()
    for event in events:
        if event.effect != MAINS_HUM.name:
            continue
        f = next(p.value for p in event.parameters if p.name == "frequency")
        waves = _waves(f, recording.t)
        passed = _above(waves, recording.dt)
        for joint in event.of_joints or (event.joint,):
            assert joint is not None, "hum is of joints"
            above = _above(current[:, joint - 1], recording.dt)
            current[:, joint - 1] -= waves @ np.linalg.lstsq(passed, above, rcond=None)[0]
    return current


def _of_joint(joint: int, lines: Sequence[_Line]) -> Event:
    return Event(
        effect=MAINS_HUM.name,
        joint=joint,
        parameters=_parameters(lines),
        evidence=f"the current of joint {joint} has a spectral line at {_frequency(lines):.2f} Hz in all "
        f"{len(lines)} recordings",
        recordings=tuple(range(len(lines))),
        gain=_gain(joint, lines),
    )


def _of_rig(found: Mapping[int, Sequence[_Line]], recordings: Sequence[Recording]) -> Event:
    """Its parameters are those of the joint with the largest line."""
    largest = max(found, key=lambda joint: float(np.mean([line.amplitude for line in found[joint]])))
    f = float(np.median([_frequency(lines) for lines in found.values()]))
    which = "all currents have" if len(found) == recordings[0].joints else f"currents of {len(found)} joints have"
    return Event(
        effect=MAINS_HUM.name,
        joint=None,
        parameters=_parameters(found[largest], f),
        evidence=f"{which} one spectral line at {f:.2f} Hz in all {len(recordings)} recordings, so that it enters "
        f"where they are common (supply, ground or converter); the largest is that of joint {largest}",
        recordings=tuple(range(len(recordings))),
        gain=_gain(largest, found[largest]),
        of_joints={joint: _parameters(lines, f) for joint, lines in found.items()},
    )


def _frequency(lines: Sequence[_Line]) -> float:
    return float(np.median([line.frequency for line in lines]))


def _parameters(lines: Sequence[_Line], frequency: float | None = None) -> list[Estimate]:
    amplitudes = np.array([line.amplitude for line in lines])
    return [
        Estimate("amplitude", float(amplitudes.mean()), float(amplitudes.std() + 0.02 * amplitudes.mean()), "A"),
        Estimate("frequency", _frequency(lines) if frequency is None else frequency, 0.05, "Hz"),
        Estimate("phase", lines[0].phase, 0.2, "rad"),
    ]


def _gain(joint: int, lines: Sequence[_Line]) -> Gain:
    before, after = (
        float(np.sqrt(np.mean(np.square(values))))
        for values in ([line.before for line in lines], [line.after for line in lines])
    )
    return Gain(before=before, after=after, unit="A", joint=joint)


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
    f = float(frequency[band[top]]) + _to_peak(power, top) * float(frequency[1])
    waves = _waves(f, t)
    a, b = np.linalg.lstsq(_above(waves, dt) * window[:, None], _above(current, dt) * window, rcond=None)[0]
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


def _to_peak(power: Array, top: int) -> float:
    """Bins from ``top`` to the peak: of a parabola through the logarithms of the power beside it."""
    if not 0 < top < len(power) - 1 or power[top - 1 : top + 2].min() <= 0.0:
        return 0.0
    below, at, above = np.log(power[top - 1 : top + 2])
    return float((below - above) / (2 * (below - 2 * at + above))) if at >= max(below, above) else 0.0


def _waves(frequency: float, t: Array) -> Array:
    """(m, 2): sine and cosine at ``frequency`` Hz."""
    angle = 2 * np.pi * frequency * t
    return np.column_stack([np.sin(angle), np.cos(angle)])


def _above(values: Array, dt: float) -> Array:
    """(m,) or (m, k): columns above HIGH_PASS."""
    sections = signal.butter(4, min(HIGH_PASS * 2 * dt, 0.9), "highpass", output="sos")
    return np.asarray(signal.sosfiltfilt(sections, values, axis=0), float)
