"""Transients of servos at setpoints that sampling puts onto the motion, or near it, where no residual shows them.

The host sends a setpoint every T s, servos follow a broken line, and every corner causes a transient in the currents in
proportion to the acceleration. Seen at times, these transients are spectral lines at whole multiples of 1/T, modulated
by the acceleration. Sampled n times per setpoint, the line at n/T falls onto 0 Hz: what is recorded is torque + c q'',
where c depends on the phase of the two clocks. The columns of a joint's own inertia say the same, so that the fit is
wrong by c and its residual is as small as ever (measured on the simulated Puma: ``docs/identification-evidence.md``).

Which lines fall onto 0 Hz, and which beside it: ``folding``.

Lines that are seen elsewhere bound those that are not: a held command falls with its frequency f at least as 1/f, and a
lag makes it fall faster.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm_io.types import Array
from identification.preprocessing.filtering import butterworth, zero_phase
from identification.preprocessing.folding import BEAT, LINES, Lines, as_one, folding_line, unbounded
from identification.preprocessing.setpoints import Setpoints
from identification.preprocessing.setpoints_in_currents import seen_at
from identification.preprocessing.signals import Motion, smooth_motion

IN_BAND = 25.0
"""Hz: nearer to 0 a line is seen in the band of a residual, side bands of the motion included."""
MOST_BESIDE = 3
"""Frequencies beside 0 Hz."""
STANDS = 0.1
"""Of a joint's rms acceleration: a stretch with less shows no ripple that it causes."""
FOLLOWS = np.log(2.0)
"""Of the ratio of both accelerations, as a logarithm: a joint that moves otherwise than its demands say has others."""
LEADS = tuple(np.arange(0.0, 0.042, 0.004).tolist())
"""s by which setpoints may be ahead of the motion: delays of servos with bandwidths down to 4 Hz."""
STRETCH = 5.0
"""s in which two clocks stay in phase to a fraction of a line's period."""


@dataclass(frozen=True)
class Driven:
    """Torques of joints that servos drive from setpoint to setpoint, as recorded.

    t, torque  (n,) s and (n, J) N m (N); NaN where a torque is missing
    setpoints  how often they come
    demands    (n, J) rad (m) that the servos follow; None: not known
    band       Hz up to which demands are followed, that of the residual that this is held against; None: the motion's
               own
    """

    t: Array
    torque: Array
    setpoints: Setpoints
    demands: Array | None = None
    band: float | None = None

    @property
    def since(self) -> Array:
        """(n,) s from the first row."""
        return self.t - self.t[0]

    @property
    def rate(self) -> float:
        """Rows/s."""
        return (len(self.t) - 1) / float(self.t[-1] - self.t[0])


def drifting(folded: Array, t: Array) -> Array:
    """(m, 2, ...): ``folded`` (m, ...) at t (m,) s of a run with clocks in phase, and its drift as they diverge."""
    along = (2 * t / max(t[-1], 1e-9) - 1).reshape(-1, *[1] * (folded.ndim - 1))
    return np.stack([folded, folded * along], axis=1)


def folded_torque(motion: Motion, driven: Driven) -> Array | None:
    """(m, J) N m (N) on the grid of the ``driven`` motion: one std of c q'' above.

    None where nothing folds, or nothing bounds what does (``unbounded``). Two std bound c at any phase.
    """
    rate = 1 / motion.dt
    line = folding_line(driven.setpoints, rate)
    if line == 0 or not len(_bounding(line, driven.setpoints, rate)):
        return None
    pushing = _pushing([line], motion, driven)
    return np.asarray(pushing * _bounds([line], motion, pushing, driven))


def folded_along(q: Array, driven: Driven) -> Array | None:
    """(n, J) N m (N): ``folded_torque`` at the rows of recorded angles q (n, J) rad (m).

    InputError as of ``smooth_motion``.
    """
    if folding_line(driven.setpoints, driven.rate) == 0 or unbounded(driven.setpoints, driven.rate):
        return None
    motion = smooth_motion(driven.t, q, driven.torque)
    folded = folded_torque(motion, driven)
    return None if folded is None else _at(driven.since, motion, folded)


