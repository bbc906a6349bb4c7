"""Overview of all residuals, and the plot of each cause."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from arm_model.effects import CATALOGUE, Instrument, Variable
from arm_report.palette import AFTER, BEFORE, EDGE, GRID, NOISE
from diagnosis.cause import Cause, Signal
from diagnosis.diagnose import Diagnosis
from diagnosis.measurements.currents.design_matrix import dataset_of
from diagnosis.report.plots.closed_loop import loop_figure
from diagnosis.report.plots.link_encoders import link_figure
from diagnosis.report.plots.residuals import unit_of
from diagnosis.report.plots.single_axis import axis_figure
from diagnosis.report.plots.tracker import tracker_figure
from diagnosis.residual.run import ROWS_PER_SECOND
from diagnosis.units import readable

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def overview(result: Diagnosis) -> tuple[Figure, str]:
    """Held-out residual of every joint over time, in units of the noise, before and after."""
    from matplotlib.figure import Figure

    joints = len(result.arm)
    side = dataset_of(result.held_out)
    height = 0.9 + 1.3 * joints
    figure = Figure(figsize=(10.5, height))
    figure.subplots_adjust(left=0.075, right=0.99, bottom=0.5 / height, top=1.0 - 0.55 / height, hspace=0.12)
    axes = figure.subplots(joints, 1, sharex=True, squeeze=False)[:, 0]
    t = np.arange(side.rows) / ROWS_PER_SECOND
    for j, axis in enumerate(axes, 1):
        noise = side.at_joint("instruments", j) / side.at_joint("deviation", j)
        # elsewhere, near standstill, the current is not determined
        shown = side.comparable(j)
        axis.axhspan(-2.0, 2.0, color=NOISE, lw=0.0, label="noise")
        lines = [(side.y, BEFORE, "before"), (result.left.held_out, AFTER, "after")]
        for values, colour, label in lines if result.causes else [(result.left.held_out, AFTER, "residual")]:
            axis.plot(t, np.where(shown, values[side.of(j)] / noise, np.nan), color=colour, lw=0.7, label=label)
        top = max(4.0, float(np.quantile(np.abs(side.y[side.of(j)][shown]), 0.99)) * 1.2) if shown.any() else 4.0
        axis.set_ylim(-top, top)
        axis.set_ylabel(f"joint {j}")
        axis.grid(color=GRID)
    edges = np.cumsum([len(run.t) for run in result.held_out]) / ROWS_PER_SECOND
    for run, edge in zip(result.held_out, edges):
        axes[0].text(
            edge - len(run.t) / ROWS_PER_SECOND, axes[0].get_ylim()[1], run.name, fontsize="small", va="bottom"
        )
        for axis in axes:
            axis.axvline(edge, color=EDGE, lw=0.8)
    axes[0].legend(loc="upper right", ncols=3, fontsize="small")
    axes[-1].set_xlabel("held-out recordings one after the other, s")
    figure.suptitle(
        "measured minus predicted current, in units of the noise std", x=0.01, y=0.995, ha="left", fontsize="medium"
    )
    return figure, "held-out residuals of all joints before and after"


def view_of(effect: str) -> str:
    """The variable against which an effect's residual current is drawn."""
    seen = CATALOGUE[effect].observed_by.get(Instrument.CURRENT)
    return Variable.POSITION if seen is None else seen.against


def cause_figure(result: Diagnosis, cause: Cause) -> tuple[Figure, str]:
    """The residual of the joint with the largest effect against the variable that shows it best, before and after."""
    from matplotlib.figure import Figure

    from diagnosis.measurements.currents.basis_functions import variables

    if result.tracked is not None and cause.by_tracker:
        return tracker_figure(result.tracked)
    joint = cause.felt_at
    assert joint is not None, "only tracked points are felt at no joint"
    if result.link is not None and cause.signal is Signal.LINK_ANGLE:
        return link_figure(result.link, result.arm, cause.effect, joint)
    if cause.signal is Signal.CLOSED_LOOP:
        return loop_figure(result.compared["held_out"], joint, cause.unit)

    if result.axis is not None and any(one.effect == cause.effect for one in result.axis.causes):
        return axis_figure(result.axis, cause.effect, result.arm.joints[0])

    side = dataset_of(result.held_out)
    name = view_of(cause.effect)
    x = dict(variables(side, result.arm, joint))[name]
    deviation, known = side.at_joint("deviation", joint), side.comparable(joint)
    noise = float(np.sqrt(np.mean(side.at_joint("instruments", joint)[known] ** 2))) if known.any() else 0.0
    residuals = [(y[side.of(joint)] * deviation)[known] for y in (side.y, result.left.held_out)]
    largest = max((float(np.abs(values).max()) for values in residuals if len(values)), default=1.0)
    factor, unit = readable(result.arm.joints[joint - 1].current_unit, [largest])
    figure = Figure(figsize=(10.5, 3.2))
    figure.subplots_adjust(left=0.085, right=0.99, bottom=0.16, top=0.9, wspace=0.05)
    axes = figure.subplots(1, 2, sharey=True)
    for axis, values, colour, title in zip(axes, residuals, (BEFORE, AFTER), ("without any cause", "with all causes")):
        axis.axhspan(-2 * factor * noise, 2 * factor * noise, color=NOISE, lw=0.0, label="noise")
        axis.plot(x[known], factor * values, ".", ms=1.6, color=colour)
        axis.set_title(title, loc="left", fontsize="medium")
        axis.set_xlabel(f"{name} of joint {joint}, {unit_of(result, joint, name)}")
        axis.grid(color=GRID)
    axes[0].set_ylabel(f"measured minus predicted\ncurrent of joint {joint}, {unit}")
    axes[1].legend(loc="upper right", fontsize="small")
    return figure, f"residual current of joint {joint} against {name}"
