"""The residual of a joint where it turns or creeps, against its velocity: friction near rest shows there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm_io.types import Array
from arm_model import EffectTerm
from arm_report import Chart, Panel, Series, Zone
from arm_report.chart import robust_range
from arm_report.palette import AFTER, BEFORE
from diagnosis.measurements.near_rest.laws import smoothing_velocity
from diagnosis.measurements.near_rest.passages import SLIDES, near_rest, observation
from diagnosis.report.plots.residuals import UNITS
from diagnosis.residual.filters import kept_rows, rate_of
from diagnosis.result import Diagnosis
from identification import recorded_quantity


def near_rest_chart(picture: str, result: Diagnosis, joint: int) -> Chart | None:
    """Residual over its std against velocity, for every recording in which the joint (from 1) reverses or creeps.

    Friction of the joint turns with the smoothing velocity that leaves least, with causes and without: laws of friction
    near rest are judged beside it, and no data sheet states it. None if no encoder resolves that speed.
    """
    arms = (result.arm, result.extended) if result.causes else (result.arm,)
    sides = [_passages(result, joint, arm.effects) for arm in arms]
    if not len(sides[0][0]):
        return None
    drive = result.arm.joints[joint - 1]
    titles = ("without any cause", "with all causes") if result.causes else ("residual",)
    panels = tuple(
        Panel(
            series=(Series(x=v, y=residual, kind="dots", colour=colour, label=title),),
            zones=(Zone(low=-2.0, high=2.0, label="noise, two std"),),
            title=title,
            x=f"velocity of joint {joint}, {drive.unit(UNITS['velocity'])}",
            y="residual over its std",
            x_range=(-SLIDES, SLIDES),
            y_range=robust_range(sides[0][1]),
            joint=joint,
        )
        for (v, residual), colour, title in zip(sides, (BEFORE, AFTER), titles)
    )
    title = f"every recording near rest: measured minus predicted {recorded_quantity(drive)} of joint {joint}"
    return Chart(name=picture, title=f"{title} against velocity", panels=panels, columns=len(panels), height=2.9)


def _passages(result: Diagnosis, joint: int, effects: Sequence[EffectTerm]) -> tuple[Array, Array]:
    """(r,) velocity and (r,) residual over its std of all recordings under the arm with these effects."""
    runs = [run for run in (*result.fit, *result.held_out) if run.powered]
    passages, velocities = (
        near_rest([observation(run, effects) for run in runs], joint),
        result.arm.joint_array("sign_velocity"),
    )
    if passages and (best := smoothing_velocity(passages)) != velocities[joint - 1]:
        velocities[joint - 1] = best
        passages = near_rest([observation(run, effects, velocities) for run in runs], joint)
    v = [one.v[kept_rows(rate_of(one.run.raw[0]))][one.rows] for one in passages]
    return np.concatenate([np.empty(0), *v]), np.concatenate([np.empty(0), *(one.residual for one in passages)])