def _pushing(lines: list[int], motion: Motion, driven: Driven) -> Array:
    """(m, J) rad/s2 (m/s2): the acceleration that causes the transients, without the transients themselves.

    The motion is later than setpoints by the delay of its servo, and an inertia of 2 % that is 20 ms ahead of the
    motion looks like a time skew of 0.4 ms. So it is that of the demands of a joint that follows them, and elsewhere
    that of the motion, as far ahead as the lines that are seen follow it best.
    """
    t, demands, period = driven.since, driven.demands, driven.setpoints.period
    moved = _slow(motion.qdd, motion, period)
    bends = np.zeros_like(moved)
    if demands is not None and demands.shape[1:] == moved.shape[1:] and np.isfinite(demands).all():
        on_grid = np.column_stack([np.interp(motion.t, t, column) for column in demands.T])
        bends = np.diff(on_grid, 2, axis=0, prepend=on_grid[:1], append=on_grid[-1:]) / motion.dt**2
    alike = _slow(bends, motion, period)
    followed = np.abs(np.log(np.maximum(alike.std(axis=0), 1e-12) / np.maximum(moved.std(axis=0), 1e-12))) < FOLLOWS
    asked = alike if driven.band is None else _slow(bends, motion, period, driven.band)
    if followed.all():
        return asked
    seen = np.unique(np.concatenate([_bounding(line, driven.setpoints, 1 / motion.dt) for line in lines]))
    ripple = driven.torque - _at(t, motion, _slow(motion.torque, motion, period))
    columns = [
        asked[:, j] if followed[j] else _ahead(moved[:, j], motion.t, t, ripple[:, j], seen / period)
        for j in range(moved.shape[1])
    ]
    return np.column_stack(columns)


def _ahead(acceleration: Array, grid: Array, t: Array, ripple: Array, frequency: Array) -> Array:
    """(m,) ``acceleration`` (m,) on the ``grid`` (m,) s, moved ahead by that one of LEADS which explains most ripple.

    ripple (n,) N m (N) at t (n,) s; frequency (k,) Hz of the lines that are visible.
    """
    here = np.isfinite(ripple)
    angle = 2 * np.pi * t[here, None] * frequency
    transients = np.concatenate([np.cos(angle), np.sin(angle)], axis=1)

    def explained(lead: float) -> float:
        columns = np.interp(t[here] + lead, grid, acceleration)[:, None] * transients
        found = columns @ np.linalg.lstsq(columns, ripple[here], rcond=None)[0]
        return float(found @ found)

    return np.interp(grid + max(LEADS, key=explained), grid, acceleration)


def lines_beside_zero(q: Array, driven: Driven) -> list[tuple[float, Array]]:
    """Frequency Hz, and amplitude std (n, J) N m (N), of lines that sampling aliases to near 0 Hz, but not onto it.

    The MOST_BESIDE largest ones, largest first; q (n, J) rad (m): recorded angles.
    """
    of_frequency = _near_zero(driven.setpoints, driven.rate)
    if not of_frequency:
        return []
    motion = smooth_motion(driven.t, q, driven.torque)
    lines = [line for at_hz in of_frequency.values() for line in at_hz]
    pushing = _pushing(lines, motion, driven)
    amplitudes = [(hz, 2 * pushing * _bounds(of_one, motion, pushing, driven)) for hz, of_one in of_frequency.items()]
    largest = sorted(amplitudes, key=lambda line: -float(np.sum(line[1] ** 2)))[:MOST_BESIDE]
    return [(hz, _at(driven.since, motion, amplitude)) for hz, amplitude in largest]


