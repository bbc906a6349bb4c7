"""A driver whose rows were computed beforehand, so that a benchmark of the sampler measures the sampler."""

from __future__ import annotations

import numpy as np
from pydantic import BaseModel

from drivers import RigContext
from drivers.protocols import Block, CounterMode, Identity, Plan


class OwnTime:
    """A sleep is over at once (drivers.protocols.HostClock)."""

    def __init__(self) -> None:
        self.now = 10**12

    def monotonic_ns(self) -> int:
        return self.now

    def wall_ns(self) -> int:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += max(0, round(seconds * 1e9))


class Config(BaseModel):
    """counters and inputs, or a tracker; ``seconds`` of rows at ``rate``."""

    counters: int = 0
    inputs: int = 0
    tracker: bool = False
    rate: float = 20_000.0
    seconds: float = 60.0


class Replayed:
    """drivers.protocols: Device, Latched, and what its Config makes of it."""

    def __init__(self, name: str, config: Config, context: RigContext) -> None:
        self.name, self.config = name, config
        if not isinstance(context.clock, OwnTime):
            context.clock = OwnTime()
        self.clock = context.clock
        rows = int(config.rate * config.seconds)
        random = np.random.default_rng(1)
        self.number = np.arange(rows)
        self.offset = ((self.number + 1) * 1e9 / config.rate + random.exponential(2000, rows)).astype(np.int64)
        self.tick = ((self.number + 1) * 1e6 / config.rate).astype(np.int64)
        columns = config.counters + config.inputs + config.tracker
        self.quality = np.zeros((rows, columns), np.uint8)
        self.counts = self.volts = self.points = None
        if config.counters:
            self.width = (24,) * config.counters
            self.counts = np.outer(self.number, np.arange(1, config.counters + 1)) & 0xFFFFFF
        if config.inputs:
            self.range_volts, self.bits = ((-10.0, 10.0),) * config.inputs, 12
            self.volts = random.normal(0, 1, (rows, config.inputs))
        if config.tracker:
            self.rate, self.memory = config.rate, rows
            self.points = random.normal(0, 1, (rows, 3))
        self.begun, self.taken = 0, 0

    def open(self) -> Identity:
        return Identity("armscope benchmarks", "replayed")

    def check(self) -> list[str]:
        return []

    def arm(self, plan: Plan) -> None:
        self.begun, self.taken = self.clock.now, 0

    def disarm(self) -> None: ...

    def close(self) -> None: ...

    def read(self) -> Block:
        rows = slice(self.taken, int(np.searchsorted(self.offset, self.clock.now - self.begun, side="right")))
        self.taken = max(rows.stop, self.taken)
        cut = (None if column is None else column[rows] for column in (self.counts, self.volts, self.points))
        return Block(self.number[rows], self.begun + self.offset[rows], self.tick[rows], self.quality[rows], *cut)


class Counter(Replayed):
    """With the shape of a quadrature counter."""

    def configure(self, channel: int, mode: CounterMode) -> None: ...
    def preset(self, channel: int, value: int) -> None: ...
    def index_enable(self, channel: int) -> None: ...
    def index_seen(self, channel: int) -> int | None:
        return None


class Tracker(Replayed):
    """With the shape of a position tracker."""

    def recall(self) -> Block:
        return self.read()


def make(name: str, config: Config, context: RigContext) -> Replayed:
    """A closed device."""
    return (Counter if config.counters else Tracker if config.tracker else Replayed)(name, config, context)
