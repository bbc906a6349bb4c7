"""Small devices in memory for the tests of daq: a driver module as in ``drivers``, with its ``Config`` and ``make``.

One ``Line`` a rig makes trigger edges on the rig's clock; cards latch on it, each with its own latency, and faults are
injected by edge. Every value is a function of the true edge, so that a shifted row shows: counter c reads ``edge * (c +
1) * STEP``, input c ``edge * 1e-3 + c`` V, the tracker ``(edge, 0, 0)`` m.
"""

from __future__ import annotations

import threading

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from arm_io import DeviceFault
from drivers import RigContext
from drivers.counting import check_channel
from drivers.protocols import Block, CounterMode, Device, HostClock, Identity, Plan, Quality
from experiment import Demand, Experiment, demand_of

STEP = 3  # counts an edge on channel 0


class Config(BaseModel):
    """One test device; faults are given by true edge, from 0 since the line started."""

    model_config = ConfigDict(extra="forbid")
    kind: str = "counter"  # counter, analog, tracker, memory_tracker, polled, controller
    channels: int = 2
    bits: int = 24
    max_rate: float | None = None
    memory: int | None = None
    latency: float = 0.0  # s from the edge until the row can be read
    jitter: float = 0.0  # s, greatest error of the host's stamp
    arrival: bool = False  # stamps are of the arrival, all rows of a read alike
    numbered: bool = True
    tick_rate: float | None = None  # Hz of the device's own clock
    tick_drift: float = 0.0  # relative error of that clock
    unseen: list[int] = []  # edges that the card's own input misses: its numbering goes on without them
    dropped: list[int] = []  # rows that the card numbers, and does not deliver
    spurious: list[int] = []  # an extra edge half a period after these
    gone_at: int | None = None  # the device fails once it gets to this edge
    silent_at: int | None = None  # the device makes no row from this edge on, without an error
    drift: float = 0.0  # relative error of the line's period (trigger device)
    line_stops_at: int | None = None  # the line makes no edge from this one on
    free_running: bool = False  # the line runs from arming on, without a start signal


class Clock:
    """Time of its own: a sleep is over at once."""

    def __init__(self) -> None:
        self.now = 1_000_000_000_000
        self.lock = threading.Lock()

    def monotonic_ns(self) -> int:
        return self.now

    def wall_ns(self) -> int:
        return self.now + 1_700_000_000_000_000_000

    def sleep(self, seconds: float) -> None:
        with self.lock:
            self.now += round(seconds * 1e9)


class Line:
    """The trigger line: edges from ``start`` on, equally spaced."""

    def __init__(self, clock: HostClock) -> None:
        self.clock = clock
        self.period = 1e-3
        self.begun: int | None = None
        self.last: int | None = None

    def start(self) -> None:
        if self.begun is None:
            self.begun = self.clock.monotonic_ns()

    def reset(self) -> None:
        self.begun = None

    def time(self, edges: NDArray[np.int64]) -> NDArray[np.int64]:
        """(n,) ns host time of edges; the first comes one period after the start."""
        assert self.begun is not None
        return self.begun + np.round((edges + 1) * self.period * 1e9).astype(np.int64)

    def seen(self, delay: float) -> int:
        """How many edges are at least ``delay`` s old."""
        if self.begun is None:
            return 0
        edges = int((self.clock.monotonic_ns() - self.begun) * 1e-9 / self.period - delay / self.period + 1e-6)
        return max(edges if self.last is None else min(edges, self.last), 0)


