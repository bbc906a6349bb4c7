"""From a recording's samples to the smooth motion and the rows that an identification may use.

One chain for every method: samples with their own stamps -> uniform grid -> zero-phase low-pass, the same for positions
and torques -> velocity and acceleration -> parallel filter and decimation, the same for the regressor and the torque.
What cannot be trusted (missing samples, gaps, saturation, standstill, the ends) is marked per joint, and every marked
row is counted under its reason.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import signal
from scipy.interpolate import make_interp_spline

from arm_io.types import Array
from arm_model.tables import Temperatures
from identification.preprocessing.filtering import butterworth, zero_phase
from identification.preprocessing.grid import longest_whole, nearest, on_grid, uniform_grid
from identification.preprocessing.setpoints import UNKNOWN, Setpoints
from identification.preprocessing.spectrum import Band, choose_band

Mask = NDArray[np.bool_]

FLAT = 5
"""Successive rows at the extreme value of a channel, while the joint moves, that count as saturated."""
SHAKEN = 0.02
"""Share of the largest travel below which a joint is only shaken by the others."""
CREEP = 0.005
"""Share of a joint's peak speed below which the direction of Coulomb friction is uncertain."""

# s: a joint that is slow for longer is at rest; a shorter passage is a reversal, in which Coulomb's law holds
REVERSAL = 0.01
ROWS = 16
"""Rows of the parallel filter at a time."""
SMEARED = 0.6
"""Periods of the low-pass's cut-off until a step that went through it is within 5 % of itself."""
MOST_ROWS = 200_000
"""Largest number of rows of a regression: each has some hundred columns."""
BLOCK = 1 << 15
"""Rows of a spline at a time."""
SPLINE_END = 25
"""Rows in which a quintic spline forgets its end or a hole (by 0.43 a row; Unser, 1999)."""


@dataclass(frozen=True)
class Motion:
    """Smooth motion on a uniform grid of dt s.

    t            (m,) s from the first sample
    q, qd, qdd   (m, J) rad, rad/s, rad/s2 (m, m/s, m/s2)
    torque       (m, J) N m (N) at the joint, after the same low-pass
    usable       (m, J) samples that count; excluded: reason -> number of the others per joint (J,)
    certain      (m, J) usable samples in which the sign of the velocity is known for as long as the low-pass smears a
                 step. Around a reversal the torque's step of Coulomb friction is smeared and the column's is not, and
                 friction there is not Coulomb's law: for a fit, such samples are made zero on both sides
    band         Hz, of the low-pass and of the parallel filter
    folded       (m, J) N m (N): one standard deviation of what sampling may have put into the torque unseen, of these
                 ``setpoints`` (``setpoint_ripple``); None: nothing, or nothing bounds it
    for_judging  the samples about reversals stay (``with_reversals``)
    sparing      every so many rows of the parallel filter are kept, all by default (``spared``)
    temperatures  of the motors meanwhile, where they were recorded
    revolute     (J,) which joints are; None: all are of one kind
    """

    dt: float
    t: Array
    q: Array
    qd: Array
    qdd: Array
    torque: Array
    usable: Mask
    certain: Mask
    excluded: Mapping[str, NDArray[np.int64]]
    band: Band
    folded: Array | None = None
    setpoints: Setpoints = UNKNOWN
    for_judging: bool = False
    sparing: int = 1
    temperatures: Temperatures | None = None
    revolute: Mask | None = None

    def moves(self, j: int) -> bool:
        """Whether joint j (from 0) is driven, and not only shaken by the others: those of its kind, in its unit."""
        travel = np.ptp(self.q, axis=0)
        alike = slice(None) if self.revolute is None else self.revolute == self.revolute[j]
        return bool(self.usable[:, j].any() and travel[j] > SHAKEN * travel[alike].max())

    def without(self, joints: Mask, reason: str) -> Motion:
        """Not a row of these ``joints`` (J,) usable; those that were are counted under ``reason``."""
        excluded = {**self.excluded, reason: np.where(joints, self.usable.sum(axis=0), 0)}
        return replace(self, usable=self.usable & ~joints, certain=self.certain & ~joints, excluded=excluded)


