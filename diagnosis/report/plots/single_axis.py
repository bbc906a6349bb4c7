"""Charts of a single axis at its full rate."""

from __future__ import annotations

import numpy as np

from arm_model import Joint
from arm_model.effects import CATALOGUE, Instrument, Variable
from arm_report import Chart, Panel, Series
from arm_report.palette import AFTER, BEFORE, PALE_AFTER, PALE_BEFORE
from diagnosis.measurements.single_axis.causes import AxisSide

BINS = 24
NEAR = 4.0
"""Times the velocity by which an effect has a width (Stribeck's): what is drawn."""


def axis_chart(name: str, axis: AxisSide, effect: str, drive: Joint) -> Chart:
    """Held-out residual with all causes and without one of them, against what shows that cause.

    This is the velocity, the position, or the rate of the command.
    """
    cause = next(one for one in axis.causes if one.effect == effect)
    definition = CATALOGUE[effect]
    match definition.observed_by[Instrument.SINGLE_AXIS].against:
        case Variable.CURRENT_RATE:
            x, label = axis.held_out.rate, f"change of the command, {drive.command_unit}/s"
        case Variable.POSITION:
            x, label = axis.held_out.q, f"position, {drive.unit('rad')}"
        case _:
            x, label = axis.held_out.v, f"velocity, {drive.unit('rad/s')}"
    widths = {p.name for p in definition.nonlinear if p.unit == "rad/s"}
    reach = next((NEAR * p.value for p in cause.parameters if p.name in widths), np.inf)
    shown = np.abs(x) < reach
    top = 1.1 * float(np.quantile(np.abs(cause.without[shown]), 0.995)) or 1.0
    sides = ((cause.without, BEFORE, "without it"), (axis.residual, AFTER, "with all causes"))
    panels = [
        Panel(
            series=(Series(x=x[shown], y=values[shown], kind="dots", colour=colour, label=title),),
            title=title,
            x=label,
            y=f"residual, {drive.command_unit}",
            y_range=(-top, top),
        )
        for values, colour, title in sides
    ]
    title = f"held-out residual below 60 Hz without {effect.replace('_', ' ')} and with it"
    return Chart(name=name, title=title, panels=tuple(panels), columns=2, height=2.9)


def wave_chart(axis: AxisSide, drive: Joint) -> Chart:
    """The residual with all causes over one length of the wave, per direction."""
    assert axis.wave is not None
    length, unit = (axis.wave.length, "rad") if drive.revolute else (1e3 * axis.wave.length, "mm")
    place = np.mod(axis.held_out.q, axis.wave.length) * (length / axis.wave.length)
    edges = np.linspace(0.0, length, BINS + 1)
    clouds, means = [], []
    for rows, pale, colour, name in (
        (axis.held_out.v > 0, PALE_AFTER, AFTER, "forwards"),
        (axis.held_out.v < 0, PALE_BEFORE, BEFORE, "backwards"),
    ):
        values = axis.residual[rows] - np.mean(axis.residual[rows])
        clouds.append(Series(x=place[rows], y=values, kind="dots", colour=pale, label=name))
        bins = np.clip(np.digitize(place[rows], edges) - 1, 0, BINS - 1)
        mean = np.bincount(bins, values, BINS) / np.maximum(np.bincount(bins, minlength=BINS), 1)
        middle = (edges[1:] + edges[:-1]) / 2
        means.append(Series(x=middle, y=mean, colour=colour, label=f"{name}, mean", width=2.0))
    top = 1.1 * float(np.quantile(np.abs(axis.residual), 0.98)) or 1.0
    panel = Panel(
        series=(*clouds, *means),
        x=f"position modulo {length:.4g} {unit}, {unit}",
        y=f"residual with all causes, {drive.command_unit}",
        y_range=(-top, top),
    )
    title = f"residual with all causes against position modulo {length:.4g} {unit}"
    return Chart(name="wave", title=title, panels=(panel,), height=2.9)
