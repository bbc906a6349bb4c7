"""Errors of the closed loop that stand clearly above the noise with all causes in the model.

Below 20 Hz and from there to 100 Hz, in the fitted recordings and in those held out. The median of one-second blocks is
judged, not the whole: how a servo comes to rest, or breaks away, is not determined by its demands, and fills some
seconds with errors of ten times the noise where nothing is wrong. Where sampling folds lines of the setpoints into the
upper band, it is judged without them.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy import signal
from scipy.interpolate import CubicSpline

from arm_io.types import Array
from diagnosis.cause import Signal, Structure
from diagnosis.cause.structure import NO_VARIABLE
from diagnosis.closed_loop.comparison import LoopComparison, LoopPair
from diagnosis.closed_loop.loop_errors import band_sections, white_noise_share
from diagnosis.closed_loop.setpoint_phase import lag_of
from diagnosis.residual.filters import COMPARE_BAND, TRANSIENT, rate_kept, rate_of
from diagnosis.residual.noise.channels import current_noise, still_rows
from diagnosis.residual.run import Run
from identification.preprocessing import zero_phase
from identification.preprocessing.folding import folded_into
from identification.selection import Split, Thresholds

HIGHEST = 100.0
"""Hz: above it, a model of servos and rotors without amplifiers says nothing."""
FOLDED = 5.0
"""Hz on either side of a folded line that are left out: transients follow an acceleration of some Hz."""
PARTS_OF_BAND = 2
"""Of equal ratio of their edges: in each the power of noise that is correlated over some ms varies by a few times."""
LEAST_SHARE = 0.2
"""Of the rows of a block that must be compared for it to count."""
LEAST_BLOCKS = 4
"""Of which a median is taken."""
PARTS = {"fit": "fitted", "held_out": "held-out"}
"""Words for the fitted and the held-out recordings."""
Pairs = Sequence[LoopPair]


@dataclass(frozen=True, kw_only=True)
class VerdictLimits(Thresholds):
    """Above what nothing is ``consistent`` or ``explained``: medians of one-second blocks over the noise.

    Of 12 simulated Pumas without a fault (seed 51201, fitted and held-out recordings) the largest is 1.7 below 20 Hz
    and 2.3 above: springs of their own, and transients at setpoints, which the servos' models have nearly right.

    loop, loop_band  below 20 Hz, and between 20 and 100 Hz
    """

    loop: float = 2.5
    loop_band: float = 4.0


LIMITS = VerdictLimits()


LeftOver = tuple[Array, Array]
"""(n,) A rms: what an identified model left beyond the noise on healthy recordings, below and above COMPARE_BAND."""

SampledLoops = Callable[[], Sequence[Sequence[LoopComparison]]]
"""Simulates the loops of arms drawn from the uncertainty of the model: of each arm, those of all recordings."""

EXACT_MODEL: Split[SampledLoops] = Split(list, list)
"""Of a model without uncertainty no arms are drawn."""


def clear_errors(
    loops: Split[Sequence[LoopPair]],
    runs: Split[Sequence[Run]],
    reported: Sequence[int | None],
    sampled: Split[SampledLoops] = EXACT_MODEL,
    left_over: LeftOver | None = None,
) -> list[Structure]:
    """Closed-loop errors clearly above the noise, at joints (from 1) that are not ``reported`` already.

    runs: all recordings, also those without a closed loop. sampled: what the uncertainty of the model makes of the
    loops with all causes (``model_errors.spreads``); left_over: what the model left on healthy recordings. Limits are
    above the noise and these together. Of fitted and held-out recordings, those with the larger error are named.
    """
    largest: dict[tuple[int, str], tuple[float, str]] = {}
    for (part, pairs), of_part, drawn in zip(loops.items(), runs, sampled):
        for joint, against, ratio in _clear_in(pairs, of_part, drawn, left_over):
            if joint not in reported and ratio > largest.get((joint, against), (0.0, ""))[0]:
                largest[joint, against] = ratio, part
    return [
        Structure(Signal.CLOSED_LOOP, joint, against, 0.0, f"{ratio:.1f} times the noise, in {PARTS[part]} recordings")
        for (joint, against), (ratio, part) in sorted(largest.items())
    ]


def _clear_in(
    pairs: Pairs, runs: Sequence[Run], sampled: SampledLoops, left_over: LeftOver | None
) -> Iterator[tuple[int, str, float]]:
    """Joint (from 1), band and size, over the noise, of every clear error; arguments as of ``clear_errors``."""
    if not pairs:
        return
    period = max(run.setpoints.period for run in runs)
    noise = np.mean([run.loop_noise for run in runs], axis=0), _noise_above(pairs, period), period
    bands = _ratios(pairs, *noise)
    if not any(np.any(ratio > limit) for _, limit, ratio in bands):
        return
    drawn = [_ratios([(one, one) for one in loops], *noise) for loops in sampled()]
    for k, (against, limit, ratio) in enumerate(bands):
        by_uncertainty = np.mean([of_arm[k][2] ** 2 for of_arm in drawn], axis=0) if drawn else 0.0
        healthy = 0.0 if left_over is None else left_over[k] / _noise_of(k, *noise)
        for j in np.flatnonzero(ratio > limit * np.sqrt(1.0 + healthy**2 + by_uncertainty)):
            yield int(j) + 1, against, float(ratio[j])


def _noise_of(band: int, noise: Array, above: Sequence[Array], _: float) -> Array:
    """(n,) A: noise below COMPARE_BAND (band 0), and from there to HIGHEST (band 1); arguments as of ``_ratios``."""
    return noise if band == 0 else np.asarray(np.mean(above, axis=0))


def _noise_above(pairs: Pairs, period: float) -> list[Array]:
    """(n,) A per recording: noise from COMPARE_BAND to HIGHEST; period: s between setpoints, or 0.

    That of its scatter from row to row, taken for white, or what the recordings show while they stand, whichever is
    larger: noise that is correlated over some ms hardly scatters from row to row.
    """
    standing = [_standing(one) for _, one in pairs]
    known = [one for one in standing if one is not None]
    at_rest = np.median(known, axis=0) if known else 0.0
    white = [
        _in_band(current_noise(one.current, one.measured("current")), _sections(rate_of(one.t), period))
        for _, one in pairs
    ]
    return [np.maximum(own, at_rest) for own in white]


def _standing(one: LoopComparison) -> Array | None:
    """(n,) A: noise from COMPARE_BAND to HIGHEST of the currents in the initial standstill, without lines; None: none.

    By the median of the spectrum in each of PARTS_OF_BAND: a servo that oscillates is no noise.
    """
    rate = rate_of(one.t)
    if (rows := still_rows(one.angle, rate)) is None:
        return None
    frequency, density = signal.periodogram(signal.detrend(one.current[rows], axis=0), rate, "hann", axis=0)
    variance = np.zeros(one.current.shape[1])
    for low, high in itertools.pairwise(np.geomspace(COMPARE_BAND, HIGHEST, PARTS_OF_BAND + 1)):
        inside = (frequency >= low) & (frequency < high)
        if inside.any():
            variance += (high - low) * np.median(density[inside], axis=0) / np.log(2.0)
    return np.sqrt(variance)


def _ratios(pairs: Pairs, noise: Array, above: Sequence[Array], period: float) -> list[tuple[str, float, Array]]:
    """For both bands: name, limit, and (n,) the median error of each joint over the noise.

    noise: (n,) A, below COMPARE_BAND; above: (n,) A per recording (``_noise_above``); period: s between setpoints or 0.
    """
    upper = f"frequencies of {COMPARE_BAND:.0f} to {HIGHEST:.0f} Hz"
    return [
        (NO_VARIABLE, LIMITS.loop, _medians(_below(after, noise) for _, after in pairs)),
        (upper, LIMITS.loop_band, _above_medians(pairs, above, period)),
    ]


def _above_medians(pairs: Pairs, noise: Sequence[Array], period: float) -> Array:
    """(n,) medians from COMPARE_BAND to HIGHEST: the simulation moved as a whole, or what it has without the causes.

    Setpoints that come later move transients. What follows the angles, as cogging does, stays where it is.
    """
    whole, parts = zip(*(_above(*pair, own, period) for pair, own in zip(pairs, noise)))
    return np.minimum(_medians(iter(whole)), _medians(iter(parts)))


def _medians(parts: Iterator[Array]) -> Array:
    """(n,) root of the median of the blocks' mean squares (blocks, n); 0 where there are too few."""
    blocks = np.concatenate(list(parts))
    if not len(blocks):
        return np.zeros(blocks.shape[1])
    enough = np.sum(np.isfinite(blocks), axis=0) >= LEAST_BLOCKS
    known = np.where(enough, blocks, 0.0)
    return np.asarray(np.sqrt(np.nanmedian(known, axis=0)))


