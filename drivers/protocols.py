"""The shapes of a device: what the sampler, the guard and the conformance suite may rely on.

A driver module under ``drivers/`` (or ``sim_backend/``, or anybody's own package) is found by its import path in the
rig file and offers two names (see ``drivers.registry``): ``Config``, a pydantic model of its table in the rig file, and
``make(name, config, world)``. What ``make`` returns is a ``Device``; which of the other shapes it has is read from the
attributes it has, never from a flag. One box may have several shapes (a LabJack T7 is counter, analogue input, trigger
and outputs in one scan).

Rows
----
An acquisition is a sequence of *triggers*, numbered from 0 since arming. Each acquiring device yields ``Block``s: rows
latched by triggers, as numpy arrays; nothing loops over samples in Python. Two ways exist, distinguished by structure:

* ``Latched`` devices have ``read``: the hardware latches on each edge of its trigger line; rows arrive in blocks.
* ``Polled`` devices have ``poll``: one row now. ``daq`` drives them on each edge or tick and makes the blocks.

Raw values only: register counts as the hardware has them (wrapped at ``width`` bits; the sampler extends them to 64 bit
with ``drivers.counting.extend``), volts at the converter's input. Calibration belongs to ``daq``.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntFlag, StrEnum
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "AnalogInput",
    "AnalogOutput",
    "ArmController",
    "Block",
    "ClockReadings",
    "CounterMode",
    "Device",
    "DigitalOutput",
    "EdgeSource",
    "HostClock",
    "Identity",
    "Latched",
    "OwnWatchdog",
    "Plan",
    "Polled",
    "PositionTracker",
    "QuadratureCounter",
    "Quality",
    "Readings",
    "Reconnecting",
    "TriggerInput",
]


class Quality(IntFlag):
    """Doubts about one value of one row; 0 is a good value. Stored as uint8."""

    GOOD = 0
    STALE = 1  # the value of an earlier trigger, repeated
    SATURATED = 2  # at the end of the converter's or counter's range
    QUADRATURE_ERROR = 4  # both lines changed at once: counts may be missing
    LATE = 8  # latched later than the driver's stated latch delay allows
    MISSING = 16  # no value: the number stored is a placeholder (0 counts, NaN volts)
    DEVICE_RESET = 32  # the device restarted: counts have jumped


class EdgeSource(StrEnum):
    """Whose edges make the rows."""

    TRACKER = "tracker"  # low-to-high edges on the trigger line: the thesis's handshake
    TIMER = "timer"  # the rig's own (device or host) timer
    POLL = "poll"  # no line at all: the host asks


class CounterMode(StrEnum):
    """How edges of the two quadrature lines are counted: one, two or four counts per line period."""

    X1 = "x1"
    X2 = "x2"
    X4 = "x4"


@dataclass(frozen=True)
class Identity:
    """What a device says it is, and its ceilings; recorded with every file and asked for more than once a run."""

    maker: str
    model: str
    serial: str = ""
    firmware: str = ""
    max_rate: float | None = None  # rows/s that it can latch; None: no limit of its own
    memory: int | None = None  # rows that it can hold before it stops; None: no limit
    latch_delay: float = 0.0  # s from edge to latch, the same on all channels
    channel_skew: float = 0.0  # s between neighbouring channels of one row
    bits: int | None = None  # of the converter or of the register
    details: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Plan:
    """What the sampler will ask of the devices.

    A device refuses a plan in ``arm`` (DeviceFault: what it cannot do, and what it can).
    """

    source: EdgeSource
    rate: float  # rows/s expected
    rows: int | None  # expected number of rows; None: until stopped
    block_seconds: float = 0.01  # how often the sampler reads


@dataclass(frozen=True, slots=True)
class Block:
    """Rows of one device, in the order in which they were latched. n rows may be 0.

    number  (n,) int64: trigger number of each row, from 0 since arming; -1 where the device does not number its rows
    host    (n,) int64 ns: host's monotonic clock at the edge (or, if the device has no time, at the arrival)
    tick    (n,) int64: the device's own clock, 0 where it has none
    counts  (n, counters) int64: raw register values, or None
    volts   (n, inputs) float64 V: at the input, or None
    points  (n, 3) float64 m: tracker's frame, NaN where the beam was broken, or None
    readings (n, k) float64: values of ``Readings``, NaN where there is none, or None
    quality (n, counters + inputs + 1 if points) uint8: Quality bits, in that order of columns
    """

    number: NDArray[np.int64]
    host: NDArray[np.int64]
    tick: NDArray[np.int64]
    quality: NDArray[np.uint8]
    counts: NDArray[np.int64] | None = None
    volts: NDArray[np.float64] | None = None
    points: NDArray[np.float64] | None = None
    readings: NDArray[np.float64] | None = None

    def __len__(self) -> int:
        return len(self.number)


@runtime_checkable
class HostClock(Protocol):
    """The host's time.

    The real one is ``drivers.clock.SystemClock``; a simulation running faster than the wall brings its own.
    """

    def monotonic_ns(self) -> int: ...
    def wall_ns(self) -> int: ...
    def sleep(self, seconds: float) -> None: ...


@runtime_checkable
class Device(Protocol):
    """Life cycle: open -> (arm -> read ... -> disarm)* -> close. Every call may raise DeviceFault; close never does.

    open() is idempotent after close(); arm() starts a new numbering of triggers; check() is what ``doctor`` prints:
    sentences about what is wrong and what to do, empty when all is well.
    """

    name: str

    def open(self) -> Identity: ...
    def check(self) -> list[str]: ...
    def arm(self, plan: Plan) -> None: ...
    def disarm(self) -> None: ...
    def close(self) -> None: ...


@runtime_checkable
class Latched(Protocol):
    """Rows latched by the hardware: ``read`` returns all rows since the last call, without waiting."""

    def read(self) -> Block: ...


@runtime_checkable
class Polled(Protocol):
    """A device that cannot latch: ``poll`` reads every channel now and returns one row.

    The row's number is -1, its host time the middle of the reading.
    """

    def poll(self) -> Block: ...


@runtime_checkable
class Reconnecting(Protocol):
    """A Latched device that retries a lost connection itself (for hardware on a cable).

    While it is ``seeking``, ``read`` gives no rows and the run continues; the driver raises DeviceFault when it gives
    up. When it is back, its numbers go on with those of the triggers: the gap in them is what was lost.
    """

    seeking: bool


@runtime_checkable
class ClockReadings(Protocol):
    """A device whose clock the host can read at any time, not only with a row.

    ``clock_readings`` gives the readings since arming, (tick, host ns) pairs in order: where there are such, the clocks
    are related by them, for the host times of the rows have been worked out from the same ticks already.
    """

    def clock_readings(self) -> list[tuple[int, int]]: ...


@runtime_checkable
class TriggerInput(Protocol):
    """Edges of the trigger line, low to high, as Blocks without values (number, host, tick).

    ``numbered`` says that numbers come from a hardware edge counter (a gap in them is a lost row, not a lost edge).
    """

    numbered: bool

    def read_edges(self) -> Block: ...


@runtime_checkable
class QuadratureCounter(Protocol):
    """Quadrature counter channels, numbered from 0. LinuxCNC hostmot2's semantics of raw count, latch and index.

    width[c] bits; counts run from the moment a channel is configured; ``preset`` sets the register; ``index_enable``
    arms a reset (or latch) at the next index pulse and ``index_seen`` returns whether it came, and at which raw count.
    """

    width: tuple[int, ...]

    def configure(self, channel: int, mode: CounterMode) -> None: ...
    def preset(self, channel: int, value: int) -> None: ...
    def index_enable(self, channel: int) -> None: ...
    def index_seen(self, channel: int) -> int | None: ...


@runtime_checkable
class AnalogInput(Protocol):
    """Analogue inputs, numbered from 0: range_volts[c] = (lowest, highest) V."""

    range_volts: tuple[tuple[float, float], ...]
    bits: int


@runtime_checkable
class DigitalOutput(Protocol):
    """TTL lines by name (``start``, ``brake`` ...). ``safe`` puts every line into its safe state; it never raises."""

    lines: tuple[str, ...]

    def write_line(self, line: str, high: bool) -> None: ...
    def safe(self) -> None: ...


@runtime_checkable
class AnalogOutput(Protocol):
    """Analogue outputs, numbered from 0, V. ``safe`` puts every output to 0 V; it never raises."""

    output_range: tuple[tuple[float, float], ...]

    def write_volts(self, channel: int, volts: float) -> None: ...
    def safe(self) -> None: ...


@runtime_checkable
class OwnWatchdog(Protocol):
    """A device that brings its own outputs into their safe state when no command has come for ``watchdog`` s.

    0: it never does.
    """

    watchdog: float


@runtime_checkable
class PositionTracker(Protocol):
    """External tracker: points in its own frame by ``read`` (Latched), or after the run from its memory (``recall``).

    It cannot be triggered; it raises the trigger line once per sample.
    """

    rate: float  # Hz, set
    memory: int  # samples

    def recall(self) -> Block: ...


@runtime_checkable
class Readings(Protocol):
    """An instrument that sends numbers on its own time, such as a vehicle's navigation: by ``read`` (Latched).

    It cannot be triggered: each reading goes to the row that is nearest to it in time, other rows have NaN.
    """

    readings: tuple[str, ...]  # their names, which become columns of the recording; SI units
    rate: float  # Hz, set


@runtime_checkable
class ArmController(Protocol):
    """The arm's own controller.

    ``load`` takes an ``experiment.Experiment``; DeviceFault for a motion that the controller cannot execute.

    ``start`` begins the motion (or arms it for the start line); ``stop`` ends it at once, controlled, and is always
    allowed; ``finished`` says whether the motion has ended; ``demand`` returns the reference joint positions (n,
    joints) rad at times (n,) s since the start, or None where the controller does not report it.
    """

    joints: int

    def load(self, experiment: object) -> None: ...
    def start(self) -> None: ...
    def stop(self) -> None: ...
    def finished(self) -> bool: ...
    def demand(self, times: NDArray[np.float64]) -> NDArray[np.float64] | None: ...
