"""report.html of a calibration: one self-contained page with its plots inside."""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

import arm_report
from arm_report import image, verdict, warning
from arm_report.palette import AFTER, BEFORE, GRID, MEASURED
from identification.kinematics.circle_points.circle_point import Circle
from identification.kinematics.data.recordings import Gravity
from identification.kinematics.data.runs import Run
from identification.kinematics.estimation.calibration import Calibration, distances
from identification.kinematics.use.iso_cube import CubeReport

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_LISTED = 50
"""Outliers of a run that the page lists; kinematics.json has all."""


def page(
    name: str, table: dict[str, Any], calibration: Calibration, gravity: Gravity | None, cubes: Sequence[CubeReport]
) -> str:
    """The page for the result ``table`` of calibrating the arm called ``name``."""
    parts = [
        _headline(table),
        *map(warning, [*table["warnings"], *map(str, calibration.shifts)]),
        "<h2>Position error before and after</h2>",
        image(error_figure(calibration, gravity), "distance of every tracked point from the model, before and after"),
        _error_table(table),
        "<h2>Parameters</h2>",
        _parameter_table(table),
        _effects(table),
    ]
    if calibration.circles:
        parts += [
            "<h2>Circles of single-joint sweeps</h2>",
            _circles_text(table),
            image(_circle_figure(calibration.circles), "circles of single-joint sweeps, and their residuals"),
        ]
    if calibration.without_circles:
        parts += [f"<p>No circle-point analysis: {html.escape(calibration.without_circles)}.</p>"]
    if calibration.refused:
        parts += ["<p>Sweeps without a circle: " + "; ".join(html.escape(r) for r in calibration.refused) + "</p>"]
    for cube in cubes:
        parts += ["<h2>ISO cube</h2>", _cube(cube)]
    parts += ["<h2>Observability of the poses</h2>", _observability(table)]
    return arm_report.page(f"{name}: kinematic calibration", parts)


def _headline(table: dict[str, Any]) -> str:
    rms, better = table["position_rms"]["held_out"], 100 * table["improvement"]["held_out"]
    where = {"split": "held-out blocks of the same runs", "cross-validation": "poses that the fit had not seen"}.get(
        str(table["held_out"]), "held-out runs"
    )
    if table["failures"]:
        return verdict("Not calibrated: " + " ".join(map(html.escape, table["failures"])), refuted=True)
    change = (
        f"falls from {_mm(rms['before'])} to {_mm(rms['after'])}"
        if better > 0
        else (f"does not fall: {_mm(rms['before'])} before, {_mm(rms['after'])} after")
    )
    return verdict(
        f"On all points of {where} the position error {change} rms per coordinate ({better:.2f} % better)."
        f" The noise of the points is {_mm(table['noise'])}.",
        refuted=better <= 0,
    )


def _error_table(table: dict[str, Any]) -> str:
    rows = []
    for part, words in (("fit", "fitted"), ("held_out", "held out")):
        for when in ("before", "after"):
            e = table["position_error"][part][when]
            rows.append(
                [f"{words}, {when}", _mm(e["rms"]), _mm(e["mean"]), _mm(e["largest"]), e["points"], e["outliers"]]
            )
            rows[-1].append(_mm(e["rms_inliers"]))
    alone = table["circle_point"]
    if alone is not None:
        e = alone["fit"]
        rows.append(
            [
                "fitted, circle points alone",
                _mm(e["rms"]),
                _mm(e["mean"]),
                _mm(e["largest"]),
                e["points"],
                e["outliers"],
                _mm(e["rms_inliers"]),
            ]
        )
    head = ["points", "rms per coordinate", "mean distance", "largest distance", "points", "outliers", "rms without"]
    out = [
        f"{html.escape(one['run'])} row {row}: {_mm(distance)} off, {html.escape(one['why'])}"
        for one in table["left_out"]
        for row, distance in list(zip(one["rows"], one["distance"]))[:_LISTED]
    ]
    small = (
        "<small>All points count, outliers too. Before: the nominal arm after the best fit of frame and target. Rows "
        "count from 1.</small>"
    )
    return _table(head, rows) + small + (f"<ul>{''.join(f'<li>{line}</li>' for line in out)}</ul>" if out else "")


