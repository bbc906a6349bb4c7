"""LabJack T7 on the wire, sans-IO: its registers, its scan list, its stream packets, codes to volts.

Sources: LabJack T-Series Datasheet (3.2 Stream Mode, 3.2.4 Low-Level Stream, 13.2 Quadrature In, 23.0 Watchdog, 20.0.1
Calibration Constants) and its register map ``ljm_constants``. Registers are 16 bit; 32-bit values take two, high word
first, except in a stream, where a 32-bit register gives its low word and STREAM_DATA_CAPTURE_16 directly after it the
high one.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from drivers.modbus_tcp import FrameError, Frames

# Register addresses; (f) float32, (u) uint32, (h) uint16.
AIN = 0  # (f) + 2 a channel
DAC = 1000  # (f) + 2 a channel
DIO = 2000  # (h) + 1 a line: writing makes the line an output
EF_READ_A = 3000  # (u) + 2 a line
STREAM_SCANRATE_HZ = 4002  # (f)
STREAM_NUM_ADDRESSES = 4004  # (u)
STREAM_SAMPLES_PER_PACKET = 4006  # (u)
STREAM_SETTLING_US = 4008  # (f)
STREAM_RESOLUTION_INDEX = 4010  # (u)
STREAM_BUFFER_SIZE_BYTES = 4012  # (u) a power of two
STREAM_CLOCK_SOURCE = 4014  # (u) 0 internal, 2 external on CIO3
STREAM_AUTO_TARGET = 4016  # (u) 1 Ethernet
STREAM_DATATYPE = 4018  # (u) must be 0; not in the register map, demanded by 3.2.4
STREAM_NUM_SCANS = 4020  # (u) 0: until stopped
STREAM_EXTERNAL_CLOCK_DIVISOR = 4022  # (u)
STREAM_SCANLIST = 4100  # (u) + 2 a slot
STREAM_DATA_CAPTURE_16 = 4899  # (h) high word of the slot before it
STREAM_ENABLE = 4990  # (u)
AIN_RANGE = 40000  # (f) + 2 a channel
AIN_NEGATIVE = 41000  # (h) + 1 a channel; 199 single-ended
EF_ENABLE = 44000  # (u) + 2 a line
EF_INDEX = 44100  # (u) + 2 a line
PRODUCT_ID = 60000  # (f) 7
FIRMWARE = 60004  # (f)
SERIAL = 60028  # (u)
CORE_TIMER = 61520  # (u) 40 MHz
WATCHDOG_ENABLE = 61600  # (u) disable before writing the others
WATCHDOG_TIMEOUT_S = 61604  # (u)
WATCHDOG_DIO_ENABLE = 61630  # (u)
WATCHDOG_DIO_STATE = 61632  # (u)
WATCHDOG_DIO_DIRECTION = 61634  # (u)
WATCHDOG_DIO_INHIBIT = 61636  # (u) bit set: this line is left alone
WATCHDOG_DAC_ENABLE = 61640  # (u) + 10 for DAC1
WATCHDOG_DAC = 61642  # (f) + 10 for DAC1
FLASH_POINTER = 61810  # (u)
FLASH_READ = 61812  # (u) repeated reads go on from the pointer

CALIBRATION_IN_FLASH = 0x3C4000
CORE_TIMER_HZ = 40e6
QUADRATURE = 10  # DIO_EF index
QUADRATURE_PAIRS = (0, 2, 6)  # the even line of each pair that can count
SINGLE_ENDED = 199
MOST_SAMPLES_PER_PACKET = 512  # over TCP
SAMPLES_PER_SECOND = 100_000.0  # the T7's ceiling: channels times scan rate, at resolution index 0 or 1
CLOCK_LINE = 19  # CIO3, external scan clock
SEPARATOR = 0xFFFF  # first sample of the dummy scan that ends an auto-recovery; no AIN ever gives it

STREAM_FUNCTION, STREAM_TYPE = 76, 16
HEADER = struct.Struct(">HHHBBBBHHH")
LONGEST_PACKET = HEADER.size + 2 * MOST_SAMPLES_PER_PACKET


class Status(IntEnum):
    """Status word of a stream packet."""

    OK = 0
    RECOVERING = 2940  # the buffer is full: scans are being skipped while it empties
    RECOVERED = 2941  # this packet holds the separator scan; info = scans skipped
    OVERLAP = 2942  # a scan began before the one before it had ended
    RECOVERY_OVERFLOW = 2943  # so many scans were skipped that their number is not known
    BURST_DONE = 2944  # STREAM_NUM_SCANS scans are done
    BUFFER_FULL = 2945  # the buffer is full and auto-recovery is off: the stream has stopped


SENTENCES = {
    Status.OVERLAP: "a scan began before the last had ended: lower the rate or measure fewer channels",
    Status.RECOVERY_OVERFLOW: "more than 65535 scans were skipped: the host read too slowly, and their number is "
    "not known",
    Status.BUFFER_FULL: "its stream buffer is full: the host read too slowly",
}


@dataclass(frozen=True)
class Packet:
    """One stream packet: bytes still in the device's buffer, status, info word, samples (n,) uint16 in scan order."""

    backlog: int
    status: int
    info: int
    samples: NDArray[np.uint16]


