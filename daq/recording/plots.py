"""Pictures of recordings: position, deviation from the demand, and current, joint by joint, several recordings on one another."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from daq.recording.reader import Recording
from daq.recording.summary import current_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

POINTS = 4000
"""Of a drawn line; of longer ones each stretch is drawn by its lowest and highest value."""


def plot(recordings: Sequence[Recording], *, joints: Sequence[int] = (), names: Sequence[str] = ()) -> Figure:
    """A figure with a row of plots a joint. All recordings start at t = 0; the demand is the first one's.

    joints  numbered from 1; default: all;  names  for the legend; default: file names
    """
    from matplotlib.figure import Figure

    shown = list(joints) or list(range(1, max(recording.joints for recording in recordings) + 1))
    names = list(names) or [recording.path.name for recording in recordings]
    demanded = any(recording.qref is not None for recording in recordings)
    figure = Figure(figsize=(10 + 6 * demanded, 1.2 + 2.2 * len(shown)), layout="constrained")
    axes = figure.subplots(len(shown), 2 + demanded, sharex=True, squeeze=False)
    for row, joint in zip(axes, shown):
        _draw_joint(row, joint, recordings, names)
    for axis in axes[-1]:
        axis.set_xlabel("t [s]")
    handles, labels = axes[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), frameon=False)
    return figure


def _draw_joint(row: Sequence[Axes], joint: int, recordings: Sequence[Recording], names: Sequence[str]) -> None:
    """Position, current, and, with a third plot, deviation from the demand."""
    first = next(recording for recording in recordings if joint <= recording.joints)
    for recording in recordings:
        if joint in recording.layout.signals.get("qref", ()) and recording.qref is not None:
            _line(row[0], recording.t, recording.qref[:, joint - 1], color="0.7", linewidth=3, label="demand")
            break
    for number, (recording, name) in enumerate(zip(recordings, names)):
        if joint > recording.joints:
            continue
        style = {"color": f"C{number}", "label": name}
        _line(row[0], recording.t, recording.q[:, joint - 1], linewidth=1, **style)
        _line(row[1], recording.t, recording.i[:, joint - 1], linewidth=0.8, **style)
        if recording.qref is not None:
            _line(row[2], recording.t, (recording.q - recording.qref)[:, joint - 1], linewidth=0.8, **style)
    unit, current = _unit(first, joint), current_unit(first)
    row[0].set_ylabel(f"{first.layout.joints[joint - 1]}\nposition [{unit}]")
    row[1].set_ylabel("current [A]" if current == "A" else "current [drive's unit]")
    if len(row) > 2:
        row[2].set_ylabel(f"position - demand [{unit}]")
    for axis in row:
        axis.grid(alpha=0.3)


def _unit(recording: Recording, joint: int) -> str:
    tables = recording.rig.get("joint", [])
    return "m" if joint <= len(tables) and tables[joint - 1].get("type") == "prismatic" else "rad"


def _line(axis: Axes, t: NDArray[np.float64], values: NDArray[np.float64], **style: object) -> None:
    axis.plot(*_thinned(t, values), **style)  # type: ignore[arg-type]


def _thinned(t: NDArray[np.float64], values: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """At most ``POINTS`` points that look like all: of each stretch its lowest and highest, where they are."""
    stretch = -(-2 * len(t) // POINTS)
    if stretch <= 2:
        return t, values
    whole = len(t) // stretch * stretch
    blocks = values[:whole].reshape(-1, stretch)
    start = np.arange(0, whole, stretch)
    low, high = (np.where(np.isnan(blocks), fill, blocks) for fill in (np.inf, -np.inf))
    picked = np.sort(np.column_stack([start + low.argmin(axis=1), start + high.argmax(axis=1)]), axis=1).ravel()
    picked = np.append(picked, np.arange(whole, len(t)))
    return t[picked], values[picked]
