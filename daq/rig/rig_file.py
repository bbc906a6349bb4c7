"""The rig file (``config/*.toml``): what is wired to what, and what the arm may be asked to do.

Channels are numbered from 0, as on the cards; joints from 1, in the order of their tables. SI units and radians.

Signs. Outside a driver a positive current drives its joint in the positive direction, so that joint torque =
torque_constant x |gear| x current. The motor's own sense may be the other way round (a negative ``gear``: the motor
turns backwards when the joint goes forward); counts and volts are of the motor, and calibration folds the gear's sign
into both. ``sign`` = -1 is for a swapped pair of wires and nothing else.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Field, PrivateAttr, model_validator

from arm_clearance import Space
from arm_io import InputError, check_table, counted, read_toml
from arm_io.table import Seconds, Table
from daq.rig.endpoints import PageTable, ZenohTable
from daq.rig.rig_tables import (
    COUNTS_PER_LINE,
    START,
    DeviceTable,
    JointTable,
    Limits,
    Output,
    RecordingTable,
    TrackerTable,
    Trigger,
)
from drivers import RigContext, check_config, make_device
from drivers.protocols import AnalogInput, AnalogOutput, CounterMode, Device, DigitalOutput, QuadratureCounter

LONGEST_RIG_NAME = 100
"""Characters: the name of the rig's lock file and its Zenoh keys follow from it."""


class Rig(Table):
    """A rig file, checked. ``joint`` alone is a rig for imported data."""

    name: Annotated[str, Field(min_length=1, max_length=LONGEST_RIG_NAME)]
    description: str = ""
    model: str | None = None  # the arm's model, relative to this file
    trigger: Trigger | None = None
    device: list[DeviceTable] = Field(default=[])
    joint: list[JointTable] = Field(min_length=1, max_length=64)
    tracker: TrackerTable | None = None
    limits: Limits = Limits()
    space: Space | None = None  # obstacles around the arm; None: collisions are not checked
    outputs: dict[str, Output] = Field(default={})
    watchdog: Seconds = 0.5  # s without a sign of life after which the guard brings all outputs to their safe state
    block_seconds: Annotated[float, Field(gt=0, le=1)] = 0.01  # how often the devices are read
    zenoh: ZenohTable = ZenohTable()
    page: PageTable = PageTable()
    recording: RecordingTable = RecordingTable()
    simulation: dict[str, Any] = Field(default={})  # for the simulated drivers, as they define it
    _folder: Path = PrivateAttr(default=Path("."))

    @property
    def joints(self) -> int:
        """Number of joints."""
        return len(self.joint)

    @property
    def model_path(self) -> Path | None:
        """The model file, or None."""
        return None if self.model is None else self._folder / self.model

    def resolve(self, path: str) -> Path:
        """A path written in the rig file, seen from the working directory."""
        return self._folder / path

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        names = [device.name for device in self.device]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"device name {name!r} is used twice")
        if self.device and self.trigger is None:
            raise ValueError("trigger: is missing; a rig with devices needs [trigger] with source, device and rate")
        if self.space is not None and self.model is None:
            raise ValueError("space: needs 'model', the arm whose links keep clear of it")
        for place, device in _device_uses(self):
            if device not in names:
                known = ", ".join(names) or "none"
                raise ValueError(f"{place}: no device {device!r}; devices of this rig: {known}")
        _check_double_use(self)
        start = self.outputs.get(START)
        if start is not None and start.channel is not None and (start.limits or (0.0, 0.0))[1] <= 0:
            raise ValueError("outputs.start: an analogue start signal needs 'limits' [0, V], V its level during a run")
        for entry in ("position", "speed", "acceleration", "current"):
            values = getattr(self.limits, entry)
            if values is not None and len(values) != len(self.joint):
                raise ValueError(f"limits.{entry}: has {len(values)} entries for {counted(len(self.joint), 'joint')}")
        return self


def _device_uses(rig: Rig) -> list[tuple[str, str]]:
    """Every place of a rig file that names a device, and the name."""
    uses = [] if rig.trigger is None else [("trigger.device", rig.trigger.device)]
    for number, joint in enumerate(rig.joint, 1):
        if joint.encoder:
            uses.append((f"joint[{number}].encoder.device", joint.encoder.device))
        if joint.current:
            uses.append((f"joint[{number}].current.device", joint.current.device))
    if rig.tracker and rig.tracker.device is not None:
        uses.append(("tracker.device", rig.tracker.device))
    return uses + [(f"outputs.{name}.device", output.device) for name, output in rig.outputs.items()]


