"""When the setpoints of a host came, against the rows of a recording.

Demands are recorded as a plan, of which the host sends a setpoint every some 10 ms; which instants these are, the
recording does not tell. Each setpoint makes a transient of the currents, so a simulation whose setpoints come 1 ms
later differs by half of the transient at 50 Hz, while its angles differ by micrometres. The transients themselves show
the lag: it is the one at which measured and simulated currents agree best.
"""

from __future__ import annotations

import numpy as np
from scipy import fft

from arm_io.types import Array

LARGEST_LAG = 0.02
"""s: half of the longest period of setpoints that is usual."""
FINE = 16
"""Points of the cross-correlation per row."""


def lag_of(measured: Array, simulated: Array, rate: float) -> float:
    """s by which measured (m, n) is behind simulated (m, n), of all columns together, within ``LARGEST_LAG``.

    Both band-passed, each column in units of its noise. The likeliest for errors of unknown size: each column counts by
    the logarithm of the squared error that is left, so that one that the simulation has wrong at any lag, as a joint
    that swings, decides nothing. Correlations are interpolated between rows by their spectrum, and between those points
    by a parabola.
    """
    fine = FINE * rate
    reach = min(round(LARGEST_LAG * fine), FINE * (len(measured) - 1))
    size = fft.next_fast_len(2 * len(measured), real=True)
    spectrum = fft.rfft(measured, size, axis=0) * np.conj(fft.rfft(simulated, size, axis=0))
    together = FINE * fft.irfft(spectrum, FINE * size, axis=0)
    alike = np.concatenate([together[-reach - 1 :], together[: reach + 2]])
    squares = np.sum(measured**2 + simulated**2, axis=0) - 2.0 * alike
    near = -np.sum(np.log(np.maximum(squares, 0.0) + len(measured)), axis=1)
    k = 1 + int(np.argmax(near[1:-1]))
    before, at, after = near[k - 1 : k + 2]
    bend = before - 2 * at + after
    return float((k - reach - 1 + (0.5 * (before - after) / bend if bend < 0.0 else 0.0)) / fine)
