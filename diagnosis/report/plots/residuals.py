"""Simulated and measured currents, and the residual against the variables that it may depend on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from arm_model import Arm
from arm_report import Chart, Panel, Series, Zone
from arm_report.chart import robust_range
from arm_report.palette import AFTER, BEFORE, MEASURED, PALE_AFTER, PALE_BEFORE
from daq.recording import Recording
from diagnosis.cause.units import variable_in_words
from diagnosis.closed_loop.comparison import LoopComparison
from diagnosis.measurements.currents.design_matrix import dataset_of
from diagnosis.measurements.currents.structure.shared_bases import variables
from diagnosis.report.plots.motion import HELD_OUT, held_out_time
from diagnosis.residual.filters import COMPARE_BAND, low_pass, rate_of
from diagnosis.result import Diagnosis
from diagnosis.selection.binned_means import quantile_edges
from diagnosis.selection.design import Dataset
from identification import recorded_quantity, recorded_signals

SHOWN = ("time", "position", "motor angle", "velocity", "load torque")
UNITS = {
    "time": "s",
    "position": "rad",
    "motor angle": "rad",
    "velocity": "rad/s",
    "acceleration": "rad/s2",
    "load torque": "N m",
    "current": "A",
    "temperature": "degC",
}
BINS = 24
"""Bins of a residual over a variable, each with as many rows."""


def in_noise(result: Diagnosis, joint: int) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Held-out residual of a joint (from 1) before and after all causes, in units of the noise, and the rows compared.

    Arrays (rows,); the third is a mask.
    """
    side = dataset_of(result.held_out)
    ratio = np.concatenate([run.deviation[:, joint - 1] / run.instruments[:, joint - 1] for run in result.held_out])
    where = side.of(joint)
    return side.y[where] * ratio, result.residual.held_out[where] * ratio, side.comparable(joint)


def against_all(result: Diagnosis, joint: int, held_out: Sequence[Recording]) -> Chart:
    """The held-out residual of a joint against time, position, motor angle, velocity, its sign and load torque.

    Also against temperature if it is recorded.
    """
    before, after, sure = in_noise(result, joint)
    at = held_out_time(result)[sure]
    clouds = [(before, PALE_BEFORE, BEFORE, "before"), (after, PALE_AFTER, AFTER, "after")]
    if not result.causes:
        clouds = [(after, PALE_AFTER, AFTER, "residual")]
    panels = []
    for name, x in _panels(dataset_of(result.held_out), result, joint, held_out):
        drawn = [_cloud(x[sure], values[sure], at, (pale, colour), label) for values, pale, colour, label in clouds]
        panels.append(
            Panel(
                # all means over all clouds
                series=tuple(series[k] for k in (0, 1) for series in drawn if series),
                zones=(Zone(low=-2.0, high=2.0, label="noise, two std"),),
                x=_with_unit(result, joint, name),
                y="residual over noise",
                y_range=robust_range((before if result.causes else after)[sure]),
                joint=joint,
                motion=HELD_OUT,
            )
        )
    quantity = recorded_quantity(result.arm.joints[joint - 1])
    return Chart(
        name=f"joint_{joint}",
        title=f"joint {joint}: measured minus predicted {quantity}, in units of the noise std",
        panels=tuple(panels),
        columns=3,
        height=2.35,
    )


def left_against(result: Diagnosis, joint: int, name: str) -> Chart | None:
    """The residual of a joint with all causes against the variable that predicts it.

    None for a variable that has no rows of its own.
    """
    of_variables = dict(variables(dataset_of(result.held_out), result.arm, joint))
    if name not in of_variables:
        return None
    _, after, sure = in_noise(result, joint)
    at = held_out_time(result)[sure]
    panel = Panel(
        series=_cloud(of_variables[name][sure], after[sure], at, (PALE_AFTER, AFTER), "residual"),
        zones=(Zone(low=-2.0, high=2.0, label="noise, two std"),),
        x=_with_unit(result, joint, name),
        y=f"residual of joint {joint} over noise",
        y_range=robust_range(after[sure]),
        joint=joint,
        motion=HELD_OUT,
    )
    against = variable_in_words(name, result.arm, joint)
    title = f"remaining residual of joint {joint} against {against}, in units of the noise std"
    picture = "".join(letter if letter.isalnum() else "_" for letter in f"unexplained_{joint}_{name}")
    return Chart(name=picture, title=title, panels=(panel,), height=2.9)


