"""The one way to everything that can move the arm: start line, analogue outputs, the arm's controller.

Every command passes the rig's limits, and everything comes to its safe state (lines low, outputs 0 V, the arm stopped)
when a run ends, when the arm leaves its limits, when a device is lost, and when the sampler has not been served for
``Rig.watchdog`` s. The watchdog counts the rig's clock, so that a simulation that runs on a time of its own is not
stopped by a debugger.

A driver that hangs in a command delays this by a quarter of ``Rig.watchdog`` at most: then the safe state is commanded
beside it, and the late command is undone and refused when the driver returns.

No program can act after SIGKILL or a power cut. The service manager's watchdog then starts
the daemon anew, and opening the rig begins with the safe state; what must be safe within milliseconds needs a watchdog
in hardware.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from arm_clearance import Chain
from arm_io import DeviceFault, InputError
from daq.rig.preflight import check_motion
from daq.rig.rig_file import Rig
from daq.rig.rig_tables import START, Output
from daq.rig.safe_state import bring_to_safe_state
from daq.rig.speed_check import SpeedCheck
from drivers.protocols import AnalogOutput, ArmController, Device, DigitalOutput, HostClock, OwnWatchdog
from experiment import Experiment

PATIENCE = 0.25
"""Share of the watchdog's time that the safe state waits for a command in progress."""