class Card:
    """Rows latched on the line's edges, with faults."""

    def __init__(self, name: str, config: Config, context: RigContext) -> None:
        self.name, self.config = name, config
        self.clock: HostClock = context.clock
        self.line = context.shared("line", lambda: Line(self.clock))
        self.slow = "slow_arming" in context.simulation  # the devices of a rig are armed 23 ms apart
        self.numbered = config.numbered
        self.lines = ("start", "brake")
        self.high: dict[str, bool] = {}
        self.is_safe = False
        self.opened = False
        self.random = np.random.default_rng(1)
        self._reset()

    def _reset(self) -> None:
        self.cursor = 0  # next true edge to hand over
        self.next_number = 0
        self.edge_log: list[Block] = []

    def open(self) -> Identity:
        self.opened = True
        c = self.config
        return Identity("armscope tests", c.kind, serial="1", max_rate=c.max_rate, memory=c.memory, bits=c.bits)

    def check(self) -> list[str]:
        return []

    def arm(self, plan: Plan) -> None:
        refuse(self, plan)
        if self.slow:
            self.clock.sleep(0.023)
        self._reset()
        self.line.period = (1 + self.config.drift) / plan.rate
        if self.config.line_stops_at is not None:
            self.line.last = self.config.line_stops_at
        if self.config.free_running:
            self.line.start()
        self.cursor = self.line.seen(0.0)  # edges before arming are none of this run's

    def disarm(self) -> None:
        self.line.reset()

    def close(self) -> None:
        self.opened = False

    def write_line(self, line: str, high: bool) -> None:
        if line not in self.lines:
            raise DeviceFault(self.name, f"has no line {line}")
        self.high[line] = high
        self.is_safe = False
        if line == "start" and high:
            self.line.start()

    def safe(self) -> None:
        self.high = dict.fromkeys(self.lines, False)
        self.is_safe = True

    def latch(self) -> tuple[NDArray[np.int64], Block]:
        """True edges (a spurious one as that before it), and their numbers, stamps and ticks."""
        c = self.config
        until = self.line.seen(c.latency)
        if c.gone_at is not None and until > c.gone_at:
            raise DeviceFault(self.name, "does not answer; check its cable")
        if c.silent_at is not None:
            until = min(until, c.silent_at)
        edges = np.arange(self.cursor, max(until, self.cursor))
        self.cursor += len(edges)
        edges = edges[~np.isin(edges, c.unseen)]
        extra = edges[np.isin(edges, c.spurious)]
        half = np.concatenate([np.zeros(len(edges)), np.full(len(extra), 0.5)])
        edges = np.concatenate([edges, extra])
        order = np.argsort(edges + half, kind="stable")
        edges, half = edges[order], half[order]
        number = self.next_number + np.arange(len(edges))
        self.next_number += len(edges)
        kept = ~np.isin(edges, c.dropped)
        edges, half, number = edges[kept], half[kept], number[kept]
        host = self.line.time(edges) + np.round(half * self.line.period * 1e9).astype(np.int64) if len(edges) else edges
        tick = np.zeros(len(edges), np.int64)
        if c.tick_rate is not None:
            tick = np.round((host - 10**12) * 1e-9 * c.tick_rate * (1 + c.tick_drift)).astype(np.int64)
        if c.arrival:
            host = np.full(len(edges), self.clock.monotonic_ns(), np.int64)
        elif c.jitter:
            host = host + np.round(self.random.uniform(-c.jitter, c.jitter, len(edges)) * 1e9).astype(np.int64)
        shown = number if c.numbered else np.full(len(edges), -1)
        return edges, Block(shown, host, tick, np.zeros((len(edges), 0), np.uint8))


class Counter(Card):
    """Quadrature counter, trigger input and lines."""

    def __init__(self, name: str, config: Config, context: RigContext) -> None:
        super().__init__(name, config, context)
        self.width = (config.bits,) * config.channels
        self.presets = [0] * config.channels
        self.modes: dict[int, CounterMode] = {}

    def configure(self, channel: int, mode: CounterMode) -> None:
        check_channel(self.name, channel, len(self.width))
        self.modes[channel] = mode
        self.presets[channel] = 0

    def preset(self, channel: int, value: int) -> None:
        check_channel(self.name, channel, len(self.width))
        self.presets[channel] = value

    def index_enable(self, channel: int) -> None:
        check_channel(self.name, channel, len(self.width))

    def index_seen(self, channel: int) -> int | None:
        return None

    def read(self) -> Block:
        edges, block = self.latch()
        self.edge_log.append(block)
        counts = np.outer(edges * STEP, np.arange(self.config.channels) + 1) + np.array(self.presets)
        counts &= (1 << self.config.bits) - 1
        return Block(block.number, block.host, block.tick, np.zeros(counts.shape, np.uint8), counts=counts)

    def read_edges(self) -> Block:
        log, self.edge_log = self.edge_log, []
        if not log:
            return _empty()
        return Block(*(np.concatenate([getattr(b, n) for b in log]) for n in ("number", "host", "tick", "quality")))


class Analog(Card):
    """Analogue inputs, latched."""

    def __init__(self, name: str, config: Config, context: RigContext) -> None:
        super().__init__(name, config, context)
        self.range_volts = ((-10.0, 10.0),) * config.channels
        self.bits = config.bits
        self.output_range = ((-5.0, 5.0),)
        self.output = 0.0
        del self.numbered, self.lines

    def write_volts(self, channel: int, volts: float) -> None:
        if channel >= len(self.output_range) or not self.output_range[0][0] <= volts <= self.output_range[0][1]:
            raise DeviceFault(self.name, f"has no output {channel} that gives {volts:g} V")
        self.output = volts

    def safe(self) -> None:
        self.output = 0.0
        self.is_safe = True

    def read(self) -> Block:
        edges, block = self.latch()
        volts = edges[:, None] * 1e-3 + np.arange(self.config.channels)
        return Block(block.number, block.host, block.tick, np.zeros(volts.shape, np.uint8), volts=volts)


