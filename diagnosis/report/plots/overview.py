"""Overview of all residuals, and the chart of each cause."""

from __future__ import annotations

import numpy as np

from arm_model.effects import CATALOGUE, Instrument, Variable
from arm_report import Chart, Level, Panel, Series, Zone
from arm_report.chart import robust_range
from arm_report.palette import AFTER, BEFORE, EDGE
from diagnosis.cause import Cause, Signal
from diagnosis.cause.units import readable, variable_in_words
from diagnosis.measurements.currents.design_matrix import dataset_of
from diagnosis.measurements.currents.structure.shared_bases import variables
from diagnosis.report.plots.closed_loop import loop_chart
from diagnosis.report.plots.link_encoders import link_chart
from diagnosis.report.plots.motion import HELD_OUT, held_out_time
from diagnosis.report.plots.near_rest import near_rest_chart
from diagnosis.report.plots.residuals import unit_of
from diagnosis.report.plots.single_axis import axis_chart
from diagnosis.report.plots.tracker import tracker_chart
from diagnosis.result import Diagnosis
from identification import recorded_quantities, recorded_quantity


def overview(result: Diagnosis) -> Chart:
    """Held-out residual of every joint over time, in units of the noise, before and after."""
    side = dataset_of(result.held_out)
    t = held_out_time(result)
    ends = np.cumsum([len(run.t) for run in result.held_out])
    borders = tuple(
        Level(value=float(t[end - len(run.t)]), axis="x", colour=EDGE, words=run.name)
        for run, end in zip(result.held_out, ends)
    )
    sides = [(side.y, BEFORE, "before"), (result.residual.held_out, AFTER, "after")]
    if not result.causes:
        sides = [(result.residual.held_out, AFTER, "residual")]
    panels = []
    for j in range(1, len(result.arm) + 1):
        noise = side.at_joint("instruments", j) / side.at_joint("deviation", j)
        # elsewhere, near standstill, the current is not determined
        shown = side.comparable(j)
        panels.append(
            Panel(
                series=tuple(
                    Series(
                        x=t,
                        y=np.where(shown, values[side.of(j)] / noise, np.nan),
                        colour=colour,
                        label=label,
                        width=0.7,
                    )
                    for values, colour, label in sides
                ),
                zones=(Zone(low=-2.0, high=2.0, label="noise, two std"),),
                # the names stand in the first panel only
                levels=borders if j == 1 else tuple(Level(value=b.value, axis="x", colour=EDGE) for b in borders),
                y_range=robust_range(side.y[side.of(j)][shown], room=1.2),
                title=f"joint {j}" if shown.any() else f"joint {j}: at standstill in every held-out recording",
                x="time in the held-out recordings, s",
                y="residual over noise",
                joint=j,
                motion=HELD_OUT,
            )
        )
    return Chart(
        name="residuals",
        title=f"measured minus predicted {recorded_quantities(result.arm)} of every joint, in units of the noise std",
        panels=tuple(panels),
        shared=True,
        height=1.45,
    )


def view_of(effect: str) -> str:
    """The variable against which an effect's residual current is drawn."""
    seen = CATALOGUE[effect].observed_by.get(Instrument.CURRENT)
    return Variable.POSITION if seen is None else seen.against


def cause_chart(result: Diagnosis, cause: Cause, number: int) -> Chart:
    """The residual of the joint with the largest effect against the variable that shows it best, before and after."""
    picture = f"cause_{number}"
    if result.tracked is not None and cause.by_tracker:
        return tracker_chart(picture, result.tracked)
    joint = cause.felt_at
    assert joint is not None, "only tracked points are felt at no joint"
    if result.link is not None and cause.signal is Signal.LINK_ANGLE:
        return link_chart(picture, result.link, result.arm, cause.effect, joint)
    if cause.signal is Signal.CLOSED_LOOP:
        return loop_chart(picture, result.closed_loops.held_out, joint, result.arm.joints[joint - 1])
    if result.axis is not None and any(one.effect == cause.effect for one in result.axis.causes):
        return axis_chart(picture, result.axis, cause.effect, result.arm.joints[0])
    chart = near_rest_chart(picture, result, joint) if CATALOGUE[cause.effect].near_rest else None
    return chart or _current_chart(picture, result, cause, joint)


def _current_chart(picture: str, result: Diagnosis, cause: Cause, joint: int) -> Chart:
    """Residual current against the variable that shows the effect best."""
    side = dataset_of(result.held_out)
    name = view_of(cause.effect)
    x = dict(variables(side, result.arm, joint))[name]
    deviation, comparable = side.at_joint("deviation", joint), side.comparable(joint)
    noise = float(np.sqrt(np.mean(side.at_joint("instruments", joint)[comparable] ** 2))) if comparable.any() else 0.0
    residuals = [(y[side.of(joint)] * deviation)[comparable] for y in (side.y, result.residual.held_out)]
    largest = max((float(np.abs(values).max()) for values in residuals if len(values)), default=1.0)
    factor, unit = readable(result.arm.joints[joint - 1].command_unit, [largest])
    at = held_out_time(result)[comparable]
    room = 1.05 * factor * largest or 1.0
    quantity, against = recorded_quantity(result.arm.joints[joint - 1]), variable_in_words(name, result.arm, joint)
    panels = tuple(
        Panel(
            series=(Series(x=x[comparable], y=factor * values, kind="dots", colour=colour, label=title, at=at),),
            zones=(Zone(low=-2 * factor * noise, high=2 * factor * noise, label="noise, two std"),),
            title=title,
            x=f"{against} of joint {joint}, {unit_of(result, joint, name)}",
            y=f"residual {quantity}, {unit}",
            y_range=(-room, room),
            joint=joint,
            motion=HELD_OUT,
        )
        for values, colour, title in zip(residuals, (BEFORE, AFTER), ("without any cause", "with all causes"))
    )
    title = f"measured minus predicted {quantity} of joint {joint} against {against}"
    return Chart(name=picture, title=title, panels=panels, columns=2, height=2.9)
