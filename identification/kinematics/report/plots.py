"""The charts of a calibration: position errors before and after, and circles of single-joint sweeps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm_report import Chart, Level, Panel, Series
from arm_report.motion import Clip, clip_of
from arm_report.palette import AFTER, BEFORE, JOINTS, MEASURED
from identification.kinematics.circle_points.circle_point import Circle
from identification.kinematics.data.recordings import Gravity
from identification.kinematics.data.runs import Run
from identification.kinematics.estimation.calibration import Calibration
from identification.kinematics.use.prediction import distances

MOST = 4000
"""Points of a run, at most."""


def error_chart(calibration: Calibration, gravity: Gravity | None) -> Chart:
    """Distance (angle) of everything tracked from the model, before and after; one panel per recording and quantity."""
    runs = [(run, "fitted") for run in calibration.runs]
    if calibration.judged_by != "cross-validation":
        runs += [(run, "held out") for run in calibration.held_out]
    panels = []
    for source, oriented, words in dict.fromkeys((run.source, run.lever > 0, words) for run, words in runs):
        shown = [run for run, part in runs if (run.source, run.lever > 0, part) == (source, oriented, words)]
        series = tuple(line for run in shown for line in _distances(calibration, run, gravity))
        noise = 1e3 * 1.6 * calibration.fit.noise / (shown[0].lever or 1.0)
        several = f", {len(shown)} reflectors" if len(shown) > 1 else ""
        panels.append(
            Panel(
                series=series,
                title=f"{_name_of(shown)} ({words}{several})",
                x="row" if shown[0].still else "time, s",
                y="angle, mrad" if oriented else "distance, mm",
                levels=(Level(value=noise, colour=MEASURED, dashed=True, label="noise (mean distance)"),),
                y_range=_range(series, noise),
                log_y=True,
                motion=source,
            )
        )
    title = "distance of every tracked point from the model, before and after"
    return Chart(name="position_error", title=title, panels=tuple(panels))


def clips_of(calibration: Calibration) -> dict[str, Clip]:
    """The motion of every recording, at the places of the x axes of ``error_chart``."""
    clips = {}
    for run in (*calibration.runs, *calibration.held_out):
        clips[run.source] = clip_of(_place(run), run.q, run.source, "row" if run.still else "time, s")
    return clips


def _place(run: Run) -> np.ndarray:
    """(N,) row of the file, from 1, of poses; else the time, s."""
    row = np.arange(len(run.t)) if run.file_row is None else run.file_row
    return np.asarray(row + 1 if run.still else run.t, float)


def _range(series: Sequence[Series], noise: float) -> tuple[float, float]:
    drawn = np.concatenate([*(one.y for one in series), [noise]])
    drawn = drawn[np.isfinite(drawn) & (drawn > 0.0)]
    return (float(drawn.min()) / 1.5, float(drawn.max()) * 1.5) if len(drawn) else (0.1, 1.0)


def _distances(calibration: Calibration, run: Run, gravity: Gravity | None) -> list[Series]:
    stride = max(1, len(run.t) // MOST)
    x = _place(run)[::stride]
    lines = []
    for before, colour, label in ((True, BEFORE, "nominal"), (False, AFTER, "calibrated")):
        off = distances(calibration, run, gravity, before=before, every=stride)
        lines.append(Series(x=x, y=1e3 * np.maximum(off, 1e-7), kind="dots", colour=colour, label=label))
    return lines


def _name_of(shown: Sequence[Run]) -> str:
    """Of one run its name; of several reflectors that of their table."""
    if len(shown) == 1:
        return shown[0].name
    return shown[0].name.partition(" reflector ")[0] + (" orientation" if shown[0].lever else "")


def circle_chart(circles: Sequence[Circle]) -> Chart:
    """The points of every sweep on their circle, and their residuals over the joint's angle."""
    panels: list[Panel] = []
    for circle in circles:
        ahead = np.linspace(circle.q.min(), circle.q.max(), 200)
        at = circle.q + circle.tangential / circle.radius
        reach = circle.radius + circle.radial
        keep = np.flatnonzero(circle.inlier)[:: max(1, len(at) // 2000)]
        # dots, because a line of a page runs from left to right
        arc = Series(
            x=circle.radius * np.cos(ahead),
            y=circle.radius * np.sin(ahead),
            kind="dots",
            colour=MEASURED,
            label="circle",
        )
        points = Series(
            x=(reach * np.cos(at))[keep], y=(reach * np.sin(at))[keep], kind="dots", colour=AFTER, label="points"
        )
        parts = (("across", JOINTS[2]), ("radial", JOINTS[1]), ("tangential", JOINTS[3]))
        residuals = tuple(
            Series(
                x=np.degrees(circle.q[keep]),
                y=1e3 * getattr(circle, part)[keep],
                kind="dots",
                colour=colour,
                label=part,
            )
            for part, colour in parts
        )
        panels += [
            Panel(
                series=(arc, points),
                title=f"joint {circle.joint}: radius {1e3 * circle.radius:.2f} mm",
                x="along the zero direction, m",
                y="across it, m",
                joint=circle.joint,
                equal=True,
            ),
            Panel(
                series=residuals,
                title=f"joint {circle.joint}: residuals",
                x=f"joint {circle.joint}, °",
                y="residual, mm",
                levels=(Level(value=0.0),),
                joint=circle.joint,
            ),
        ]
    title = "circles of single-joint sweeps, and their residuals"
    return Chart(name="circles", title=title, panels=tuple(panels), columns=2)
