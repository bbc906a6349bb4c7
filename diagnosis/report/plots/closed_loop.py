"""Spectrum of the closed-loop current error, without and with the causes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy import signal

from arm_io.types import Array
from arm_report.palette import AFTER, BEFORE, GRID, SHADE
from diagnosis.closed_loop.comparison import Compared
from diagnosis.closed_loop.resonance import BAND
from diagnosis.residual.expected_current import rate_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure


SEGMENT = 1.0
"""s: length of the segments over which the spectrum is averaged."""


def loop_figure(pairs: Sequence[tuple[Compared, Compared]], joint: int, unit: str) -> tuple[Figure, str]:
    """Amplitude density of measured minus simulated current of a joint, in ``unit`` per root hertz.

    pairs: held-out loops (before, after).
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.5, 3.4), layout="constrained")
    axis = figure.subplots()
    for several, colour, label in zip(zip(*pairs), (BEFORE, AFTER), ("without any cause", "with all causes")):
        frequency, density = _spectrum(several, joint)
        axis.semilogy(frequency, density, color=colour, lw=1.2, label=label)
    axis.axvspan(*BAND, color=SHADE, lw=0.0)
    axis.set_xlim(0.0, 1.2 * BAND[1])
    axis.set_xlabel("frequency, Hz (shaded: band compared)")
    axis.set_ylabel(f"closed-loop current error\nof joint {joint}, {unit}/sqrt(Hz)")
    axis.legend(fontsize="small")
    axis.grid(color=GRID, which="both")
    return figure, f"spectrum of the current error of joint {joint} in closed loop, without and with the causes"


def _spectrum(loops: Sequence[Compared], joint: int) -> tuple[Array, Array]:
    rate = rate_of(loops[0].t)
    rows = min(round(SEGMENT * rate), *(len(one.t) for one in loops))
    each = [signal.welch((one.current - one.simulated_current)[:, joint - 1], rate, nperseg=rows) for one in loops]
    return each[0][0], np.sqrt(np.mean([density for _, density in each], axis=0))
