"""A device that is asked for its promises, and how it is brought to make rows."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from arm_io import DeviceFault
from drivers.blocks import join
from drivers.protocols import (
    AnalogInput,
    Block,
    Device,
    EdgeSource,
    Latched,
    Plan,
    PositionTracker,
    QuadratureCounter,
    Quality,
    Readings,
)

ALL_BITS = int(sum(Quality))


def _nothing() -> None: ...


@dataclass
class Specimen:
    """A device to be asked.

    make    a closed one; made many times, before and while others are open
    source  what makes its rows, at ``rate`` rows/s
    begin   sets the edges going, after it was armed
    wait    lets s pass
    end     stops the edges, before it is armed again
    ready   what must be open beside it, where a rig is needed for its rows
    """

    make: Callable[[], Device]
    source: EdgeSource
    rate: float
    begin: Callable[[], None] = _nothing
    wait: Callable[[float], None] = time.sleep
    end: Callable[[], None] = _nothing
    ready: Callable[[], None] = _nothing
    checked: list[str] = field(default_factory=list)

    def plan(self, rate: float | None = None, rows: int | None = 100) -> Plan:
        return Plan(self.source, rate or self.rate, rows)


def refuses(call: Callable[[], object], what: str) -> None:
    """A DeviceFault of one line; anything else breaks the promise."""
    try:
        call()
    except DeviceFault as fault:
        assert fault.what and "\n" not in fault.what
    except Exception as error:
        raise AssertionError(f"{what}: {type(error).__name__}: {error}, must be a DeviceFault") from error
    else:
        raise AssertionError(f"{what} is not refused")


def open_one(specimen: Specimen) -> Device:
    specimen.ready()
    device = specimen.make()
    device.open()
    return device


def shape_of(device: object) -> tuple[int, int, bool]:
    """Counters, inputs, and whether there are points."""
    counters = len(device.width) if isinstance(device, QuadratureCounter) else 0
    inputs = len(device.range_volts) if isinstance(device, AnalogInput) else 0
    return counters, inputs, isinstance(device, PositionTracker)


def assert_well_formed(block: Block, device: object) -> None:
    """Dtypes, shapes and marks of ``drivers.protocols.Block``."""
    n, (counters, inputs, points) = len(block), shape_of(device)
    for name in ("number", "host", "tick"):
        column = getattr(block, name)
        assert column.dtype == np.int64 and column.shape == (n,), f"{name} is {column.dtype} {column.shape}"
    assert block.quality.dtype == np.uint8
    assert block.quality.shape == (n, counters + inputs + points), f"quality is {block.quality.shape}"
    assert (block.quality <= ALL_BITS).all()
    readings = len(device.readings) if isinstance(device, Readings) else 0
    for name, width, dtype in (
        ("counts", counters, np.int64),
        ("volts", inputs, np.float64),
        ("points", 3 * points, float),
        ("readings", readings, float),
    ):
        column = getattr(block, name)
        if width:
            assert column is not None, f"no {name}"
            assert column.dtype == dtype and column.shape == (n, width), f"{name} is {column.dtype} {column.shape}"
        else:
            assert column is None, f"{name} of a device without"
    assert (np.diff(block.host) >= 0).all(), "host time goes back"
    missing = (block.quality & Quality.MISSING) != 0
    if block.volts is not None:
        assert np.array_equal(np.isnan(block.volts), missing[:, counters : counters + inputs])
    if block.points is not None:
        assert np.array_equal(np.isnan(block.points).any(axis=1), missing[:, -1])


def latched_rows(specimen: Specimen, device: Latched, rows: int = 20) -> Block:
    """At least so many rows, one under the other."""
    blocks: list[Block] = []
    for _ in range(400):
        specimen.wait(max(2.0 / specimen.rate, 0.005))
        blocks.append(device.read())
        if sum(map(len, blocks)) >= rows:
            break
    counters, inputs, points = shape_of(device)
    readings = len(device.readings) if isinstance(device, Readings) else 0
    block = join(blocks, counters, inputs, points=points, readings=readings)
    assert len(block) >= rows, f"{len(block)} rows came, {rows} were awaited"
    return block
