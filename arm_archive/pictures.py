"""The small picture of an entry: the motion of a recording, the errors of a result."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from arm_archive.entries import RECORDING
from arm_io import DeviceFault, InputError, read_text
from arm_io.types import Array
from arm_report.palette import AFTER, JOINTS
from daq.recording import open_long
from daq.recording.losses import unreported

WIDTH, HEIGHT = 80, 26
"""px, size of a picture."""
BINS = 40
"""Number of time intervals in which the motion of a recording is drawn."""
MOST_BYTES = 200_000_000
"""Maximum size of a recording that is read for its picture, which takes some seconds."""
MOST_BARS = 16
"""Bars of a picture at most."""
PALE = "#c3cbd4"


def picture_of(folder: Path, path: str, kind: str) -> str | None:
    """SVG picture of ``WIDTH`` x ``HEIGHT`` px; None: the file has nothing to draw, is too long, or cannot be read."""
    try:
        if kind == RECORDING:
            return _motion(folder / path)
        return _bars(*_OF_KIND[kind](json.loads(read_text(folder / path))))
    except (InputError, DeviceFault, OSError, ValueError, KeyError, TypeError, AttributeError, OverflowError):
        return None


def _motion(path: Path) -> str | None:
    """Positions of all joints over time on one scale: lowest and highest value of every interval."""
    if path.stat().st_size > MOST_BYTES:
        return None
    with unreported():
        recording = open_long(path, damaged=True)
    if not len(recording):
        return None
    low, high = np.full((BINS, recording.joints), np.inf), np.full((BINS, recording.joints), -np.inf)
    for block in recording.blocks():
        bins = np.minimum((block.t * (BINS / max(recording.duration, 1e-9))).astype(np.int64), BINS - 1)
        np.minimum.at(low, bins, np.where(np.isnan(block.q), np.inf, block.q))
        np.maximum.at(high, bins, np.where(np.isnan(block.q), -np.inf, block.q))
    there = np.isfinite(low)
    if not there.any():
        return None
    bottom, top = low[there].min(), high[there].max()
    room = max(top - bottom, 1e-6)
    lines = [
        _line((low[:, k] - bottom) / room, (high[:, k] - bottom) / room, JOINTS[k % len(JOINTS)])
        for k in range(recording.joints)
    ]
    return _svg("joint positions over time", "".join(lines))


def _line(low: Array, high: Array, colour: str) -> str:
    """Polyline through the lowest and highest value of every interval with values, as shares of the height, upwards."""
    points = []
    for k in np.flatnonzero(np.isfinite(low)).tolist():
        x = (k + 0.5) * WIDTH / BINS
        points += [f"{x:.0f},{1 + (HEIGHT - 2) * (1 - share):.1f}" for share in (low[k], high[k])]
    return f'<polyline points="{" ".join(points)}" fill="none" stroke="{colour}" stroke-width="1"/>'


def _bars(title: str, pairs: Sequence[tuple[float, float]], shown: Sequence[bool] | None = None) -> str | None:
    """A bar per pair: the second value in front of the first one, which is pale and wider; ``shown``: coloured bars."""
    pairs = pairs[:MOST_BARS]
    most = max((value for pair in pairs for value in pair), default=0.0)
    if not 0 < most < np.inf:
        return None
    step = min(WIDTH / len(pairs), 16.0)
    parts = []
    for k, (behind, value) in enumerate(pairs):
        colour = AFTER if shown is None or shown[k] else PALE
        for share, fill, inset in ((behind / most, PALE, 1.0), (value / most, colour, 0.3 * step)):
            height = max(share * (HEIGHT - 2), 0.8 if share > 0 else 0.0)
            place = f'x="{k * step + inset:.1f}" y="{HEIGHT - height:.1f}" width="{step - 2 * inset:.1f}"'
            parts.append(f'<rect {place} height="{height:.1f}" fill="{fill}"/>' if height else "")
    return _svg(title, "".join(parts))


def _svg(title: str, inside: str) -> str:
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}">'
        f"<title>{title}</title>{inside}</svg>"
    )


Bars = tuple[str, Sequence[tuple[float, float]], Sequence[bool] | None]
"""Title, pairs and ``shown`` of ``_bars``."""


def _identified(table: Mapping[str, Any]) -> Bars:
    errors = [one["relative_error"] for one in table["joints"]]
    return "relative error of each joint", [(0.0, _number(one.get("held_out", one["fit"]))) for one in errors], None


def _diagnosed(table: Mapping[str, Any]) -> Bars:
    pairs = [(_number(one["noise_ratio"]["before"]), _number(one["noise_ratio"]["after"])) for one in table["signals"]]
    return "error over noise of each joint without the causes (pale) and with them", pairs, None


def _calibrated(table: Mapping[str, Any]) -> Bars:
    parts = [one for part in ("fit", "held_out") if (one := table["position_rms"].get(part))]
    pairs = [(_number(one["before"]), _number(one["after"])) for one in parts]
    return "error of position before (pale) and after: fitted, held out", pairs, None


def _compared(table: Mapping[str, Any]) -> Bars:
    changes = sorted(table["changes"], key=lambda one: -abs(_number(one["z"])))
    shown = [bool(change["significant"]) for change in changes]
    return (
        "changes over their standard deviations; blue: significant",
        [(0.0, abs(_number(change["z"]))) for change in changes],
        shown,
    )


def _number(value: Any) -> float:
    return 0.0 if value is None else float(value)


_OF_KIND = {
    "identification": _identified,
    "diagnosis": _diagnosed,
    "kinematics": _calibrated,
    "comparison": _compared,
}
