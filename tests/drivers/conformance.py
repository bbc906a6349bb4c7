"""What every driver of a shape must do: one function a promise of ``drivers.shapes``, for simulated devices and hardware alike.

``check(specimen)`` asks a device for every shape it has. A laboratory's own driver is checked the same way::

    check(Specimen(make=lambda: my_driver.make("card", my_config, {}), source=EdgeSource.TIMER, rate=100.0))
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from drivers.blocks import join
from drivers.counting import extend
from drivers.shapes import (
    AnalogInput,
    AnalogOutput,
    ArmController,
    Block,
    CounterMode,
    Device,
    DigitalOutput,
    EdgeSource,
    Identity,
    Latched,
    Plan,
    Polled,
    PositionTracker,
    QuadratureCounter,
    Quality,
    TriggerInput,
)
from inputs import DeviceFault

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


def check(specimen: Specimen) -> list[str]:
    """Asks for everything; returns the names of the promises that this device's shapes make. Raises AssertionError."""
    closed = specimen.make()
    promises: list[Callable[[Specimen], None]] = [closed_device, life_cycle, says_who_it_is, knows_its_ceiling]
    if isinstance(closed, Latched) and not isinstance(closed, PositionTracker | QuadratureCounter | AnalogInput):
        raise AssertionError(f"{closed.name} makes rows without any values")
    shapes: list[tuple[type, Callable[[Specimen], None]]] = [
        (Latched, rows_are_numbered_from_zero_at_every_arming),
        (TriggerInput, edges_are_blocks_without_values),
        (Polled, polled_rows_are_of_the_time_of_asking),
        (QuadratureCounter, presets_are_shown_and_registers_wrap),
        (QuadratureCounter, counters_refuse_what_they_do_not_have),
        (AnalogInput, volts_are_within_range_or_marked),
        (DigitalOutput, lines_are_known_and_made_safe),
        (AnalogOutput, outputs_keep_their_range_and_are_made_safe),
        (PositionTracker, the_tracker_recalls_its_points),
        (ArmController, the_arm_may_always_be_stopped),
    ]
    promises += [promise for shape, promise in shapes if isinstance(closed, shape)]
    for promise in promises:
        try:
            promise(specimen)
        except (AssertionError, DeviceFault) as error:
            raise AssertionError(f"{closed.name}: {promise.__name__.replace('_', ' ')}: {error}") from error
        specimen.checked.append(promise.__name__)
    return specimen.checked


def refuses(call: Callable[[], object], what: str) -> None:
    """A DeviceFault of one line; anything else breaks the promise."""
    try:
        call()
    except DeviceFault as fault:
        assert fault.what and "\n" not in fault.what
    except Exception as error:
        raise AssertionError(f"{what}: {type(error).__name__}: {error}, where a DeviceFault is wanted") from error
    else:
        raise AssertionError(f"{what} is not refused")


def _open(specimen: Specimen) -> Device:
    specimen.ready()
    device = specimen.make()
    device.open()
    return device


def _acquires(device: object) -> bool:
    return isinstance(device, Latched | Polled | PositionTracker)


# Life cycle


def closed_device(specimen: Specimen) -> None:
    """Making one touches nothing; closed, it can be closed and disarmed, made safe, and says what is wrong when asked for more."""
    device = specimen.make()
    assert isinstance(device, Device)
    if isinstance(device, DigitalOutput | AnalogOutput):
        device.safe()
    device.close()
    device.close()
    if _acquires(device):
        refuses(lambda: device.arm(specimen.plan()), "arming a closed device")


def life_cycle(specimen: Specimen) -> None:
    """open -> (arm -> disarm)* -> close, and all of it again."""
    specimen.ready()
    device = specimen.make()
    first = device.open()
    for _ in range(2):
        device.arm(specimen.plan())
        device.disarm()
        device.disarm()
    device.close()
    device.close()
    again = device.open()
    for name in ("maker", "model", "serial", "firmware", "memory", "bits"):
        assert getattr(again, name) == getattr(first, name), f"{name} is another one after it was closed and opened"
    device.close()


def says_who_it_is(specimen: Specimen) -> None:
    device = _open(specimen)
    try:
        identity = _identity(device, specimen)
        assert identity.maker and identity.model, "maker and model are wanted"
        assert identity.max_rate is None or identity.max_rate > 0
        assert identity.memory is None or identity.memory > 0
        assert identity.latch_delay >= 0 and identity.channel_skew >= 0
        assert isinstance(device.check(), list)
        assert all(isinstance(line, str) and "\n" not in line for line in device.check())
    finally:
        device.close()


def _identity(device: Device, specimen: Specimen) -> Identity:
    device.close()
    specimen.ready()
    return device.open()


