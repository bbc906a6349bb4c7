"""Effects that are events or lines rather than columns: hum in the current, a current that is clipped (``jumps``: counts).

Each is looked for in the raw rows of every recording, before any filter would smear it, and taken away before the rest is judged.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, signal

from arm_io.types import Array
from daq.recording import Recording
from diagnosis.measurements.currents.estimates import Estimate
from diagnosis.residual.noise import scatter, still_noise
from diagnosis.residual.run_setup import setup_of

MAINS = (50.0, 60.0)
"""Hz: what the grids of the world run at, to within 1 Hz."""
HUM_BAND = (45.0, 65.0)
"""Hz: where the floor beside the line is taken."""
HUM_OVER_FLOOR = 40.0
"""Power of a line over the median of its neighbours; white noise exceeds 40 once in e^28 bins."""
RUNS_AWAY = 1.5
"""Times as far from its demand as ever before, of a joint whose current is clipped."""
AVERAGED, FLAT_SECONDS, PILED = 0.01, 0.03, 3.0
"""A current averaged over the first is clipped if it lies flat for the second, and if of the rows near its top this many times more lie at it
than below it."""


@dataclass(frozen=True)
class Gain:
    """What an event explains where it shows: rms of that error without and with it, in ``unit``, at ``joint`` (1-based), and the probability that the
    fall is chance."""

    before: float
    after: float
    unit: str
    joint: int
    p: float = 0.0


@dataclass(frozen=True)
class Event:
    """An effect found in raw rows: name, joint (0: no joint's own), parameters, sentence, the recordings (by index) that show it, and what it
    explains there (None: it shows in a closed loop only)."""

    effect: str
    joint: int
    parameters: list[Estimate]
    evidence: str
    recordings: tuple[int, ...]
    gain: Gain | None = None


def hum(recordings: list[Recording]) -> list[Event]:
    """A line at the frequency of the mains in a current that stands out of the floor in every recording."""
    events = []
    for j in range(recordings[0].joints):
        lines = [_line(r.t, r.i[:, j]) for r in recordings]
        frequencies = np.array([line[0] for line in lines])
        if min(line[2] for line in lines) < HUM_OVER_FLOOR or np.ptp(frequencies) > 1.0:
            continue
        amplitudes = np.array([line[1] for line in lines])
        phase = lines[0][3]
        before, after = (float(np.mean([line[k] ** 2 for line in lines]) ** 0.5) for k in (4, 5))
        events.append(
            Event(
                "mains_hum",
                j + 1,
                [
                    Estimate(
                        "amplitude", float(amplitudes.mean()), float(amplitudes.std() + 0.02 * amplitudes.mean()), "A"
                    ),
                    Estimate("frequency", float(np.median(frequencies)), 0.05, "Hz"),
                    Estimate("phase", phase, 0.2, "rad"),
                ],
                f"the current of joint {j + 1} carries a line at {np.median(frequencies):.2f} Hz in all {len(recordings)} recordings",
                tuple(range(len(recordings))),
                Gain(before, after, "A", j + 1),
            )
        )
    return events


def _line(t: Array, current: Array) -> tuple[float, ...]:
    """Frequency Hz, amplitude A, power over the floor, phase at t = 0 of the strongest line at the mains; rms A in HUM_BAND with and without it."""
    dt = float(np.median(np.diff(t)))
    window = signal.windows.hann(len(t))
    spectrum = np.fft.rfft((current - current.mean()) * window, 4 * len(t))
    frequency = np.fft.rfftfreq(4 * len(t), dt)
    band = np.flatnonzero((frequency >= HUM_BAND[0]) & (frequency <= HUM_BAND[1]))
    if len(band) == 0:
        return (0.0,) * 6
    power = np.abs(spectrum[band]) ** 2
    near = np.min(np.abs(frequency[band][:, None] - np.array(MAINS)), axis=1) < 1.0
    top = int(np.argmax(np.where(near, power, 0.0)))
    f = float(frequency[band[top]])
    basis = np.column_stack([np.sin(2 * np.pi * f * t), np.cos(2 * np.pi * f * t)]) * window[:, None]
    high = signal.sosfiltfilt(signal.butter(4, min(30.0 * 2 * dt, 0.9), "highpass", output="sos"), current)
    a, b = np.linalg.lstsq(basis, high * window, rcond=None)[0]
    line = a * np.sin(2 * np.pi * f * t) + b * np.cos(2 * np.pi * f * t)
    near_mains = signal.butter(
        4, [min(2 * edge * dt, top) for edge, top in zip(HUM_BAND, (0.98, 0.99))], "bandpass", output="sos"
    )
    rms = (float(np.std(signal.sosfiltfilt(near_mains, values))) for values in (current, current - line))
    return f, float(np.hypot(a, b)), float(power[top] / np.median(power)), float(np.arctan2(b, a)), *rms


def without_hum(recording: Recording, events: list[Event]) -> Array:
    """(n, J) A: the currents with the lines taken out, each with its own phase in this recording."""
    current = recording.i.copy()
    for event in events:
        if event.effect != "mains_hum":
            continue
        f = next(p.value for p in event.parameters if p.name == "frequency")
        basis = np.column_stack([np.sin(2 * np.pi * f * recording.t), np.cos(2 * np.pi * f * recording.t)])
        column = current[:, event.joint - 1]
        dt = recording.dt
        high = signal.sosfiltfilt(signal.butter(4, min(30.0 * 2 * dt, 0.9), "highpass", output="sos"), column)
        current[:, event.joint - 1] = column - basis @ np.linalg.lstsq(basis, high, rcond=None)[0]
    return current


def encoder_step(q: Array) -> float:
    """rad: smallest step that occurs often in an angle (n,)."""
    steps = np.abs(np.diff(q))
    steps = steps[steps > 1e-9]
    return float(np.quantile(steps, 0.02)) if len(steps) else 0.0


def clipped(recordings: list[Recording]) -> list[Event]:
    """Currents that pile up at one extreme value, in either direction.

    Of a current that turns round by itself as many rows lie within 2 widths of its top as in the 6 widths below (a parabola); of one that is
    clipped, nearly all of them: in all recordings together, or in one in which the joint runs away from its demand meanwhile. The width is what
    noise and converter leave of a value averaged over ``AVERAGED`` s.
    """
    events = []
    smooth = [_averaged(r) for r in recordings]
    still = still_noise([r for r in recordings if not setup_of(r).drives_off])  # noise that no average takes away
    for j in range(recordings[0].joints):
        top = max(float(values[:, j].max()) for values in smooth)
        rows = max(1, round(AVERAGED / recordings[0].dt))
        noise = float(np.hypot(max(float(scatter(r.i)[j]) for r in recordings) / np.sqrt(rows), still[j]))
        width = max(encoder_step(recordings[0].i[:, j]) / 2, 0.002 * top, 3.3 * noise)
        near = [float(np.sum(values[:, j] > top - 2 * width)) * r.dt for values, r in zip(smooth, recordings)]
        below = [float(np.sum(values[:, j] > top - 8 * width)) * r.dt for values, r in zip(smooth, recordings)]
        moving = [k for k, r in enumerate(recordings) if near[k] > 0.0 and np.ptp(r.q[:, j]) > 0.01]
        flat = _longest_of([values[:, j] > top - 2 * width for values in smooth], recordings)
        piled = sum(near) > PILED * (sum(below) - sum(near)) or any(
            near[k] > PILED * (below[k] - near[k]) and _runs_away(recordings[k], j, smooth[k][:, j] > top - 2 * width)
            for k in moving
        )
        if top > 10 * width and moving and flat > FLAT_SECONDS and piled:
            events.append(
                Event(
                    "current_limit",
                    j + 1,
                    [Estimate("limit", top - width, width, "A")],
                    f"the current of joint {j + 1} lies flat at {top:.2f} A in {len(moving)} of {len(recordings)} recordings",
                    tuple(moving),
                )
            )
    return events


def _averaged(recording: Recording) -> Array:
    rows = max(1, round(AVERAGED / recording.dt))
    return np.asarray(np.abs(ndimage.uniform_filter1d(recording.i, rows, axis=0)), float)


def _runs_away(recording: Recording, j: int, flat: NDArray[np.bool_]) -> bool:
    """Whether a joint is farther from its demand at the end of the longest stretch of ``flat`` (m,) current than ever before."""
    starts, ends = _stretches(flat)
    if recording.qref is None or len(starts) == 0:
        return False
    longest = int(np.argmax(ends - starts))
    start, end = int(starts[longest]), int(ends[longest])
    error = np.abs(recording.qref[:, j] - recording.q[:, j])
    return (end - start) * recording.dt > FLAT_SECONDS and bool(error[end - 1] > RUNS_AWAY * error[: start + 1].max())


def _longest_of(flags: list[NDArray[np.bool_]], recordings: list[Recording]) -> float:
    return max(_longest(one) * r.dt for one, r in zip(flags, recordings))


def _longest(flags: NDArray[np.bool_]) -> int:
    """Length of the longest run of True."""
    starts, ends = _stretches(flags)
    return int(np.max(ends - starts, initial=0))


def _stretches(flags: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First rows of all runs of True, and those after their last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.view(np.int8), [0]])))
    return edges[::2], edges[1::2]
