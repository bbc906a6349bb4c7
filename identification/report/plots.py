"""The pictures of an identification's report."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from scipy import signal
from scipy.interpolate import make_interp_spline

from arm_io.types import Array
from arm_report.palette import AFTER, AXIS, BEFORE, GRID, MEASURED

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from identification.result import Identification, Prediction


def predictions(result: Identification) -> Iterator[tuple[Figure, str]]:
    """Per run: measured and predicted torque of each joint, and their difference at a scale of its own."""
    from matplotlib.figure import Figure

    for run in _worth_showing(result):
        joints = np.unique(run.joint)
        figure = Figure(figsize=(10.5, 0.6 + 1.75 * len(joints)), layout="constrained")
        axes = figure.subplots(len(joints), 2, sharex=True, squeeze=False, width_ratios=(2, 1))
        for (axis, difference), j in zip(axes, joints):
            mine = run.joint == j
            t, measured, predicted, residual = _with_breaks(
                run.t[mine], run.measured[mine], run.predicted[mine], run.residual[mine]
            )
            axis.plot(t, measured, color=MEASURED, lw=1.8, label="measured")
            axis.plot(t, predicted, color=AFTER, lw=0.7, label="predicted")
            difference.plot(t, residual, color=BEFORE, lw=0.7)
            rms = float(np.sqrt(np.mean(run.residual[mine] ** 2)))
            difference.set_title(f"rms {rms:.3g}", loc="right", fontsize="small", color=BEFORE, pad=2)
            axis.set_ylabel(f"joint {j + 1}, {'N m' if result.arm.joints[j].revolute else 'N'}")
            for each in (axis, difference):
                each.axhline(0.0, color=AXIS, lw=0.6)
                each.grid(color=GRID)
        kind = "held out" if run.held_out else "fitted"
        axes[0, 0].set_title(f"{run.run} ({kind})", loc="left")
        axes[0, 0].legend(loc="upper right", ncols=2, frameon=True, fontsize="small")
        axes[0, 1].set_title("difference, its own scale", loc="left", fontsize="small")
        for axis in axes[-1]:
            axis.set_xlabel("time, s")
        yield figure, f"measured and predicted torque of {run.run}"


def spectra(result: Identification) -> Iterator[tuple[Figure, str]]:
    """Residual against torque, and where the cut-off frequencies come from."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.5, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    run = _worth_showing(result)[-1]
    for n, j in enumerate(np.unique(run.joint)):
        mine = run.joint == j
        f, torque = _density(run.t[mine], run.measured[mine])
        _, residual = _density(run.t[mine], run.residual[mine])
        left.semilogy(f, torque, color=f"C{n}", lw=0.8, alpha=0.45)
        left.semilogy(f, residual, color=f"C{n}", lw=1.2, label=f"joint {j + 1}")
    left.set(xlabel="frequency, Hz", ylabel="density, (N m)²/Hz or N²/Hz", title="torque (pale) and residual")
    left.legend(fontsize="x-small", ncols=2)
    if result.bands:
        band = result.bands[0]
        for n, column in enumerate(band.density.T):
            right.loglog(band.frequency[1:], np.maximum(column[1:], 1e-300), lw=0.8, color=f"C{n}")
        right.axvline(band.motion, color="k", lw=1.0, label=f"differentiation {band.motion:.3g} Hz")
        right.axvline(band.parallel, color="k", lw=1.0, ls="--", label=f"regression {band.parallel:.3g} Hz")
        right.set(
            xlabel="frequency, Hz",
            ylabel="density, (rad/s²)²/Hz or (m/s²)²/Hz",
            title="acceleration, differenced twice",
        )
        low = np.min(band.density[1:].max(axis=1))
        right.set_ylim(bottom=max(low * 1e-3, 1e-300))
        right.legend(fontsize="small")
    for axis in (left, right):
        axis.grid(color=GRID)
    yield figure, "spectra of torque, residual and acceleration"


def _worth_showing(result: Identification) -> list[Prediction]:
    """Held-out runs first, then fitted ones, three of each at most."""
    shown = [[run for run in result.rows(held) if len(run.t)] for held in (True, False)]
    return shown[0][:3] + shown[1][:3]


def _with_breaks(t: Array, *lines: Array) -> tuple[Array, ...]:
    """The lines between their rows, which are band-limited, by a cubic spline; NaN where rows were left out."""
    period = np.median(np.diff(t)) if len(t) > 1 else 1.0
    parts = np.split(np.arange(len(t)), np.flatnonzero(np.diff(t) > 1.5 * period) + 1)
    drawn: list[list[Array]] = [[] for _ in range(len(lines) + 1)]
    for part in parts:
        fine = np.linspace(t[part[0]], t[part[-1]], 8 * len(part) + 1)
        degree = min(3, len(part) - 1)
        for place, line in zip(drawn[1:], lines):
            place += [make_interp_spline(t[part], line[part], k=degree)(fine), np.array([np.nan])]
        drawn[0] += [fine, np.array([np.nan])]
    return tuple(np.concatenate(pieces) for pieces in drawn)


def _density(t: Array, values: Array) -> tuple[Array, Array]:
    """Spectral density on the rows' own grid; left-out rows count as zero."""
    period = float(np.median(np.diff(t)))
    place = np.rint((t - t[0]) / period).astype(int)
    grid = np.zeros(place[-1] + 1)
    grid[place] = values
    f, density = signal.welch(grid, 1 / period, nperseg=min(len(grid), 256), detrend=False)
    return f[1:], np.maximum(density[1:], 1e-300)