def smooth_motion(
    t: Array, q: Array, torque: Array, *, saturated: Mask | None = None, band: Band | None = None
) -> Motion:
    """The motion behind samples t (n,) s increasing, q (n, J), torque (n, J); NaN where a sample is missing.

    ``saturated`` (n, J) marks torques that the instrument clipped; flat tops are found here. ``band``: see
    ``choose_band``, the default.
    """
    grid, dt = uniform_grid(t)
    q_smooth, far_q = on_grid(t, q, grid, dt)
    torque_smooth, far_torque = on_grid(t, torque, grid, dt)
    band = band or choose_band(q_smooth[longest_whole(far_q, dt)], dt)
    for channels in (q_smooth, torque_smooth):
        channels[:] = low_passed(channels, band, dt)
    qd, qdd = _derivatives(q_smooth, dt)

    # A hole narrower than an eighth of the shortest period that passes counts as sampled.
    bridge = max(1.5 * dt, 1 / (8 * band.motion))
    memory = int(np.ceil(1 / (band.motion * dt)))
    reach = memory + SPLINE_END
    clipped = flat_tops(torque, q) if saturated is None else saturated | flat_tops(torque, q)
    slow = np.abs(qd) <= slowest_certain_speed(q, qd, band, dt)
    reasons = {
        "gap": _dilate(np.any(far_q > bridge, axis=1, keepdims=True) | (far_torque > bridge), reach),
        "end": np.repeat(_ends(len(grid), reach)[:, None], q.shape[1], axis=1),
        "saturated": _dilate(nearest(t, clipped, grid), reach),
        "standstill": _lasting(slow, int(np.ceil(REVERSAL / dt))),
    }
    usable = np.ones(q_smooth.shape, bool)
    excluded = {}
    for reason, marked in reasons.items():
        excluded[reason] = np.sum(usable & marked, axis=0)
        usable &= ~marked
    certain = usable & ~_dilate(slow, int(np.ceil(SMEARED / (band.motion * dt))))
    return Motion(dt, grid - t[0], q_smooth, qd, qdd, torque_smooth, usable, certain, excluded, band)


def low_passed(channels: Array, band: Band, dt: float) -> Array:
    """Channels (m, ...) at rows dt s apart through the low-pass of positions and torques.

    A torque that steps at a reversal rings after it; a column of such a torque does so after the same filter only.
    """
    low_pass = butterworth(4, band.motion * dt * 2)
    return _both_ways(low_pass, channels)


def parallel_filter(motion: Motion, columns: Array) -> Array:
    """``columns`` (m, ...) low-pass filtered, with 2.5 / ``sparing`` rows left per period of the cut-off frequency.

    This is the parallel filter: both sides of the equations of motion pass through it.

    A finite symmetric impulse response (zero phase), so that row k rests on rows k step .. k step + window - 1 alone.
    """
    taps, step = _parallel(motion)
    return _decimated(columns, taps, step)


def _decimated(columns: Array, taps: Array, step: int) -> Array:
    """``columns`` (m, ...) by the impulse response ``taps``, every ``step``-th row that it fits under."""
    flat = columns.reshape(len(columns), -1)
    rows = (len(flat) - len(taps)) // step + 1
    # A product with a band of shifted taps, some rows at a time: most of it is zeros, and still the quickest way for
    # many columns.
    band = np.zeros((min(ROWS, rows), (min(ROWS, rows) - 1) * step + len(taps)))
    for row in range(len(band)):
        band[row, row * step : row * step + len(taps)] = taps
    kept = np.zeros((rows, flat.shape[1]))
    # what acts on one joint is zero at the others
    used = np.flatnonzero(flat.any(axis=0))
    for first in range(0, rows, ROWS):
        count = min(ROWS, rows - first)
        width = (count - 1) * step + len(taps)
        kept[first : first + count, used] = band[:count, :width] @ flat[first * step : first * step + width, used]
    return kept.reshape(rows, *columns.shape[1:])