def _below(one: LoopComparison, noise: Array) -> Array:
    """(blocks, n) mean square of the error below COMPARE_BAND over the noise (n,), at the rows that are compared."""
    error = one.error("current") / noise
    return _of_blocks(error, one.known[: len(error)], round(rate_kept(rate_of(one.t))))


def _above(before: LoopComparison, one: LoopComparison, noise: Array, period: float) -> tuple[Array, Array]:
    """(blocks, n) mean squares of the error from COMPARE_BAND to HIGHEST over the ``noise`` (n,) A there.

    At rows that were measured. The instants of the setpoints are not recorded: the simulation is moved to where its
    transients are those measured; first as a whole, then only what it is without the causes.
    """
    rate = rate_of(one.t)
    if rate < 4 * COMPARE_BAND:
        none = np.full((0, one.current.shape[1]), np.nan)
        return none, none
    sections = _sections(rate, period)
    known = one.measured("current")
    measured, simulated, without = (
        zero_phase(sections, current) / noise
        for current in (
            np.where(known, one.current, one.simulated_current),
            one.simulated_current,
            before.simulated_current,
        )
    )
    end = round(TRANSIENT * rate)
    lag = lag_of((known * measured)[end:-end], (known * simulated)[end:-end], rate)

    def error_per_block(moving: Array) -> Array:
        moved = CubicSpline(one.t, moving)(np.clip(one.t - lag, one.t[0], one.t[-1])) + (simulated - moving)
        error = (measured - moved)[end:-end]
        return _of_blocks(error, known[end:-end], round(rate))

    return error_per_block(simulated), error_per_block(without)


