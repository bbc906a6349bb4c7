"""The rig with its devices open: what a daemon keeps from one run to the next."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from arm_clearance import Chain
from arm_io import DeviceFault, InputError
from daq.rig.calibration import Calibration, calibration_of, counts_at
from daq.rig.channels import Columns, columns_of
from daq.rig.guard import Guard
from daq.rig.rig_file import Rig, check_channels, context_of, make_devices
from drivers import SystemClock
from drivers.protocols import Device, HostClock, Identity, QuadratureCounter


class Bench:
    """The devices of a rig, by name, in the order of the rig file; ``chain``: the arm's links, for a ``[space]``.

    identities   what each device says it is; there once opened
    columns      which channel is which column of the rows
    calibration  of these columns
    guard        the only way to outputs and arm
    clock        the host's time: the real one, or that of a simulation
    presets      device -> channel -> count to which it was last set
    """

    def __init__(self, rig: Rig, chain: Chain | None = None) -> None:
        if rig.trigger is None:
            raise InputError(rig.name, "trigger: is missing; this rig has no devices and is for imported data only")
        self.rig = rig
        self.trigger = rig.trigger
        self._context = context_of(rig)
        self.devices: dict[str, Device] = make_devices(rig, self._context, rig.name)
        check_channels(rig, self.devices, rig.name)
        self.columns: Columns = columns_of(rig, self.devices)
        self.calibration: Calibration = calibration_of(rig, self.columns)
        self.clock: HostClock = SystemClock()
        self.guard = Guard(rig, self.devices, self.clock, chain)
        self.identities: dict[str, Identity] = {}
        self.presets: dict[str, dict[int, int]] = {}

    def open(self) -> None:
        """Opens every device, brings the outputs to their safe state and configures the counters; all or none."""
        try:
            for name, device in self.devices.items():
                self.identities[name] = device.open()
                self.guard.opened.add(name)
            self.clock = self._context.clock
            self.guard.clock = self.clock
            self.guard.make_safe()
            for joint in self.rig.joint:
                if joint.encoder:
                    self._counter(joint.encoder.device).configure(joint.encoder.channel, joint.encoder.mode)
                    if isinstance(joint.encoder.preset, int):
                        self.preset(joint.encoder.device, joint.encoder.channel, joint.encoder.preset)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Outputs safe, every device closed; may be called at any time."""
        if self.guard.opened:
            self.guard.make_safe()
        self.guard.opened.clear()
        for device in self.devices.values():
            device.close()
        self.identities = {}

    def check(self) -> list[str]:
        """Problems that the devices themselves report, one sentence each."""
        return [f"{name}: {sentence}" for name, device in self.devices.items() for sentence in device.check()]

    def preset(self, device: str, channel: int, count: int) -> None:
        """Sets a counter's register to a count (its low bits, where the register is narrower)."""
        counter = self._counter(device)
        counter.preset(channel, count & ((1 << counter.width[channel]) - 1))
        self.presets.setdefault(device, {})[channel] = count

    def zero(self, position: NDArray[np.float64], *, only_start: bool = False) -> None:
        """Sets the counters so that the joints read ``position`` (J,) rad, where the arm must now stand still.

        only_start  only those joints whose encoder has preset = "start"; the others keep their count
        """
        counts = counts_at(self.calibration, np.asarray(position, float))
        for joint, count in zip(self.rig.joint, counts.tolist()):
            if joint.encoder and (joint.encoder.preset == "start" or not only_start):
                self.preset(joint.encoder.device, joint.encoder.channel, count)

    def _counter(self, name: str) -> QuadratureCounter:
        device = self.devices[name]
        if not isinstance(device, QuadratureCounter):
            raise DeviceFault(name, "is no counter")
        return device


@contextmanager
def open_bench(rig: Rig, chain: Chain | None = None) -> Iterator[Bench]:
    """The open bench of a rig; it is closed at the end of the block in any case."""
    bench = Bench(rig, chain)
    bench.open()
    try:
        yield bench
    finally:
        bench.close()
