"""Setup of a LabJack T7 before it measures: identity, watchdog, counters, stream."""

from __future__ import annotations

import struct
from collections.abc import Iterable

from drivers.labjack_t7 import protocol as t7
from drivers.labjack_t7.link import T7Link
from drivers.protocols import EdgeSource, Plan

BUFFER_BYTES = 32768  # the T7's largest
ALL_LINES = 0x7FFFFF  # DIO0 to DIO22


def read_calibration(link: T7Link) -> t7.InputCalibration | None:
    """Constants of the +-10 V range from the device's flash; None where they make no sense."""
    link.write_uint(t7.FLASH_POINTER, t7.CALIBRATION_IN_FLASH)
    positive, negative, center, _ = struct.unpack(">4f", link.read(t7.FLASH_READ, 8))
    if not (1e-4 < positive < 1e-3 and -1e-3 < negative < -1e-4 and 3e4 < center < 4e4):
        return None
    return t7.InputCalibration(positive, negative, center)


def set_outputs_low(link: T7Link, lines: Iterable[int]) -> None:
    """Lines low, both DACs at 0 V."""
    for address, data in _outputs_low(lines):
        link.write(address, data)


def force_outputs_low(link: T7Link, lines: Iterable[int]) -> None:
    """As ``set_outputs_low``; if that fails, each output is written on its own over a new connection.

    OSError if the T7 accepts no connection; its own watchdog then remains.
    """
    writes = _outputs_low(lines)
    try:
        for address, data in writes:
            link.write(address, data)
    except OSError:
        link.write_afresh(writes)


def _outputs_low(lines: Iterable[int]) -> list[tuple[int, bytes]]:
    """Register and data of each output in its safe state."""
    low = [(t7.DIO + line, struct.pack(">H", 0)) for line in lines]
    return low + [(t7.DAC + 2 * dac, struct.pack(">f", 0.0)) for dac in (0, 1)]


def set_watchdog(link: T7Link, lines: Iterable[int], seconds: int) -> None:
    """The T7 lowers ``lines`` and zeroes its DACs itself after ``seconds`` without a command.

    0: never (datasheet 23.0).

    The settings live in flash, which wears: they are written only where they differ.
    """
    driven = sum(1 << line for line in lines)
    wanted: list[tuple[int, bytes]] = [
        (t7.WATCHDOG_TIMEOUT_S, struct.pack(">I", max(1, seconds))),
        (t7.WATCHDOG_DIO_ENABLE, struct.pack(">I", int(driven != 0))),
        (t7.WATCHDOG_DIO_STATE, struct.pack(">I", 0)),
        (t7.WATCHDOG_DIO_DIRECTION, struct.pack(">I", driven)),
        (t7.WATCHDOG_DIO_INHIBIT, struct.pack(">I", ALL_LINES & ~driven)),
    ]
    for dac in (0, 1):
        wanted.append((t7.WATCHDOG_DAC_ENABLE + 10 * dac, struct.pack(">I", 1)))
        wanted.append((t7.WATCHDOG_DAC + 10 * dac, struct.pack(">f", 0.0)))
    enabled = int(seconds > 0)
    same = all(link.read(address, 2) == data for address, data in wanted)
    if same and link.read_uint(t7.WATCHDOG_ENABLE) == enabled:
        return
    link.write_uint(t7.WATCHDOG_ENABLE, 0)
    for address, data in wanted:
        link.write(address, data)
    link.write_uint(t7.WATCHDOG_ENABLE, enabled)


def start_counter(link: T7Link, line: int) -> None:
    """Starts quadrature counting x4 on lines ``line`` and ``line`` + 1, from 0.

    The index is written while the counter is disabled (datasheet 13.2).
    """
    for register, value in ((t7.EF_ENABLE, 0), (t7.EF_INDEX, t7.QUADRATURE), (t7.EF_ENABLE, 1)):
        for phase in (line, line + 1):
            link.write_uint(register + 2 * phase, value)


def counter_runs(link: T7Link, line: int) -> bool:
    """False after a power-up: an extended feature is off until it is configured."""
    return link.read_uint(t7.EF_INDEX + 2 * line) == t7.QUADRATURE and link.read_uint(t7.EF_ENABLE + 2 * line) == 1


def set_stream(link: T7Link, scan: t7.ScanList, plan: Plan, rows_left: int | None) -> None:
    """Everything about the stream but its start."""
    external = plan.source == EdgeSource.TRACKER
    scans = t7.packet_scans(scan, plan.rate, rows_left, plan.block_seconds)
    link.write_uint(t7.STREAM_ENABLE, 0)
    for n in scan.inputs:
        link.write_float(t7.AIN_RANGE + 2 * n, 10.0)
        link.write_word(t7.AIN_NEGATIVE + n, t7.SINGLE_ENDED)
    link.write_float(t7.STREAM_SCANRATE_HZ, plan.rate)
    link.write_uint(t7.STREAM_NUM_ADDRESSES, scan.slots)
    link.write_uint(t7.STREAM_SAMPLES_PER_PACKET, scans * scan.slots)
    link.write_float(t7.STREAM_SETTLING_US, 0.0)
    link.write_uint(t7.STREAM_RESOLUTION_INDEX, 0)
    link.write_uint(t7.STREAM_BUFFER_SIZE_BYTES, BUFFER_BYTES)
    link.write_uint(t7.STREAM_CLOCK_SOURCE, 2 if external else 0)
    if external:
        link.write_uint(t7.STREAM_EXTERNAL_CLOCK_DIVISOR, 1)
    link.write_uint(t7.STREAM_AUTO_TARGET, 1)
    link.write_uint(t7.STREAM_DATATYPE, 0)
    link.write_uint(t7.STREAM_NUM_SCANS, 0)
    for slot, address in enumerate(scan.addresses):
        link.write_uint(t7.STREAM_SCANLIST + 2 * slot, address)
