"""The conformance suite over every driver that there is, each against its simulator."""

from __future__ import annotations

import importlib
import os
import pkgutil
import sys
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest

import drivers
import sim_backend
from drivers import RigContext
from drivers.protocols import Device, EdgeSource, Plan
from sim_backend import navigation
from sim_backend.protocol.wires import Wires
from sim_backend.rig.clock import FastClock
from tests.daq import instruments
from tests.drivers.conformance import Specimen, check
from tests.drivers.swing import counts, swing_wires, volts
from tests.drivers.test_comedi_ni_labpc import fake_comedilib
from tests.drivers.test_val_terminal import StraightArm
from tests.ports import free_port

POLL, TIMER, TRACKER = EdgeSource.POLL, EdgeSource.TIMER, EdgeSource.TRACKER


@contextmanager
def on_its_wire(
    name: str, options: dict[str, Any], wires: Wires | None = None
) -> Iterator[tuple[Callable[[], Device], Any]]:
    """A way to make the driver's devices, and the simulator that they talk to, at work."""
    driver = importlib.import_module(f"drivers.{name}")
    simulator = importlib.import_module(f"sim_backend.protocol.{name}")
    where = driver.Config.model_validate(options)
    box = simulator.make(name, where, wires or swing_wires())
    box.open()
    try:
        yield lambda: driver.make(name, where, RigContext()), box
    finally:
        box.close()


@contextmanager
def polled(name: str, options: dict[str, Any]) -> Iterator[Specimen]:
    with on_its_wire(name, options) as (make, _):
        yield Specimen(make, POLL, 50.0)


def virtual_bus() -> dict[str, Any]:
    return {"interface": "virtual", "channel": uuid.uuid4().hex}


def us_digital_qsb(tmp: Path) -> Any:
    return polled("us_digital_qsb", {"port": str(tmp / "qsb"), "timeout": 1.0})


def us_digital_ad4b(tmp: Path) -> Any:
    return polled("us_digital_ad4b", {"port": str(tmp / "ad4b"), "timeout": 1.0})


def cia406(tmp: Path) -> Any:
    return polled("cia406", {"nodes": (1, 2), "bits": 25, "timeout": 0.5, **virtual_bus()})


@contextmanager
def cia406_on_a_nodes_syncs(tmp: Path) -> Iterator[Specimen]:
    with on_its_wire("cia406", {"nodes": (1, 2), "bits": 25, "sync": 2, **virtual_bus()}) as (make, _):
        yield Specimen(make, TIMER, 200.0)


def isabellenhuette_ivts(tmp: Path) -> Any:
    sensors = [{"command": 0x411 + k, "reply": 0x511 + k, "result": 0x521 + 16 * k} for k in range(2)]
    return polled("isabellenhuette_ivts", {"sensors": sensors, "period": 2, **virtual_bus()})


def linux_counter(tmp: Path) -> Any:
    return polled("linux_counter", {"sysfs": str(tmp), "counts": (0, 2)})


@contextmanager
def labjack_t7(tmp: Path) -> Iterator[Specimen]:
    options = {"host": "127.0.0.1", "port": free_port(), "stream_port": free_port(), "timeout": 0.5}
    with on_its_wire("labjack_t7", options) as (make, _):
        yield Specimen(make, TIMER, 500.0)


@contextmanager
def tracker_stream(tmp: Path) -> Iterator[Specimen]:
    options = {"port": free_port(), "unit": "mm", "memory": 400, "rate": 500.0, "file": str(tmp / "points.csv")}
    with on_its_wire("tracker_stream", options) as (make, box):
        yield Specimen(make, TRACKER, 500.0, begin=lambda: box.start(time.monotonic_ns()), end=box.stop)


@contextmanager
def val_terminal(tmp: Path) -> Iterator[Specimen]:
    wires = Wires(counts=counts, volts=volts, arm=StraightArm())
    with on_its_wire("val_terminal", {"port": str(tmp / "val"), "answer_timeout": 0.5}, wires) as (make, _):
        yield Specimen(make, POLL, 50.0)


@contextmanager
def comedi_ni_labpc(tmp: Path) -> Iterator[Specimen]:
    from drivers import comedi_ni_labpc as driver

    library = fake_comedilib()
    before = sys.modules.get("comedi")
    sys.modules["comedi"] = library

    def scans(seconds: float) -> None:
        time.sleep(seconds)
        os.write(library.writing, b"\0\x04" * 4 * round(seconds * 1000))

    try:
        yield Specimen(lambda: driver.make("card", driver.Config(inputs=4), RigContext()), TIMER, 1000.0, wait=scans)
    finally:
        sys.modules.pop("comedi") if before is None else sys.modules.__setitem__("comedi", before)
        os.close(library.reading)
        os.close(library.writing)