class Tracker(Card):
    """A tracker that streams its points."""

    def __init__(self, name: str, config: Config, context: RigContext) -> None:
        super().__init__(name, config, context)
        self.rate = 1000.0
        self.memory = config.memory or 1000
        del self.numbered, self.lines

    def read(self) -> Block:
        return self._points()

    def recall(self) -> Block:
        return self._points()

    def _points(self) -> Block:
        edges, block = self.latch()
        points = np.column_stack([edges, np.zeros((len(edges), 2))]).astype(float)
        return Block(block.number, block.host, block.tick, np.zeros((len(edges), 1), np.uint8), points=points)


class MemoryTracker(Card):
    """A tracker whose points stay in its memory until they are recalled."""

    def __init__(self, name: str, config: Config, context: RigContext) -> None:
        super().__init__(name, config, context)
        self.rate = 1000.0
        self.memory = config.memory or 1000
        del self.numbered, self.lines

    def recall(self) -> Block:
        return Tracker._points(self)  # type: ignore[arg-type]


class Slow:
    """Analogue inputs without a latch: they show the milliseconds since the clock's zero, at the time of asking."""

    def __init__(self, name: str, config: Config, context: RigContext) -> None:
        self.name, self.config = name, config
        self.clock: HostClock = context.clock
        self.range_volts = ((-10.0, 1e6),) * config.channels
        self.bits = 16
        self.polls = 0
        self.opened = False

    def open(self) -> Identity:
        self.opened = True
        return Identity("armscope tests", "slow", max_rate=self.config.max_rate, bits=16)

    def check(self) -> list[str]:
        return []

    def arm(self, plan: Plan) -> None:
        refuse(self, plan)
        self.polls = 0

    def disarm(self) -> None: ...

    def close(self) -> None: ...

    def poll(self) -> Block:
        self.polls += 1
        if self.config.gone_at is not None and self.polls > self.config.gone_at:
            raise DeviceFault(self.name, "does not answer; check its cable")
        now = self.clock.monotonic_ns()
        volts = np.full((1, self.config.channels), now * 1e-6 % 1e6)
        zeros = np.zeros((1, self.config.channels), np.uint8)
        return Block(np.array([-1]), np.array([now]), np.array([0]), zeros, volts=volts)


class Controller:
    """An arm controller that plays the demand of an experiment."""

    def __init__(self, name: str, config: Config, context: RigContext) -> None:
        self.name, self.config = name, config
        self.joints = config.channels
        self.clock: HostClock = context.clock
        self.duration, self.begun, self.stopped = 0.0, 0, 0
        self.experiment: object = None
        self.motion: Demand | None = None

    def open(self) -> Identity:
        return Identity("armscope tests", "controller")

    def check(self) -> list[str]:
        return []

    def arm(self, plan: Plan) -> None: ...

    def disarm(self) -> None: ...

    def close(self) -> None: ...

    def load(self, experiment: object) -> None:
        if not isinstance(experiment, Experiment):
            raise DeviceFault(self.name, "needs an Experiment")
        self.experiment = experiment
        self.motion = demand_of(experiment)
        self.duration = self.motion.duration

    def start(self) -> None:
        if self.motion is None:
            raise DeviceFault(self.name, "has no experiment")
        self.begun = self.clock.monotonic_ns()

    def stop(self) -> None:
        self.stopped += 1

    def finished(self) -> bool:
        return self.clock.monotonic_ns() >= self.begun + self.duration * 1e9

    def demand(self, times: NDArray[np.float64]) -> NDArray[np.float64] | None:
        return None if self.motion is None else self.motion(times)


def refuse(device: Card | Slow, plan: Plan) -> None:
    """What a device says that is closed, or asked for more than it can."""
    if not device.opened:
        raise DeviceFault(device.name, "is not open")
    if device.config.max_rate is not None and plan.rate > device.config.max_rate:
        raise DeviceFault(device.name, "cannot be that fast")


def _empty() -> Block:
    nothing = np.empty(0, np.int64)
    return Block(nothing, nothing, nothing, np.empty((0, 0), np.uint8))


KINDS = {
    "counter": Counter,
    "analog": Analog,
    "tracker": Tracker,
    "memory_tracker": MemoryTracker,
    "polled": Slow,
    "controller": Controller,
}


def make(name: str, config: Config, context: RigContext) -> Device:
    """A closed test device."""
    if "own_time" in context.simulation and not isinstance(context.clock, Clock):
        context.clock = Clock()
    return KINDS[config.kind](name, config, context)  # type: ignore[no-any-return, abstract]


__all__ = ["STEP", "Clock", "Config", "Line", "Quality", "make"]
