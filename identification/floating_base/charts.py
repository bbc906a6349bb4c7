"""Charts of a floating base: wrench of the thrusters against what the motion takes, each thruster, the motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from arm_io.types import Array
from arm_model import Arm
from arm_model.collision import chain_of
from arm_model.moving_base import thrust_of
from arm_model.tables import DEGREES, Thruster
from arm_report import Chart, Level, Panel, Series, Zone
from arm_report.motion import Motion, clip_of
from arm_report.palette import AFTER, BEFORE, MEASURED, joint_colour
from identification.floating_base.wrenches import Wrenches

MOST = 3
"""Recordings that are drawn."""
ZERO = (Level(value=0.0),)
HEIGHT = 1.75
"""Of a panel on paper, inches."""
HULL = 0.03
"""m: radius of the lines that stand for the hull."""


def unit(degree: int) -> str:
    """Of a wrench, by the number of its degree of freedom from 0."""
    return "N" if degree < 3 else "N m"


def wrench_charts(runs: Sequence[Wrenches]) -> list[Chart]:
    """Per recording: thrust and what the motion takes in each degree of freedom, and their difference."""
    charts = []
    for number, run in enumerate(runs[:MOST], 1):
        panels: list[Panel] = []
        for k, name in enumerate(DEGREES):
            rms = float(np.sqrt(np.mean(run.after[:, k] ** 2)))
            needed = Series(x=run.t, y=run.needed[:, k], colour=MEASURED, label="taken by the motion", width=1.8)
            given = Series(x=run.t, y=run.thrust[:, k], colour=AFTER, label="thrust")
            off = Series(x=run.t, y=run.after[:, k], colour=BEFORE, label="difference")
            panels += [
                _over_time(run, (needed, given), name, f"{'force' if k < 3 else 'moment'}, {unit(k)}"),
                _over_time(run, (off,), f"{name}, difference: rms {rms:.3g} {unit(k)}", f"difference, {unit(k)}"),
            ]
        title = f"thrust and the wrench that the motion takes, {run.run.name}"
        charts.append(
            Chart(
                name=f"wrench_{number}",
                title=title,
                panels=tuple(panels),
                columns=2,
                widths=(2.0, 1.0),
                shared=True,
                height=HEIGHT,
            )
        )
    return charts


def residual_charts(runs: Sequence[Wrenches], noise: Array, changed: bool) -> list[Chart]:
    """Per recording: missing thrust over the noise (6,) in each degree of freedom, before and after."""
    charts = []
    for number, run in enumerate(runs[:MOST], 1):
        panels = []
        for k, name in enumerate(DEGREES):
            sides = [(run.before, BEFORE, "before")] if changed else []
            lines = tuple(
                Series(x=run.t, y=values[:, k] / noise[k], colour=colour, label=label, width=0.9)
                for values, colour, label in [*sides, (run.after, AFTER, "after" if changed else "residual")]
            )
            band = (Zone(low=-2.0, high=2.0, label="noise, two std"),)
            panels.append(_over_time(run, lines, name, "residual over noise", band))
        title = f"wrench that the motion takes less thrust, over the noise, {run.run.name}"
        name = f"residual_{number}"
        charts.append(Chart(name=name, title=title, panels=tuple(panels), columns=2, shared=True, height=HEIGHT))
    return charts


def parts_chart(run: Wrenches) -> Chart:
    """What the wrench that the motion takes consists of, the arm's reaction among it."""
    panels = []
    for k, name in enumerate(DEGREES):
        lines = tuple(
            Series(x=run.t, y=values[:, k], colour=joint_colour(number), label=part, width=1.2)
            for number, (part, values) in enumerate(run.required.items(), 1)
        )
        panels.append(_over_time(run, lines, name, f"{'force' if k < 3 else 'moment'}, {unit(k)}"))
    title = f"what the motion takes, by its parts, {run.run.name}"
    return Chart(name="parts", title=title, panels=tuple(panels), columns=2, shared=True, height=HEIGHT)


