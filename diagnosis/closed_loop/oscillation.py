"""Frequency and amplitude of what a closed loop leaves, where a servo oscillates by itself (a limit cycle)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import welch

from arm_io.types import Array
from arm_model import Arm
from diagnosis.cause import Signal, Structure
from diagnosis.cause.structure import NO_VARIABLE
from diagnosis.cause.units import readable, rounded
from diagnosis.closed_loop.clear_errors import HIGHEST
from diagnosis.closed_loop.comparison import LoopComparison
from diagnosis.residual.filters import COMPARE_BAND, rate_of
from diagnosis.selection.waves import SECONDS, SLOWEST, peak
from identification import recorded_quantity

LACKING = 0.25
"""Share of the simulated current's power in a line below which the measured current lacks the line."""
LEAST_ANGLE = 1e-7
"""rad (m): no encoder of a joint resolves less."""


@dataclass(frozen=True)
class Oscillation:
    """Frequency Hz, and amplitudes of current (in its own unit) and angle (rad, m) of a sine of constant strength.

    simulated_alone: the measured current lacks the line.
    """

    frequency: float
    current: float
    angle: float
    simulated_alone: bool = False


def with_oscillations(structures: Sequence[Structure], compared: Iterable[LoopComparison], arm: Arm) -> list[Structure]:
    """The structures, with frequency and amplitudes where a structure is mostly one oscillation."""
    loops, found = list(compared), []
    for one in structures:
        swing = None
        if one.signal is Signal.CLOSED_LOOP and one.joint is not None:
            band = (SLOWEST, COMPARE_BAND) if one.against == NO_VARIABLE else (COMPARE_BAND, HIGHEST)
            swing = oscillation(loops, one.joint, band)
        found.append(one if swing is None else replace(one, size=f"{one.size}: {_words(swing, arm, one.joint or 1)}"))
    return found


def oscillation(compared: Sequence[LoopComparison], joint: int, band: tuple[float, float]) -> Oscillation | None:
    """The oscillation in a ``band`` (Hz) of a joint (from 1) that one of the loops lacks; None: no line stands out.

    Only recordings with the sampling rate of the first one that measured this joint are used.
    """
    seen = [one for one in compared if one.measured("current")[:, joint - 1].any()]
    alike = [one for one in seen if len(one.t) >= _segment(one) and np.isclose(_rate(one), _rate(seen[0]))]
    if not alike:
        return None
    powers = [_power(alike, of, joint) for of in ("current", "angle")]
    frequency: Array = np.asarray(np.fft.rfftfreq(_segment(alike[0]), 1.0 / _rate(alike[0])), float)
    inside = (frequency >= band[0]) & (frequency <= min(band[1], 0.45 * _rate(alike[0])))
    line = peak(frequency, powers[0], inside)
    if line is None:
        return None
    at, bins = line
    current, angle = (float(np.sqrt(2.0 * power[bins].sum() * frequency[1])) for power in powers)
    measured, simulated = (_line(alike, of, joint, bins) for of in ("current", "simulated_current"))
    return Oscillation(at, current, angle, measured < LACKING * simulated)


def _rate(one: LoopComparison) -> float:
    return rate_of(one.t)


def _segment(one: LoopComparison) -> int:
    return round(SECONDS * _rate(one))


def _power(compared: Sequence[LoopComparison], of: str, joint: int) -> Array:
    """Mean power density of a joint's ``current`` or ``angle`` errors over all recordings, weighted by duration."""
    of_each = [one.spectrum(of, joint, _segment(one))[1] for one in compared]
    return np.asarray(np.average(of_each, axis=0, weights=[one.measured(of)[:, joint - 1].sum() for one in compared]))


def _line(compared: Sequence[LoopComparison], of: str, joint: int, bins: slice) -> float:
    """A2/Hz: power density of a joint's ``current`` or ``simulated_current`` in ``bins``, of all recordings."""
    each = [welch(getattr(one, of)[:, joint - 1], _rate(one), nperseg=_segment(one))[1] for one in compared]
    return float(np.mean(each, axis=0)[bins].sum())


def _words(oscillating: Oscillation, arm: Arm, joint: int) -> str:
    """``it oscillates at 5.3 Hz, with amplitudes of 120 mA and 0.034 mrad``, unless setpoints cause the line."""
    drive = arm.joints[joint - 1]
    sizes = []
    for size, unit in ((oscillating.current, drive.command_unit), (oscillating.angle, drive.unit("rad"))):
        factor, shown = readable(unit, (size,))
        sizes.append(f"{rounded(size * factor, 2)} {shown}")
    if _at_setpoints(oscillating.frequency, arm):
        line = f"most of it at {oscillating.frequency:.1f} Hz ({sizes[0]}), {_times(oscillating.frequency, arm)}"
        if oscillating.simulated_alone:
            return (
                f"{line} the rate of the model's setpoints, a line that the measured {recorded_quantity(drive)} lacks: "
                "setpoints of the arm come at another rate, or its servo interpolates them otherwise; correct the "
                "controller of the model"
            )
        return (
            f"{line} the rate of the setpoints: the servo responds to them differently "
            "from that of the model; check its gains, and check the joint for elasticity"
        )
    if oscillating.angle < LEAST_ANGLE:
        return (
            f"it oscillates at {oscillating.frequency:.1f} Hz, with an amplitude of {sizes[0]}, and the angle does not"
        )
    return f"it oscillates at {oscillating.frequency:.1f} Hz, with amplitudes of {sizes[0]} and {sizes[1]}"


def _at_setpoints(frequency: float, arm: Arm) -> bool:
    """Whether a frequency is a multiple of the model's setpoint rate, within the resolution of the spectrum."""
    if arm.controller is None:
        return False
    rate = 1.0 / arm.controller.setpoint_period
    return frequency > rate / 2 and abs(frequency - round(frequency / rate) * rate) < 0.5 / SECONDS


def _times(frequency: float, arm: Arm) -> str:
    """``once``, ``2 times``, of the rate of the setpoints."""
    assert arm.controller is not None
    times = round(frequency * arm.controller.setpoint_period)
    return "once" if times == 1 else f"{times} times"
