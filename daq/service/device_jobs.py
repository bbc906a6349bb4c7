"""What a service does with its devices; every function here may take long, and runs on the thread that owns them."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Container
from concurrent.futures import Future
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from arm_clearance import Chain
from arm_io import DeviceFault, InputError
from daq.rig.bench import Bench
from daq.rig.rig_file import Rig
from daq.service.commands.arguments import ArmArguments
from daq.service.publisher import Publisher
from daq.service.run import Run, request_of
from daq.service.transfer.folder import RecordingsFolder, check_name
from drivers.protocols import Device

Table = dict[str, Any]
CLAIM_SECONDS = 2.0
"""How long a client's liveliness token may take to arrive after its command."""


@dataclass(frozen=True)
class Armed:
    """A run that waits for its start.

    client   name of the liveliness token of its owner; None: no owner
    asked    monotonic time of the command, s; ``until``: when it expires, ``expires`` s after it was ready
    """

    run: Run
    client: str | None
    asked: float
    until: float
    expires: float

    def lapsed(self, clients: Container[str]) -> str | None:
        """Why an armed run must not wait any longer, or None; clients: names of the liveliness tokens present."""
        now = time.monotonic()
        if now >= self.until:
            return f"not started within {self.expires:g} s"
        if self.client and now > self.asked + CLAIM_SECONDS and self.client not in clients:
            return "the client that armed it is gone"
        return None


class DeviceJobs:
    """The jobs of the thread that talks to the devices of an open rig."""

    def __init__(self, rig: Rig, rig_text: str, chain: Chain | None = None) -> None:
        self.bench = Bench(rig, chain)
        self._rig_text = rig_text

    def known_identities(self) -> Table:
        """What every device said it is when it was opened; from any thread."""
        return {"devices": {name: asdict(identity) for name, identity in list(self.bench.identities.items())}}

    def identities(self) -> Table:
        """The same, after opening the devices where that is needed."""
        self._open()
        return self.known_identities()

    def check(self) -> Table:
        """Of each device its identity, null where it does not answer, and what is wrong with it.

        Where the rig cannot be opened as a whole, each device is opened alone, so that a missing one hides no other.
        """
        with contextlib.suppress(DeviceFault):
            self._open()
        opened = bool(self.bench.identities)
        return {"devices": {name: self._examined(device, opened) for name, device in self.bench.devices.items()}}

    def _examined(self, device: Device, opened: bool) -> Table:
        found: Table = {"identity": None, "problems": []}
        try:
            found["identity"] = asdict(self.bench.identities[device.name] if opened else device.open())
            found["problems"] += device.check()
        except DeviceFault as fault:
            found |= {"identity": None, "problems": [fault.what]}
        finally:
            if not opened:
                device.close()
        return found

    def zero(self, position: list[float]) -> Table:
        """Sets the counters so that the joints, which stand, read ``position`` (J,) rad (m)."""
        self._open()
        self.bench.zero(np.array(position))
        return {"position": position}

    def arm(
        self, wanted: ArmArguments, folder: RecordingsFolder | None, publisher: Publisher | None, asked: float
    ) -> Armed:
        """Gets everything ready for an experiment and begins the file; after an error there is neither."""
        request = request_of(wanted.experiment, wanted.experiment_file, place_of(wanted.out, folder))
        self._open()
        run = Run(self.bench, self._rig_text, request, publisher)
        run.arm()
        return Armed(run, wanted.client, asked, time.monotonic() + wanted.expires, wanted.expires)

    def run(self, run: Run, started: Future[None]) -> None:
        """Starts an armed run, says so, and takes its rows until it has ended. After a fault the devices are closed."""
        try:
            run.start()
        except Exception as error:
            self.bench.close()
            started.set_exception(error)
            return
        started.set_result(None)
        try:
            run.take()
        finally:
            if run.result is None or run.result["ending"]["fault"]:
                self.bench.close()

    def _open(self) -> None:
        """The devices, opened anew after a fault. DeviceFault: one of them is still not there."""
        if not self.bench.identities:
            self.bench.open()


def place_of(out: str, folder: RecordingsFolder | None) -> Path:
    """Where a recording goes; InputError: no file, or a relative path. Who is beyond loopback may name no folders."""
    if folder is not None:
        return folder.place(out)
    path = Path(out)
    if not path.is_absolute():
        raise InputError("daemon", f"out: {out} is relative; the daemon needs the whole path")
    if not path.name:
        raise InputError("daemon", f"out: {out} names no file")
    for part in path.parts[1:]:
        check_name(part)
    return path
