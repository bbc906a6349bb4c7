"""Noise of a recording's channels, from the recording alone: quantisation, scatter, and the currents at standstill."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, signal

from arm_io.types import Array
from daq.recording import Recording
from diagnosis.residual.filters import COMPARE_BAND, low_pass
from diagnosis.residual.noise.encoder_step import encoder_step, found_once
from identification.preprocessing import UNKNOWN, Setpoints, zero_phase
from identification.selection import MAD_TO_STD

QUIET_ROWS = 60
"""Rows that a quiet block must have."""
QUIET_BLOCKS = 5
"""Quiet blocks that there must be."""
VARIES = 1.5
"""Largest rms of the deviations of noise from straight lines, over that in the quietest fifth of all seconds.

Of noise correlated over 0.03 to 0.4 s it is 1.1 to 1.35.
"""
IN_LINES = 1.55
"""Rms of noise over that of its deviations from straight lines of one second, where it is correlated over 0.25 s."""
END_SECONDS = 0.1
"""Beginning of a recording that is excluded: filter transient and start of the drives."""
TOP = 0.7
"""Share of the Nyquist frequency from which on noise is looked for."""
SEGMENT = 128
"""Rows of a spectrum: half a second at 250 Hz."""
CLIPPED = 4.0
"""Times the mean power from which on a power is no noise; 2 % of noise are."""
ROUNDS = 20
"""Times that the mean is computed again without these powers, at most."""
CONVERGED = 0.999
"""Share of the mean before from which on it has converged."""
STILL_SECONDS = 0.2
"""Shortest standstill of the whole arm from which noise is estimated."""


def scatter(values: Array, measured: NDArray[np.bool_] | None = None) -> Array:
    """(n,) std of white noise on (m, n) samples, from the median absolute value above 0.7 of the Nyquist frequency.

    measured: (m, n) samples that count, as interpolated ones have no noise; all of a column that has none. None: all.
    """
    sections, passed = _high_pass()
    high = np.abs(zero_phase(sections, values))
    median = np.median(high, axis=0)
    if measured is not None:
        for j in np.flatnonzero(measured.any(axis=0) & ~measured.all(axis=0)):
            median[j] = np.median(high[measured[:, j], j])
    return np.asarray(MAD_TO_STD * median / np.sqrt(passed))


def floor(values: Array) -> Array:
    """(n,) std of white noise on (m, n) samples, between the lines of servos whose setpoints come every few rows.

    The smaller of ``scatter``, which passes over what fills few rows, as steps of friction and single transients, and
    of the floor of the spectrum, which passes over what fills few frequencies: these lines, their side bands, and
    whatever aliases above 0.7 of the Nyquist frequency.
    """
    deviation, (sections, _) = scatter(values), _high_pass()
    rows = min(SEGMENT, len(values))
    frequency, _, spectra = signal.stft(
        zero_phase(sections, values),
        2.0,
        nperseg=rows,
        noverlap=rows // 2,
        axis=0,
        boundary=None,
        padded=False,
        scaling="psd",
    )
    inside = (frequency >= TOP) & (frequency < 1.0 - 2.0 / rows)
    if not inside.any():
        return deviation
    _, response = signal.sosfreqz(sections, np.pi * frequency[inside])
    power = 2.0 * np.abs(spectra[inside]) ** 2 / np.abs(response[:, None, None]) ** 4
    lowest = np.array([_mean_of_noise(power[:, j].ravel()) for j in range(values.shape[1])])
    return np.minimum(deviation, np.sqrt(lowest))


def current_noise(
    i: Array,
    measured: NDArray[np.bool_] | None = None,
    *,
    between_lines: bool = False,
    beside: Array | None = None,
) -> Array:
    """(n,) A: std of what instruments add to each row of recorded currents (m, n), taken for white.

    Their ``scatter``, of the ``measured`` rows, or their ``floor``; no less than that of the converter's steps
    (variance step^2 / 12), of which a standing current shows few. beside: (m, n) A that are known without noise.
    """
    scattered = i if beside is None else i - beside
    white = floor(scattered) if between_lines else scatter(scattered, measured)
    known = [i[:, j] if measured is None else i[measured[:, j], j] for j in range(i.shape[1])]
    return np.maximum(white, np.array([encoder_step(column) for column in known]) / np.sqrt(12))


def _mean_of_noise(power: Array) -> float:
    """Mean of powers (k,) of noise, exponentially distributed, among which fewer than half are larger for a reason."""
    mean = float(np.median(power)) / np.log(2.0)
    inside = 1.0 - CLIPPED / np.expm1(CLIPPED)
    for _ in range(ROUNDS):
        noise_bins = power[power < CLIPPED * mean]
        if not len(noise_bins) or (less := float(noise_bins.mean()) / inside) > CONVERGED * mean:
            break
        mean = less
    return mean


@cache
def _high_pass() -> tuple[Array, float]:
    """Sections, and the share of white noise's power that passes them, forwards and back."""
    sections = signal.butter(4, TOP, "highpass", output="sos")
    _, response = signal.sosfreqz(sections, 1000)
    return sections, float(np.mean(np.abs(response) ** 4))


