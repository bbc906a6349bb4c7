"""Spectrum of the closed-loop current error, without and with the causes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm_io.types import Array
from arm_model import Joint
from arm_report import Chart, Panel, Series, Zone
from arm_report.palette import AFTER, BEFORE, SHADE
from diagnosis.closed_loop.comparison import LoopComparison, LoopPair
from diagnosis.closed_loop.loop_errors import BAND
from diagnosis.residual.filters import rate_of
from identification import recorded_quantity

SEGMENT = 1.0
"""s: length of the segments over which the spectrum is averaged."""


def loop_chart(name: str, pairs: Sequence[LoopPair], joint: int, drive: Joint) -> Chart:
    """Amplitude density of measured minus simulated current of a joint (from 1), in its unit per root hertz.

    pairs: held-out loops (before, after); drive: that joint.
    """
    lines, quantity = [], recorded_quantity(drive)
    for loops, colour, label in zip(zip(*pairs), (BEFORE, AFTER), ("without any cause", "with all causes")):
        frequency, density = _spectrum(loops, joint)
        shown = frequency <= 1.2 * BAND[1]
        lines.append(Series(x=frequency[shown], y=density[shown], colour=colour, label=label, width=1.2))
    panel = Panel(
        series=tuple(lines),
        zones=(Zone(low=BAND[0], high=BAND[1], axis="x", colour=SHADE, label="band compared"),),
        x="frequency, Hz",
        y=f"{quantity} error, {drive.command_unit}/sqrt(Hz)",
        log_y=True,
        joint=joint,
    )
    title = f"spectrum of the {quantity} error of joint {joint} in closed loop, without and with the causes"
    return Chart(name=name, title=title, panels=(panel,), height=2.9)


def _spectrum(loops: Sequence[LoopComparison], joint: int) -> tuple[Array, Array]:
    rate = rate_of(loops[0].t)
    rows = min(round(SEGMENT * rate), *(len(one.t) for one in loops))
    each = [one.spectrum("current", joint, rows) for one in loops]
    return each[0][0], np.sqrt(np.mean([density for _, density in each], axis=0))
