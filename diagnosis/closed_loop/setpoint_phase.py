"""When the setpoints of a host came, against the rows of a recording.

Demands are recorded as a plan, of which the host sends a setpoint every some 10 ms; which instants these are, the
recording does not state. Each setpoint makes a transient of the currents, so a simulation whose setpoints come 1 ms
later differs by half of the transient at 50 Hz, while its angles differ by micrometres. The transients themselves show
the lag: it is the one at which measured and simulated currents agree best.
"""

from __future__ import annotations

import numpy as np
from scipy import fft
from scipy.signal import CZT

from arm_io.types import Array

LARGEST_LAG = 0.02
"""s: half of the longest period of setpoints that is usual."""
FINE = 16
"""Points of the cross-correlation per row."""


def lag_of(measured: Array, simulated: Array, rate: float) -> float:
    """s by which measured (m, n) is behind simulated (m, n), of all columns together, within ``LARGEST_LAG``.

    Both band-passed, each column in units of its noise. The likeliest for errors of unknown size: each column counts by
    the logarithm of the squared error that is left, so that one that the simulation has wrong at any lag, as a joint
    that swings, decides nothing. Between the points of the correlation lies a parabola.
    """
    fine = FINE * rate
    reach = min(round(LARGEST_LAG * fine), FINE * (len(measured) - 1))
    alike = _correlation(measured, simulated, reach + 1)
    squares = np.sum(measured**2 + simulated**2, axis=0) - 2.0 * alike
    near = -np.sum(np.log(np.maximum(squares, 0.0) + len(measured)), axis=1)
    k = 1 + int(np.argmax(near[1:-1]))
    before, at, after = near[k - 1 : k + 2]
    bend = before - 2 * at + after
    return float((k - reach - 1 + (0.5 * (before - after) / bend if bend < 0.0 else 0.0)) / fine)


def _correlation(measured: Array, simulated: Array, most: int) -> Array:
    """(2 most + 1, n): sums of measured (m, n) times simulated (m, n) earlier by k/FINE rows, k from -most to most.

    Between rows by their spectrum, whose inverse transform is computed at these lags alone: those of all rows would be
    a hundred times as many.
    """
    size = fft.next_fast_len(2 * len(measured), real=True)
    spectrum = fft.rfft(measured.T, size) * np.conj(fft.rfft(simulated.T, size))
    spectrum[:, 1 : (size + 1) // 2] *= 2.0  # negative frequencies too
    turn = 2j * np.pi / (FINE * size)
    at_lags = CZT(spectrum.shape[1], 2 * most + 1, np.exp(turn), np.exp(turn * most))
    return np.asarray(at_lags(spectrum), np.complex128).real.T / size
