"""Simulated and measured currents, and the residual against the variables that it may depend on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from arm_report.palette import AFTER, BEFORE, GRID, MEASURED, NOISE, PALE_AFTER, PALE_BEFORE
from daq.recording import Recording
from diagnosis.closed_loop.comparison import Compared
from diagnosis.diagnose import Diagnosis
from diagnosis.measurements.currents.basis_functions import variables
from diagnosis.measurements.currents.design_matrix import dataset_of
from diagnosis.residual.expected_current import COMPARE_BAND, low_pass, rate_of
from diagnosis.selection.design import Dataset
from diagnosis.units import unit_at

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


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
POINTS = 1500
"""Points of a line, at most: more than a picture has columns."""
BINS = 24


def in_noise(result: Diagnosis, joint: int) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Held-out residual of a joint (from 1) before and after all causes (rows,), over the instruments' noise.

    The last are the rows that are compared.
    """
    side = dataset_of(result.held_out)
    ratio = np.concatenate([run.deviation[:, joint - 1] / run.instruments[:, joint - 1] for run in result.held_out])
    where = side.of(joint)
    return side.y[where] * ratio, result.left.held_out[where] * ratio, side.comparable(joint)


def against_all(result: Diagnosis, joint: int, held_out: Sequence[Recording]) -> tuple[Figure, str]:
    """The held-out residual of one joint against time, position, motor angle, velocity, its sign and load torque.

    Against temperature as well where it is recorded.
    """
    from matplotlib.figure import Figure

    before, after, sure = in_noise(result, joint)
    panels = list(_panels(dataset_of(result.held_out), result, joint, held_out))
    rows = -(-len(panels) // 3)
    figure = Figure(figsize=(10.5, 2.35 * rows))
    figure.subplots_adjust(left=0.06, right=0.99, bottom=0.24 / rows, top=1.0 - 0.16 / rows, wspace=0.06, hspace=0.42)
    axes = figure.subplots(rows, 3, squeeze=False, sharey=True).ravel()
    for axis, (name, x) in zip(axes, panels):
        axis.axhspan(-2.0, 2.0, color=NOISE, lw=0.0)
        clouds = [
            (before, PALE_BEFORE, BEFORE, "before"),
            (after, PALE_AFTER, AFTER, "after"),
        ]
        for values, pale, colour, label in clouds if result.causes else [(after, PALE_AFTER, AFTER, "mean in bins")]:
            _cloud(axis, x[sure], values[sure], pale, colour, label)
        axis.set_xlabel(_with_unit(result, joint, name))
        axis.grid(color=GRID)
        axis.locator_params(nbins=5)
    for axis in axes[len(panels) :]:
        axis.set_axis_off()
    _limit(axes[0], (before if result.causes else after)[sure])
    if sure.any():
        axes[0].legend(loc="upper right", ncols=2, fontsize="small")
    figure.suptitle(
        f"joint {joint}: measured minus predicted current, in units of the noise std",
        x=0.01,
        ha="left",
        fontsize="medium",
    )
    return figure, f"residual of joint {joint} against time, position, motor angle, velocity, direction and load"


def left_against(result: Diagnosis, joint: int, name: str) -> tuple[Figure, str] | None:
    """The residual of a joint with all causes against the variable that predicts it.

    None for a variable that has no rows of its own.
    """
    from matplotlib.figure import Figure

    side = dataset_of(result.held_out)
    found = dict(variables(side, result.arm, joint))
    if name not in found:
        return None
    _, after, sure = in_noise(result, joint)
    figure = Figure(figsize=(10.5, 3.2), layout="constrained")
    axis = figure.subplots()
    axis.axhspan(-2.0, 2.0, color=NOISE, lw=0.0, label="noise")
    _cloud(axis, found[name][sure], after[sure], PALE_AFTER, AFTER, "mean in bins")
    _limit(axis, after[sure])
    axis.set_xlabel(_with_unit(result, joint, name))
    axis.set_ylabel(f"residual of joint {joint}, in units of the noise std")
    axis.grid(color=GRID)
    axis.legend(loc="upper right", fontsize="small")
    return figure, f"remaining residual of joint {joint} against {name}"


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


def _cloud(axis: Axes, x: Array, y: Array, pale: str, colour: str, label: str) -> None:
    """Rows as pale points, means in bins of equal number over them."""
    if len(x) == 0:
        return
    thin = slice(None, None, max(1, len(x) // 3000))
    values = np.unique(x)
    if len(values) <= 3:  # a sign: side by side
        spread = x + 0.25 * np.random.default_rng(0).uniform(-1, 1, len(x))
        axis.plot(spread[thin], y[thin], ".", ms=1.5, color=pale, rasterized=True)
        bins = np.searchsorted(values, x)
    else:
        axis.plot(x[thin], y[thin], ".", ms=1.5, color=pale, rasterized=True)
        bins = np.digitize(x, np.unique(np.quantile(x, np.linspace(0, 1, BINS + 1)[1:-1])))
    places = [np.flatnonzero(bins == k) for k in np.unique(bins)]
    middle, mean = (np.array([values_[k].mean() for k in places]) for values_ in (x, y))
    axis.plot(middle, mean, "o-" if len(places) < 4 else "-", ms=5, lw=1.6, color=colour, label=label)


def _limit(axis: Axes, values: Array) -> None:
    top = max(4.0, 1.15 * float(np.quantile(np.abs(values), 0.99))) if len(values) else 4.0
    axis.set_ylim(-top, top)


def unit_of(result: Diagnosis, joint: int, name: str) -> str:
    """The unit of a variable at a joint (from 1), or at the other one that it names: ``position of joint 3``."""
    variable, _, other = name.partition(" of joint ")
    return unit_at(result.arm.joints[int(other or joint) - 1], UNITS[variable]) if variable in UNITS else ""


def _with_unit(result: Diagnosis, joint: int, name: str) -> str:
    unit = unit_of(result, joint, name)
    return f"{name}, {unit}" if unit else name


def side_by_side(before: Compared, after: Compared, extended: bool, units: Sequence[str]) -> tuple[Figure, str]:
    """One recording: measured and simulated current of every joint, and the error of the simulated angle."""
    from matplotlib.figure import Figure

    joints = before.current.shape[1]
    height = 0.8 + 1.25 * joints
    figure = Figure(figsize=(10.5, height))
    figure.subplots_adjust(left=0.08, right=0.99, bottom=0.5 / height, top=1.0 - 0.3 / height, wspace=0.12, hspace=0.12)
    axes = figure.subplots(joints, 2, sharex=True, squeeze=False)
    rate = rate_of(before.t)
    thin = slice(None, None, max(1, len(before.t) // POINTS))
    t = before.t[thin]
    measured = low_pass(before.current, COMPARE_BAND, rate)[thin]
    lines = [(before, BEFORE, "simulated, before" if extended else "simulated")]
    lines += [(after, AFTER, "simulated, after")] if extended else []
    shown = [
        (
            low_pass(one.simulated_current, COMPARE_BAND, rate)[thin],
            low_pass(one.angle - one.simulated_angle, COMPARE_BAND, rate)[thin],
        )
        for one, _, _ in lines
    ]
    for j, (left, right) in enumerate(axes):
        left.plot(t, measured[:, j], color=MEASURED, lw=2.4, label="measured")
        for (current, error), (_, colour, label) in zip(shown, lines):
            left.plot(t, current[:, j], color=colour, lw=0.8, label=label)
            right.plot(t, 1e3 * error[:, j], color=colour, lw=0.8)
        left.set_ylabel(f"joint {j + 1}")
        for axis in (left, right):
            axis.grid(color=GRID)
            axis.locator_params(nbins=5)
    band = f"below {COMPARE_BAND:g} Hz"
    axes[0, 0].set_title(f"motor current {band}, {' or '.join(units)}", loc="left", fontsize="medium")
    axes[0, 1].set_title(f"measured minus simulated angle {band}, mrad (mm)", loc="left", fontsize="medium")
    axes[0, 0].legend(loc="upper right", ncols=3, fontsize="x-small")
    for axis in axes[-1]:
        axis.set_xlabel("time, s")
    return figure, f"measured and simulated currents and angles of {before.name}"
