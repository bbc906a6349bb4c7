"""What an acquisition reads: a stream for every device that makes rows, and pollers for those that have to be asked."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TypeGuard, cast

from arm_io import DeviceFault, InputError
from daq.acquisition.device_stream import Stream
from daq.acquisition.polling import PolledDevice, Poller, sleep_until
from daq.rig.bench import Bench
from drivers import empty
from drivers.protocols import Block, Device, EdgeSource, Latched, Plan, Polled, PositionTracker, Readings, TriggerInput


class Intake:
    """The devices of an open bench, armed for one plan.

    clock     the stream whose rows say which triggers there were
    others    all further streams that are joined during the run
    recalled  the tracker whose points come from its memory after the run, or None
    """

    def __init__(self, bench: Bench, plan: Plan) -> None:
        self.bench, self.plan = bench, plan
        self.pollers: dict[str, Poller] = {}
        self.recalled: Stream | None = None
        streams: dict[str, Stream] = {}
        for name in bench.devices:
            stream = self._stream(name)
            if stream is not None:
                streams[name] = stream
        if bench.trigger.device not in streams:
            raise InputError(bench.rig.name, f"trigger.device: {bench.trigger.device} sees no edges and makes no rows")
        self.clock = streams.pop(bench.trigger.device)
        self.others = [stream for stream in streams.values() if stream is not self.recalled]
        self._readers = {stream.name: self._reader(stream.name) for stream in self.streams}

    @property
    def streams(self) -> list[Stream]:
        """All that are read during the run, the clock first."""
        return [self.clock, *self.others]

    def arm(self) -> None:
        """Arms every device, the clock last, so that no device misses its first edge."""
        for name in sorted(self.bench.devices, key=lambda name: name == self.clock.name):
            self.bench.devices[name].arm(self._plan_of(name))

    def _plan_of(self, name: str) -> Plan:
        """The plan for one device: devices on their own time are read at their own rate."""
        device, rate = self.bench.devices[name], self.plan.rate
        if name in self.pollers:
            rate = min(rate, 1e9 / self.pollers[name].period_ns)
        elif self._own_time(device):
            rate = device.rate
        else:
            return self.plan
        rows = None if self.plan.rows is None else math.ceil(self.plan.rows * rate / self.plan.rate)
        source = EdgeSource.POLL if name in self.pollers else self.plan.source
        return replace(self.plan, source=source, rate=rate, rows=rows)

    def _own_time(self, device: Device) -> TypeGuard[PositionTracker | Readings]:
        """Whether its rows are joined by their time: trackers, unless they make the trigger, and readings."""
        tracks = isinstance(device, PositionTracker) and self.plan.source is not EdgeSource.TRACKER
        return tracks or isinstance(device, Readings)

    def arm_afresh(self) -> None:
        """Just before the start: if edges arrive already (a free-running line), arms again, to restart the numbers."""
        running = False
        for name in self.bench.devices:
            device = self.bench.devices[name]
            if name not in self.pollers and isinstance(device, Latched):
                running |= len(device.read()) > 0
        if running:
            self.disarm()
            self.arm()

    def start(self, now: int) -> None:
        """Starts the pollers."""
        for poller in self.pollers.values():
            poller.start(now)

    def read(self, stream: Stream) -> None:
        """Takes what a device has made since the last time. Raises DeviceFault."""
        block = self._readers[stream.name]()
        if block is not None:
            stream.push(block)

    def _reader(self, name: str) -> Callable[[], Block | None]:
        """The function that reads a device; determined once, because isinstance with a Protocol is slow."""
        device = self.bench.devices[name]
        if name in self.pollers:
            return self.pollers[name].read
        if isinstance(device, Latched):
            if name == self.bench.trigger.device and isinstance(device, TriggerInput):
                return partial(_rows_of_clock, device, device)
            return device.read
        assert isinstance(device, TriggerInput)
        return device.read_edges

    def sleep(self) -> None:
        """Until the next reading is due."""
        clock = self.bench.clock
        until = clock.monotonic_ns() + round(self.plan.block_seconds * 1e9)
        sleep_until(clock, until, list(self.pollers.values()))

    def behind(self, last: int, gone: dict[str, str]) -> bool:
        """Whether a device that still answers has rows to come up to trigger ``last``."""
        awaited = [s for s in self.streams if s is self.clock or s.required]
        return any(s.newest < last for s in awaited if s.name not in gone)

    def finish(self) -> None:
        """No more rows will come: rows that waited for their successors are decided."""
        for poller in self.pollers.values():
            poller.stop()
        for stream in self.streams:
            stream.push(empty(), final=True)

    def oddities(self) -> list[str]:
        """Sentences about irregularities of the trigger inputs that are no losses."""
        notes = []
        for stream in self.streams:
            if stream.indexer.extra:
                notes.append(f"{stream.name}: {stream.indexer.extra} edges on its trigger input were interference")
            if stream.indexer.unguarded and not stream.by_time:
                until = "" if stream.indexer.regular is False else f" before row {stream.indexer.unguarded}"
                notes.append(f"{stream.name}: its time stamps are too uneven to detect a missed edge{until}")
        return notes

    def disarm(self) -> list[str]:
        """Disarms every device; sentences about those that would not."""
        problems = []
        for poller in self.pollers.values():
            poller.stop()
        for name, device in self.bench.devices.items():
            try:
                device.disarm()
            except DeviceFault as fault:
                problems.append(f"{name} could not be disarmed: {fault.what}")
        return problems

    def _stream(self, name: str) -> Stream | None:
        """The stream of a device, None for one that makes no rows."""
        bench, device = self.bench, self.bench.devices[name]
        period = 1.0 / self.plan.rate
        polled = isinstance(device, Polled) and (self.plan.source is EdgeSource.POLL or not isinstance(device, Latched))
        by_time = polled or self._own_time(device)
        stream = Stream(name, bench.columns, period * 1e9, by_time=by_time, presets=bench.presets.get(name, {}))
        if polled:
            ceiling = bench.identities[name].max_rate or self.plan.rate
            self.pollers[name] = Poller(cast(PolledDevice, device), bench.clock, max(period, 1.0 / ceiling))
            return stream
        if isinstance(device, Latched):
            return stream
        if name == bench.columns.tracker and isinstance(device, PositionTracker):
            self.recalled = stream
            return stream
        return stream if name == bench.trigger.device and isinstance(device, TriggerInput) else None


def _rows_of_clock(rows: Latched, edges: TriggerInput) -> Block:
    """The rows of a clock that also lists its edges; the list is discarded, so that it does not grow."""
    edges.read_edges()
    return rows.read()
