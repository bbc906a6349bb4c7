"""The columns that a recording is exported with, whatever the format (docs/recordings.md)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from arm_io.types import Array
from daq.recording.head import RecordingHead

if TYPE_CHECKING:
    from daq.recording.reader import Recording


def columns_of(block: Recording) -> dict[str, Array]:
    """Column of the table -> (n,)."""
    columns: dict[str, Array] = {"t": block.t if block.time is None else block.time}
    for signal, having in block.layout.signals.items():
        values = getattr(block, signal)
        columns |= {f"{signal}{joint}": values[:, joint - 1] for joint in having}
    if block.xyz is not None:
        columns |= dict(zip("xyz", block.xyz.T))
    return columns | block.extra


def units_of(recording: RecordingHead) -> dict[str, str]:
    """Column -> its unit; a table's further columns have none."""
    units = {"t": "s", **dict.fromkeys("xyz", "m")}
    for signal, having in recording.layout.signals.items():
        for joint in having:
            current = recording.current_unit(joint)
            named = {"i": "drive unit" if current == "drive" else current, "v": "V", "temp": "degC"}
            units[f"{signal}{joint}"] = named.get(signal) or recording.position_unit(joint)
    return units
