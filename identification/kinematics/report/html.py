"""report.html of a calibration: one self-contained page with its plots inside."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

import arm_report
from arm_io import counted
from arm_model import Arm
from arm_model.collision import chain_of
from arm_report import Report
from arm_report.motion import Motion
from arm_report.numbers import value_and_two_std, with_two_std
from identification.kinematics.data.recordings import Gravity
from identification.kinematics.estimation.calibration import Calibration
from identification.kinematics.report.plots import circle_chart, clips_of, error_chart
from identification.kinematics.report.write import NO_CHANGE, change, coupling_equations
from identification.kinematics.use.iso_cube import CubeReport

_SHOWN = (
    *((name, 180 / np.pi, "°") for name in ("theta", "alpha", "beta")),
    *((name, 1e3, " mm") for name in ("a", "d")),
)
"""Parameters of a joint with the factor and unit in which they are shown."""
_LISTED = 50
"""Outliers of a run that the page lists; kinematics.json has all."""


def page(
    arm: Arm, table: dict[str, Any], calibration: Calibration, gravity: Gravity | None, cubes: Sequence[CubeReport]
) -> Report:
    """The page for the result ``table`` of calibrating an arm."""
    clips = clips_of(calibration)
    says, refuted = headline(table)
    return Report(
        title=f"{arm.name}: kinematic calibration",
        template="identification.kinematics.report/calibration.html",
        joints=[joint.name for joint in arm.joints],
        motion=Motion(arm=chain_of(arm).to_json(), clips=clips),
        content={
            "says": says,
            "refuted": refuted,
            "warnings": [*table["warnings"], *map(str, calibration.shifts)],
            "errors": error_chart(calibration, gravity),
            "error_table": _error_table(table),
            "left_out": _left_out(table),
            "budget": _budget(table),
            "uncertainty": table["uncertainty"],
            "repeated": _repeated(table),
            "parameters": _parameter_table(table),
            "corrections": _corrections(table),
            "frame_known": table["tracker_frame"]["known"],
            "coupling": coupling_equations(table),
            "base": ", ".join(f"{1e3 * v:.3f}" for v in np.array(table["base"])[:3, 3]),
            "targets": Markup("; ").join(map(_target, table["targets"])),
            "tried": _tried(table),
            "found": _found(table),
            "circles": circle_chart(calibration.circles) if calibration.circles else None,
            "circle_table": _circle_table(table),
            "without_circles": calibration.without_circles,
            "refused": calibration.refused,
            "cubes": [(cube, _cube(cube)) for cube in cubes],
            "identifiable": table["identifiable"],
            "correlated": f"{table['correlated_points']:.1f}",
            "observability": _observability(table),
        },
    )


def headline(table: dict[str, Any]) -> tuple[str, bool]:
    """The verdict, and whether it is that the calibration is worse; a model that needs none is no failure."""
    rms, better = table["position_rms"]["held_out"], table["improvement"]["held_out"]
    where = {"split": "held-out blocks of the same runs", "cross-validation": "poses that were not fitted"}.get(
        str(table["held_out"]), "held-out runs"
    )
    if table["failures"]:
        return "Not calibrated: " + " ".join(table["failures"]), True
    fall = (
        f"falls from {_mm(rms['before'])} to {_mm(rms['after'])}"
        if better > 0
        else (f"does not fall: {_mm(rms['before'])} before, {_mm(rms['after'])} after")
    )
    stated = ", as stated" if table["noise"] == table["point_std"] else ""
    return (
        f"On all points of {where} the position error {fall} rms per coordinate ({change(better, max(rms.values()))})."
        f"{_without_outliers(table)} The noise of the points is {_mm(table['noise'])}{stated}.{_orientation(table)}",
        better <= -NO_CHANGE and not table["position_error"]["held_out"]["after"]["outliers"],
    )


def _without_outliers(table: dict[str, Any]) -> str:
    """A sentence on the held-out points without the outliers, which hide what became of the others; empty without."""
    errors = table["position_error"]["held_out"]
    if not (count := errors["after"]["outliers"]):
        return ""
    was, now = (errors[when]["rms_inliers"] for when in ("before", "after"))
    return f" Without {counted(count, 'outlier')} it was {_mm(was)}, and is {_mm(now)}."


def _orientation(table: dict[str, Any]) -> str:
    """A sentence on the held-out orientation error of six-dimensional targets; empty without."""
    if not (rms := table["orientation_rms"].get("held_out")):
        return ""
    before, after = 1e3 * rms["before"], 1e3 * rms["after"]
    return f" The orientation error was {before:.3g} mrad rms per coordinate, and is {after:.3g} mrad."


def _error_table(table: dict[str, Any]) -> Markup:
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
    return _table(head, rows)


def _budget(table: dict[str, Any]) -> Markup:
    """Standard uncertainties by source, combined and expanded."""
    known = table["uncertainty"]
    rows = []
    for one in known["components"]:
        freedom = one["degrees_of_freedom"]
        rows.append(
            [one["source"], one["how"], one["type"], "" if freedom is None else f"{freedom:.0f}", _mm(one["std"])]
        )
    rows.append(["combined standard uncertainty", "root of the sum of squares", "", "", _mm(known["combined"])])
    rows.append(["expanded uncertainty", f"k = {known['coverage_factor']:g}", "", "", _mm(known["expanded"])])
    rows.append(["distance in space", "95 % of the points are nearer", "", "", _mm(known["in_space"])])
    head = ["source", "from", "type", "degrees of freedom", "per coordinate"]
    return arm_report.table(rows, head, (3, 4), stacked=True)


def _repeated(table: dict[str, Any]) -> Markup | None:
    """Poses that were visited several times; None without such."""
    if not (found := table["uncertainty"]["repeated"]):
        return None
    rows = []
    for pose in found["poses"][:_LISTED]:
        name = f"{pose['file']}{pose['reflector'] and ', reflector ' + pose['reflector']}"
        visits = ", ".join(map(str, pose["rows"][:_LISTED])) + (" .." if len(pose["rows"]) > _LISTED else "")
        was, now = (_mm(pose["accuracy"][when]) for when in ("before", "after"))
        rows.append([name, visits, len(pose["rows"]), was, now, _mm(pose["repeatability"])])
    head = ["pose", "rows", "visits", "accuracy before", "accuracy after", "repeatability"]
    return arm_report.table(rows, head, (2, 3, 4, 5))


def _left_out(table: dict[str, Any]) -> list[str]:
    return [
        f"{one['run']} row {row}: {1e3 * distance:.4g} {'mm' if one['quantity'] == 'position' else 'mrad'} off, "
        f"{one['why']}"
        for one in table["left_out"]
        for row, distance in list(zip(one["rows"], one["distance"]))[:_LISTED]
    ]


def _parameter_table(table: dict[str, Any]) -> Markup:
    rows = []
    for row in table["parameters"]:
        cells: list[Any] = [f"joint {row['joint']}"]
        for name, factor, unit in _SHOWN:
            cells.append(_with_std(factor * row[name], factor * row["std"][name], unit))
        rows.append(cells)
    return _table(["", *(name for name, *_ in _SHOWN)], rows)


def _corrections(table: dict[str, Any]) -> Markup | None:
    """What is added to the parameters of the model, those that are kept left empty; None: nothing is."""
    rows = []
    for row, added in zip(table["parameters"], table["corrections"]):
        several = [(factor * added[name], factor * row["std"][name], unit) for name, factor, unit in _SHOWN]
        cells = [_with_std(value, std, unit) if value or std else "" for value, std, unit in several]
        rows.append([f"joint {row['joint']}", *cells])
    return _table(["", *(name for name, *_ in _SHOWN)], rows) if any(any(cells[1:]) for cells in rows) else None


def _target(target: dict[str, Any]) -> Markup:
    """Where a target is, with its deviations."""
    pose, std = np.array(target["pose"]), target["std"]
    several = zip(pose[:3, 3], "xyz")
    place = Markup(", ").join(_with_std(1e3 * v, 1e3 * std.get(axis, 0.0), "") for v, axis in several)
    name = f" {target['name']}" if target["name"] else ""
    given = ""
    if not np.allclose(target["place"], pose[:3, 3], rtol=0.0, atol=1e-9):
        there = ", ".join(f"{1e3 * v:.1f}" for v in target["place"])
        given = f" (in the last link of the given model, as for --target: {there})"
    return Markup("target{} at ({}) mm{}").format(name, place, given)


def _tried(table: dict[str, Any]) -> Markup | None:
    rows = []
    for trial in table["tried"]:
        seen = trial["unseen_rms"]
        outcome = "accepted" if trial["accepted"] else "not needed"
        rows.append([_in_words(trial["title"]), _mm(seen["before"]), _mm(seen["after"]), f"{trial['z']:.1f}", outcome])
    return _table(["effect", "held-out rms before", "after", "gain / std error", ""], rows) if rows else None


def _found(table: dict[str, Any]) -> list[str]:
    found = []
    for effect in table["effects"]:
        values = ", ".join(
            f"{n} {with_two_std(p['value'], p['std'], mark='±')} {p['unit']}" for n, p in effect["parameters"].items()
        )
        other = _in_words(", ".join(effect["indistinguishable"]))
        if other:
            values += f"; these poses do not discriminate it from {other}"
        found.append(f"{_in_words(effect['title'])}: {values}")
    return found


def _circle_table(table: dict[str, Any]) -> Markup:
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
    return _table(["", "radius", "arc", "axis ±", "across", "radial", "tangential", "once per turn"], rows)


def _cube(cube: CubeReport) -> Markup:
    rows = [
        [f"P{k}", _mm(before), _mm(after), _mm(over)]
        for k, (before, after, over) in enumerate(zip(cube.before, cube.after, cube.overshoot, strict=True), 1)
    ]
    return _table(["point", "error of the nominal arm", "of the calibrated arm", "overshoot"], rows)


INDICES = {
    "o1": "the smallest volume of the uncertainty (D-optimal)",
    "o2": "the best condition number",
    "o3": "the smallest uncertainty in the worst direction (E-optimal)",
    "o4": "the least amplification of noise",
    "o5": "the smallest mean variance (A-optimal)",
}
"""Observability indices (Sun and Hollerbach, ICRA 2008), and what poses with the largest one have."""


def _observability(table: dict[str, Any]) -> Markup:
    o = table["observability"]
    rows = [[k.upper(), f"{o[k]:.4g}", INDICES[k]] for k in INDICES]
    return arm_report.table(rows, ["index", "value", "is largest for"], (1,))


def _table(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> Markup:
    """Numbers flush right, after a first column of words."""
    return arm_report.table(rows, head, range(1, len(head)))


def _in_words(title: str) -> str:
    """'link sag of joint 2'."""
    return title.replace("_", " ")


def _mm(metres: float | None) -> str:
    return "-" if metres is None else f"{1e3 * metres:.4g} mm"


def _with_std(value: float, std: float, unit: str) -> Markup:
    """A value, and two standard deviations where it has one."""
    if std <= 0:
        return Markup("{:.4f}{}").format(value, unit)
    return Markup("{}{unit} <small>± {}</small>").format(*value_and_two_std(value, std), unit=unit)
