"""Charts of motor minus link encoder."""

from __future__ import annotations

import numpy as np

from arm_model import Arm
from arm_model.effects import CATALOGUE, Instrument, Variable
from arm_report import Chart, Panel, Series
from arm_report.palette import AFTER, BEFORE
from diagnosis.measurements.link_encoders.causes import LinkSide

AGAINST = {Variable.LOAD: ("load", "load", "N m"), Variable.VELOCITY: ("v", "velocity", "rad/s")}
"""Field of the rows, name and unit of the variables that a difference is drawn against, in addition to the angle."""


def link_overview(link: LinkSide, arm: Arm) -> Chart:
    """Held-out difference of every joint's encoders over time, its constant left out, before and after all causes."""
    t = np.asarray(np.arange(link.held_out.rows) * float(link.held_out.t[1] - link.held_out.t[0]), float)
    sides = ((link.without, BEFORE, "before"), (link.residual, AFTER, "after all causes"))
    panels = [
        Panel(
            series=tuple(
                Series(x=t, y=1e3 * values[:, k], colour=colour, label=when) for values, colour, when in sides
            ),
            title=f"joint {joint}",
            x="time in the held-out recordings, s",
            y=f"difference, m{arm.joints[joint - 1].unit('rad')}",
            joint=joint,
        )
        for k, joint in enumerate(int(j) for j in link.held_out.joints)
    ]
    title = "motor minus link encoder in the held-out recordings, before and after"
    return Chart(name="encoders", title=title, panels=tuple(panels), shared=True, height=1.5)


def link_chart(name: str, link: LinkSide, arm: Arm, effect: str, joint: int) -> Chart:
    """Held-out difference of one joint's encoders, over its angle and over the variable that shows the effect best.

    It is drawn before and after all causes.
    """
    k, drive = int(np.flatnonzero(link.held_out.joints == joint)[0]), arm.joints[joint - 1]
    variable = CATALOGUE[effect].observed_by[Instrument.LINK_ENCODER].against
    shown = [("q", "angle", "rad"), *([AGAINST[variable]] if variable in AGAINST else [])]
    # an effect that changes the description is a constant between two encoders
    constant = link.held_out.difference[:, k].mean() if CATALOGUE[effect].change is not None else 0.0
    sides = ((link.without + constant, BEFORE, "before"), (link.residual, AFTER, "after all causes"))
    panels = [
        Panel(
            series=tuple(
                Series(
                    x=getattr(link.held_out, field)[:, k], y=1e3 * values[:, k], kind="dots", colour=colour, label=when
                )
                for values, colour, when in sides
            ),
            x=f"{words} of joint {joint}, {drive.unit(unit)}",
            y=f"difference, m{drive.unit('rad')}",
            joint=joint,
        )
        for field, words, unit in shown
    ]
    title = f"motor minus link encoder of joint {joint} against {shown[-1][1]}"
    return Chart(name=name, title=title, panels=tuple(panels), columns=len(panels), height=2.9)
