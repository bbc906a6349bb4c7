"""National Instruments Lab-PC under comedi: the thesis's own analogue card, which Linux still drives (``ni_labpc``).

12 bit, 8 inputs, one converter multiplexed over the channels at 83 333 samples/s; two analogue outputs, one digital
port. A scan begins on each edge at EXTCONV (source ``tracker``) or on the card's own timer. Its counters count pulses,
not quadrature: the encoders need another card. Needs comedilib's Python binding (module ``comedi``), which is not on
PyPI: it comes with comedilib.
"""

from __future__ import annotations

import contextlib
import importlib
import os
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from arm_io import DeviceFault
from arm_io.table import Table
from drivers.blocks import join
from drivers.counting import check_channel
from drivers.protocols import Block, EdgeSource, HostClock, Identity, Plan, Quality
from drivers.rig_context import RigContext

SAMPLES_PER_SECOND = 83_333.0
PORT_LINES = 8  # of the first digital port


class Config(Table):
    """A Lab-PC in the rig file.

    inputs  how many analogue inputs, from channel 0 on: the card scans them without gaps
    range   number of the input range (0: +-5 V on a bipolar card)
    lines   digital outputs by name, as line numbers of port A
    """

    device: str = "/dev/comedi0"
    inputs: Annotated[int, Field(ge=1, le=8)] = 8
    range: Annotated[int, Field(ge=0)] = 0
    lines: dict[str, Annotated[int, Field(ge=0, lt=PORT_LINES)]] = Field(default={"start": 0})


