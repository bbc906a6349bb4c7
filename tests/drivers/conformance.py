"""What every driver of a shape must do.

One function a promise of ``drivers.protocols``, for simulated devices and hardware alike.

``check(specimen)`` asks a device for every shape it has. A laboratory's own driver is checked the same way::

    check(Specimen(make=lambda: my_driver.make("card", my_config, RigContext()), source=EdgeSource.TIMER, rate=100.0))
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from arm_io import DeviceFault
from drivers.blocks import join
from drivers.protocols import (
    AnalogInput,
    AnalogOutput,
    ArmController,
    Device,
    DigitalOutput,
    EdgeSource,
    Identity,
    Latched,
    Polled,
    PositionTracker,
    QuadratureCounter,
    Readings,
    TriggerInput,
)
from tests.drivers.conformance_channels import (
    counters_refuse_what_they_do_not_have,
    lines_are_known_and_made_safe,
    outputs_keep_their_range_and_are_made_safe,
    presets_are_shown_and_registers_wrap,
    readings_have_names_of_their_own,
    the_arm_may_always_be_stopped,
    the_tracker_recalls_its_points,
    volts_are_within_range_or_marked,
)
from tests.drivers.specimen import Specimen, assert_well_formed, latched_rows, open_one, refuses

__all__ = ["Specimen", "check"]


def check(specimen: Specimen) -> list[str]:
    """Asks for everything; returns the names of the promises that this device's shapes make. Raises AssertionError."""
    closed = specimen.make()
    promises: list[Callable[[Specimen], None]] = [closed_device, life_cycle, says_who_it_is, knows_its_ceiling]
    with_values = PositionTracker | QuadratureCounter | AnalogInput | Readings
    if isinstance(closed, Latched) and not isinstance(closed, with_values):
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
        (Readings, readings_have_names_of_their_own),
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


def _acquires(device: object) -> bool:
    return isinstance(device, Latched | Polled | PositionTracker)


# Life cycle


def closed_device(specimen: Specimen) -> None:
    """Making one touches nothing.

    Closed, it can be closed and disarmed, made safe, and says what is wrong when asked for more.
    """
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
    device = open_one(specimen)
    try:
        identity = _identity(device, specimen)
        assert identity.maker and identity.model, "maker and model are required"
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


def rows_are_numbered_from_zero_at_every_arming(specimen: Specimen) -> None:
    device = open_one(specimen)
    assert isinstance(device, Latched)
    try:
        for _ in range(2):
            device.arm(specimen.plan())
            specimen.begin()
            block = latched_rows(specimen, device)
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
    device = open_one(specimen)
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
    device = open_one(specimen)
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
