"""The counter card of the thesis, MIT C12: three quadrature channels of 24 bit and one of 32, on one trigger input.

Modes x1, x2 and x4; presets; reset on the next index pulse (once a motor revolution). Six joints need two cards. Rows
are numbered by the card's own count of edges; its ticks are of its 1 MHz timer.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from arm_io import DeviceFault
from arm_io.table import Rate, Table
from drivers import RigContext
from drivers.protocols import Block, CounterMode, Identity, Plan, Quality
from sim_backend.electronics import quadrature
from sim_backend.electronics.counter_register import Register
from sim_backend.rig.faults import DeviceReset, EmiCounts, StuckChannel
from sim_backend.rig.latch import TICK_RATE, Latch
from sim_backend.rig.trigger_line import Seen
from sim_backend.rig.world import World, check_wired, world_of

NEVER = np.iinfo(np.int64).max


class Config(Table):
    """One card. joints: the joint whose motor's encoder is wired to each channel; 0 for a channel left open."""

    joints: list[Annotated[int, Field(ge=0)]] = Field(default=[1, 2, 3, 0], min_length=1)
    bits: list[Annotated[int, Field(ge=8, le=48)]] = Field(default=[24, 24, 24, 32])
    max_rate: Rate = 25e3  # rows/s

    @model_validator(mode="after")
    def _as_many(self) -> Config:
        if len(self.bits) != len(self.joints):
            raise ValueError(f"'bits' has {len(self.bits)} entries, 'joints' has {len(self.joints)}")
        return self


