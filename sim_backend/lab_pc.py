"""The analogue card of the thesis, Lab-PC: eight inputs of 12 bit with one converter, two analogue outputs.

It also has TTL lines, and the timer B2.

The converter goes through the inputs one after the other: input c of a row is converted c / conversion_rate after the
edge. The trigger input counts edges; with the timer as their source, counter B2 of this card makes them, from the rise
of the ``start`` line on.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from arm_io import DeviceFault
from arm_io.table import Rate, Table
from drivers import RigContext
from drivers.protocols import Block, EdgeSource, Identity, Plan, Quality
from sim_backend.electronics import adc, noise
from sim_backend.electronics.adc import Converter
from sim_backend.rig.faults import StuckChannel
from sim_backend.rig.latch import TICK_RATE, Latch
from sim_backend.rig.trigger_line import Seen, TriggerLine
from sim_backend.rig.world import World, check_wired, world_of

START = "start"


class Config(Table):
    """One card; ``joints``: the joint whose current transducer is wired to each input.

    0 means that the input is open (it reads 0 V).
    """

    joints: list[Annotated[int, Field(ge=0)]] = Field(default=[1, 2, 3, 4, 5, 6, 0, 0], min_length=1, max_length=16)
    bits: Annotated[int, Field(ge=8, le=24)] = 12
    range: tuple[float, float] = (-10.0, 10.0)  # V
    offset: float = 0.0  # V, of the converter
    noise: Annotated[float, Field(ge=0)] = 0.001  # V, standard deviation, of the converter
    conversion_rate: Rate = 83.3e3  # 1/s, all inputs together
    lines: list[str] = Field(default=[START])


class Card:
    """drivers.protocols: Device, Latched, Polled, AnalogInput, TriggerInput, DigitalOutput, AnalogOutput."""

    numbered = True
    output_range = ((-5.0, 5.0), (-5.0, 5.0))

    def __init__(self, name: str, config: Config, world: World) -> None:
        self.name, self.config, self._world = name, config, world
        self.range_volts = (config.range,) * len(config.joints)
        self.bits = config.bits
        self.lines = tuple(config.lines)
        self.high = dict.fromkeys(self.lines, False)
        self.output = [0.0] * len(self.output_range)
        self._converter = Converter(config.bits, *config.range, config.offset, config.noise)
        self._noise = noise.keys(world.settings.seed, f"converter of {name}", len(config.joints))
        self._skew = np.rint(np.arange(len(config.joints)) / config.conversion_rate * 1e9).astype(np.int64)
        self._latch = Latch(world, name, self._acquire)
        self._edges = Latch(world, name, _no_values)

    def open(self) -> Identity:
        self._latch.open()
        self._edges.open()
        return Identity(
            maker="armscope",
            model="simulated Lab-PC",
            serial=self.name,
            max_rate=self._max_rate(),
            channel_skew=1.0 / self.config.conversion_rate,
            bits=self.bits,
            details={"tick_rate": f"{TICK_RATE:.0f}", "joints": ", ".join(map(str, self.config.joints))},
        )

    def check(self) -> list[str]:
        return []

    def arm(self, plan: Plan) -> None:
        if plan.rate > self._max_rate():
            raise DeviceFault(
                self.name,
                f"converts {self.config.conversion_rate:g} values/s: {len(self._skew)} inputs at most "
                f"{self._max_rate():.0f} times per second, not {plan.rate:g}; lower the rate",
            )
        self._latch.arm(plan)
        self._edges.arm(plan)
        if plan.source is EdgeSource.TIMER:
            period = 1e9 / (plan.rate * self._world.drift(self.name))
            self._world.pulse_by(lambda start: TriggerLine(start + round(period), period))

    def disarm(self) -> None:
        self._latch.disarm()
        self._edges.disarm()

    def close(self) -> None:
        self.safe()
        self._latch.close()
        self._edges.close()

    def read(self) -> Block:
        return self._latch.read()

    def read_edges(self) -> Block:
        return self._edges.read()

    def poll(self) -> Block:
        return self._latch.single()

    def write_line(self, line: str, high: bool) -> None:
        self._latch.check_open()
        if line not in self.high:
            raise DeviceFault(self.name, f"has no line {line!r}; it has {', '.join(self.lines)}")
        self._write(line, high)

    def write_volts(self, channel: int, volts: float) -> None:
        self._latch.check_open()
        if not 0 <= channel < len(self.output):
            raise DeviceFault(self.name, f"has no output {channel}; it has 0 and 1")
        low, high = self.output_range[channel]
        if not low <= volts <= high:
            raise DeviceFault(self.name, f"output {channel} gives {low:g} to {high:g} V, not {volts:g} V")
        self.output[channel] = volts

    def safe(self) -> None:
        self.output = [0.0] * len(self.output_range)
        for line in self.lines:
            self._write(line, False)

    def _write(self, line: str, high: bool) -> None:
        self.high[line] = high
        if line == START:
            self._world.write_start(high)

    def _max_rate(self) -> float:
        return self.config.conversion_rate / len(self._skew)

    def _acquire(self, seen: Seen) -> Block:
        at = seen.time[:, None] + self._skew
        for fault in self._world.faults_of(self.name):
            if isinstance(fault, StuckChannel):
                since = self._latch.since_ns()
                begin = max(since + round(fault.at * 1e9), self._world.oldest_ns())
                end = np.inf if fault.back is None else since + fault.back * 1e9
                column = at[:, fault.channel]
                column[(column >= begin) & (column < end)] = begin
        its_noise = noise.normals(self._noise, at - self._world.epoch_ns(), 1)[0]
        codes = adc.codes(self._converter, self._wires(at), its_noise)
        quality = np.where(adc.saturated(self._converter, codes), np.uint8(Quality.SATURATED), np.uint8(0))
        none = np.empty(0, np.int64)
        return Block(none, none, none, quality, volts=adc.reported(self._converter, codes))

    def _wires(self, at: NDArray[np.int64]) -> NDArray[np.float64]:
        """(k, inputs) V at the inputs, each at its own time."""
        joints = len(self._world.plant.encoder_lines)
        wired = [(channel, joint - 1) for channel, joint in enumerate(self.config.joints) if joint]
        when = np.repeat(at[:, :1], joints, axis=1)
        for channel, joint in wired:
            when[:, joint] = at[:, channel]
        transducers = self._world.transducer_volts(when)
        volts = np.zeros(at.shape)
        for channel, joint in wired:
            volts[:, channel] = transducers[:, joint]
        return volts


def _no_values(seen: Seen) -> Block:
    none = np.empty(0, np.int64)
    return Block(none, none, none, np.empty((len(seen.edge), 0), np.uint8))


def make(name: str, config: Config, context: RigContext) -> Card:
    """A closed card. InputError where it is wired to a joint that the arm does not have."""
    world = world_of(context)
    check_wired(name, config.joints, world)
    return Card(name, config, world)