@cache
def _sections(rate: float, period: float) -> Array:
    """Of the band from COMPARE_BAND to HIGHEST at ``rate`` rows/s, less what setpoints every ``period`` s fold."""
    band = COMPARE_BAND, HIGHEST
    without = [
        signal.butter(2, [2 * (f - FOLDED) / rate, 2 * (f + FOLDED) / rate], btype="bandstop", output="sos")
        for f in folded_into(band, period, rate)
    ]
    return np.vstack([band_sections(rate, band), *without])


def _in_band(white: Array, sections: Array) -> Array:
    """(n,) std that a filter, forwards and back, leaves of white noise of std (n,)."""
    return np.asarray(np.maximum(white * np.sqrt(white_noise_share(sections)), 1e-12))


def _of_blocks(values: Array, measured: NDArray[np.bool_], rows: int) -> Array:
    """(blocks, n) mean squares of values (m, n) over blocks of ``rows``; NaN where too few rows are known."""
    blocks = len(values) // rows
    shape = blocks, rows, values.shape[1]
    squares, weight = (part[: blocks * rows].reshape(shape) for part in (values**2 * measured, measured.astype(float)))
    counted = weight.sum(axis=1)
    return np.where(counted >= LEAST_SHARE * rows, squares.sum(axis=1) / np.maximum(counted, 1.0), np.nan)