def knows_its_ceiling(specimen: Specimen) -> None:
    """A rate above the stated ceiling is refused, and the device can still be used."""
    device = specimen.make()
    specimen.ready()
    identity = device.open()
    try:
        if identity.max_rate is not None and _acquires(device):
            too_fast = specimen.plan(identity.max_rate * 1.5)
            refuses(lambda: device.arm(too_fast), "a rate above max_rate")
            device.arm(specimen.plan())
            device.disarm()
    finally:
        device.close()


# Rows


def _shape(device: object) -> tuple[int, int, bool]:
    """Counters, inputs, and whether there are points."""
    counters = len(device.width) if isinstance(device, QuadratureCounter) else 0
    inputs = len(device.range_volts) if isinstance(device, AnalogInput) else 0
    return counters, inputs, isinstance(device, PositionTracker)


def assert_well_formed(block: Block, device: object) -> None:
    """Dtypes, shapes and marks of ``drivers.shapes.Block``."""
    n, (counters, inputs, points) = len(block), _shape(device)
    for name in ("number", "host", "tick"):
        column = getattr(block, name)
        assert column.dtype == np.int64 and column.shape == (n,), f"{name} is {column.dtype} {column.shape}"
    assert block.quality.dtype == np.uint8
    assert block.quality.shape == (n, counters + inputs + points), f"quality is {block.quality.shape}"
    assert (block.quality <= ALL_BITS).all()
    for name, width, dtype in (
        ("counts", counters, np.int64),
        ("volts", inputs, np.float64),
        ("points", 3 * points, float),
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


def _rows(specimen: Specimen, device: Latched, rows: int = 20) -> Block:
    """At least so many rows, one under the other."""
    blocks: list[Block] = []
    for _ in range(400):
        specimen.wait(max(2.0 / specimen.rate, 0.005))
        blocks.append(device.read())
        if sum(map(len, blocks)) >= rows:
            break
    counters, inputs, points = _shape(device)
    block = join(blocks, counters, inputs, points=points)
    assert len(block) >= rows, f"{len(block)} rows came, {rows} were awaited"
    return block


def rows_are_numbered_from_zero_at_every_arming(specimen: Specimen) -> None:
    device = _open(specimen)
    assert isinstance(device, Latched)
    try:
        for _ in range(2):
            device.arm(specimen.plan())
            specimen.begin()
            block = _rows(specimen, device)
            specimen.end()
            device.disarm()
            assert_well_formed(block, device)
            if (block.number >= 0).all():
                assert block.number[0] == 0, f"the first row has number {block.number[0]}"
                assert (np.diff(block.number) > 0).all(), "numbers do not increase"
            else:
                assert (block.number == -1).all(), "some rows are numbered and some are not"
            assert (block.tick == 0).all() or (np.diff(block.tick) > 0).all(), "the device's clock does not go on"
    finally:
        device.close()


def edges_are_blocks_without_values(specimen: Specimen) -> None:
    device = _open(specimen)
    assert isinstance(device, TriggerInput) and isinstance(device, Device)
    try:
        device.arm(specimen.plan())
        specimen.begin()
        blocks = []
        for _ in range(40):
            specimen.wait(max(1.0 / specimen.rate, 0.005))
            if isinstance(device, Latched):
                device.read()
            blocks.append(device.read_edges())
        specimen.end()
        device.disarm()
        block = join(blocks)
        assert len(block) > 5, "no edges came"
        assert block.counts is None and block.volts is None and block.points is None
        if device.numbered:
            assert block.number[0] == 0 and (np.diff(block.number) > 0).all()
    finally:
        device.close()


def polled_rows_are_of_the_time_of_asking(specimen: Specimen) -> None:
    device = _open(specimen)
    assert isinstance(device, Polled)
    try:
        if specimen.source is EdgeSource.POLL:
            device.arm(specimen.plan())
        last = 0
        for _ in range(5):
            specimen.wait(2.0 / specimen.rate)
            block = device.poll()
            assert len(block) == 1 and block.number[0] == -1
            assert_well_formed(block, device)
            assert block.host[0] >= last
            last = int(block.host[0])
    finally:
        device.close()


# Counters


def _counts(specimen: Specimen, device: QuadratureCounter) -> Block:
    """Some rows of counts, however this counter makes them."""
    assert isinstance(device, Device)
    device.arm(specimen.plan())
    if isinstance(device, Latched) and specimen.source is not EdgeSource.POLL:
        specimen.begin()
        block = _rows(specimen, device)
        specimen.end()
    else:
        assert isinstance(device, Polled)
        blocks = []
        for _ in range(20):
            specimen.wait(1.0 / specimen.rate)
            blocks.append(device.poll())
        counters, inputs, points = _shape(device)
        block = join(blocks, counters, inputs, points=points)
    device.disarm()
    return block


def presets_are_shown_and_registers_wrap(specimen: Specimen) -> None:
    """A register set near its end goes on from the other end, and extended counts never see it."""
    device = _open(specimen)
    assert isinstance(device, QuadratureCounter)
    try:
        for channel, width in enumerate(device.width):
            for value in ((1 << width) - 3, 3, 1 << (width - 2)):
                try:
                    device.preset(channel, value)
                except DeviceFault:  # an absolute encoder that keeps its own zero says so
                    continue
                block = _counts(specimen, device)
                assert block.counts is not None
                raw = block.counts[:, channel]
                assert ((raw >= 0) & (raw < 1 << width)).all(), f"channel {channel}: counts outside {width} bits"
                moved = extend(raw, width, value) - value
                assert np.abs(moved).max() < 1 << (width - 2), (
                    f"channel {channel}: preset {value} is not where it counts from"
                )
    finally:
        device.close()


def counters_refuse_what_they_do_not_have(specimen: Specimen) -> None:
    device = _open(specimen)
    assert isinstance(device, QuadratureCounter)
    try:
        absent = len(device.width)
        for mode in CounterMode:
            try:
                device.configure(0, mode)
            except DeviceFault as fault:
                assert "x" in fault.what, "a mode that it lacks is refused without saying which it has"
        refuses(lambda: device.configure(absent, CounterMode.X4), f"configuring channel {absent}")
        refuses(lambda: device.preset(absent, 0), f"a preset of channel {absent}")
        refuses(lambda: device.index_enable(absent), f"the index of channel {absent}")
        try:
            device.index_enable(0)
        except DeviceFault:
            return
        seen = device.index_seen(0)
        assert seen is None or isinstance(seen, int)
    finally:
        device.close()


# Analogue inputs, outputs


def volts_are_within_range_or_marked(specimen: Specimen) -> None:
    device = _open(specimen)
    assert isinstance(device, AnalogInput) and isinstance(device, Device)
    try:
        assert device.bits > 0
        low, high = np.array(device.range_volts).T
        assert (low < high).all()
        device.arm(specimen.plan())
        if isinstance(device, Latched) and specimen.source is not EdgeSource.POLL:
            specimen.begin()
            block = _rows(specimen, device)
            specimen.end()
        else:
            assert isinstance(device, Polled)
            block = device.poll()
        device.disarm()
        assert block.volts is not None
        quality = block.quality[:, _shape(device)[0] :][:, : len(low)]
        inside = (block.volts >= low) & (block.volts <= high)
        marked = (quality & (Quality.SATURATED | Quality.MISSING)) != 0
        assert (inside | marked).all(), "a value outside its range without a mark"
    finally:
        device.close()


def lines_are_known_and_made_safe(specimen: Specimen) -> None:
    device = _open(specimen)
    assert isinstance(device, DigitalOutput) and isinstance(device, Device)
    try:
        assert len(set(device.lines)) == len(device.lines)
        for line in device.lines:
            device.write_line(line, True)
            device.write_line(line, False)
        refuses(lambda: device.write_line("no such line", True), "an unknown line")
        device.safe()
        device.safe()
    finally:
        device.close()
    device.safe()


def outputs_keep_their_range_and_are_made_safe(specimen: Specimen) -> None:
    device = _open(specimen)
    assert isinstance(device, AnalogOutput) and isinstance(device, Device)
    try:
        for channel, (low, high) in enumerate(device.output_range):
            assert low <= 0 <= high, "0 V, the safe state, is outside the range"
            device.write_volts(channel, (low + high) / 2)
            for volts in (low - 1.0, high + 1.0):
                refuses(partial(device.write_volts, channel, volts), f"{volts:g} V on output {channel}")
        refuses(lambda: device.write_volts(len(device.output_range), 0.0), "an unknown output")
        device.safe()
    finally:
        device.close()
    device.safe()


# Tracker and arm


def the_tracker_recalls_its_points(specimen: Specimen) -> None:
    device = _open(specimen)
    assert isinstance(device, PositionTracker) and isinstance(device, Device)
    try:
        assert device.rate > 0 and device.memory >= 0
        device.arm(specimen.plan())
        specimen.begin()
        specimen.wait(30 / specimen.rate)
        specimen.end()
        device.disarm()
        try:
            block = device.recall()
        except DeviceFault:  # one that keeps none says so
            return
        assert_well_formed(block, device)
        assert len(block) <= device.memory
        assert (np.diff(block.number) > 0).all() and (len(block) == 0 or block.number[0] >= 0)
    finally:
        device.close()


def the_arm_may_always_be_stopped(specimen: Specimen) -> None:
    device = _open(specimen)
    assert isinstance(device, ArmController) and isinstance(device, Device)
    try:
        assert device.joints > 0
        device.stop()
        refuses(lambda: device.load("anything but an experiment"), "something else than an experiment")
        refuses(device.start, "a start without an experiment")
        device.stop()
        assert device.finished() in (True, False)
        demand = device.demand(np.array([0.0, 0.1]))
        assert demand is None or demand.shape == (2, device.joints)
    finally:
        device.close()
