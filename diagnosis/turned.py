"""Motors of the wrist that turn although their axes were told to rest: the coupling of the wrist's gears.

In the wrist of a Puma the motors of axes 5 and 6 turn with those of 4 and 5. Where the controller knows it and the model does not, the recorded
motor angle of a resting axis follows the angles of the others: q_j - qref_j = -sum_k c_jk q_k, far more than a servo errs.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from daq.recording import Recording
from diagnosis.events import Event
from diagnosis.noise import angle_noise
from diagnosis.parameters import Estimate

Array = NDArray[np.float64]

PAIRS = ((5, 4), (6, 4), (6, 5))
"""Axis that turns, motor that turns it; from 1."""
EXPLAINED = 0.9
"""Share of the squared difference of motor and demand that the coupling must explain, in every recording where it is to be seen."""
STEPS = 20.0
"""Times the noise of the angle that the motor must turn."""


def turned_wrist(recordings: Sequence[Recording]) -> list[Event]:
    """The coupling of the wrist, seen in motor angles against demands; empty where there is none, or no demand to hold angles against."""
    able = [r for r in recordings if r.qref is not None and r.joints >= 6 and not np.isnan(r.qref).any()]
    if not able:
        return []
    found: dict[tuple[int, int], tuple[float, float]] = {}
    for axis in (5, 6):
        of_motors = _follows(able, axis, [motor for turned, motor in PAIRS if turned == axis])
        found |= {(axis, motor): one for motor, one in of_motors.items()}
    if not found:
        return []
    rows = [Estimate(f"c{a}{m}", *found.get((a, m), (0.0, 0.005)), "1") for a, m in PAIRS]
    told = ", ".join(
        f"{100 * abs(c):.1f} % of motor {motor} by motor {axis}" for (axis, motor), (c, _) in found.items()
    )
    sentence = f"motors turn although their axes are told to rest: {told}"
    return [Event("wrist_coupling", 0, rows, sentence, tuple(range(len(recordings))))]


def _follows(recordings: Sequence[Recording], axis: int, motors: Sequence[int]) -> dict[int, tuple[float, float]]:
    """Coefficient and standard deviation for each motor that turns the motor of an axis, from all recordings; none where they do not explain it."""
    each: list[tuple[Array, Array]] = []
    for r in recordings:
        assert r.qref is not None
        own = r.q[:, axis - 1] - r.qref[:, axis - 1]
        speed = np.gradient(r.qref[:, axis - 1], r.dt)
        others = np.stack([r.q[:, m - 1] - r.q[0, m - 1] for m in motors], axis=1)
        if np.std(others, axis=0).max() * 0.3 < STEPS * angle_noise(r.q)[axis - 1]:
            continue  # nothing turns that could turn it
        # a servo lags behind its own demand in proportion to its speed; what is constant is a zero
        each.append((np.column_stack([-others, speed, np.ones(len(own))]), own))
    if not each:
        return {}
    solved = [np.linalg.lstsq(x, y, rcond=1e-8)[0][: len(motors)] for x, y in each]
    common = np.median(solved, axis=0)
    for (x, y), _ in zip(each, solved):
        free = x[:, len(motors) :]
        rest = y - free @ np.linalg.lstsq(free, y, rcond=None)[0]
        turned = x[:, : len(motors)] @ common
        turned = turned - free @ np.linalg.lstsq(free, turned, rcond=None)[0]
        if np.sum((rest - turned) ** 2) > (1.0 - EXPLAINED) * np.sum(rest**2):
            return {}
    noise = float(np.mean([angle_noise(r.q)[axis - 1] for r in recordings]))
    if max(float(np.std(x[:, : len(motors)] @ common)) for x, _ in each) < STEPS * noise:
        return {}
    scatter = np.std(solved, axis=0) / np.sqrt(len(solved)) + 0.01 * np.abs(common)
    return {m: (float(c), float(s)) for m, c, s in zip(motors, common, scatter) if abs(c) > 3 * s}