@dataclass(frozen=True)
class ScanList:
    """What one scan measures, in the order in which the T7 does it.

    Analogue first: AIN never gives 0xFFFF, so that the separator scan of an auto-recovery can be distinguished from
    data.

    inputs    AIN numbers
    counters  even DIO lines of the quadrature pairs
    timer     True: CORE_TIMER of every scan, the device's own time of the trigger
    """

    inputs: tuple[int, ...]
    counters: tuple[int, ...]
    timer: bool = True

    @property
    def addresses(self) -> list[int]:
        """Register of every slot; a 32-bit register takes two."""
        wide = [EF_READ_A + 2 * line for line in self.counters] + [CORE_TIMER] * self.timer
        return [AIN + 2 * n for n in self.inputs] + [a for w in wide for a in (w, STREAM_DATA_CAPTURE_16)]

    @property
    def slots(self) -> int:
        return len(self.inputs) + 2 * (len(self.counters) + self.timer)

    @property
    def fastest(self) -> float:
        """Scans/s at the T7's ceiling of samples/s."""
        return SAMPLES_PER_SECOND / self.slots


@dataclass(frozen=True)
class Scans:
    """n scans, decoded. number (n,) of the scan since the stream began, skipped ones counted; codes (n, inputs) uint16.

    Counts (n, counters) int64, 32 bit unsigned; timer (n,) int64, 32 bit unsigned (0 without).
    """

    number: NDArray[np.int64]
    codes: NDArray[np.uint16]
    counts: NDArray[np.int64]
    timer: NDArray[np.int64]
    skipped: int = 0  # scans missing in these numbers, by the device's own count


