"""Plots of a single axis at its full rate."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from arm_model import Joint
from arm_model.effects import CATALOGUE, Instrument, Variable
from arm_report.palette import AFTER, BEFORE, GRID
from diagnosis.measurements.single_axis.causes import AxisSide
from diagnosis.units import unit_at

if TYPE_CHECKING:
    from matplotlib.figure import Figure

UP, DOWN = AFTER, BEFORE
BINS = 24
NEAR = 4.0
"""Times the velocity by which an effect has a width (Stribeck's): what is drawn."""


def axis_figure(axis: AxisSide, effect: str, drive: Joint) -> tuple[Figure, str]:
    """Held-out residual without one of the causes and with all, against what shows that cause.

    Velocity, place, or how fast the command changes.
    """
    from matplotlib.figure import Figure

    cause = next(one for one in axis.causes if one.effect == effect)
    definition = CATALOGUE[effect]
    match definition.observed_by[Instrument.SINGLE_AXIS].against:
        case Variable.CURRENT_RATE:
            x, label = axis.held_out.rate, f"change of the command, {drive.current_unit}/s"
        case Variable.POSITION:
            x, label = axis.held_out.q, f"position, {unit_at(drive, 'rad')}"
        case _:
            x, label = axis.held_out.v, f"velocity, {unit_at(drive, 'rad/s')}"
    widths = {p.name for p in definition.nonlinear if p.unit == "rad/s"}
    reach = next((NEAR * p.value for p in cause.parameters if p.name in widths), np.inf)
    shown = np.abs(x) < reach
    figure = Figure(figsize=(10.5, 3.2), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    for panel, values, colour, title in zip(
        panels, (cause.without, axis.residual), (BEFORE, AFTER), ("without it", "with all causes")
    ):
        panel.plot(x[shown], values[shown], ".", ms=2.0, color=colour)
        panel.set_title(title, loc="left", fontsize="medium")
        panel.set_xlabel(label)
        panel.grid(color=GRID)
    top = 1.1 * float(np.quantile(np.abs(cause.without[shown]), 0.995))
    panels[0].set_ylim(-top, top)
    panels[0].set_ylabel(f"measured minus predicted\nbelow 60 Hz, {drive.current_unit}")
    return figure, f"held-out residual without {effect.replace('_', ' ')} and with it"


def wave_figure(axis: AxisSide, drive: Joint) -> tuple[Figure, str]:
    """The residual with all causes over one length of the wave, per direction."""
    from matplotlib.figure import Figure

    assert axis.wave is not None
    length, unit = (axis.wave.length, "rad") if drive.revolute else (1e3 * axis.wave.length, "mm")
    place = np.mod(axis.held_out.q, axis.wave.length) * (length / axis.wave.length)
    edges = np.linspace(0.0, length, BINS + 1)
    figure = Figure(figsize=(10.5, 3.2), layout="constrained")
    panel = figure.subplots()
    for rows, colour, name in ((axis.held_out.v > 0, UP, "forwards"), (axis.held_out.v < 0, DOWN, "backwards")):
        values = axis.residual[rows] - np.mean(axis.residual[rows])
        panel.plot(place[rows], values, ".", ms=1.4, color=colour, alpha=0.25)
        bins = np.clip(np.digitize(place[rows], edges) - 1, 0, BINS - 1)
        mean = np.bincount(bins, values, BINS) / np.maximum(np.bincount(bins, minlength=BINS), 1)
        panel.plot((edges[1:] + edges[:-1]) / 2, mean, "-", lw=2.0, color=colour, label=f"{name}, mean")
    top = 1.1 * float(np.quantile(np.abs(axis.residual), 0.98))
    panel.set_ylim(-top, top)
    panel.set_xlabel(f"position modulo {length:.4g} {unit}, {unit}")
    panel.set_ylabel(f"residual with all causes,\n{drive.current_unit}")
    panel.grid(color=GRID)
    panel.legend(loc="upper right", fontsize="small")
    return figure, f"residual with all causes against position modulo {length:.4g} {unit}"
