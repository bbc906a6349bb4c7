"""What servos ask of their drives, by their own linear law, which recordings of demands, angles and currents show.

A servo of any structure, P-PI cascade or PID, with feed-forward of gravity and acceleration or without, gives a sum of
the demand, the angle, their rates, the integral of the error and what is fed forward. Its gains are fitted to the rows
in which the current is small. Where the drive gives no more, the law asks for more than any row has, whatever the arm
does: masses, friction and what is wrong with them are in no term (a parity relation of the controller: Chow & Willsky,
IEEE Transactions on Automatic Control 29, 1984).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from arm_io.types import Array
from arm_model import Arm
from arm_model.system import rigid_torque_along
from daq.recording import Recording
from diagnosis.residual.filters import MOTION_BAND, TRANSIENT, low_pass
from diagnosis.residual.noise.channels import current_noise
from diagnosis.residual.noise.encoder_step import encoder_step
from diagnosis.residual.run_setup import has_demand, set_up

SMALL, AWAY = 0.85, 0.05
"""Share of the largest current below which rows show the law of the servo, and s from any larger one."""
MOVES = 0.01
"""rad (m) that a joint must move in a recording to show anything."""
MOST = 0.9
"""Share of the rows with less than the largest current that must get what the law asks for."""
FLAT = 2.0
"""Noises by which a current may scatter where its drive gives no more."""
HALF = 0.674
"""Standard deviations of a normal distribution on either side of its mean within which half of it lies."""
MEMORY = 0.1
"""s after which the noise of a current says something new."""
LEAST_TIME = 0.01
"""s for which a servo must ask for more, in all."""
BAND = 0.4
"""Of the rate of the rows, at most: the band in which the law is fitted."""


@dataclass(frozen=True, kw_only=True)
class Clipped:
    """A current that a drive does not exceed though its servo asks for more.

    level, std  A; recordings: those that show it, by index
    """

    level: float
    std: float
    recordings: tuple[int, ...]


def fed_forward(recording: Recording, arm: Arm) -> Array | None:
    """(m, n) N m (N) against gravity at the demands, which servos may feed forward; None without demands."""
    if recording.qref is None or not has_demand(recording):
        return None
    still = np.zeros_like(recording.qref)
    return rigid_torque_along(set_up(arm, recording), recording.qref, still, still)


def clipped_by_command(recordings: Sequence[Recording], weights: Sequence[Array | None], j: int) -> Clipped | None:
    """The level at which the current of joint j (from 0) is clipped; None where no servo asked for more than it got.

    weights: of each recording, as of ``fed_forward``.
    """
    usable = [k for k, r in enumerate(recordings) if has_demand(r) and np.ptp(r.q[:, j]) > MOVES]
    if not usable:
        return None
    laws = [_Rows.of(recordings[k], weights[k], j) for k in usable]
    top = max(float(np.abs(law.given).max()) for law in laws)
    small = [law.small(SMALL * top) for law in laws]
    command = _commands(laws, small)
    if command is None:
        return None
    doubt = _doubt(laws, command, small, top)
    # where more is asked, a law that is wrong by a share is wrong by more, and so it is far from the rows that show it
    doubts = [doubt * np.maximum(one.reach, np.maximum(np.abs(one.asked) / (SMALL * top), 1.0)) for one in command]
    beyond = [np.where(np.abs(one.asked) > top + far, np.sign(one.asked), 0.0) for one, far in zip(command, doubts)]
    shown = [recordings[k].i[law.kept, j] * sign for k, law, sign in zip(usable, laws, beyond)]
    at_level = np.concatenate([i[sign != 0.0] for i, sign in zip(shown, beyond)])
    seconds = len(at_level) * recordings[usable[0]].dt
    if seconds < LEAST_TIME:
        return None
    low, level, high = np.quantile(at_level, (0.25, 0.5, 0.75))
    noise = max(float(current_noise(recordings[k].i)[j]) for k in usable)
    step = max(encoder_step(recordings[k].i[:, j]) for k in usable)
    if high - low > 2.0 * HALF * FLAT * noise:
        return None
    independent = max(1.0, seconds / MEMORY)
    return Clipped(
        level=float(level),
        std=max(step / 2, noise / float(np.sqrt(independent))),
        recordings=tuple(k for k, sign in zip(usable, beyond) if sign.any()),
    )


def _doubt(laws: Sequence[_Rows], command: Sequence[_Command], small: Sequence[NDArray[np.bool_]], top: float) -> float:
    """A by which the law departs from any row that shows it, or from most in which it asks for less than the ``top``.

    A drive gives these what they ask for, and the law was not fitted to them.
    """
    errors = [np.abs(law.given - one.asked) for law, one in zip(laws, command)]
    sizes = [np.abs(one.asked) for one in command]
    fitted = max(float(error[rows].max()) for error, rows in zip(errors, small))
    given = np.concatenate([error[(size > SMALL * top) & (size < top)] for error, size in zip(errors, sizes)])
    return max(fitted, float(np.quantile(given, MOST))) if len(given) else fitted


@dataclass(frozen=True)
class _Command:
    """What the law asks for in one recording: (m,) A, and how far each row is from those that show the law.

    reach  (m,) root of its leverage over the largest of theirs (Belsley, Kuh, Welsch, Regression Diagnostics, 1980)
    """

    asked: Array
    reach: Array


@dataclass(frozen=True)
class _Rows:
    """One joint in one recording, in the band: columns (m, p) of the law, and the current (m,) A that was given."""

    columns: Array
    given: Array
    kept: slice
    period: float

    @classmethod
    def of(cls, recording: Recording, weight: Array | None, j: int) -> _Rows:
        """Those of joint j (from 0), without the filter's transients at both ends; ``weight`` as of ``fed_forward``."""
        rate = 1.0 / recording.dt
        end = round(TRANSIENT * rate)
        rows = slice(end, len(recording) - end)
        terms = np.column_stack([*_terms(recording, weight, j), recording.i[:, j]])
        smooth = low_pass(terms - terms[0], min(MOTION_BAND, BAND * rate), rate) + terms[0]
        return cls(smooth[rows, :-1], smooth[rows, -1], rows, recording.dt)

    def small(self, level: float) -> NDArray[np.bool_]:
        """(m,): whether the current is below a level, A, there and for some time on both sides."""
        away = 2 * round(AWAY / self.period) + 1
        return np.asarray(ndimage.minimum_filter1d(np.abs(self.given) < level, away))


