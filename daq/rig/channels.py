"""Which column of ``Rows.counts``, ``Rows.volts`` and ``Rows.quality`` is which channel of which device."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from arm_io import InputError
from daq.rig.rig_file import Rig, context_of, make_devices
from drivers.protocols import AnalogInput, Device, Latched, Polled, PositionTracker, QuadratureCounter, Readings

Place = tuple[str, int]


@dataclass(frozen=True)
class Columns:
    """All channels of all devices that make rows, in the order of the rig file.

    Channels that no joint uses are included: raw values are recorded completely.

    counters  (C) device and channel of each column of ``counts``; ``widths`` (C) bits of their registers
    inputs    (A) device and channel of each column of ``volts``
    tracker   the device that gives ``points``, or None
    readings  device and name of each further column
    """

    counters: tuple[Place, ...]
    widths: tuple[int, ...]
    inputs: tuple[Place, ...]
    tracker: str | None
    readings: tuple[tuple[str, str], ...] = ()

    @property
    def quality(self) -> int:
        """Number of columns of ``quality``."""
        return len(self.counters) + len(self.inputs) + (self.tracker is not None)

    def names(self) -> tuple[list[str], list[str]]:
        """Names of the counter and of the input columns: ``device.channel``."""
        return [f"{d}.{c}" for d, c in self.counters], [f"{d}.{c}" for d, c in self.inputs]

    def as_table(self) -> dict[str, Any]:
        """The columns as plain data, for the head of a recording."""
        counters, inputs = self.names()
        table: dict[str, Any] = {"counters": counters, "inputs": inputs, "tracker": self.tracker}
        if self.readings:
            table["readings"] = {name: device for device, name in self.readings}
        return table


def columns_of(rig: Rig, devices: Mapping[str, Device]) -> Columns:
    """The columns that the rig's devices make. InputError where two devices give the same one."""
    acquiring = [d for d in devices.values() if isinstance(d, Latched | Polled)]
    counters = [d for d in acquiring if isinstance(d, QuadratureCounter)]
    inputs = [d for d in acquiring if isinstance(d, AnalogInput)]
    tracker = rig.tracker.device if rig.tracker else None
    if tracker is not None and not isinstance(devices[tracker], PositionTracker):
        tracker = None
    readings = [(d.name, name) for d in acquiring if isinstance(d, Readings) for name in d.readings]
    first: dict[str, str] = {}
    for device, name in readings:
        if first.setdefault(name, device) != device:
            raise InputError(rig.name, f"{first[name]} and {device} both give {name}; one of them must")
    return Columns(
        counters=tuple((d.name, c) for d in counters for c in range(len(d.width))),
        widths=tuple(width for d in counters for width in d.width),
        inputs=tuple((d.name, c) for d in inputs for c in range(len(d.range_volts))),
        tracker=tracker,
        readings=tuple(readings),
    )


def channel_names(rig: Rig) -> list[str]:
    """``device.channel`` of each column of ``Rows.quality``; the tracker's is its name. Touches no device.

    InputError where a driver is not installed.
    """
    columns = columns_of(rig, make_devices(rig, context_of(rig)))
    counters, inputs = columns.names()
    return counters + inputs + ([] if columns.tracker is None else [columns.tracker])
