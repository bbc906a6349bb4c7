"""CiA 406 encoders and IVT-S sensors on python-can's virtual bus, and over Unix sockets between processes."""

from __future__ import annotations

import time
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm_io import DeviceFault
from drivers import RigContext, can_bus
from drivers.blocks import join
from drivers.cia406 import device as cia406
from drivers.cia406.protocol import ABSENT, Rounds
from drivers.isabellenhuette_ivts import device as isabellenhuette_ivts
from drivers.protocols import Block, CounterMode, EdgeSource, Plan, Quality
from sim_backend.protocol import cia406 as sim_cia406
from sim_backend.protocol import isabellenhuette_ivts as sim_ivts
from tests.drivers.swing import counts, swing_wires, volts

POLL = Plan(EdgeSource.POLL, 100.0, None)
SENSORS = [{"command": 0x411 + k, "reply": 0x511 + k, "result": 0x521 + 16 * k} for k in range(2)]


def virtual() -> dict[str, Any]:
    return {"interface": "virtual", "channel": uuid.uuid4().hex}


def sockets(folder: Path) -> dict[str, Any]:
    return {"interface": "unix", "channel": str(folder / "can")}


def together(driver: Any, simulator: Any, where: Any) -> Iterator[tuple[Any, Any]]:
    box = simulator.make("box", where, swing_wires())
    box.open()
    device = driver.make("device", where, RigContext())
    yield device, box
    device.close()
    box.close()


@pytest.fixture(params=["virtual", "unix"])
def bus(request: pytest.FixtureRequest, tmp_path: Path) -> dict[str, Any]:
    return virtual() if request.param == "virtual" else sockets(tmp_path)


@pytest.fixture
def encoders(bus: dict[str, Any]) -> Iterator[tuple[Any, Any]]:
    yield from together(cia406, sim_cia406, cia406.Config(nodes=(1, 2, 5), bits=25, timeout=1.0, **bus))


@pytest.fixture
def one_bus() -> Iterator[tuple[Any, Any]]:
    yield from together(cia406, sim_cia406, cia406.Config(nodes=(1, 2), bits=25, patience=2.0, latest=0.4, **virtual()))


@pytest.fixture
def sensors(bus: dict[str, Any]) -> Iterator[tuple[Any, Any]]:
    where = isabellenhuette_ivts.Config(sensors=SENSORS, period=2, patience=2.0, **bus)
    yield from together(isabellenhuette_ivts, sim_ivts, where)


def poll(device: Any, rows: int, columns: tuple[int, int], every: float = 0.005) -> Block:
    blocks = []
    for _ in range(rows):
        blocks.append(device.poll())
        time.sleep(every)
    return join(blocks, *columns)


def test_encoders_answer_every_sync(encoders: tuple[Any, Any]) -> None:
    device, box = encoders
    identity = device.open()
    assert identity.serial == "E0000001, E0000002, E0000005" and device.check() == []
    device.arm(POLL)
    block = poll(device, 40, (3, 0))
    truth = np.stack([counts(c, block.host) for c in range(3)], axis=1) + (1 << 24)
    assert np.median(np.abs(block.counts - truth)) < 100
    assert not block.quality.any()
    assert box.bus.is_open


def test_rate_of_the_bus_is_a_ceiling(one_bus: tuple[Any, Any]) -> None:
    device, _ = one_bus
    assert device.open().max_rate == pytest.approx(1e6 / (can_bus.frame_bits(0) + 2 * can_bus.frame_bits(4)))
    with pytest.raises(DeviceFault, match="possible with 2 encoders"):
        device.arm(Plan(EdgeSource.POLL, 5000.0, None))
    with pytest.raises(DeviceFault, match="quadrature"):
        device.configure(0, CounterMode.X1)