def _parameter_table(table: dict[str, Any]) -> str:
    rows = []
    for row in table["parameters"]:
        cells: list[Any] = [f"joint {row['joint']}"]
        for name in ("theta", "alpha", "beta"):
            cells.append(_with_std(np.degrees(row[name]), np.degrees(row["std"][name]), "°"))
        for name in ("a", "d"):
            cells.append(_with_std(1e3 * row[name], 1e3 * row["std"][name], " mm"))
        rows.append(cells)
    frame = table["tracker_frame"]
    text = (
        ""
        if frame["known"]
        else "<p>The tracker's frame was unknown; its pose was estimated together with the arm.</p>"
    )
    base = np.array(table["base"])
    for entry in table["coupling"]:
        text += (
            f"<p>Coupling: link angle {entry['joint']} has {entry['ratio']:.6g}"
            + (f" ± {entry['std']:.1g}" if entry["std"] else "")
            + f" times the angle that the controller reports for joint {entry['by']}.</p>"
        )
    text += (
        f"<p>Base at ({', '.join(f'{1e3 * v:.3f}' for v in base[:3, 3])}) mm. In the frame of the last link: "
        f"{'; '.join(map(_target, table['targets']))}.</p>"
        "<small>A value without a std was held: it is aliased with other parameters. Aliased parameters (last link "
        "and target position; "
        "rotation of the base and offset of joint 1) are decided by prior knowledge.</small>"
    )
    return _table(["", "theta", "alpha", "beta", "a", "d"], rows) + text


def _target(target: dict[str, Any]) -> str:
    """Where a target is, with its deviations."""
    pose, std = np.array(target["pose"]), target["std"]
    place = ", ".join(_with_std(1e3 * v, 1e3 * std.get(axis, 0.0), "") for v, axis in zip(pose[:3, 3], "xyz"))
    return f"target {html.escape(target['name'])} at ({place}) mm".replace("target  at", "target at")


def _effects(table: dict[str, Any]) -> str:
    rows = []
    for trial in table["tried"]:
        seen = trial["unseen_rms"]
        outcome = "accepted" if trial["accepted"] else "not needed"
        rows.append([trial["title"], _mm(seen["before"]), _mm(seen["after"]), f"{trial['z']:.1f}", outcome])
    if not rows:
        return ""
    found = []
    for effect in table["effects"]:
        values = ", ".join(
            f"{n} {p['value']:.4g} ± {p['std']:.1g} {p['unit']}" for n, p in effect["parameters"].items()
        )
        other = ", ".join(effect["indistinguishable"])
        if other:
            values += f"; these poses do not discriminate it from {other}"
        found.append(f"<li>{effect['title']}: {html.escape(values)}</li>")
    return (
        "<h2>Beyond geometry</h2><p>Each effect was cross-validated on blocks of points; the best of each step is "
        "listed, until none "
        "improves the held-out error.</p>"
        + _table(["effect", "held-out rms before", "after", "gain / std error", ""], rows)
        + (f"<ul>{''.join(found)}</ul>" if found else "")
    )


def _circles_text(table: dict[str, Any]) -> str:
    rows = []
    for c in table["circles"]:
        r, wave = c["residual_rms"], c["once_a_turn"]
        turn = f"{1e3 * wave['amplitude']:.3f} mrad ({100 * wave['share']:.0f} %)" if wave["share"] > 0.3 else "-"
        rows.append(
            [
                f"joint {c['joint']}",
                _mm(c["radius"]),
                f"{np.degrees(c['arc']):.0f}°",
                f"{1e6 * c['std']['axis']:.0f} µrad",
                _mm(r["across"]),
                _mm(r["radial"]),
                _mm(r["tangential"]),
                turn,
            ]
        )
    return _table(["", "radius", "arc", "axis ±", "across", "radial", "tangential", "once per turn"], rows) + (
        "<small>Tangential: encoder angle against the angle on the circle. Once per turn: encoder eccentricity, or "
        "gravity "
        "sag of a joint about a horizontal axis; the least-squares fit discriminates them. Encoders do not affect "
        "across and radial residuals.</small>"
    )


def _cube(cube: CubeReport) -> str:
    rows = [
        [f"P{k}", _mm(before), _mm(after), _mm(over)]
        for k, (before, after, over) in enumerate(zip(cube.before, cube.after, cube.overshoot, strict=True), 1)
    ]
    return _table(["point", "error of the nominal arm", "of the calibrated arm", "overshoot"], rows) + (
        f"<small>{html.escape(cube.run)}: ISO 9283, cube of {1e3 * cube.side:.0f} mm, five points of its diagonal "
        "plane. Distances between "
        "the measured standstill positions and what the nominal and the calibrated model predict.</small>"
    )


def _observability(table: dict[str, Any]) -> str:
    o = table["observability"]
    rows = [[name.upper(), f"{o[name]:.4g}"] for name in ("o1", "o2", "o3", "o4", "o5")]
    return (
        f"<p>{table['identifiable']} combinations of parameters are identifiable from these poses; "
        f"{table['correlated_points']:.1f} neighbouring points count as one in the deviations.</p>"
        + _table(["index", ""], rows)
    )