def thruster_chart(arm: Arm, found: Arm, runs: Sequence[Wrenches]) -> Chart | None:
    """Each thruster over its demand: the model's, as found in ``found``, and seen; None without thrusters."""
    assert arm.floating is not None
    assert found.floating is not None
    panels = []
    for k, (model, now) in enumerate(zip(arm.floating.thruster, found.floating.thruster)):
        demand, seen = (np.concatenate([getattr(run, name)[:, k] for run in runs]) for name in ("demand", "seen"))
        grid: Array = np.linspace(float(demand.min()), float(demand.max()), 60)
        panels.append(
            Panel(
                series=(
                    Series(x=demand, y=seen, kind="dots", colour=MEASURED, label="seen", width=1.0),
                    Series(x=grid, y=_law(model, grid), colour=BEFORE, label="model", dashed=True, width=1.4),
                    Series(x=grid, y=_law(now, grid), colour=AFTER, label="found", width=1.4),
                ),
                title=f"thruster {k + 1}",
                x="demand, N",
                y="thrust, N",
                levels=ZERO,
            )
        )
    title = "thrust of each thruster over its demand"
    return Chart(name="thrusters", title=title, panels=tuple(panels), columns=4, height=2.2) if panels else None


def motion_charts(runs: Sequence[Wrenches]) -> list[Chart]:
    """Per recording: where the vehicle was and how it turned, from its first row on."""
    charts = []
    for number, one in enumerate(runs[:MOST], 1):
        run, t = one.run, _time(one)
        turned = Rotation.from_quat(run.base.attitude[:, [1, 2, 3, 0]])
        away = np.degrees((turned[0].inv() * turned).as_rotvec())
        panels = [
            Panel(
                series=tuple(
                    Series(x=t, y=values[:, k], colour=joint_colour(k + 1), label=axis) for k, axis in enumerate("xyz")
                ),
                title=title,
                x="time, s",
                y=y,
                levels=ZERO,
                motion=run.name,
            )
            for values, title, y in (
                (run.position - run.position[0], "position", "moved, m"),
                (away, "attitude: rotation vector", "turned, degrees"),
            )
        ]
        name, title = f"vehicle_{number}", f"motion of the vehicle, {run.name}"
        charts.append(Chart(name=name, title=title, panels=tuple(panels), columns=2, shared=True, height=HEIGHT))
    return charts


def motion_of(arm: Arm, runs: Sequence[Wrenches]) -> Motion:
    """The vehicle with its arm along each recording."""
    clips = {}
    for one in runs[:MOST]:
        run = one.run
        pose = np.concatenate([run.position - run.position[0], run.base.attitude], axis=1)
        clips[run.name] = clip_of(_time(one), run.q, run.name, pose=pose)
    return Motion(arm=chain_of(arm).to_json() | {"hull": _hull(arm)}, clips=clips)


def _time(one: Wrenches) -> Array:
    """(m,) s of all rows of a recording."""
    return np.asarray(one.run.dt * np.arange(len(one.run.q)))


def _hull(arm: Arm) -> list[list[object]]:
    """Lines [from, to, radius] between the thrusters, m in the body frame, that stand for the vehicle."""
    assert arm.floating is not None
    places = [thruster.position for thruster in arm.floating.thruster]
    return [[list(a), list(b), HULL] for k, a in enumerate(places) for b in places[k + 1 :] if _one_axis(a, b)]


def _one_axis(a: Sequence[float], b: Sequence[float]) -> bool:
    """Whether two points differ along one axis only: edges of a box."""
    return sum(abs(p - q) > 1e-6 for p, q in zip(a, b)) == 1


def _law(thruster: Thruster, demand: Array) -> Array:
    return thruster.gain * thrust_of(demand, thruster)


def _over_time(run: Wrenches, series: tuple[Series, ...], title: str, y: str, zones: tuple[Zone, ...] = ()) -> Panel:
    return Panel(series=series, title=title, x="time, s", y=y, zones=zones, levels=ZERO, motion=run.run.name)