class Card:
    """drivers.protocols: Device, Latched, Polled, QuadratureCounter."""

    def __init__(self, name: str, config: Config, world: World) -> None:
        self.name, self.config, self._world = name, config, world
        self.width = tuple(config.bits)
        self._modes = [CounterMode.X4] * len(self.width)
        self._registers = [Register(bits) for bits in self.width]
        self._index: dict[int, int] = {}  # channel -> looking for the next index pulse from this time on
        self._index_seen: dict[int, tuple[int, int]] = {}  # channel -> when it came, and the count there
        self._latch = Latch(world, name, self._acquire)

    def open(self) -> Identity:
        self._latch.open()
        return Identity(
            maker="armscope",
            model="simulated MIT C12",
            serial=self.name,
            max_rate=self.config.max_rate,
            bits=max(self.width),
            details={"tick_rate": f"{TICK_RATE:.0f}", "joints": ", ".join(map(str, self.config.joints))},
        )

    def check(self) -> list[str]:
        return []

    def arm(self, plan: Plan) -> None:
        if plan.rate > self.config.max_rate:
            raise DeviceFault(
                self.name, f"latches at most {self.config.max_rate:g} rows/s, not {plan.rate:g}; lower the rate"
            )
        self._latch.arm(plan)
        for register in self._registers:
            register.begin()

    def disarm(self) -> None:
        self._latch.disarm()

    def close(self) -> None:
        self._latch.close()

    def read(self) -> Block:
        return self._latch.read()

    def poll(self) -> Block:
        return self._latch.single()

    def configure(self, channel: int, mode: CounterMode) -> None:
        self._check(channel)
        self._modes[channel] = mode
        self._set(channel, 0)

    def preset(self, channel: int, value: int) -> None:
        self._check(channel)
        self._set(channel, value)

    def index_enable(self, channel: int) -> None:
        self._check(channel)
        self._index[channel] = self._world.now()
        self._index_seen.pop(channel, None)
        self._world.changed()

    def index_seen(self, channel: int) -> int | None:
        self._check(channel)
        now = self._world.now()
        self._find_index(channel, now)
        when, count = self._index_seen.get(channel, (NEVER, 0))
        return count if when <= now else None

    def _check(self, channel: int) -> None:
        self._latch.check_open()
        if not 0 <= channel < len(self.width):
            raise DeviceFault(self.name, f"has no channel {channel}; it has 0 to {len(self.width) - 1}")

    def _set(self, channel: int, value: int) -> None:
        now = self._world.now()
        register = self._registers[channel]
        register.forget_after(now)
        register.set(now, int(self._counts(np.array([now]))[0, channel]), value)
        self._world.changed()

    def _counts(self, at: NDArray[np.int64]) -> NDArray[np.int64]:
        """(k, channels): what the motors' edges make in each channel's mode; 0 on a channel left open."""
        a, b = self._world.edges_passed(at)
        counts = np.zeros((len(at), len(self.width)), np.int64)
        for channel, joint in enumerate(self.config.joints):
            if joint:
                counts[:, channel] = quadrature.count(a[:, joint - 1], b[:, joint - 1], self._modes[channel])
        return counts

    def _acquire(self, seen: Seen) -> Block:
        at = seen.time
        counts = self._counts(at)
        quality = np.zeros(counts.shape, np.uint8)
        faults = self._world.faults_of(self.name)
        since = self._latch.since_ns()
        for fault in faults:
            if isinstance(fault, StuckChannel):
                stuck = _from(at, since, fault.at) & ~_from(at, since, np.inf if fault.back is None else fault.back)
                if stuck.any():
                    held = self._counts(np.array([max(since + round(fault.at * 1e9), self._world.oldest_ns())]))
                    counts[stuck, fault.channel] = held[0, fault.channel]
            elif isinstance(fault, EmiCounts):
                later = _from(at, since, fault.at)
                counts[:, fault.channel] += fault.counts * later
                if fault.noticed:
                    quality[self._first(at, since, fault.at), fault.channel] |= np.uint8(Quality.QUADRATURE_ERROR)
        for channel, register in enumerate(self._registers):
            if channel in self._index and len(at):
                self._find_index(channel, int(at[-1]))
            counts[:, channel] = register.show(at, counts[:, channel])
        for fault in faults:
            if isinstance(fault, DeviceReset):
                self._restart(fault, at, counts, quality)
        none = np.empty(0, np.int64)
        return Block(none, none, none, quality, counts=counts)

    def _restart(
        self, fault: DeviceReset, at: NDArray[np.int64], counts: NDArray[np.int64], quality: NDArray[np.uint8]
    ) -> None:
        """Registers begin again at 0."""
        since = self._latch.since_ns()
        later = _from(at, since, fault.at)
        if later.any():
            then = np.array([max(since + round(fault.at * 1e9), self._world.oldest_ns())])
            motor = self._counts(then)[0]
            for channel, register in enumerate(self._registers):
                shown = register.show(then, motor[channel : channel + 1])
                counts[later, channel] = quadrature.wrap(counts[later, channel] - shown, register.bits)
            quality[self._first(at, since, fault.at)] |= np.uint8(Quality.DEVICE_RESET)

    def _first(self, at: NDArray[np.int64], since: int, begin: float) -> NDArray[np.bool_]:
        """The first row from ``begin`` on."""
        period = 0.0 if self._world.line is None else self._world.line.period_ns * 1e-9
        return _from(at, since, begin) & ~_from(at, since, begin + period)

    def _find_index(self, channel: int, until: int) -> None:
        """Resets the channel's register at its index pulse, if its motor has passed a whole revolution."""
        joint = self.config.joints[channel]
        begin = self._index.get(channel)
        if begin is None or until <= begin or not joint:
            return
        grid = np.append(np.arange(begin, until, 100_000), until)
        revolutions = self._world.motor_angle(grid)[:, joint - 1] / (2 * np.pi)
        passed = np.flatnonzero(np.diff(np.floor(revolutions)))
        if len(passed) == 0:
            self._index[channel] = until
            return
        low, high = revolutions[passed[0] : passed[0] + 2]
        part = (max(np.floor(low), np.floor(high)) - low) / (high - low)
        when = int(grid[passed[0]] + part * (grid[passed[0] + 1] - grid[passed[0]]))
        count = int(self._counts(np.array([when]))[0, channel])
        shown = int(self._registers[channel].show(np.array([when]), np.array([count]))[0])
        self._registers[channel].set(when, count, 0)
        self._index_seen[channel] = (when, shown)
        del self._index[channel]


def _from(at: NDArray[np.int64], since: int, begin: float) -> NDArray[np.bool_]:
    return (at - since) * 1e-9 >= begin


def make(name: str, config: Config, context: RigContext) -> Card:
    """A closed card. InputError where it is wired to a joint that the arm does not have."""
    world = world_of(context)
    check_wired(name, config.joints, world)
    return Card(name, config, world)
