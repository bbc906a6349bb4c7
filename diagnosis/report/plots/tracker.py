"""Plot of the tracked points."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from arm_report.palette import AFTER, BEFORE, GRID, MEASURED
from diagnosis.measurements.tracker.causes import Tracked

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def tracker_figure(tracked: Tracked) -> tuple[Figure, str]:
    """Distance of every tracked point from where the model has it, before and after all causes.

    Fitted and held-out recordings.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.5, 3.4), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    for axis, (name, (before, after)) in zip(axes, tracked.distances.items()):
        row = np.arange(len(before))
        for distance, colour, label in ((before, BEFORE, "before"), (after, AFTER, "after all causes")):
            axis.semilogy(row, 1e3 * np.maximum(distance, 1e-7), ".", ms=1.6, color=colour, label=label)
        axis.axhline(1e3 * 1.6 * tracked.noise, color=MEASURED, ls="--", lw=1, label="noise")
        axis.set_title(name.replace("_", " "), loc="left", fontsize="medium")
        axis.set_xlabel("tracked point")
        axis.grid(color=GRID)
    axes[0].set_ylabel("distance from the model's point, mm")
    axes[1].legend(loc="upper right", fontsize="small", markerscale=5)
    return figure, "distance of tracked points from the model's, before and after all causes"