def _check_double_use(rig: Rig) -> None:
    """ValueError for two joints on one channel: a typing error that would look like a coupling of the arm."""
    for kind in ("encoder", "current"):
        taken: dict[tuple[str, int], int] = {}
        for number, joint in enumerate(rig.joint, 1):
            if (wiring := getattr(joint, kind)) is None:
                continue
            first = taken.setdefault((wiring.device, wiring.channel), number)
            if first != number:
                raise ValueError(
                    f"joint[{number}].{kind}: channel {wiring.channel} of {wiring.device} is already joint {first}'s"
                )


def read_rig(path: str | Path, *, drivers: bool = True) -> Rig:
    """Reads and checks a rig file; InputError names the file, the entry, and what would be right.

    drivers  False leaves out what needs the drivers (each device's own options, ranges of channels): enough for
             ``import``, and for a rig whose drivers are not installed here.
    """
    rig = check_table(path, read_toml(path), Rig)
    rig._folder = Path(path).resolve().parent
    if rig.model_path is not None and not os.path.isfile(rig.model_path):  # False too for a name that no file can have
        raise InputError(path, f"model: no file {rig.model_path}")
    if drivers:
        for number, device in enumerate(rig.device, 1):
            check_config(device.driver, device.options, f"{path}: device[{number}] ({device.name})")
        check_channels(rig, make_devices(rig, context_of(rig), path), path)
    return rig


def context_of(rig: Rig) -> RigContext:
    """The context that all drivers of the rig share."""
    return RigContext(
        simulation=dict(rig.simulation),
        model=rig.model_path,
        folder=rig._folder,
        gears=tuple(joint.gear for joint in rig.joint),
        counts=tuple(_x4_counts(joint) for joint in rig.joint),
    )


def _x4_counts(joint: JointTable) -> float | None:
    """Counts per rad (m) of the joint if its counter counted all four edges of a line."""
    if joint.encoder is None or joint.scale is None:
        return None
    return joint.scale * COUNTS_PER_LINE[CounterMode.X4] / COUNTS_PER_LINE[joint.encoder.mode]


def make_devices(rig: Rig, context: RigContext, where: str | Path = "rig") -> dict[str, Device]:
    """The rig's devices by name, in the order of the file, closed; making one must not touch any hardware."""
    return {
        device.name: make_device(
            device.driver, device.name, device.options, context, f"{where}: device[{number}] ({device.name})"
        )
        for number, device in enumerate(rig.device, 1)
    }


def check_channels(rig: Rig, devices: dict[str, Device], where: str | Path = "rig") -> None:
    """Every channel and line that the rig names exists on its device; else InputError."""
    for number, joint in enumerate(rig.joint, 1):
        if joint.encoder:
            counter = devices[joint.encoder.device]
            place = f"joint[{number}].encoder"
            if not isinstance(counter, QuadratureCounter):
                raise InputError(where, f"{place}.device: {counter.name} is no counter")
            _check_channel(where, place, counter.name, joint.encoder.channel, len(counter.width))
        if joint.current:
            analog = devices[joint.current.device]
            place = f"joint[{number}].current"
            if not isinstance(analog, AnalogInput):
                raise InputError(where, f"{place}.device: {analog.name} is no analogue input")
            _check_channel(where, place, analog.name, joint.current.channel, len(analog.range_volts))
    for name, output in rig.outputs.items():
        device, place = devices[output.device], f"outputs.{name}"
        if output.line is not None:
            if not isinstance(device, DigitalOutput):
                raise InputError(where, f"{place}.device: {device.name} has no digital lines")
            if output.line not in device.lines:
                lines = ", ".join(device.lines)
                raise InputError(where, f"{place}.line: {device.name} has no line {output.line!r}; it has {lines}")
        if output.channel is not None:
            if not isinstance(device, AnalogOutput):
                raise InputError(where, f"{place}.device: {device.name} has no analogue outputs")
            _check_channel(where, place, device.name, output.channel, len(device.output_range))


def _check_channel(where: str | Path, place: str, device: str, channel: int, channels: int) -> None:
    if channel >= channels:
        wanted = f"0 to {channels - 1}" if channels else "none"
        raise InputError(where, f"{place}.channel: {device} has no channel {channel}; it has {wanted}")