def _panels(side: Dataset, result: Diagnosis, joint: int, held_out: Sequence[Recording]) -> Iterator[tuple[str, Array]]:
    for name, values in variables(side, result.arm, joint):
        if name in SHOWN:
            yield name, values
        if name == "velocity":
            yield "sign of velocity", np.sign(values)
    warm = [r.temp for r in held_out]
    if len(warm) == len(side.runs) and all(temp is not None and np.isfinite(temp[:, joint - 1]).any() for temp in warm):
        parts = []
        for run, recording, temp in zip(side.runs, held_out, warm):
            assert temp is not None
            there = np.isfinite(temp[:, joint - 1])
            parts.append(np.interp(run.t, recording.t[there], temp[there, joint - 1]))
        yield "temperature", np.concatenate(parts)


def _cloud(x: Array, y: Array, at: Array, colours: tuple[str, str], label: str) -> tuple[Series, ...]:
    """Rows as pale dots, measured at the instants ``at``, and means in bins of equal number; nothing of no rows."""
    if len(x) == 0:
        return ()
    values = np.unique(x)
    shown = x
    if len(values) <= 3:  # a sign: side by side
        shown = x + 0.25 * np.random.default_rng(0).uniform(-1, 1, len(x))
        bins = np.searchsorted(values, x)
    else:
        bins = np.digitize(x, quantile_edges(x, BINS))
    places = [np.flatnonzero(bins == k) for k in np.unique(bins)]
    middle, mean = (np.array([values_[k].mean() for k in places]) for values_ in (x, y))
    order = np.argsort(middle)
    kind: Literal["both", "line"] = "both" if len(places) < 4 else "line"
    return (
        Series(x=shown, y=y, kind="dots", colour=colours[0], label=label, at=at),
        Series(x=middle[order], y=mean[order], kind=kind, colour=colours[1], label=f"{label}, mean in bins", width=1.6),
    )


def unit_of(result: Diagnosis, joint: int, name: str) -> str:
    """The unit of a variable at a joint (from 1), or at the other one that it names: ``position of joint 3``."""
    variable, _, other = name.partition(" of joint ")
    return result.arm.joints[int(other or joint) - 1].unit(UNITS[variable]) if variable in UNITS else ""


def _with_unit(result: Diagnosis, joint: int, name: str) -> str:
    unit, words = unit_of(result, joint, name), variable_in_words(name, result.arm, joint)
    return f"{words}, {unit}" if unit else words


def side_by_side(before: LoopComparison, after: LoopComparison, extended: bool, arm: Arm, picture: str) -> Chart:
    """One recording: measured and simulated current of every joint, and the error of the simulated position."""
    rate = rate_of(before.t)
    sides = [(before, BEFORE, "simulated, before" if extended else "simulated")]
    sides += [(after, AFTER, "simulated, after")] if extended else []
    measured = low_pass(before.current, COMPARE_BAND, rate)
    shown = [
        (
            low_pass(one.simulated_current, COMPARE_BAND, rate),
            1e3 * low_pass(one.angle - one.simulated_angle, COMPARE_BAND, rate),
        )
        for one, _, _ in sides
    ]
    panels: list[Panel] = []
    for j, joint in enumerate(arm.joints):
        small = "mrad" if joint.revolute else "mm"
        currents = [Series(x=before.t, y=measured[:, j], colour=MEASURED, label="measured", width=2.4)]
        errors = []
        for (current, error), (_, colour, label) in zip(shown, sides):
            currents.append(Series(x=before.t, y=current[:, j], colour=colour, label=label))
            errors.append(Series(x=before.t, y=error[:, j], colour=colour, label=label))
        for series, title, label in (
            (currents, f"joint {j + 1}", f"{recorded_quantity(joint)}, {joint.command_unit}"),
            (errors, f"joint {j + 1}, error of the position", f"error, {small}"),
        ):
            panels.append(
                Panel(series=tuple(series), title=title, x="time, s", y=label, joint=j + 1, motion=before.name)
            )
    measured_of = recorded_signals(arm)
    title = f"measured and simulated {measured_of} of {before.name}, and measured minus simulated positions"
    return Chart(
        name=picture,
        title=f"{title}, below {COMPARE_BAND:g} Hz",
        panels=tuple(panels),
        columns=2,
        shared=True,
        height=1.5,
    )
