"""Plots of motor minus link encoder."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from arm_model import Arm
from arm_model.effects import CATALOGUE, Instrument, Variable
from arm_report.palette import AFTER, BEFORE, GRID
from diagnosis.measurements.link_encoders.causes import LinkSide
from diagnosis.units import unit_at

if TYPE_CHECKING:
    from matplotlib.figure import Figure

AGAINST = {Variable.LOAD: ("load", "load", "N m"), Variable.VELOCITY: ("v", "velocity", "rad/s")}
"""Field of the rows, name and unit of the variables that a difference is drawn against, in addition to the angle."""


def link_overview(link: LinkSide, arm: Arm) -> tuple[Figure, str]:
    """Held-out difference of every joint's encoders over time, its constant left out, before and after all causes."""
    from matplotlib.figure import Figure

    joints = [int(j) for j in link.held_out.joints]
    figure = Figure(figsize=(10.5, 0.8 + 1.35 * len(joints)), layout="constrained")
    axes = figure.subplots(len(joints), 1, sharex=True, squeeze=False)[:, 0]
    t = np.arange(link.held_out.rows) * float(link.held_out.t[1] - link.held_out.t[0])
    for k, (joint, axis) in enumerate(zip(joints, axes)):
        for values, colour, when in ((link.without, BEFORE, "before"), (link.residual, AFTER, "after all causes")):
            axis.plot(t, values[:, k] * 1e3, color=colour, lw=0.8, label=when)
        axis.set_ylabel(f"joint {joint}, m{unit_at(arm.joints[joint - 1], 'rad')}")
        axis.grid(color=GRID)
    axes[0].legend(loc="upper right", ncols=2, fontsize="small")
    axes[-1].set_xlabel("held-out recordings, s")
    figure.suptitle("motor minus link encoder", x=0.01, ha="left", fontsize="medium")
    return figure, "held-out difference of motor and link encoders before and after"


def link_figure(link: LinkSide, arm: Arm, effect: str, joint: int) -> tuple[Figure, str]:
    """Held-out difference of one joint's encoders over its angle and over the variable that shows the effect best.

    Before and after all causes.
    """
    from matplotlib.figure import Figure

    k, drive = int(np.flatnonzero(link.held_out.joints == joint)[0]), arm.joints[joint - 1]
    variable = CATALOGUE[effect].observed_by[Instrument.LINK_ENCODER].against
    panels = [("q", "angle", "rad"), *([AGAINST[variable]] if variable in AGAINST else [])]
    # an effect that changes the description is a constant between two encoders
    constant = link.held_out.difference[:, k].mean() if CATALOGUE[effect].change is not None else 0.0
    figure = Figure(figsize=(10.5, 3.2), layout="constrained")
    axes = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    for axis, (field, name, unit) in zip(axes, panels):
        x = getattr(link.held_out, field)[:, k]
        for values, colour, when in (
            (link.without + constant, BEFORE, "before"),
            (link.residual, AFTER, "after all causes"),
        ):
            axis.plot(x, values[:, k] * 1e3, ".", ms=1.6, color=colour, label=when)
        axis.set_xlabel(f"{name} of joint {joint}, {unit_at(drive, unit)}")
        axis.grid(color=GRID)
    axes[0].set_ylabel(f"motor minus link encoder\nof joint {joint}, m{unit_at(drive, 'rad')}")
    axes[0].legend(loc="best", fontsize="small", markerscale=5)
    return figure, f"motor minus link encoder of joint {joint} against {panels[-1][1]}"
