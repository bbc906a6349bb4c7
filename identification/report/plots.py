"""The charts of an identification's report."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy import signal
from scipy.interpolate import make_interp_spline

from arm_io.types import Array
from arm_report import Chart, Level, Panel, Series
from arm_report.palette import AFTER, AXIS, BEFORE, MEASURED, joint_colour

if TYPE_CHECKING:
    from identification.preprocessing.spectrum import Band
    from identification.result import Identification, Prediction

FINE = 8
"""Points of a drawn line per row, at most: between rows, which are few, it is a spline."""
MOST_FINE = 2000
"""Points of a drawn line that a page shows without thinning them."""


def predictions(result: Identification) -> Iterator[Chart]:
    """Per run: measured and predicted torque of each joint, and their difference at a scale of its own."""
    units = ["N m" if joint.revolute else "N" for joint in result.arm.joints]
    for number, run in enumerate(_worth_showing(result), 1):
        yield prediction_chart(run, units, f"prediction_{number}")


def prediction_chart(run: Prediction, units: Sequence[str] = (), name: str = "prediction") -> Chart:
    """Measured and predicted torque of each joint of a run, and their difference; units of all joints: N m or N."""
    panels: list[Panel] = []
    for j in np.unique(run.joint):
        mine, unit = run.joint == j, units[j] if units else ""
        t, measured, predicted, residual = _with_breaks(
            run.t[mine], run.measured[mine], run.predicted[mine], run.residual[mine]
        )
        rms = float(np.sqrt(np.mean(run.residual[mine] ** 2)))
        axis = {"N m": "torque, N m", "N": "force, N"}.get(unit, "torque, N m (force, N)")
        panels += [
            Panel(
                series=(
                    Series(x=t, y=measured, colour=MEASURED, label="measured", width=1.8),
                    Series(x=t, y=predicted, colour=AFTER, label="predicted"),
                ),
                title=f"joint {j + 1}",
                x="time, s",
                y=axis,
                levels=(Level(value=0.0),),
                joint=int(j) + 1,
                motion=run.run,
            ),
            Panel(
                series=(Series(x=t, y=residual, colour=BEFORE, label="difference"),),
                title=f"joint {j + 1}, difference: rms {rms:.3g} {unit}".rstrip(),
                x="time, s",
                y=f"difference, {unit}" if unit else "difference",
                levels=(Level(value=0.0),),
                joint=int(j) + 1,
                motion=run.run,
            ),
        ]
    kind = "held out" if run.held_out else "fitted"
    return Chart(
        name=name,
        title=f"measured and predicted torque of {run.run} ({kind})",
        panels=tuple(panels),
        columns=2,
        widths=(2.0, 1.0),
        shared=True,
        height=1.75,
    )


def spectra(result: Identification) -> Chart:
    """Residual against torque, and where the cut-off frequencies come from."""
    panels = [_torque_spectra(_worth_showing(result)[-1]), *map(_acceleration_spectra, result.bands[:1])]
    return Chart(
        name="spectra",
        title="spectra of torque, residual and acceleration",
        panels=tuple(panels),
        columns=len(panels),
        height=3.1,
    )


def _torque_spectra(run: Prediction) -> Panel:
    """Spectral densities of measured torque and residual, joint by joint."""
    lines = []
    for j in np.unique(run.joint):
        mine, joint = run.joint == j, int(j) + 1
        f, torque = _density(run.t[mine], run.measured[mine])
        _, residual = _density(run.t[mine], run.residual[mine])
        colour = joint_colour(joint)
        lines += [
            Series(x=f, y=torque, colour=colour, width=0.8, dashed=True, joint=joint),
            Series(x=f, y=residual, colour=colour, width=1.4, label=f"joint {joint}", joint=joint),
        ]
    return Panel(
        series=tuple(lines),
        title="torque (dashed) and residual",
        x="frequency, Hz",
        y="density, (N m)²/Hz or N²/Hz",
        log_y=True,
    )


def _acceleration_spectra(band: Band) -> Panel:
    """Spectral density of the angles differenced twice, with the cut-off frequencies that follow from it."""
    low = float(np.min(band.density[1:].max(axis=1)))
    columns = [
        Series(
            x=band.frequency[1:],
            y=np.maximum(column[1:], max(low * 1e-3, 1e-300)),
            colour=joint_colour(joint),
            joint=joint,
        )
        for joint, column in enumerate(band.density.T, 1)
    ]
    cuts = (
        Level(value=band.motion, axis="x", colour=AXIS, words=f"differentiation {band.motion:.3g} Hz"),
        Level(value=band.parallel, axis="x", colour=AXIS, words=f"regression {band.parallel:.3g} Hz", dashed=True),
    )
    return Panel(
        series=tuple(columns),
        title="acceleration, differenced twice",
        x="frequency, Hz",
        y="density, (rad/s²)²/Hz or (m/s²)²/Hz",
        levels=cuts,
        log_x=True,
        log_y=True,
    )


def _worth_showing(result: Identification) -> list[Prediction]:
    """Held-out runs first, then fitted ones, three of each at most."""
    shown = [[run for run in result.rows(held) if len(run.t)] for held in (True, False)]
    return shown[0][:3] + shown[1][:3]


def _with_breaks(t: Array, *lines: Array) -> tuple[Array, ...]:
    """(k,) s and the lines (m,) at t (m,) s between their rows, by a cubic spline; NaN where rows were left out."""
    period = np.median(np.diff(t)) if len(t) > 1 else 1.0
    parts = np.split(np.arange(len(t)), np.flatnonzero(np.diff(t) > 1.5 * period) + 1)
    drawn: list[list[Array]] = [[] for _ in range(len(lines) + 1)]
    per_row = max(1, min(FINE, MOST_FINE // len(t)))
    for part in parts:
        fine = np.linspace(t[part[0]], t[part[-1]], per_row * (len(part) - 1) + 1)
        degree = min(3, len(part) - 1)
        for place, line in zip(drawn[1:], lines):
            place += [make_interp_spline(t[part], line[part], k=degree)(fine), np.array([np.nan])]
        drawn[0] += [fine, fine[-1:]]
    return tuple(np.concatenate(pieces) for pieces in drawn)


def _density(t: Array, values: Array) -> tuple[Array, Array]:
    """(f,) Hz and (f,) spectral density of values (m,) on the rows' own grid; left-out rows count as zero."""
    period = float(np.median(np.diff(t)))
    place = np.rint((t - t[0]) / period).astype(int)
    grid = np.zeros(place[-1] + 1)
    grid[place] = values
    f, density = signal.welch(grid, 1 / period, nperseg=min(len(grid), 256), detrend=False)
    return f[1:], np.maximum(density[1:], 1e-300)
