"""How often a host sent setpoints, from the demands of a recording: for models that say nothing of their controller.

Servos follow straight lines between setpoints. Such a line bends at every setpoint and nowhere else, so that the
magnitude of the second difference of the demands is a train of pulses at their rate. A plan bends all the time.
"""

from __future__ import annotations

import numpy as np

from arm_io.types import Array

SLOWEST = 5.0
"""Hz: setpoints that are slower are not looked for."""
FEWEST = 2.2
"""Rows per setpoint: of two, the pulses follow one another without a row between."""
SHARP = 0.5
"""Share of the pulses that must be in step with the line of their rate: of 2.5 rows per setpoint 0.57 are, of more
rows more."""
LARGEST = 3.0
"""Times the median pulse: where few corners are much sharper than others, as of a motion from point to point, these
would make the line as wide as their moves are short."""
OCTAVE = 1.5
"""Below it there is no other multiple of the first line."""


def setpoint_period(demands: Array, dt: float) -> float:
    """s between setpoints of demands (m, J), rows ``dt`` s apart; 0: they are no straight lines, or too short ones."""
    bends = np.nan_to_num(np.abs(np.diff(demands, 2, axis=0))).sum(axis=1)
    bent = bends > 1e-6 * bends.max(initial=0.0)
    if bent.sum() < 20:
        return 0.0
    pulses = np.minimum(bends, LARGEST * float(np.median(bends[bent])))
    length = 1 << int(np.ceil(np.log2(4 * len(pulses))))
    line = np.abs(np.fft.rfft(pulses, length))
    frequency = np.fft.rfftfreq(length, dt)
    inside = (frequency > SLOWEST) & (frequency < 1.0 / (FEWEST * dt))
    sharp = np.flatnonzero(inside & (line > SHARP * pulses.sum()))
    if not len(sharp):
        return 0.0
    # the first line: where every setpoint comes at a row, all its multiples are as strong
    first = sharp[frequency[sharp] < OCTAVE * frequency[sharp[0]]]
    best = int(first[np.argmax(line[first])])
    # the top of the line, between the frequencies of the spectrum
    low, top, high = line[best - 1 : best + 2]
    between = 0.5 * (low - high) / min(low - 2 * top + high, -1e-30)
    return float(1.0 / (frequency[best] + between * frequency[1]))