class Guard:
    """Outputs and arm of one rig. May be used from any thread.

    chain    the arm's links, for rigs with a ``[space]``
    tripped  why all is held safe, or None
    silent   the device that was waited for when the watchdog tripped; None if none was
    opened   the devices that are open: only they can be, and need to be, made safe
    """

    def __init__(self, rig: Rig, devices: Mapping[str, Device], clock: HostClock, chain: Chain | None = None) -> None:
        self.rig, self.clock, self.chain = rig, clock, chain
        self.tripped: str | None = None
        self.opened: set[str] = set()
        self._devices = devices
        self._arm, self.controller = _controller(devices)  # its name, "" for none, and the device
        _check_watchdogs(rig, devices)
        self._lock = threading.RLock()
        self._overtaken = 0  # number of times that the safe state was commanded while another command hung
        self._fed = 0
        self._awaited: str | None = None  # device that is being read
        self._slow: str | None = None  # device whose reading took long since the last sign of life
        self.silent: str | None = None
        self._speeds = _speed_check(rig)
        self._watching: threading.Thread | None = None
        self._end = threading.Event()

    # Commands

    def set_line(self, name: str, high: bool) -> None:
        """Drives a digital output of the rig file."""
        output = self._output(name)
        device = self._devices[output.device]
        if output.line is None or not isinstance(device, DigitalOutput):
            raise InputError(f"outputs.{name}", "is an analogue output; give it volts")
        with self._commanding(name):
            device.write_line(output.line, high)

    def set_volts(self, name: str, volts: float) -> None:
        """Drives an analogue output, within the rig's and the device's limits."""
        output = self._output(name)
        device = self._devices[output.device]
        if output.channel is None or not isinstance(device, AnalogOutput):
            raise InputError(f"outputs.{name}", "is a digital line; set it high or low")
        low, high = device.output_range[output.channel]
        if output.limits is not None:
            low, high = max(low, output.limits[0]), min(high, output.limits[1])
        if not low <= volts <= high:  # False for NaN too
            raise InputError(f"outputs.{name}", f"{volts:g} V is outside {low:g} to {high:g} V")
        with self._commanding(name):
            device.write_volts(output.channel, volts)

    def load(self, experiment: Experiment) -> None:
        """Gives the controller an experiment that keeps the rig's limits and its space; InputError otherwise."""
        problems = check_motion(self.rig, experiment, self.chain)
        if problems:
            more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
            raise InputError(f"experiment {experiment.name!r}", problems[0] + more)
        with self._commanding("the arm"):
            if self.controller is not None:
                self.controller.load(experiment)

    def start(self, *, motion: bool) -> tuple[int, int]:
        """Starts the arm, if it has a ``motion``, and raises the start output; the watchdog then expects ``feed``.

        Returns host ns before and after the call by which the start signal went out.
        """
        with self._commanding("the arm") as begun:
            self._fed = self._watched = self.clock.monotonic_ns()
            self._slow = None
            self._speeds = _speed_check(self.rig)
            self._watch()
            before = self.clock.monotonic_ns()
            if motion and self.controller is not None:
                with self.awaiting(self._arm):
                    self.controller.start()
            self._refuse_if_overtaken("the arm", begun)
            if START in self.rig.outputs:
                before = self.clock.monotonic_ns()
                with self.awaiting(self.rig.outputs[START].device):
                    self._raise_start()
            return before, self.clock.monotonic_ns()

    # Supervision

    def feed(self) -> None:
        """A sign of life.

        One that comes too late is none, though the watching thread may have been suspended as long.
        """
        now = self.clock.monotonic_ns()
        if now - self._fed > self.rig.watchdog * 1e9:
            self._starved()
        self._fed, self._slow = now, None

    @contextmanager
    def awaiting(self, device: str) -> Iterator[None]:
        """``device`` is read or commanded: if it takes too long, that is whom the watchdog names."""
        began = self.clock.monotonic_ns()
        self._awaited = device
        try:
            yield
        finally:
            self._awaited = None
            if self.clock.monotonic_ns() - began > self.rig.watchdog * 0.5e9:
                self._slow = device

    def breach(
        self,
        position: NDArray[np.float64],
        current: NDArray[np.float64],
        host_ns: NDArray[np.int64],
        unmeasured: NDArray[np.bool_] | None = None,
        untimed: NDArray[np.bool_] | None = None,
    ) -> str | None:
        """What limit the arm was seen to break in rows (n, J), as a sentence; None if it kept them all.

        unmeasured  (n, J) True where the joint has no encoder, or its device says itself that the value is missing;
                    None: nowhere. A position that is not finite elsewhere is a breach, with or without limits: the
                    position of the arm is unknown.
        untimed     (n, J) True where the value was not taken at the time of its row; None: nowhere

        A current that is NaN was not measured; an infinite one is a breach. Speed is that of ``daq.rig.speed_check``,
        over the blocks of one run, which must be given in their order.
        """
        if len(position) == 0:
            return None
        limits = self.rig.limits
        measured = np.ones(position.shape, bool) if unmeasured is None else ~unmeasured
        low, high = np.array(limits.position or [(-np.inf, np.inf)] * self.rig.joints).T
        within = (position >= low) & (position <= high) & np.isfinite(position)  # false for NaN
        if (out := measured & ~within).any():
            row, joint = np.argwhere(out)[0]
            at, unit = f"{position[row, joint]:.4g}", self.rig.joint[joint].unit
            return f"joint {joint + 1} at {at} {unit}, limits {low[joint]:g} to {high[joint]:g} {unit}"
        largest = np.array(limits.current or [np.finfo(float).max] * self.rig.joints)
        if (over := ~(np.abs(current) <= largest) & ~np.isnan(current)).any():
            row, joint = np.argwhere(over)[0]
            unit = self.rig.joint[joint].current_unit
            return f"current {current[row, joint]:.4g} {unit} in joint {joint + 1}, limit {largest[joint]:g} {unit}"
        if self._speeds is None:
            return None
        timed = np.ones(position.shape, bool) if untimed is None else ~untimed
        return self._speeds.too_fast(position, measured, timed, host_ns)

    def trip(self, why: str) -> None:
        """Safe state, held until ``reset``. Further commands are refused from here on, without waiting for one."""
        self.tripped = self.tripped or why
        self.make_safe()

    def hold(self, why: str) -> threading.Thread:
        """As ``trip``, without waiting; returns the thread that brings all outputs to their safe state."""
        self.tripped = self.tripped or why
        making_safe = threading.Thread(target=self.make_safe, name="hold", daemon=True)
        making_safe.start()
        return making_safe

    def reset(self) -> None:
        """A person has removed the cause: commands are accepted again."""
        self.tripped = self.silent = None

    def make_safe(self) -> None:
        """Stops the arm and brings every output to its safe state; never raises, tries every open device."""
        self._end.set()
        patience = PATIENCE * self.rig.watchdog
        alone = self._lock.acquire(timeout=patience)  # a hanging command may hold it
        if not alone:
            self._overtaken += 1
        try:
            there = {name: device for name, device in self._devices.items() if name in self.opened}
            stop = {name: device.stop for name, device in there.items() if isinstance(device, ArmController)}
            outputs = {n: d.safe for n, d in there.items() if isinstance(d, DigitalOutput | AnalogOutput)}
            if failed := bring_to_safe_state(stop, outputs, patience):
                did = "the command to stop" if failed[0] in stop else "the command to make its outputs safe"
                self.tripped = self.tripped or f"{failed[0]} did not take {did}"
        finally:
            if alone:
                self._lock.release()

    # Inside

    def _raise_start(self) -> None:
        """A line goes high, an analogue output to its upper limit."""
        output = self.rig.outputs[START]
        if output.limits is None:
            self.set_line(START, True)
        else:
            self.set_volts(START, output.limits[1])

    def _output(self, name: str) -> Output:
        if name not in self.rig.outputs:
            known = ", ".join(self.rig.outputs) or "none"
            raise InputError(f"outputs.{name}", f"no such output in the rig file; there are: {known}")
        return self.rig.outputs[name]

    @contextmanager
    def _commanding(self, what: str) -> Iterator[int]:
        """One command at a time; DeviceFault where all is held safe, or was made safe while the command hung.

        Such a command may have reached its device after the safe state: that is commanded once more. Gives what
        ``_refuse_if_overtaken`` compares.
        """
        with self._lock:
            self._refuse_if_tripped(what)
            begun = self._overtaken
            try:
                yield begun
            finally:
                if self._overtaken != begun:
                    self.make_safe()
            self._refuse_if_overtaken(what, begun)

    def _refuse_if_overtaken(self, what: str, begun: int) -> None:
        if self._overtaken != begun:
            self._refuse_if_tripped(what)
            raise DeviceFault("guard", f"{what} was made safe while a command to it was under way")

    def _refuse_if_tripped(self, what: str) -> None:
        if self.tripped is not None:
            advice = "remove the cause, then reset it: armscope reset RIG.toml"
            raise DeviceFault("guard", f"{what} is held safe: {self.tripped}; {advice}")

    def _watch(self) -> None:
        self._end = threading.Event()
        self._watching = threading.Thread(target=self._watchdog, args=(self._end,), name="watchdog", daemon=True)
        self._watching.start()

    def _watchdog(self, end: threading.Event) -> None:
        while not end.wait(self.rig.watchdog / 4):
            now = self.clock.monotonic_ns()
            if now - self._fed > self.rig.watchdog * 1e9:
                self._starved()
                return
            self._watched = now

    def _starved(self) -> None:
        """Trips the guard: by the device that was awaited, unless this whole program was suspended as well."""
        stood_still = self.clock.monotonic_ns() - self._watched > self.rig.watchdog * 0.75e9
        if self.tripped is None:
            self.silent = None if stood_still else self._awaited or self._slow
        who = "the sampler was not active" if self.silent is None else f"{self.silent} did not answer"
        self.trip(f"{who} for {self.rig.watchdog:g} s")


def _speed_check(rig: Rig) -> SpeedCheck | None:
    if rig.limits.speed is None:
        return None
    period = 0.0 if rig.trigger is None else 1e9 / rig.trigger.rate
    return SpeedCheck(np.array(rig.limits.speed), period, [joint.unit for joint in rig.joint])


def _check_watchdogs(rig: Rig, devices: Mapping[str, Device]) -> None:
    """A program must end its run before a device makes its own outputs safe."""
    for name, device in devices.items():
        if isinstance(device, OwnWatchdog) and 0 < device.watchdog <= rig.watchdog:
            raise InputError(
                rig.name,
                f"watchdog: {rig.watchdog:g} s must be shorter than {device.watchdog:g} s, after which {name} makes "
                "its own outputs safe",
            )


def _controller(devices: Mapping[str, Device]) -> tuple[str, ArmController | None]:
    """The rig's arm controller and its name: the device that has the shape of one."""
    found = [(name, device) for name, device in devices.items() if isinstance(device, ArmController)]
    if len(found) > 1:
        names = ", ".join(name for name, _ in found)
        raise InputError("rig", f"has more than one arm controller: {names}; a rig has one arm")
    return found[0] if found else ("", None)