@dataclass(frozen=True)
class SimulatedLoop:
    """A closed loop on the demands of a recording of k rows, of which a residual keeps m; all 0 at joints unlike it.

    angle, current  (k, n) rad and A in its rows
    residual        (m, n) A: of the model that was simulated, so all that the method has wrong
    """

    angle: Array
    current: Array
    residual: Array


@dataclass(frozen=True, kw_only=True)
class KnownNoise:
    """What is known of the instruments beside the samples of a residual.

    still   (n,) A: std of the currents at standstill; 0 where it is not known
    steps   (n,) rad: of the encoders, for angles that were interpolated and show them no more; None: as the angles show
    band    Hz to which angles are smoothed before they are used (``instruments.band_of_angles``); inf: they are not
    setpoints  of the servos, as model or demands say; UNKNOWN: as the model or the currents say
    demands  (k, n) rad of the k rows: what the servos were asked; None: not recorded
    residual  (n,) A: std that the residual will have from the instruments, of samples that are simulated: neither it
              nor what sampling folds can be seen in these; None: as the samples show
    loop    a simulation of the recording, whose own residual is none of the recording's; None: none
    """

    still: Array | float = 0.0
    steps: Array | None = None
    band: float = np.inf
    setpoints: Setpoints = UNKNOWN
    demands: Array | None = None
    residual: Array | None = None
    loop: SimulatedLoop | None = None


NOTHING_KNOWN = KnownNoise()


def angle_noise(q: Array, steps: Array | None = None) -> Array:
    """(n,) rad: std of recorded angles (m, n): of their step (step / sqrt(12)) or their scatter, whichever is larger.

    Angles without steps have their scatter alone. ``steps`` (n,) rad: as of ``KnownNoise``.
    """
    steps = encoder_steps(q) if steps is None else steps
    quantised = steps / np.sqrt(12)
    white = angle_scatter(q)
    # the scatter of quantised angles follows from their steps to within a third: only more than that is further noise
    noise: Array = np.where(white > 2.0 * quantised, white, quantised)
    return noise


def angle_scatter(q: Array) -> Array:
    """(n,) rad: ``scatter`` of recorded angles (m, n)."""
    return np.array([_scatter_of(column) for column in q.T])


@found_once
def _scatter_of(angle: Array) -> float:
    return float(scatter(angle))


def encoder_steps(q: Array) -> Array:
    """(n,) rad: step of each of the recorded angles (m, n); 0 for those without."""
    return np.array([encoder_step(column) for column in q.T])


def resolution(q: Array) -> float:
    """rad: width of the uniform error that an angle (m,) is recorded with: its step or, if noise is larger, that."""
    return float(np.sqrt(12) * angle_noise(q[:, None])[0])


def still_noise(recordings: Sequence[Recording]) -> Array:
    """(n,) A: std, in the band of comparison, of the currents in the initial standstill of recordings.

    0 if no recording begins with one.

    Noise correlated over tenths of a second does not show in the scatter between neighbouring rows. The median of all
    recordings is taken, about their trends: while an arm settles, its currents change for a reason.
    """
    stds = []
    for recording in recordings:
        if (still := standstill(recording)) is not None:
            stds.append(_about_trend(low_pass(recording.i, COMPARE_BAND, 1.0 / recording.dt)[still]))
    return np.median(stds, axis=0) if stds else np.zeros(recordings[0].joints if recordings else 1)