@contextmanager
def simulated(name: str, options: dict[str, Any], root: Path) -> Iterator[Specimen]:
    """A device of the simulated rig; the tracker beside it makes the edges once the Lab-PC raises the start line."""
    context = RigContext(simulation={"pace": "fast"}, model=root / "config/models/puma560.toml")

    def make(driver: str, **table: Any) -> Any:
        module = importlib.import_module(f"sim_backend.{driver}")
        return module.make(driver, module.Config.model_validate(table), context)

    tracker, card = make("optotrak"), make("lab_pc")
    clock = context.clock
    assert isinstance(clock, FastClock)
    with ExitStack() as stack:
        for device in (tracker, card):
            device.open()
            stack.callback(device.close)

        def begin() -> None:
            if name != "optotrak":
                tracker.arm(Plan(TRACKER, 500.0, None))
            card.write_line("start", True)

        yield Specimen(
            lambda: make(name, **options),
            TRACKER,
            500.0,
            begin,
            clock.sleep,
            end=lambda: card.write_line("start", False),
        )


@contextmanager
def aboard(root: Path) -> Iterator[Specimen]:
    """Instruments of the simulated vehicle, on their own time."""
    context = RigContext(simulation={"pace": "fast"}, model=root / "config/models/rov_arm.toml")
    config = navigation.Config(gives=["position", "rates"], rate=100.0)
    navigation.make("first", config, context)  # the rig's clock becomes the simulation's
    yield Specimen(lambda: navigation.make("imu", config, context), TIMER, 100.0, wait=context.clock.sleep)


@contextmanager
def in_memory(kind: str) -> Iterator[Specimen]:
    """The instruments of the tests of daq, which must not promise less than a real device."""
    context = RigContext(simulation={"own_time": True})
    config = instruments.Config(kind=kind, max_rate=5000.0 if kind != "controller" else None, free_running=True)
    instruments.make("first", config, context)
    line = context.shared("line", lambda: instruments.Line(context.clock))
    source = POLL if kind == "polled" else TRACKER
    yield Specimen(
        lambda: instruments.make(kind, config, context), source, 1000.0, wait=context.clock.sleep, end=line.reset
    )


ON_WIRES = [us_digital_qsb, us_digital_ad4b, cia406, isabellenhuette_ivts, linux_counter, labjack_t7]
ON_WIRES += [tracker_stream, val_terminal, comedi_ni_labpc]
SIMULATED = {"mit_c12": {}, "lab_pc": {}, "optotrak": {}, "unimation": {}}


@pytest.mark.parametrize("driver", [*ON_WIRES, cia406_on_a_nodes_syncs], ids=lambda driver: driver.__name__)
def test_driver_on_its_wire(driver: Callable[[Path], Any], tmp_path: Path) -> None:
    with driver(tmp_path) as specimen:
        assert len(check(specimen)) >= 4


@pytest.mark.parametrize("name", SIMULATED)
def test_device_of_the_simulated_rig(name: str, root: Path) -> None:
    with simulated(name, SIMULATED[name], root) as specimen:
        assert len(check(specimen)) >= 4


def test_streaming_tracker_of_the_simulated_rig(root: Path) -> None:
    with simulated("optotrak", {"stream": 350.0}, root) as specimen:
        assert "rows_are_numbered_from_zero_at_every_arming" in check(specimen)


def test_instruments_of_the_simulated_vehicle(root: Path) -> None:
    with aboard(root) as specimen:
        assert "readings_have_names_of_their_own" in check(specimen)


@pytest.mark.parametrize("kind", instruments.KINDS)
def test_instrument_of_the_tests(kind: str) -> None:
    with in_memory(kind) as specimen:
        assert len(check(specimen)) >= 4


def test_no_driver_is_left_out() -> None:
    """Whatever module has a Config and a make is checked above."""
    found = set()
    for package in (drivers, sim_backend):
        for module in pkgutil.iter_modules(package.__path__, package.__name__ + "."):
            loaded = importlib.import_module(module.name)
            if hasattr(loaded, "Config") and hasattr(loaded, "make"):
                found.add(module.name.rpartition(".")[2])
    assert found == {driver.__name__ for driver in ON_WIRES} | set(SIMULATED) | {"navigation"}