def spared(motions: Sequence[Motion]) -> list[Motion]:
    """The motions with rows of the parallel filter left out until MOST_ROWS remain of all joints and motions.

    Little is lost: what an hour of motion leaves unexplained is correlated for longer than the rows are then apart.
    """
    rows = sum(len(motion.t) // parallel_window(motion)[1] * motion.q.shape[1] for motion in motions)
    return [replace(motion, sparing=max(1, -(-rows // MOST_ROWS))) for motion in motions]


def parallel_window(motion: Motion) -> tuple[int, int]:
    """Rows under the parallel filter's impulse response, and from one kept row to the next."""
    taps, step = _parallel(motion)
    return len(taps), step


def parallel_rows(motion: Motion) -> tuple[Array, Mask]:
    """Times (k,) s of the rows of ``parallel_filter``, and which of them (k, J) rest on usable rows alone.

    A row counts as such if at least 98 % of its filter weight is on usable rows.
    """
    taps, step = _parallel(motion)
    weight = np.abs(taps) / np.abs(taps).sum()
    bad = _decimated((~motion.usable).astype(float), weight, step)
    first = (len(taps) - 1) // 2
    return motion.t[first : first + step * len(bad) : step], np.asarray(bad < 0.02)


def equation_rows(motion: Motion) -> tuple[Array, Mask]:
    """Stamps (k,) s of the rows of ``parallel_filter`` and which of them may be used (k, J).

    Those of ``parallel_rows``; of a motion for fitting, those in which samples that are certain have half of the
    weight.
    """
    t, trusted = parallel_rows(motion)
    return t, trusted if motion.for_judging else parallel_filter(motion, equation_weight(motion)) > 0.5


def sliding_rows(motion: Motion) -> Mask:
    """(k, J) rows of ``parallel_filter`` that rest on certain samples alone: no reversal or standstill is near."""
    return parallel_rows(replace(motion, usable=motion.certain))[1]


def equation_weight(motion: Motion) -> Array:
    """(m, J) factor of both sides of the equations before the parallel filter: 0 where the equations do not hold."""
    return np.ones(motion.usable.shape) if motion.for_judging else motion.certain.astype(float)


def with_reversals(motion: Motion) -> Motion:
    """The motion for judging a fit rather than for fitting."""
    return replace(motion, for_judging=True)


def parallel_taps(motion: Motion) -> Array:
    """(m,) the symmetric impulse response of the parallel low-pass."""
    cut = motion.band.parallel * motion.dt  # of the rate
    return _taps(min(int(np.ceil(2.0 / cut)), (len(motion.t) - 1) // 4), cut)


@lru_cache(maxsize=256)
def _taps(half: int, cut: float) -> Array:
    """(2 half + 1,) read-only taps of a low-pass at ``cut`` of the rate of the rows."""
    taps = np.asarray(signal.firwin(2 * half + 1, min(2 * cut, 0.98)), float)
    taps.setflags(write=False)
    return taps


def _parallel(motion: Motion) -> tuple[Array, int]:
    taps, cut = parallel_taps(motion), motion.band.parallel * motion.dt
    return taps, max(1, int(1 / (2.5 * cut))) * motion.sparing


def slowest_certain_speed(q: Array, qd: Array, band: Band, dt: float) -> Array:
    """Below this speed (J,) the sign of the velocity, and with it Coulomb friction, is not known.

    Less than one encoder step within a period of the filter; three times the velocity noise that passes it; creep.
    """
    step = np.array([_resolution(column) for column in q.T])
    # White position noise of rms s has density 2 dt s^2; differentiated and cut at f: s_v^2 = 2 dt s^2 (2 pi)^2 f^3 /
    # 3.
    noise = band.noise_rms * 2 * np.pi * np.sqrt(2 * dt * band.motion**3 / 3)
    rounding = 1e-9 * np.maximum(np.max(np.abs(q), axis=0), 1.0)  # a joint at rest in a simulation has noise 0
    still = np.where(np.ptp(q, axis=0) < rounding, np.inf, 0.0)
    return np.maximum.reduce([step * band.motion, 3 * noise, CREEP * np.max(np.abs(qd), axis=0), still])


def stretches_of(marked: NDArray[np.bool_]) -> NDArray[np.intp]:
    """(k, 2) the first row of every stretch of ``marked`` rows (m,), and the row after its last."""
    return np.flatnonzero(np.diff(marked, prepend=False, append=False)).reshape(-1, 2)


def longest_stretch(marked: NDArray[np.bool_]) -> int:
    """Number of rows of the longest stretch of ``marked`` rows (m,); 0 where none is."""
    return int(np.max(np.diff(stretches_of(marked)), initial=0))


def flat_tops(channel: Array, q: Array) -> Mask:
    """Rows (n, J) of at least FLAT equal samples at the channel's extreme value while the joint moves."""
    flat = np.zeros(channel.shape, bool)
    for j, column in enumerate(channel.T):
        if not np.isfinite(column).any():
            continue
        low, high = np.nanmin(column), np.nanmax(column)
        for extreme in (low, high):
            at = (column == extreme) & (high > low)
            for start, stop in stretches_of(at):
                if stop - start >= FLAT and np.ptp(q[start:stop, j]) > 0:
                    flat[start:stop, j] = True
    return flat


def _both_ways(sos: Array, channels: Array) -> Array:
    pad = min(len(channels) - 1, 3 * int(np.ceil(10 / max(1e-3, 1 - np.max(np.abs(signal.sos2zpk(sos)[1]))))))
    return zero_phase(sos, channels, pad=pad)


def _derivatives(q: Array, dt: float) -> tuple[Array, Array]:
    """First and second derivative of the quintic spline through q (m, J), rows dt s apart.

    A block at a time: twice SPLINE_END rows beyond it, what the spline does there is less than rounding.
    """
    first, second = np.empty_like(q), np.empty_like(q)
    for start in range(0, len(q), BLOCK):
        # The last block takes in what would be too short a block of its own.
        stop = len(q) if len(q) - start < 2 * BLOCK else start + BLOCK
        low, high = max(0, start - 2 * SPLINE_END), min(len(q), stop + 2 * SPLINE_END)
        t = dt * np.arange(high - low)
        spline = make_interp_spline(t, q[low:high], k=5)
        inside = t[start - low : stop - low]
        first[start:stop], second[start:stop] = spline(inside, 1), spline(inside, 2)
        if stop == len(q):
            break
    return first, second


def _lasting(marked: Mask, rows: int) -> Mask:
    """Only those runs of ``marked`` (m, J) that last longer than ``rows``: a reversal at speed is not a standstill."""
    lasting = np.zeros_like(marked)
    for j, column in enumerate(marked.T):
        for start, stop in stretches_of(column):
            lasting[start:stop, j] = stop - start > rows
    return lasting


def _dilate(marked: Mask, reach: int) -> Mask:
    """``marked`` (m, J) widened by ``reach`` rows either way."""
    count = np.cumsum(
        np.concatenate([np.zeros((reach + 1, marked.shape[1])), marked, np.zeros((reach, marked.shape[1]))]), axis=0
    )
    return np.asarray(count[2 * reach + 1 :] - count[: -2 * reach - 1] > 0)


def _ends(rows: int, reach: int) -> Mask:
    ends = np.zeros(rows, bool)
    ends[:reach] = ends[-reach:] = True
    return ends


def _resolution(column: Array) -> float:
    """Smallest step between the values that an encoder channel takes, rad or m; 0 where it is not quantised."""
    values = np.unique(column[np.isfinite(column)])
    steps = np.diff(values)
    if len(steps) < 10:
        return float(steps.min()) if len(steps) else 0.0
    step = float(np.quantile(steps, 0.02))
    multiples = np.abs(steps / step - np.rint(steps / step)) < 0.05 if step > 0 else np.zeros(1, bool)
    return step if np.mean(multiples) > 0.9 else 0.0