def error_figure(calibration: Calibration, gravity: Gravity | None) -> Figure:
    """Distance (angle) of everything tracked from the model, before and after; one panel per recording and quantity."""
    from matplotlib.figure import Figure

    runs = [(run, "fitted") for run in calibration.runs]
    if calibration.judged_by != "cross-validation":
        runs += [(run, "held out") for run in calibration.held_out]
    panels = list(dict.fromkeys((run.source, run.lever > 0, words) for run, words in runs))
    figure = Figure(figsize=(10.5, 2.6 * len(panels)), layout="constrained")
    for k, (source, oriented, words) in enumerate(panels):
        shown = [run for run, part in runs if (run.source, run.lever > 0, part) == (source, oriented, words)]
        axes = figure.add_subplot(len(panels), 1, k + 1)
        for run in shown:
            _draw_distances(axes, calibration, run, gravity)
        noise = 1e3 * 1.6 * calibration.fit.noise / (shown[0].lever or 1.0)
        _limit(axes, noise)
        axes.axhline(noise, color=MEASURED, lw=1, ls="--")
        axes.grid(color=GRID)
        several = f", {len(shown)} reflectors" if len(shown) > 1 else ""
        axes.set_title(f"{_name_of(shown)} ({words}{several})", loc="left", fontsize=10)
        axes.set_xlabel("row" if shown[0].still else "t [s]")
        axes.set_ylabel("angle [mrad]" if oriented else "distance [mm]")
        if k == 0:
            marks = [axes.plot([], [], "o", ms=4, color=colour)[0] for colour in (BEFORE, AFTER)]
            marks += [axes.plot([], [], color=MEASURED, lw=1, ls="--")[0]]
            names = ["nominal", "calibrated", "noise (mean distance)"]
            figure.legend(marks, names, loc="outside upper right", fontsize=8, ncol=3)
    return figure


def _limit(axes: Any, noise: float) -> None:
    """Limits about all points and the noise; matplotlib's own warn where the points are equal but for rounding."""
    drawn = np.concatenate([*(line.get_ydata() for line in axes.lines), [noise]])
    drawn = drawn[np.isfinite(drawn) & (drawn > 0.0)]
    axes.set_autoscaley_on(False)
    if len(drawn):
        axes.set_ylim(float(drawn.min()) / 1.5, float(drawn.max()) * 1.5)


def _draw_distances(axes: Any, calibration: Calibration, run: Run, gravity: Gravity | None) -> None:
    stride = max(1, len(run.t) // 4000)
    row = np.arange(len(run.t)) if run.file_row is None else run.file_row
    x = (row + 1 if run.still else run.t)[::stride]
    size = 2 if len(x) > 400 else 4
    for before, colour in ((True, BEFORE), (False, AFTER)):
        off = distances(calibration, run, gravity, before=before, every=stride)
        axes.semilogy(x, 1e3 * np.maximum(off, 1e-7), ".", ms=size, color=colour)


def _name_of(shown: Sequence[Run]) -> str:
    """Of one run its name; of several reflectors that of their table."""
    if len(shown) == 1:
        return shown[0].name
    return shown[0].name.partition(" reflector ")[0] + (" orientation" if shown[0].lever else "")


def _circle_figure(circles: Sequence[Circle]) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.5, 2.7 * len(circles)), layout="constrained")
    for k, circle in enumerate(circles):
        left = figure.add_subplot(len(circles), 2, 2 * k + 1)
        ahead = np.linspace(circle.q.min(), circle.q.max(), 200)
        at = circle.q + circle.tangential / circle.radius
        reach = circle.radius + circle.radial
        keep = np.flatnonzero(circle.inlier)[:: max(1, len(at) // 2000)]
        left.plot(circle.radius * np.cos(ahead), circle.radius * np.sin(ahead), color=MEASURED, lw=1)
        left.plot((reach * np.cos(at))[keep], (reach * np.sin(at))[keep], ".", ms=2, color=AFTER)
        left.plot([0, circle.radius], [0, 0], color=BEFORE, lw=1)
        left.plot(0, 0, "+", color=BEFORE)
        left.set_aspect("equal", "datalim")
        left.set_title(f"joint {circle.joint}: radius {1e3 * circle.radius:.2f} mm", loc="left", fontsize=10)
        left.set_xlabel("along the zero direction [m]")
        right = figure.add_subplot(len(circles), 2, 2 * k + 2)
        for part, colour in (("across", MEASURED), ("radial", BEFORE), ("tangential", AFTER)):
            right.plot(
                np.degrees(circle.q[keep]), 1e3 * getattr(circle, part)[keep], ".", ms=1.5, color=colour, label=part
            )
        right.set_xlabel(f"joint {circle.joint} [°]")
        right.set_ylabel("residual [mm]")
        right.legend(loc="upper right", fontsize=8, markerscale=5)
    return figure


def _table(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """Numbers flush right, after a first column of words."""
    return arm_report.table([[str(cell) for cell in row] for row in rows], head, range(1, len(head)))


def _mm(metres: float | None) -> str:
    return "-" if metres is None else f"{1e3 * metres:.4g} mm"


def _with_std(value: float, std: float, unit: str) -> str:
    return f"{value:.4f}{unit}" + (f" <small>± {std:.2g}</small>" if std > 0 else "")