_standstills: WeakKeyDictionary[Recording, slice | None] = WeakKeyDictionary()
"""Of recordings that were asked for: screening does so four times."""


def standstill(recording: Recording) -> slice | None:
    """Rows that a recording begins with in which no joint moves, after the start of the drives; None: too few."""
    if recording not in _standstills:
        _standstills[recording] = still_rows(recording.q, 1.0 / recording.dt)
    return _standstills[recording]


def still_rows(q: Array, rate: float) -> slice | None:
    """``standstill`` of recorded angles (m, n) rad at ``rate`` rows/s."""
    span = max(3, int(0.05 * rate))
    near = ndimage.maximum_filter1d(q, span, axis=0) - ndimage.minimum_filter1d(q, span, axis=0)
    away = np.abs(q - np.median(q[:span], axis=0))
    moving = np.any(np.maximum(near, away) > 8.0 * angle_noise(q), axis=1)
    first, last = int(END_SECONDS * rate), (int(np.argmax(moving)) if moving.any() else len(q)) - span
    return slice(first, last) if last - first > STILL_SECONDS * rate else None


def is_stationary(residual: Array, block: NDArray[np.intp], rows: NDArray[np.intp]) -> bool:
    """Whether a residual (m,), of which ``rows`` (k,) count, is as large in the quietest seconds as in all others.

    Noise is, however it is correlated; the effect of an error varies from second to second. False for too few rows.
    Compared are deviations from straight lines; what lies in the lines is no more than noise has there.
    """
    values = residual[rows]
    stds = _about_lines(rows, values, _of_enough_rows(block[rows]))
    if len(stds) < QUIET_BLOCKS:
        return False
    about_lines = float(np.sqrt(np.mean(stds**2)))
    in_all = float(np.sqrt(np.mean(values**2)))
    return about_lines <= VARIES * float(np.quantile(stds, 0.2)) and in_all <= IN_LINES * about_lines


def quiet_stds(values: Array, t: Array, rows: NDArray[np.bool_]) -> Array:
    """(k,) std of values (m,) about straight lines, in each second of t (m,) s of which all ``rows`` count."""
    second = (t - t[0]).astype(np.intp)
    whole = np.bincount(second, rows) >= np.bincount(second)
    of_whole = rows & whole[second]
    return _about_lines(np.flatnonzero(of_whole), values[of_whole], second[of_whole]) if of_whole.any() else np.zeros(0)


def _of_enough_rows(block: NDArray[np.intp]) -> NDArray[np.intp]:
    """Numbers of blocks (k,), in which those of fewer than ``QUIET_ROWS`` rows are one with the following.

    A joint that moves for half of every second shows its noise as well as one that moves all the time.
    """
    number, held = np.zeros(int(block.max(initial=0)) + 1, dtype=np.intp), 0
    for k, count in enumerate(np.bincount(block).tolist()):
        number[k] = number[k - 1] + (held >= QUIET_ROWS) if k else 0
        held = count + (held if held < QUIET_ROWS else 0)
    return number[block]


def _about_lines(x: NDArray[np.intp], y: Array, block: NDArray[np.intp]) -> Array:
    """Std of y (k,) about a straight line over x (k,) in each block that has enough rows."""
    count = np.bincount(block)
    rows = np.maximum(count, 1)
    x_about, y_about = (values - (np.bincount(block, values) / rows)[block] for values in (x, y))
    slope = np.bincount(block, x_about * y_about) / np.maximum(np.bincount(block, x_about**2), 1e-300)
    variance = np.bincount(block, (y_about - slope[block] * x_about) ** 2) / rows
    return np.asarray(np.sqrt(variance[count >= QUIET_ROWS]), float)


def _about_trend(values: Array) -> Array:
    """(n,) std of (m, n) values about straight lines through them: the settling of a servo is not noise."""
    x = np.linspace(-1.0, 1.0, len(values))
    detrended = values - np.polynomial.polynomial.polyval(x, np.polynomial.polynomial.polyfit(x, values, 1)).T
    deviation: Array = detrended.std(axis=0)
    return deviation