def _near_zero(setpoints: Setpoints, rate: float) -> dict[float, list[int]]:
    """Hz beside 0 at which lines of the setpoints are seen -> these lines; only lines that others bound."""
    period = setpoints.period
    if as_one(setpoints, rate):
        return {}
    lines = np.arange(1, LINES + 1)
    seen = seen_at(lines, period, rate)
    near = (seen > BEAT) & (seen < min(IN_BAND, 0.5 / period))
    of_frequency: dict[float, list[int]] = {}
    for line, frequency in zip(lines[near].tolist(), seen[near].tolist()):
        if len(_bounding(line, setpoints, rate)):
            # lines seen at the same frequency add up
            same = next((other for other in of_frequency if abs(other - frequency) <= BEAT), frequency)
            of_frequency.setdefault(same, []).append(line)
    return of_frequency


def _bounding(line: int, setpoints: Setpoints, rate: float) -> Lines:
    """Lines between a quarter of ``line`` and itself, or below, that are seen far from 0 Hz, each at its own place.

    Of two rows per setpoint that the currents show, the first line, at the Nyquist frequency.
    """
    lower = np.arange(1, line)
    if _at_nyquist(line, setpoints):
        return lower
    seen = seen_at(lower, setpoints.period, rate)
    inside = (seen > min(IN_BAND, 0.5 / setpoints.period)) & (seen < rate / 2 - BEAT)
    # of lines seen at the same frequency, the lowest stands for all
    together = np.abs(seen[:, None] - seen) <= BEAT
    lower = lower[inside & ~np.any(np.tril(together, -1), axis=1)]
    near = lower[lower >= line / 4]
    return near if len(near) else lower


def _at_nyquist(line: int, setpoints: Setpoints) -> bool:
    """Whether ``line`` is the second of two rows per setpoint, bounded by the first, at the Nyquist frequency."""
    return line == 2 and setpoints.source == "currents"


def _slow(values: Array, motion: Motion, period: float, band: float | None = None) -> Array:
    """(m, J) what is demanded of values (m, J) on the motion's grid up to ``band`` Hz, without the transients."""
    cut = min(motion.band.parallel if band is None else band, 0.5 / period)
    low_pass = butterworth(4, 2 * cut * motion.dt)
    return zero_phase(low_pass, values)


def _bounds(lines: list[int], motion: Motion, pushing: Array, driven: Driven) -> Array:
    """(J,) kg m2 (kg): std of the sum of ``lines`` per acceleration ``pushing`` (m, J), by the lines that are seen."""
    t, setpoints = driven.since, driven.setpoints
    variance, slow = np.zeros(pushing.shape[1]), _slow(motion.torque, motion, setpoints.period)
    for line in lines:
        seen = _bounding(line, setpoints, 1 / motion.dt)
        angle = 2 * np.pi * t[:, None] * seen / setpoints.period
        transients = np.concatenate([np.cos(angle), np.sin(angle)], axis=1)
        if _at_nyquist(line, setpoints):
            # one phase of the bounding line is seen: what folds may be twice as large as by both
            transients = np.cos(angle) / 2
        for j in np.flatnonzero(motion.usable.any(axis=0)):
            ripple = driven.torque[:, j] - np.interp(t, motion.t, slow[:, j])
            columns = np.interp(t, motion.t, pushing[:, j])[:, None] * transients
            variance[j] += _power(columns, ripple, t, seen / line) / 4
    return np.sqrt(variance)


def _power(transients: Array, ripple: Array, t: Array, scale: Array) -> float:
    """Mean squared amplitude of k lines with columns ``transients`` (n, k) or (n, 2 k), each times ``scale`` (k,)."""
    power, least = [], STANDS * np.std(transients[:, 0])
    for stretch in np.array_split(np.arange(len(t)), max(1, int(t[-1] / STRETCH))):
        rows = stretch[np.isfinite(ripple[stretch])]
        if len(rows) > 10 * transients.shape[1] and np.std(transients[rows, 0]) > least:
            amplitude = np.linalg.lstsq(transients[rows], ripple[rows], rcond=None)[0].reshape(-1, len(scale))
            power.append(np.mean(np.sum(amplitude**2, axis=0) * scale**2))
    return float(np.mean(power)) if power else 0.0


def _at(t: Array, motion: Motion, values: Array) -> Array:
    """(n, J): values (m, J) on a motion's grid, at times t (n,) s from its start."""
    return np.column_stack([np.interp(t, motion.t, column) for column in values.T])
