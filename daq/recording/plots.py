"""Pictures of recordings.

Position, deviation from the demand, and current, joint by joint, several recordings on one another.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from arm_report.notebook import drawing
from daq.recording.head import RecordingHead

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from daq.recording.blocks import LongRecording
    from daq.recording.reader import Recording

POINTS = 4000
"""Of a drawn line; of longer ones each stretch is drawn by its lowest and highest value."""


def plot(
    recordings: Sequence[Recording | LongRecording], *, joints: Sequence[int] = (), names: Sequence[str] = ()
) -> Figure:
    """A figure with a row of plots per joint. All recordings start at t = 0; the demand is the first one's.

    joints  numbered from 1; default: all;  names  for the legend; default: file names
    """
    shown = list(joints) or list(range(1, max(recording.joints for recording in recordings) + 1))
    names = list(names) or [recording.path.name for recording in recordings]
    demanded = any("qref" in recording.layout.signals for recording in recordings)
    figure = drawing(10 + 6 * demanded, 1.2 + 2.2 * len(shown))
    axes = figure.subplots(len(shown), 2 + demanded, sharex=True, squeeze=False)
    lines = [_lines(recording, shown) for recording in recordings]
    for row, joint in zip(axes, shown):
        _draw_joint(row, joint, recordings, lines, names)
    for axis in axes[-1]:
        axis.set_xlabel("t [s]")
    handles, labels = axes[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), frameon=False)
    return figure


Line = tuple[NDArray[np.float64], NDArray[np.float64]]
"""t (m,) s, and values (m,)."""


def _draw_joint(
    row: Sequence[Axes],
    joint: int,
    recordings: Sequence[RecordingHead],
    lines: Sequence[dict[tuple[str, int], Line]],
    names: Sequence[str],
) -> None:
    """Position, current, and, with a third plot, deviation from the demand."""
    first = next(recording for recording in recordings if joint <= recording.joints)
    demand = next((drawn["qref", joint] for drawn in lines if ("qref", joint) in drawn), None)
    if demand is not None:
        row[0].plot(*demand, color="0.7", linewidth=3, label="demand")
    for number, (drawn, name) in enumerate(zip(lines, names)):
        style: dict[str, Any] = {"color": f"C{number}", "label": name}
        for axis, signal, width in zip(row, ("q", "i", "deviation"), (1.0, 0.8, 0.8)):
            if (signal, joint) in drawn:
                axis.plot(*drawn[signal, joint], linewidth=width, **style)
    unit, current = first.position_unit(joint), first.current_unit(joint)
    row[0].set_ylabel(f"{first.layout.joints[joint - 1]}\nposition [{unit}]")
    labels = {"A": "current [A]", "N m": "torque [N m]", "N": "force [N]"}
    row[1].set_ylabel(labels.get(current, "current [drive's unit]"))
    if len(row) > 2:
        row[2].set_ylabel(f"position - demand [{unit}]")
    for axis in row:
        axis.grid(alpha=0.3)


def _lines(recording: Recording | LongRecording, joints: Sequence[int]) -> dict[tuple[str, int], Line]:
    """(signal, joint) -> what is drawn of it: at most ``POINTS`` points that look like all."""
    here = [joint for joint in joints if joint <= recording.joints]
    keys = [(signal, joint) for signal in ("q", "i") for joint in here]
    demanded = [joint for joint in here if joint in recording.layout.signals.get("qref", ())]
    keys += [(signal, joint) for signal in ("qref", "deviation") for joint in demanded]
    envelope = Envelope(len(recording))
    for block in recording.blocks():
        columns = [_values(block, signal)[:, joint - 1] for signal, joint in keys]
        envelope.add(block.t, np.column_stack(columns) if columns else np.empty((len(block), 0)))
    return dict(zip(keys, envelope.lines()))


def _values(block: Recording, signal: str) -> NDArray[np.float64]:
    if signal == "deviation":
        assert block.qref is not None
        return block.q - block.qref
    values: NDArray[np.float64] = getattr(block, signal)
    return values


class Envelope:
    """Lines over time as they look on paper: of each stretch of rows the lowest and the highest value, where they are.

    rows  how many will come; of few, all are kept
    """

    def __init__(self, rows: int) -> None:
        self._stretch = max(1, -(-2 * rows // POINTS))
        self._whole = self._stretch <= 2
        self._t: list[NDArray[np.float64]] = []
        self._values: list[NDArray[np.float64]] = []
        self._waiting: Line | None = None

    def add(self, t: NDArray[np.float64], values: NDArray[np.float64]) -> None:
        """The rows that follow: t (n,) s, values (n, k) of k lines."""
        if self._waiting is not None:
            t, values = np.concatenate([self._waiting[0], t]), np.concatenate([self._waiting[1], values])
        whole = 0 if self._whole else len(t) // self._stretch * self._stretch
        if whole:
            self._reduce(t[:whole], values[:whole])
        if self._whole:
            self._t.append(np.repeat(t[:, None], values.shape[1], axis=1))
            self._values.append(values)
        else:
            self._waiting = t[whole:].copy(), values[whole:].copy()

    def lines(self) -> list[Line]:
        """One for each column of the values."""
        if self._waiting is not None:
            t, values = self._waiting
            self._t.append(np.repeat(t[:, None], values.shape[1], axis=1))
            self._values.append(values)
        return list(zip(np.concatenate(self._t).T, np.concatenate(self._values).T))

    def _reduce(self, t: NDArray[np.float64], values: NDArray[np.float64]) -> None:
        stretches = values.reshape(-1, self._stretch, values.shape[1])
        low, high = (np.where(np.isnan(stretches), fill, stretches) for fill in (np.inf, -np.inf))
        start = np.arange(0, len(t), self._stretch)[:, None]
        picked = np.sort(np.stack([start + low.argmin(axis=1), start + high.argmax(axis=1)], axis=1), axis=1)
        picked = picked.reshape(-1, values.shape[1])
        self._t.append(t[picked])
        self._values.append(np.take_along_axis(values, picked, axis=0))