class NiLabPc:
    """The device (shapes: Latched, TriggerInput, AnalogInput, AnalogOutput, DigitalOutput)."""

    numbered = True
    bits = 12

    def __init__(self, name: str, config: Config, clock: HostClock) -> None:
        self.name, self.config, self._clock = name, config, clock
        self.lines = tuple(config.lines)
        self.range_volts: tuple[tuple[float, float], ...] = ((-5.0, 5.0),) * config.inputs
        self.output_range: tuple[tuple[float, float], ...] = ((-5.0, 5.0),) * 2
        self._comedi: Any = None
        self._card: Any = None
        self._bytes = b""
        self._running = False

    def open(self) -> Identity:
        try:
            self._comedi = c = importlib.import_module("comedi")
        except ImportError:
            raise self._fault("comedilib's Python binding (module 'comedi') is not installed") from None
        self._card = c.comedi_open(self.config.device)
        if self._card is None:
            raise self._fault(f"{self.config.device} cannot be opened: is ni_labpc loaded and attached?")
        if c.comedi_get_driver_name(self._card) != "ni_labpc":
            driver = c.comedi_get_driver_name(self._card)
            self.close()
            raise self._fault(f"{self.config.device} is driven by {driver}, not by ni_labpc")
        self._input, self._output, self._digital = (
            c.comedi_find_subdevice_by_type(self._card, kind, 0)
            for kind in (c.COMEDI_SUBD_AI, c.COMEDI_SUBD_AO, c.COMEDI_SUBD_DIO)
        )
        self._full = int(c.comedi_get_maxdata(self._card, self._input, 0))
        self.range_volts = (self._range(self._input, self.config.range),) * self.config.inputs
        self.output_range = (self._range(self._output, 0),) * 2
        for line in self.config.lines.values():
            c.comedi_dio_config(self._card, self._digital, line, c.COMEDI_OUTPUT)
        self.safe()
        return Identity(
            maker="National Instruments",
            model=str(c.comedi_get_board_name(self._card)),
            max_rate=SAMPLES_PER_SECOND / self.config.inputs,
            channel_skew=1 / SAMPLES_PER_SECOND,
            bits=self.bits,
            details={"device": self.config.device},
        )

    def _range(self, subdevice: int, number: int) -> tuple[float, float]:
        span = self._comedi.comedi_get_range(self._card, subdevice, 0, number)
        return float(span.min), float(span.max)

    def check(self) -> list[str]:
        return [] if self._card is not None else [f"{self.config.device} is not open: is ni_labpc attached?"]

    def arm(self, plan: Plan) -> None:
        c, most = self._comedi, SAMPLES_PER_SECOND / self.config.inputs
        if self._card is None:
            raise self._fault("is not open")
        if plan.source == EdgeSource.POLL:
            raise self._fault("cannot be polled row by row: trigger source must be tracker or timer")
        if plan.rate > most:
            raise self._fault(f"{plan.rate:g} rows/s requested, {most:.0f} possible with {self.config.inputs} inputs")
        self.disarm()
        command = c.comedi_cmd_struct()
        channels = c.chanlist(self.config.inputs)
        for n in range(self.config.inputs):
            channels[n] = c.cr_pack(n, self.config.range, c.AREF_GROUND)
        command.subdev, command.flags = self._input, 0
        command.start_src, command.start_arg = c.TRIG_NOW, 0
        external = plan.source == EdgeSource.TRACKER
        command.scan_begin_src = c.TRIG_EXT if external else c.TRIG_TIMER
        command.scan_begin_arg = 0 if external else round(1e9 / plan.rate)
        command.convert_src, command.convert_arg = c.TRIG_TIMER, round(1e9 / SAMPLES_PER_SECOND)
        command.scan_end_src, command.scan_end_arg = c.TRIG_COUNT, self.config.inputs
        command.stop_src, command.stop_arg = c.TRIG_NONE, 0
        command.chanlist, command.chanlist_len = channels, self.config.inputs
        # the first test rounds the times to what the card can do, the second must find nothing to change
        for _ in range(2):
            verdict = c.comedi_command_test(self._card, command)
        if verdict != 0 or c.comedi_command(self._card, command) < 0:
            raise self._fault(f"the card refuses the scan (comedi_command_test: step {verdict})")
        self._file = c.comedi_fileno(self._card)
        os.set_blocking(self._file, False)
        wide = c.comedi_get_subdevice_flags(self._card, self._input) & c.SDF_LSAMPL
        self._type = np.dtype(np.uint32 if wide else np.uint16)
        self._period = 1e9 / plan.rate
        self._bytes, self._number, self._running = b"", 0, True
        self._rows: list[Block] = []
        self._edges: list[Block] = []

    def disarm(self) -> None:
        if self._running:
            self._running = False
            self._comedi.comedi_cancel(self._card, self._input)

    def close(self) -> None:
        if self._card is not None:
            with contextlib.suppress(OSError):
                self.disarm()
            self.safe()
            self._comedi.comedi_close(self._card)
            self._card = None

    def read(self) -> Block:
        self._pump()
        blocks, self._rows = self._rows, []
        return join(blocks, 0, self.config.inputs)

    def read_edges(self) -> Block:
        self._pump()
        blocks, self._edges = self._edges, []
        return join(blocks)

    def _pump(self) -> None:
        if not self._running:
            raise self._fault("is not armed")
        try:
            data = os.read(self._file, 1 << 16)
        except BlockingIOError:
            return
        except OSError as error:
            raise self._fault(f"{error}: its buffer overflowed, or the card is gone") from None
        if not data:
            raise self._fault("the scan has stopped: its buffer overflowed")
        now = self._clock.monotonic_ns()
        self._bytes += data
        scan = self.config.inputs * self._type.itemsize
        whole = len(self._bytes) // scan
        codes = np.frombuffer(self._bytes, self._type, whole * self.config.inputs).reshape(whole, -1)
        self._bytes = self._bytes[whole * scan :]
        if not whole:
            return
        low, high = self.range_volts[0]
        number = self._number + np.arange(whole, dtype=np.int64)
        self._number += whole
        # The card has no clock to read: the newest scan has just come, those before it a period apart.
        host = now - ((whole - 1 - np.arange(whole)) * self._period).astype(np.int64)
        ends = (codes == 0) | (codes == self._full)
        quality = np.where(ends, np.uint8(Quality.SATURATED), np.uint8(0)).astype(np.uint8)
        tick = np.zeros(whole, np.int64)
        volts = low + codes * ((high - low) / self._full)
        self._rows.append(Block(number, host, tick, quality, volts=volts))
        self._edges.append(Block(number, host, tick, np.zeros((whole, 0), np.uint8)))

    def write_line(self, line: str, high: bool) -> None:
        if line not in self.config.lines:
            raise self._fault(f"has no line {line!r}; it has {', '.join(self.lines)}")
        if self._comedi.comedi_dio_write(self._card, self._digital, self.config.lines[line], int(high)) < 0:
            raise self._fault(f"line {line} cannot be switched")

    def write_volts(self, channel: int, volts: float) -> None:
        check_channel(self.name, channel, len(self.output_range))
        low, high = self.output_range[channel]
        if not low <= volts <= high:
            raise self._fault(f"output {channel}: {volts:g} V requested, {low:g} to {high:g} V possible")
        full = int(self._comedi.comedi_get_maxdata(self._card, self._output, channel))
        code = round((volts - low) / (high - low) * full)
        if self._comedi.comedi_data_write(self._card, self._output, channel, 0, self._comedi.AREF_GROUND, code) < 0:
            raise self._fault(f"output {channel} cannot be written")

    def safe(self) -> None:
        """Lines low, outputs at 0 V; one that fails leaves no other as it is."""
        if self._card is not None:
            for line in self.lines:
                with contextlib.suppress(DeviceFault):
                    self.write_line(line, False)
            for channel in range(len(self.output_range)):
                with contextlib.suppress(DeviceFault):
                    self.write_volts(channel, 0.0)

    def _fault(self, what: str) -> DeviceFault:
        return DeviceFault(self.name, what)


def make(name: str, config: Config, context: RigContext) -> NiLabPc:
    """The card at ``config.device``, closed."""
    return NiLabPc(name, config, context.clock)


def find(config: Config) -> list[str]:
    """The comedi devices that the kernel knows."""
    return [str(path) for path in sorted(Path("/dev").glob("comedi[0-9]*"))]
