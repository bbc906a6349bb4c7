"""Where sampling puts the spectral lines of setpoints: onto 0 Hz, beside it, or far from the motion.

Setpoints every T s make lines at whole multiples of 1/T (``setpoint_ripple``). Rows at n/T put line n onto 0 Hz. The
rate of the rows need not be a multiple of that of the setpoints: of 5 rows in 2 setpoints, the fifth line falls onto
0 Hz. Other lines fall beside it, at up to some tens of Hz, where they look like an oscillation: of setpoints every
10 ms in 240 rows/s, the fifth is seen at 20 Hz.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from identification.preprocessing.setpoints import Setpoints
from identification.preprocessing.setpoints_in_currents import seen_at

BEAT = 1.0
"""Hz from 0 at which a line counts as on it. A quicker beat changes its sign many times in a run: a residual shows it,
and the blocks of ``uncertainty`` count it."""
LINES = 24
"""Lines that are followed: the next are below a twentieth of the first."""
AWAY = 0.4
"""Of the setpoints' rate: the distance of a good sampling rate from its multiples."""

Lines = NDArray[np.int_]


def folded_into(band: tuple[float, float], period: float, rate: float) -> Array:
    """(k,) Hz within ``band`` at which rows at ``rate`` Hz show lines from half of that rate up to it, and none below.

    How large such a line is depends on how servo and transducer respond there. If setpoints come a little later, it
    turns by the angle of its own frequency, not of that at which it is seen. Servos filter what is above the rate. A
    period of 0: setpoints are not known.
    """
    lines = np.arange(1, int(rate * period) + 1)
    if not len(lines):
        return np.zeros(0)
    seen, below = seen_at(lines, period, rate), lines / period <= rate / 2
    folded = np.unique(seen[~below & (seen >= band[0]) & (seen <= band[1])])
    return np.array([f for f in folded if np.all(np.abs(seen[below] - f) > BEAT)])


def whole_rows(setpoints: Setpoints, rate: float) -> int:
    """Rows at ``rate`` Hz per setpoint if they beat more slowly than BEAT; else 0."""
    rows = round(setpoints.period * rate)
    return rows if rows > 1 and abs(rows / setpoints.period - rate) <= BEAT else 0


def folding_line(setpoints: Setpoints, rate: float) -> int:
    """The lowest line of setpoints that rows at ``rate`` Hz put within BEAT of 0 Hz; 0: none.

    As many as rows per setpoint where these are a whole number. Of one row per setpoint or less, no line is counted but
    the first, of servos that work several times per setpoint.
    """
    rows = whole_rows(setpoints, rate)
    if rows:
        return rows
    if as_one(setpoints, rate):
        return int(setpoints.within and seen_at(np.array([1]), setpoints.period, rate)[0] <= BEAT)
    return next((k for k in range(2, LINES + 1) if seen_at(np.array([k]), setpoints.period, rate)[0] <= BEAT), 0)


def as_one(setpoints: Setpoints, rate: float) -> bool:
    """Whether rows at ``rate`` Hz are no more frequent than setpoints, as when recorder and controller are one program.

    True also if no setpoints are known.
    """
    return setpoints.period * rate < 1.0 + BEAT * setpoints.period


def unbounded(setpoints: Setpoints, rate: float) -> bool:
    """Whether a line falls onto 0 Hz that no other bounds: the first; the second of known setpoints of two rows each.

    Such currents do not determine an inertia. Setpoints that the currents show are seen in their first line.
    """
    line = folding_line(setpoints, rate)
    return line == 1 or (line == 2 and setpoints.source != "currents")


def rate_beside(period: float, rate: float) -> float:
    """``rate`` Hz, or the next lower one at which the ripple of setpoints every ``period`` s is far from the motion.

    0.4 of the setpoints' own rate beside a multiple. A period of 0: of an arm without a controller. Below two rows per
    setpoint there is no lower one.
    """
    rows = round(rate * period)
    return rate if rows < 2 or abs(rate * period - rows) > AWAY / 2 else round((rows - AWAY) / period, 2)


def rate_instead(period: float, rate: float) -> float:
    """Hz at which to record where rows at ``rate`` Hz fold the ripple of setpoints every ``period`` s onto the motion.

    The next lower one beside a multiple of the setpoints' own; where ``rate`` is beside one, as 2.5 rows per setpoint
    are, the one below its double.
    """
    beside = rate_beside(period, max(rate, 2.0 / period))
    return beside if beside != rate else rate_beside(period, 2.0 * rate)