def _terms(recording: Recording, weight: Array | None, j: int) -> Iterator[Array]:
    """(m,) each: what a servo's command may be a sum of."""
    assert recording.qref is not None and weight is not None
    demand, q, period = recording.qref[:, j], recording.q[:, j], recording.dt
    rate = np.gradient(demand, period)
    yield from (demand - q, rate, np.gradient(q, period), np.cumsum(demand - q) * period, q, np.gradient(rate, period))
    yield weight[:, j]


def _commands(laws: Sequence[_Rows], small: Sequence[NDArray[np.bool_]]) -> list[_Command] | None:
    """What the law asks for, with one set of gains and a constant per recording (its integral begins).

    None where too few rows show it.
    """
    every = [
        np.column_stack([law.columns, *(np.full(len(law.given), float(k == own)) for k in range(len(laws)))])
        for own, law in enumerate(laws)
    ]
    if sum(int(rows.sum()) * law.period for law, rows in zip(laws, small)) < 1.0 or not all(r.any() for r in small):
        return None
    a = np.concatenate([one[rows] for one, rows in zip(every, small)])
    scale = np.linalg.norm(a, axis=0)
    scale[scale == 0.0] = 1.0
    given = np.concatenate([law.given[rows] for law, rows in zip(laws, small)])
    gains = np.linalg.lstsq(a / scale, given)[0] / scale
    spread = np.linalg.pinv((a / scale).T @ (a / scale), hermitian=True)
    leverage = [np.sqrt(np.maximum(np.sum((one / scale @ spread) * (one / scale), axis=1), 0.0)) for one in every]
    largest = max(float(one[rows].max()) for one, rows in zip(leverage, small))
    return [_Command(one @ gains, far / largest) for one, far in zip(every, leverage)]