def test_preset_moves_the_encoder_for_good(one_bus: tuple[Any, Any]) -> None:
    device, _ = one_bus
    device.open()
    device.preset(1, 1000)
    start = time.monotonic_ns()
    device.arm(POLL)
    block = poll(device, 3, (2, 0))
    moved = counts(1, block.host) - counts(1, np.array([start]))
    assert np.median(np.abs(block.counts[:, 1] - 1000 - moved)) < 600


def test_a_late_answer_is_not_the_next_rows(one_bus: tuple[Any, Any]) -> None:
    device, box = one_bus
    device.open()
    device.arm(POLL)
    box.encoders[2].delay = 0.03  # the row waits for 10 ms
    block = poll(device, 20, (2, 0), 0.008)
    box.encoders[2].delay = 0.0
    given = block.quality == 0
    assert not given[:, 1].any() and 2 < given[:, 0].sum() < 10  # no SYNC while one is owed
    time.sleep(0.05)
    block = poll(device, 5, (2, 0))
    truth = counts(1, block.host) + (1 << 24)
    assert not block.quality.any() and np.median(np.abs(block.counts[:, 1] - truth)) < 100


def test_an_encoder_that_falls_silent_is_missing_alone_and_costs_no_rate(one_bus: tuple[Any, Any]) -> None:
    device, box = one_bus
    device.open()
    device.arm(POLL)
    device._rounds = Rounds((1, 2), 0.02)
    box.encoders[1].mute = True
    end = time.monotonic() + 5
    while device._rounds.nodes[1].silent < ABSENT:
        assert time.monotonic() < end
        assert device.poll().quality[0, 0] & Quality.MISSING
    begun = time.monotonic()
    block = poll(device, 10, (2, 0), 0.0)
    assert time.monotonic() - begun < 10 * device.config.timeout
    assert (block.quality[:, 0] == Quality.MISSING).all() and not block.quality[:, 1].any()
    box.encoders[1].mute = False
    assert not poll(device, 10, (2, 0), 0.01).quality[-1].any()


def test_an_encoder_that_restarts_is_set_up_again_and_marked(one_bus: tuple[Any, Any]) -> None:
    device, box = one_bus
    device.open()
    device.arm(POLL)
    poll(device, 3, (2, 0))
    box.restart(2)
    time.sleep(0.02)
    block = poll(device, 30, (2, 0))
    assert block.quality[-1].tolist() == [0, Quality.DEVICE_RESET]
    truth = counts(1, block.host) + (1 << 24)
    assert np.median(np.abs(block.counts[-20:, 1] - truth[-20:])) < 200