class Stream:
    """Bytes of the stream connection -> scans."""

    def __init__(self, scan: ScanList) -> None:
        self.scan = scan
        self.backlog = 0  # bytes in the device's buffer, at the last packet
        self._frames = Frames(LONGEST_PACKET)
        self._next = 0

    def feed(self, data: bytes) -> Scans:
        """Scans completed by ``data``.

        Raises FrameError on bytes that are no stream packet, StreamStopped where the T7 ended it.
        """
        number: list[NDArray[np.int64]] = []
        rows: list[NDArray[np.uint16]] = []
        skipped = 0
        for frame in self._frames.feed(data):
            packet = _packet(frame.function, frame.body)
            if packet.status in SENTENCES:
                raise StreamStopped(Status(packet.status))
            if len(packet.samples) % self.scan.slots:
                raise FrameError(f"{len(packet.samples)} samples are no whole scans of {self.scan.slots}")
            self.backlog = packet.backlog
            scans = packet.samples.reshape(-1, self.scan.slots)
            numbers = self._next + np.arange(len(scans), dtype=np.int64)
            self._next += len(scans)
            if packet.status == Status.RECOVERED:
                scans, numbers = self._skip(scans, numbers, packet.info)
                skipped += packet.info
            number.append(numbers)
            rows.append(scans)
        slots = self.scan.slots
        return self._decode(
            np.concatenate(number) if number else np.empty(0, np.int64),
            np.concatenate(rows) if rows else np.empty((0, slots), np.uint16),
            skipped,
        )

    def _skip(
        self, scans: NDArray[np.uint16], numbers: NDArray[np.int64], info: int
    ) -> tuple[NDArray[np.uint16], NDArray[np.int64]]:
        """Takes the separator out and shifts what follows it by the number of skipped scans.

        It is as the separator is one of them, as in the U3's guide, 5.2.12, and as LJM fills the gap.
        """
        at = np.flatnonzero(scans[:, 0] == SEPARATOR)
        if len(at) != 1:
            raise FrameError(f"{len(at)} separator scans in the packet that ends an auto-recovery; expected 1")
        row = np.arange(len(numbers))
        self._next += info - 1
        numbers = numbers + (row > at[0]) * (info - 1)
        return scans[row != at[0]], numbers[row != at[0]]

    def _decode(self, number: NDArray[np.int64], rows: NDArray[np.uint16], skipped: int) -> Scans:
        inputs, counters = len(self.scan.inputs), len(self.scan.counters)
        wide = rows[:, inputs:].astype(np.int64)
        values = wide[:, 0::2] | (wide[:, 1::2] << 16)
        timer = values[:, counters] if self.scan.timer else np.zeros(len(rows), np.int64)
        return Scans(number, rows[:, :inputs], values[:, :counters], timer, skipped)


class StreamStopped(RuntimeError):
    """The T7 ended the stream, and says why."""

    def __init__(self, status: Status) -> None:
        self.status = status
        super().__init__(SENTENCES[status])


def _packet(function: int, body: bytes) -> Packet:
    if function != STREAM_FUNCTION or len(body) < 8 or body[0] != STREAM_TYPE or len(body) % 2:
        raise FrameError(f"function {function} with {len(body)} bytes is not a stream packet")
    backlog, status, info = struct.unpack_from(">HHH", body, 2)
    return Packet(backlog, status, info, np.frombuffer(body, ">u2", offset=8).astype(np.uint16))


def encode_packet(transaction: int, packet: Packet) -> bytes:
    """A stream packet as the T7 sends it."""
    data = packet.samples.astype(">u2").tobytes()
    frame = (transaction & 0xFFFF, 0, HEADER.size - 6 + len(data), 1, STREAM_FUNCTION)
    return HEADER.pack(*frame, STREAM_TYPE, 0, packet.backlog, packet.status, packet.info) + data


@dataclass(frozen=True)
class InputCalibration:
    """Constants of one range of the fast converter, as in the device's flash: volts = slope (code - center)."""

    positive_slope: float = 0.000315805780
    negative_slope: float = -0.000315805800
    center: float = 33523.0

    def volts(self, codes: NDArray[np.uint16]) -> NDArray[np.float64]:
        """Stream codes -> V at the input (20.0.1: below the centre (center - code) negative_slope)."""
        away = codes.astype(np.float64) - self.center
        return np.where(away < 0, -away * self.negative_slope, away * self.positive_slope)

    def codes(self, volts: NDArray[np.float64]) -> NDArray[np.uint16]:
        """The converter itself: V -> nearest code, 0xFFFF never."""
        slope = np.where(np.asarray(volts) < 0, -self.negative_slope, self.positive_slope)
        return np.clip(np.rint(volts / slope + self.center), 0, SEPARATOR - 1).astype(np.uint16)

    @property
    def range_volts(self) -> tuple[float, float]:
        low, high = self.volts(np.array([0, SEPARATOR - 1], np.uint16))
        return float(low), float(high)


def packet_scans(scan: ScanList, rate: float, rows: int | None, seconds: float) -> int:
    """Scans a packet: about ``seconds`` of them, within 512 samples.

    A packet leaves the T7 only when it is full, so that where the number of rows is known, the packet size divides it
    and no row stays behind.
    """
    most = max(1, min(MOST_SAMPLES_PER_PACKET // scan.slots, round(rate * seconds)))
    if rows is None:
        return most
    return max(n for n in range(1, most + 1) if rows % n == 0)
