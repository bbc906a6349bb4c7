"""What a driver with counters, analogue channels, outputs, points or an arm must do.

See ``tests.drivers.conformance``.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from arm_io import DeviceFault
from drivers.blocks import join
from drivers.counting import extend
from drivers.protocols import (
    AnalogInput,
    AnalogOutput,
    ArmController,
    Block,
    CounterMode,
    Device,
    DigitalOutput,
    EdgeSource,
    Latched,
    Polled,
    PositionTracker,
    QuadratureCounter,
    Quality,
    Readings,
)
from tests.drivers.specimen import Specimen, assert_well_formed, latched_rows, open_one, refuses, shape_of

# Counters


def _counts(specimen: Specimen, device: QuadratureCounter) -> Block:
    """Some rows of counts, however this counter makes them."""
    assert isinstance(device, Device)
    device.arm(specimen.plan())
    if isinstance(device, Latched) and specimen.source is not EdgeSource.POLL:
        specimen.begin()
        block = latched_rows(specimen, device)
        specimen.end()
    else:
        assert isinstance(device, Polled)
        blocks = []
        for _ in range(20):
            specimen.wait(1.0 / specimen.rate)
            blocks.append(device.poll())
        counters, inputs, points = shape_of(device)
        block = join(blocks, counters, inputs, points=points)
    device.disarm()
    return block


def presets_are_shown_and_registers_wrap(specimen: Specimen) -> None:
    """A register set near its end goes on from the other end, and extended counts never see it."""
    device = open_one(specimen)
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
                raw = block.counts[(block.quality[:, channel] & Quality.MISSING) == 0, channel]
                assert len(raw), f"channel {channel}: no row has a count"
                assert ((raw >= 0) & (raw < 1 << width)).all(), f"channel {channel}: counts outside {width} bits"
                moved = extend(raw, width, value) - value
                assert np.abs(moved).max() < 1 << (width - 2), (
                    f"channel {channel}: preset {value} is not where it counts from"
                )
    finally:
        device.close()


def counters_refuse_what_they_do_not_have(specimen: Specimen) -> None:
    device = open_one(specimen)
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
    device = open_one(specimen)
    assert isinstance(device, AnalogInput) and isinstance(device, Device)
    try:
        assert device.bits > 0
        low, high = np.array(device.range_volts).T
        assert (low < high).all()
        device.arm(specimen.plan())
        if isinstance(device, Latched) and specimen.source is not EdgeSource.POLL:
            specimen.begin()
            block = latched_rows(specimen, device)
            specimen.end()
        else:
            assert isinstance(device, Polled)
            block = device.poll()
        device.disarm()
        assert block.volts is not None
        quality = block.quality[:, shape_of(device)[0] :][:, : len(low)]
        inside = (block.volts >= low) & (block.volts <= high)
        marked = (quality & (Quality.SATURATED | Quality.MISSING)) != 0
        assert (inside | marked).all(), "a value outside its range without a mark"
    finally:
        device.close()


def lines_are_known_and_made_safe(specimen: Specimen) -> None:
    device = open_one(specimen)
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
    device = open_one(specimen)
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
    device = open_one(specimen)
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


def readings_have_names_of_their_own(specimen: Specimen) -> None:
    device = specimen.make()
    assert isinstance(device, Readings)
    assert device.rate > 0
    assert device.readings
    assert len(set(device.readings)) == len(device.readings)
    assert all(name.isidentifier() for name in device.readings)


def the_arm_may_always_be_stopped(specimen: Specimen) -> None:
    device = open_one(specimen)
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