def test_bus_off_is_a_gap_and_is_recovered_from(one_bus: tuple[Any, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    import can

    device, _ = one_bus
    device.open()
    device.arm(POLL)
    assert not poll(device, 3, (2, 0)).quality.any()

    def off(message: can.Message, timeout: float | None = None) -> None:
        raise can.CanOperationError("bus off")

    monkeypatch.setattr(device._bus._bus, "send", off)  # the adapter's word for it; reopening makes a new one
    assert (device.poll().quality == Quality.MISSING).all()
    assert "terminators" in device.check()[0]
    block = poll(device, 60, (2, 0), 0.01)
    assert not block.quality[-1].any()


def test_an_encoder_that_restarted_while_the_bus_was_off_is_marked(
    one_bus: tuple[Any, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """No message reports that it booted; its lost settings show it."""
    import can

    device, box = one_bus
    device.open()
    device.arm(POLL)
    assert not poll(device, 3, (2, 0)).quality.any()
    box.close()
    box.restart(2)
    box.open()

    def off(message: can.Message, timeout: float | None = None) -> None:
        raise can.CanOperationError("bus off")

    monkeypatch.setattr(device._bus._bus, "send", off)
    assert (device.poll().quality & Quality.MISSING).all()
    block = poll(device, 60, (2, 0), 0.01)
    assert block.quality[-1].tolist() == [Quality.GOOD, Quality.DEVICE_RESET]


def test_another_encoder_with_its_node_number_is_not_taken_for_it(one_bus: tuple[Any, Any]) -> None:
    device, box = one_bus
    device.open()
    device.arm(POLL)
    poll(device, 3, (2, 0))
    box.encoders[2].node.data_store[0x1018] = {4: (77).to_bytes(4, "little")}
    box.bus.send(0x700 + 2, b"\x00")  # it boots
    with pytest.raises(DeviceFault, match="node 2 is another encoder: serial number 0000004D, not E0000002"):
        end = time.monotonic() + 6
        while time.monotonic() < end:
            poll(device, 1, (2, 0))


def test_bus_off_of_a_shared_bus_is_recovered_from_by_both(monkeypatch: pytest.MonkeyPatch) -> None:
    import can

    bus = virtual()
    here = cia406.Config(nodes=(1,), bits=25, timeout=0.2, **bus)
    there = isabellenhuette_ivts.Config(sensors=SENSORS[:1], period=5, **bus)
    boxes = [sim_cia406.make("e", here, swing_wires()), sim_ivts.make("i", there, swing_wires())]
    context = RigContext()
    devices = [cia406.make("e", here, context), isabellenhuette_ivts.make("i", there, context)]
    for each in boxes + devices:
        each.open()
    for device in devices:
        device.arm(POLL)

    def off(message: can.Message, timeout: float | None = None) -> None:
        raise can.CanOperationError("bus off")

    monkeypatch.setattr(devices[0]._bus._bus, "send", off)
    assert (devices[0].poll().quality == Quality.MISSING).all()
    while not (devices[1].poll().quality & (Quality.STALE | Quality.MISSING)).all():
        time.sleep(0.005)  # nothing is heard of a bus that is off
    end = time.monotonic() + 5
    while any((device.poll().quality != 0).any() for device in devices):
        assert time.monotonic() < end
        time.sleep(0.005)
    for each in devices + boxes:
        each.close()


def test_a_bus_with_nobody_on_it() -> None:
    where = cia406.Config(nodes=(9,), **virtual())
    device = cia406.make("nobody", where, RigContext())
    with pytest.raises(DeviceFault, match="node 9, object 1000h"):
        device.open()
    sensor = isabellenhuette_ivts.make("nobody", isabellenhuette_ivts.Config(**virtual()), RigContext())
    with pytest.raises(DeviceFault, match="did not answer"):
        sensor.open()
    absent = cia406.make("absent", cia406.Config(nodes=(9,), interface="socketcan", channel="can7"), RigContext())
    with pytest.raises(DeviceFault, match="adapter"):
        absent.open()


def test_a_node_that_is_no_encoder_or_counts_otherwise() -> None:
    where = cia406.Config(nodes=(1,), bits=25, **virtual())
    box = sim_cia406.make("box", where, swing_wires())
    box.open()
    other = cia406.Config(nodes=(1,), bits=24, interface=where.interface, channel=where.channel)
    with pytest.raises(DeviceFault, match="correct 'bits'"):
        cia406.make("other", other, RigContext()).open()
    box.encoders[1].node.data_store[0x1000] = {0: (401).to_bytes(4, "little")}
    with pytest.raises(DeviceFault, match="profile is 401"):
        cia406.make("device", where, RigContext()).open()
    box.close()


def test_currents_are_those_on_the_wires(sensors: tuple[Any, Any]) -> None:
    device, _ = sensors
    identity = device.open()
    assert identity.maker == "Isabellenhuette" and identity.details["unit"] == "A"
    device.arm(POLL)
    block, end = poll(device, 40, (0, 2)), time.monotonic() + 5
    while not (fresh := block.quality == 0).mean() > 0.5:
        # a process that a busy machine stops for a while has stale rows, whatever the sensors do
        assert time.monotonic() < end
        block = poll(device, 40, (0, 2))
    truth = np.stack([volts(k, block.host) for k in range(2)], axis=1)
    assert np.median(np.abs(block.volts - truth)[fresh]) < 0.03  # a period of 2 ms at 9.4 A/s, and rounding to 1 mA
    assert device.check() == [] or "lost" in device.check()[0]


def test_lost_results_are_found_by_the_counter(sensors: tuple[Any, Any]) -> None:
    device, box = sensors
    device.open()
    device.arm(POLL)
    poll(device, 5, (0, 2))
    before = [r.lost for r in device._results]
    with box._lock:
        box.sensors[1].drop = 3
    block = poll(device, 20, (0, 2))
    assert device._results[1].lost >= before[1] + 3
    assert (block.quality[:, 1] & Quality.LATE).any()
    assert "lost" in " ".join(device.check())


def test_sensors_that_fall_silent_are_stale_then_sought(sensors: tuple[Any, Any]) -> None:
    device, box = sensors
    device.open()
    device.arm(POLL)
    poll(device, 3, (0, 2))
    box.mute = True
    time.sleep(0.05)
    poll(device, 1, (0, 2))
    assert (device.poll().quality & Quality.STALE).all()
    time.sleep(0.15)
    device.poll()
    assert (device.poll().quality == Quality.MISSING).all()
    box.mute = False
    block = poll(device, 80, (0, 2), 0.01)
    assert (block.quality[-20:] == 0).any(axis=0).all()


def test_a_sensor_that_restarts_is_set_up_again(sensors: tuple[Any, Any]) -> None:
    """It says that it is alive; as delivered it would give a result every 20 ms, and voltages too."""
    device, box = sensors
    identity = device.open()
    assert identity.firmware == "3.1.7" and identity.serial == "0000162e, 0000162e"
    device.arm(POLL)
    assert not (poll(device, 5, (0, 2)).quality & Quality.MISSING).any()
    box.restart(1)
    assert box.sensors[1].period[0] == 0.02
    end = time.monotonic() + 5
    while box.sensors[1].period != [0.002] + 7 * [0.0]:
        assert time.monotonic() < end
        poll(device, 1, (0, 2))
    block = poll(device, 40, (0, 2))
    truth = np.stack([volts(k, block.host) for k in range(2)], axis=1)
    fresh = block.quality == 0
    assert fresh[:, 1].any() and np.median(np.abs(block.volts - truth)[fresh]) < 0.03


def test_a_sensor_made_for_another_current_is_told() -> None:
    bus = virtual()
    box = sim_ivts.make("box", isabellenhuette_ivts.Config(rated_current=100.0, **bus), swing_wires())
    box.open()
    device = isabellenhuette_ivts.make("device", isabellenhuette_ivts.Config(rated_current=300.0, **bus), RigContext())
    device.open()
    assert device.check()[0] == "the sensor at 521h is made for 100 A, not 300: correct 'rated_current'"
    device.close()
    box.close()


def test_two_drivers_share_one_bus() -> None:
    bus = virtual()
    here = cia406.Config(nodes=(1,), bits=25, timeout=1.0, **bus)
    there = isabellenhuette_ivts.Config(sensors=SENSORS[:1], period=5, **bus)
    boxes = [sim_cia406.make("e", here, swing_wires()), sim_ivts.make("i", there, swing_wires())]
    for box in boxes:
        box.open()
    context = RigContext()
    devices = [cia406.make("e", here, context), isabellenhuette_ivts.make("i", there, context)]
    for device in devices:
        device.open()
        device.arm(POLL)
    assert devices[0]._bus is devices[1]._bus
    for _ in range(5):
        assert not devices[0].poll().quality.any()
        assert not (devices[1].poll().quality & Quality.MISSING).any()
    devices[0].close()
    assert not (devices[1].poll().quality & Quality.MISSING).any()  # the bus stays while one needs it
    devices[1].close()
    for box in boxes:
        box.close()
