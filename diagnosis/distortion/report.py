"""distortion.json and distortion.html: a time-varying parameter, over time and against other variables."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from arm_io.types import Array
from arm_io.whole_folder import whole_folder
from arm_report import Chart, Level, Panel, Report, Series, write_report
from arm_report.palette import AFTER, BEFORE, PALE_AFTER
from diagnosis.distortion.distortion import Distortion, sentence

SCHEMA = "armscope.distortion/1"
UNITS = {"position": "rad", "speed": "rad/s", "load torque": "N m", "time": "s", "temperature": "degC", "direction": ""}


def write_distortion(out: FilePath, result: Distortion, pictures: Collection[str] = ()) -> dict[str, Any]:
    """Writes DIR/distortion.html, its charts as ``pictures`` and DIR/distortion.json; returns what the latter holds."""
    with whole_folder(out, "distortion") as there:
        return write_report(there, ("distortion.html", "distortion.json"), _page(result), table_of(result), pictures)


def table_of(result: Distortion) -> dict[str, Any]:
    """The content of distortion.json; values at instants without information are interpolated by the smoother."""
    value, std = result.constant
    return {
        "schema": SCHEMA,
        "parameter": result.parameter,
        "unit": result.unit,
        "model": result.model,
        "varies": result.varies,
        "constant": {"value": value, "std": std},
        "walk_per_sqrt_s": result.strength,
        "verdict": sentence(result),
        "explained_by": [
            {"against": one.against, "share": round(one.share, 4), "chance": round(one.chance, 4), "p": round(one.p, 4)}
            for one in result.shares
        ],
        "recordings": [
            {
                "recording": path.name,
                "t": np.round(path.t, 4).tolist(),
                "value": path.value.tolist(),
                "std": path.std.tolist(),
                "seen": path.seen.tolist(),
                **{
                    name.replace(" ", "_"): np.round(values, 5).tolist()
                    for name, values in path.against.items()
                    if name != "time"
                },
            }
            for path in result.paths
        ],
    }


def over_time(result: Distortion) -> Chart:
    """The parameter along every recording, with two standard deviations, and the model's value."""
    panels = []
    for path in result.paths:
        finite = np.isfinite(path.std)
        line = Series(
            x=path.t[finite],
            y=path.value[finite],
            two_std=2 * path.std[finite],
            colour=AFTER,
            label=f"{result.parameter} ± 2 std",
            width=1.3,
        )
        panels.append(
            Panel(
                series=(line,),
                levels=(Level(value=result.model, colour=BEFORE, dashed=True, label="model"),),
                title=path.name,
                x="time, s",
                y=_labelled(result),
                y_range=_span(result),
            )
        )
    return Chart(name="over_time", title=f"{result.parameter} over time", panels=tuple(panels), height=2.0)


def against(result: Distortion) -> Chart:
    """The parameter against every variable that it may depend on, with means in bins."""
    names = [name for name in result.paths[0].against if all(name in path.against for path in result.paths)]
    explained = {one.against: one for one in result.shares}
    panels = []
    for name in names:
        x = np.concatenate([path.against[name][path.seen] for path in result.paths])
        value = np.concatenate([path.value[path.seen] for path in result.paths])
        std = np.concatenate([path.std[path.seen] for path in result.paths])
        shown = x + (0.15 * np.random.default_rng(0).uniform(-1, 1, len(x)) if name == "direction" else 0.0)
        middle, mean, band = _means(x, value, std)
        unit = f", {result.drive.unit(UNITS[name])}" if UNITS[name] else ""
        share = explained.get(name)
        panels.append(
            Panel(
                series=(
                    Series(x=shown, y=value, kind="dots", colour=PALE_AFTER),
                    Series(x=middle, y=mean, two_std=band, kind="both", colour=AFTER, label="mean ± 2 std", width=1.2),
                ),
                levels=(Level(value=result.model, colour=BEFORE, dashed=True, label="model"),),
                title="" if share is None else f"explains {share.share:.0%} (p = {share.p:.2g})",
                x=f"{name}{unit}",
                y=_labelled(result),
                y_range=_span(result),
            )
        )
    title = f"{result.parameter} against position, direction, speed, load torque and time"
    return Chart(name="against", title=title, panels=tuple(panels), columns=3)


def _labelled(result: Distortion) -> str:
    return f"{result.parameter}, {result.unit}" if result.unit else result.parameter


def _span(result: Distortion) -> tuple[float, float]:
    """Range of the value axis: the values with two std where there is information, and the model's value."""
    value = np.concatenate([path.value[path.seen] for path in result.paths])
    std = np.concatenate([path.std[path.seen] for path in result.paths])
    low, high = np.quantile(value - 2 * std, 0.02), np.quantile(value + 2 * std, 0.98)
    low, high = min(float(low), result.model), max(float(high), result.model)
    # a variation below one per cent is drawn as a level line
    room = max(0.15 * (high - low), 0.02 * abs(result.model), 1e-12)
    return low - room, high + room


def _means(x: Array, value: Array, std: Array) -> tuple[Array, Array, Array]:
    """(bins,) each: middle of every bin of x (k,), mean of the values (k,) in it, and two std."""
    different = np.unique(x)
    edges = different if len(different) <= 3 else np.unique(np.quantile(x, np.linspace(0, 1, 13)))[:-1]
    bins = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 1)
    places = [np.flatnonzero(bins == k) for k in np.unique(bins)]
    middle = np.array([x[k].mean() for k in places])
    mean = np.array([np.average(value[k], weights=std[k] ** -2) for k in places])
    two_std = np.array([2 * std[k].mean() for k in places])
    return middle, mean, two_std


def _page(result: Distortion) -> Report:
    rows = [(one.against, f"{one.share:.0%}", f"{one.chance:.0%}", f"{one.p:.2g}") for one in result.shares]
    return Report(
        title=f"{result.parameter}, time-varying",
        template="diagnosis.distortion/distortion.html",
        content={
            "says": sentence(result),
            "over_time": over_time(result),
            "against": against(result),
            "shares": rows,
        },
    )
