"""Chart of the tracked points."""

from __future__ import annotations

import numpy as np

from arm_report import Chart, Level, Panel, Series
from arm_report.palette import AFTER, BEFORE, MEASURED
from diagnosis.measurements.tracker.causes import Tracked


def tracker_chart(name: str, tracked: Tracked) -> Chart:
    """Distance of every tracked point from its predicted place before and after all causes, fitted and held out."""
    panels = []
    for title, (before, after) in tracked.distances.items():
        row = np.arange(len(before), dtype=float)
        sides = ((before, BEFORE, "before"), (after, AFTER, "after all causes"))
        panels.append(
            Panel(
                series=tuple(
                    Series(x=row, y=1e3 * np.maximum(distance, 1e-7), kind="dots", colour=colour, label=label)
                    for distance, colour, label in sides
                ),
                levels=(Level(value=1e3 * 1.6 * tracked.noise, colour=MEASURED, dashed=True, label="noise"),),
                title=title.replace("_", " "),
                x="tracked point",
                y="distance, mm",
                log_y=True,
            )
        )
    title = "distance of tracked points from the model's, before and after all causes"
    return Chart(name=name, title=title, panels=tuple(panels), columns=len(panels), height=2.9)
