"""Mains hum in the currents: a spectral line at 50 or 60 Hz, found in raw rows and subtracted."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from arm_io.parallel import in_parallel
from arm_io.types import Array
from arm_model import Arm
from arm_model.effects.sensing import MAINS_HUM
from daq.recording import Recording
from diagnosis.cause import Estimate
from diagnosis.residual.noise.channels import standstill
from diagnosis.screening.event import Event, Gain
from diagnosis.screening.spectral_line import MAINS, OVER_FLOOR, Line, above, line_near_mains, waves
from identification import recorded_quantities, recorded_quantity, recorded_signals

ONE_LINE = 1.0
"""Hz: largest difference of the frequencies of one line between recordings and joints: the mains drifts."""
OFF_MAINS = 0.01
"""Of a mains frequency by which it may be off: interconnected supplies 99.5 % of a year (EN 50160)."""
ALIASED = 3
"""Sampling rates up to which lines of setpoints are searched for."""
COMB = 2
"""Lines as strong beside it, of which a line near the mains is one: of torque pulses, say, that follow one another."""
MODULATED = 0.25
"""Variance of the power of a line, over the square of its mean, from which on it is none of the mains."""
SURE = 3.0
"""Std by which the variance must be above that, or below it."""


def mains_hum(recordings: Sequence[Recording], lines_of: Mapping[int, Sequence[Line]], arm: Arm) -> list[Event]:
    """Mains hum among the spectral lines near the mains frequency of each joint, in all recordings.

    lines_of: from ``lines_near_mains``. Lines that do not behave like the mains are left out (``_no_mains``).

    One event of the whole rig where most currents show the line: what couples it in is common to them.
    """
    hum = {joint: lines for joint, lines in lines_of.items() if _no_mains(lines) is None}
    frequencies = [_frequency(lines) for lines in hum.values()]
    if len(hum) > max(1, recordings[0].joints / 2) and np.ptp(frequencies) <= ONE_LINE:
        return [_of_rig(hum, recordings, arm)]
    return [_of_joint(joint, lines, arm) for joint, lines in hum.items()]


def other_lines(lines_of: Mapping[int, Sequence[Line]], arm: Arm) -> Iterator[str]:
    """Says which currents have a line near the mains (``lines_near_mains``) that is no mains hum."""
    of_reason: dict[str, list[str]] = {}
    for joint, lines in lines_of.items():
        if reason := _no_mains(lines):
            amplitude = float(np.mean([line.amplitude for line in lines]))
            size = f"{amplitude:.2g} {arm.joints[joint - 1].command_unit}"
            of_reason.setdefault(reason, []).append(f"{_frequency(lines):.2f} Hz at joint {joint} ({size})")
    for reason, places in of_reason.items():
        yield f"unexplained: a line of the {recorded_quantities(arm)}, {', '.join(places)}; no mains hum, as {reason}"


def lines_near_mains(recordings: Sequence[Recording], arm: Arm) -> dict[int, list[Line]]:
    """By joint (from 1), lines near the mains of all recordings: single ones above the floor, at one frequency.

    None of the setpoints of the arm's controller (``_of_setpoints``), nor of torque pulses, unless it is there while
    the arm stands: neither is then.
    """
    joints = recordings[0].joints
    # the joints of a recording one after the other: they share a transform
    places = list(itertools.product([(r, standstill(r)) for r in recordings], range(joints)))
    found = in_parallel(lambda place: line_near_mains(place[0][0].t, place[0][0].i[:, place[1]], place[0][1]), places)
    every = [found[joint::joints] for joint in range(joints)]
    return {
        joint: lines
        for joint, lines in enumerate(every, 1)
        if min(line.over_floor for line in lines) >= OVER_FLOOR
        and np.ptp([line.frequency for line in lines]) <= ONE_LINE
        and (
            _stays_at_rest(lines)
            or (
                max(line.comparable for line in lines) < COMB
                and not any(_of_setpoints(line, arm, r.dt) for line, r in zip(lines, recordings))
            )
        )
    }


def _no_mains(lines: Sequence[Line]) -> str | None:
    """Why the lines of all recordings at one joint cannot be mains hum; None if they may be."""
    if not _stays_at_rest(lines) and any(_modulated(line) for line in lines):
        return "its amplitude varies with the motion, like that of servo transients at setpoints"
    if min(abs(_frequency(lines) / mains - 1.0) for mains in MAINS) > OFF_MAINS:
        return f"the mains is within {OFF_MAINS:.0%} of 50 or 60 Hz"
    return None


def _stays_at_rest(lines: Sequence[Line]) -> bool:
    """Whether a line is there while the arm stands: in all recordings in which it does, and steady in the others."""
    stands = [line.at_rest for line in lines if line.at_rest is not None]
    return bool(stands) and all(stands) and all(_steady(line) for line in lines if line.at_rest is None)


def _modulated(line: Line) -> bool:
    """Whether the amplitude of a line varies significantly."""
    return line.modulation - SURE * line.modulation_std > MODULATED


def _steady(line: Line) -> bool:
    """Whether the amplitude of a line varies significantly less than that of transients at setpoints."""
    return line.modulation + SURE * line.modulation_std < MODULATED


def _of_setpoints(line: Line, arm: Arm, dt: float) -> bool:
    """Whether sampling every dt s puts a line of the transients at setpoints within ONE_LINE of ``line``.

    The servos filter lines above the sampling rate, and some of these are near any frequency: of those above the first
    and up to ``ALIASED`` times the sampling rate, only a line counts whose amplitude may vary, as transients at
    setpoints do with the acceleration.
    """
    if arm.controller is None:
        return False
    period = arm.controller.setpoint_period
    lines = np.arange(1, int(ALIASED * period / dt) + 1) / period
    sampled = np.abs(lines - np.round(lines * dt) / dt)
    near = np.abs(sampled - line.frequency) <= ONE_LINE
    below = np.arange(len(lines)) <= int(period / dt)
    return bool(np.any(near & below) or (np.any(near) and not _steady(line)))


def without_hum(recording: Recording, events: Sequence[Event]) -> Array:
    """(n, J) A: the currents with the lines subtracted, each with its own phase in this recording."""
    current = recording.i.copy()
    for event in events:
        if event.effect != MAINS_HUM.name:
            continue
        f = next(p.value for p in event.parameters if p.name == "frequency")
        line = waves(f, recording.t)
        filtered_line = above(line, recording.dt)
        for joint in event.of_joints or (event.joint,):
            assert joint is not None, "hum is of joints"
            filtered = above(current[:, joint - 1], recording.dt)
            current[:, joint - 1] -= line @ np.linalg.lstsq(filtered_line, filtered, rcond=None)[0]
    return current


def _of_joint(joint: int, lines: Sequence[Line], arm: Arm) -> Event:
    return Event(
        effect=MAINS_HUM.name,
        joint=joint,
        parameters=_parameters(lines),
        evidence=f"the {recorded_quantity(arm.joints[joint - 1])} of joint {joint} has a spectral line at "
        f"{_frequency(lines):.2f} Hz in all {len(lines)} recordings",
        recordings=tuple(range(len(lines))),
        gain=_gain(joint, lines),
    )


def _of_rig(hum: Mapping[int, Sequence[Line]], recordings: Sequence[Recording], arm: Arm) -> Event:
    """Its parameters are those of the joint with the largest line."""
    largest = max(hum, key=lambda joint: float(np.mean([line.amplitude for line in hum[joint]])))
    f = float(np.median([_frequency(lines) for lines in hum.values()]))
    signals = recorded_signals(arm)
    subject = f"all {signals} have" if len(hum) == recordings[0].joints else f"{signals} of {len(hum)} joints have"
    return Event(
        effect=MAINS_HUM.name,
        joint=None,
        parameters=_parameters(hum[largest], f),
        evidence=f"{subject} one spectral line at {f:.2f} Hz in all {len(recordings)} recordings, so that its "
        f"source is common to them (supply, ground or converter); the largest is that of joint {largest}",
        recordings=tuple(range(len(recordings))),
        gain=_gain(largest, hum[largest]),
        of_joints={joint: _parameters(lines, f) for joint, lines in hum.items()},
    )


def _frequency(lines: Sequence[Line]) -> float:
    return float(np.median([line.frequency for line in lines]))


def _parameters(lines: Sequence[Line], frequency: float | None = None) -> list[Estimate]:
    """Means over the recordings, with the std of these means by noise and by their scatter.

    The phase is that of the first recording, known as well as the others have the same: each has its own t = 0.
    """
    amplitude, amplitude_std = _mean([line.amplitude for line in lines], [line.amplitude_std for line in lines])
    _, frequency_std = _mean([line.frequency for line in lines], [line.frequency_std for line in lines])
    turned = [float(np.angle(np.exp(1j * (line.phase - lines[0].phase)))) for line in lines]
    phase_std = max(lines[0].phase_std, float(np.sqrt(np.mean(np.square(turned)))))
    return [
        Estimate("amplitude", amplitude, amplitude_std, "A"),
        Estimate("frequency", _frequency(lines) if frequency is None else frequency, frequency_std, "Hz"),
        Estimate("phase", lines[0].phase, phase_std, "rad"),
    ]


def _mean(values: Sequence[float], stds: Sequence[float]) -> tuple[float, float]:
    """Of recordings whose values differ by their noise and by what the mains does from one to the next."""
    scatter = float(np.var(values, ddof=1)) if len(values) > 1 else 0.0
    return float(np.mean(values)), float(np.sqrt(max(scatter, float(np.mean(np.square(stds)))) / len(values)))


def _gain(joint: int, lines: Sequence[Line]) -> Gain:
    before, after = (
        float(np.sqrt(np.mean(np.square(values))))
        for values in ([line.before for line in lines], [line.after for line in lines])
    )
    return Gain(before=before, after=after, unit="A", joint=joint)
