"""distortion.json and distortion.html: a time-varying parameter, over time and against other variables."""

from __future__ import annotations

import json
from html import escape
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import numpy as np

from arm_io import make_folder, write_text
from arm_io.types import Array
from arm_report import image, note, page, table, verdict
from arm_report.palette import AFTER, BEFORE, GRID, PALE_AFTER
from diagnosis.distortion.distortion import Distortion, sentence
from diagnosis.units import unit_at

if TYPE_CHECKING:
    from matplotlib.figure import Figure


SCHEMA = "armscope.distortion/1"
UNITS = {"position": "rad", "speed": "rad/s", "load torque": "N m", "time": "s", "temperature": "degC", "direction": ""}


def write_distortion(out: FilePath, result: Distortion) -> dict[str, Any]:
    """Writes DIR/distortion.html and DIR/distortion.json; returns what the latter holds."""
    make_folder(out)
    content = table_of(result)
    write_text(out / "distortion.html", _page(result))
    write_text(out / "distortion.json", json.dumps(content, indent=2) + "\n")
    return content


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


def over_time(result: Distortion) -> tuple[Figure, str]:
    """The parameter along every recording, with two standard deviations; the model's value dashed."""
    from matplotlib.figure import Figure

    count = len(result.paths)
    figure = Figure(figsize=(10.5, 0.8 + 2.0 * count), layout="constrained")
    axes = figure.subplots(count, 1, squeeze=False, sharey=True)[:, 0]
    for axis, path in zip(axes, result.paths):
        finite = np.isfinite(path.std)
        low, high = path.value - 2 * path.std, path.value + 2 * path.std
        axis.fill_between(path.t[finite], low[finite], high[finite], color=PALE_AFTER, label="± 2 std")
        axis.plot(path.t[finite], path.value[finite], color=AFTER, lw=1.3, label=result.parameter)
        axis.axhline(result.model, color=BEFORE, ls="--", lw=1.0, label="model")
        axis.set_title(path.name, loc="left", fontsize="medium")
        axis.set_ylabel(result.unit)
        axis.grid(color=GRID)
    axes[0].set_ylim(*_span(result))
    axes[0].legend(loc="upper right", ncols=3, fontsize="small")
    axes[-1].set_xlabel("time, s")
    return figure, f"{result.parameter} over time"


def against(result: Distortion) -> tuple[Figure, str]:
    """The parameter against every variable that it may depend on, with means in bins."""
    from matplotlib.figure import Figure

    names = [name for name in result.paths[0].against if all(name in path.against for path in result.paths)]
    rows = -(-len(names) // 3)
    figure = Figure(figsize=(10.5, 2.9 * rows), layout="constrained")
    axes = figure.subplots(rows, 3, squeeze=False, sharey=True).ravel()
    explained = {one.against: one for one in result.shares}
    for axis, name in zip(axes, names):
        x = np.concatenate([path.against[name][path.seen] for path in result.paths])
        value = np.concatenate([path.value[path.seen] for path in result.paths])
        std = np.concatenate([path.std[path.seen] for path in result.paths])
        shown = x + (0.15 * np.random.default_rng(0).uniform(-1, 1, len(x)) if name == "direction" else 0.0)
        axis.plot(shown, value, ".", ms=2.5, color=PALE_AFTER)
        axis.errorbar(*_means(x, value, std), fmt="o-", ms=4, lw=1.2, color=AFTER, capsize=2)
        axis.axhline(result.model, color=BEFORE, ls="--", lw=1.0)
        unit = f", {unit_at(result.drive, UNITS[name])}" if UNITS[name] else ""
        share = explained.get(name)
        axis.set_title(
            "" if share is None else f"explains {share.share:.0%} (p = {share.p:.2g})", loc="left", fontsize="medium"
        )
        axis.set_xlabel(f"{name}{unit}")
        axis.grid(color=GRID)
    for axis in axes[len(names) :]:
        axis.set_axis_off()
    axes[0].set_ylabel(f"{result.parameter}, {result.unit}" if result.unit else result.parameter)
    axes[0].set_ylim(*_span(result))
    return figure, f"{result.parameter} against position, direction, speed, load torque and time"


def _span(result: Distortion) -> tuple[float, float]:
    """Range of the axes: the values with two std where there is information, and the value of the model."""
    value = np.concatenate([path.value[path.seen] for path in result.paths])
    std = np.concatenate([path.std[path.seen] for path in result.paths])
    low, high = np.quantile(value - 2 * std, 0.02), np.quantile(value + 2 * std, 0.98)
    low, high = min(float(low), result.model), max(float(high), result.model)
    # a variation below a hundredth is drawn as a level line
    room = max(0.15 * (high - low), 0.02 * abs(result.model), 1e-12)
    return low - room, high + room


def _means(x: Array, value: Array, std: Array) -> tuple[Array, Array, Array]:
    """Middle of every bin, mean of the values in it, and two std."""
    different = np.unique(x)
    edges = different if len(different) <= 3 else np.unique(np.quantile(x, np.linspace(0, 1, 13)))[:-1]
    bins = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 1)
    places = [np.flatnonzero(bins == k) for k in np.unique(bins)]
    middle = np.array([x[k].mean() for k in places])
    mean = np.array([np.average(value[k], weights=std[k] ** -2) for k in places])
    spread = np.array([2 * std[k].mean() for k in places])
    return middle, mean, spread


def _page(result: Distortion) -> str:
    rows = [(escape(one.against), f"{one.share:.0%}", f"{one.chance:.0%}", f"{one.p:.2g}") for one in result.shares]
    head = ("variable", "share of variance explained", "by chance", "p")
    body = [
        verdict(sentence(result)),
        note(
            "The smallest variation of this one parameter that makes the model match the measured currents "
            "(Butterfield &amp;"
            " Thomas, 1986): a random walk, smoothed forwards and backwards. No cause is named; the variables it "
            "correlates with hint at one."
        ),
        image(*over_time(result)),
        "<h2>Correlation with other variables</h2>",
        image(*against(result)),
        table(rows, head, (1, 2, 3)) if rows else "",
    ]
    return page(f"{result.parameter}, time-varying", body)
