"""``armscope sim-devices``: a simulator of every device of a rig on its own protocol, with one arm behind them all."""

from __future__ import annotations

import importlib
import json
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from arm_io import InputError
from armscope.commands.options import ReadyJson
from daq.rig import DeviceTable, Rig, context_of, read_rig
from drivers import check_config, is_loopback

if TYPE_CHECKING:
    from sim_backend.protocol import CurrentWire, EncoderWire, Simulator

PREFIX, SIMULATORS = "drivers.", "sim_backend.protocol."


def command(
    rig: Annotated[
        Path, typer.Argument(metavar="RIG.toml", help="the rig; the addresses of its devices must be on this machine")
    ],
    as_json: ReadyJson = False,
) -> None:
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    with simulated_devices(read_rig(rig), rig) as simulators:
        addresses = {simulator.name: str(simulator.address) for simulator in simulators}
        lines = [json.dumps({"devices": addresses})] if as_json else [f"{k}: {v}" for k, v in addresses.items()]
        print(*lines, sep="\n", flush=True)
        print("ready; stop with Ctrl-C", file=sys.stderr, flush=True)
        stop.wait()


@contextmanager
def simulated_devices(rig: Rig, where: str | Path) -> Iterator[list[Simulator]]:
    """Every device of the rig, simulated and answering, until the block ends.

    InputError for a device without a simulator.
    """
    simulators = make_simulators(rig, where)
    opened: list[Simulator] = []
    try:
        for simulator in simulators:
            simulator.open()
            opened.append(simulator)
        yield simulators
    finally:
        for simulator in reversed(opened):
            simulator.close()


def make_simulators(rig: Rig, where: str | Path) -> list[Simulator]:
    """The simulators, closed, wired to one world as the rig file says; InputError: a device of another host."""
    from sim_backend.protocol import TriggerLine, puma
    from sim_backend.rig import world_of

    modules = {device.name: _simulator_of(device, where) for device in rig.device}
    world = world_of(context_of(rig))
    trigger = TriggerLine()
    gear = np.array([joint.gear for joint in rig.joint])
    puma.warm_up(world)
    simulators: list[Simulator] = []
    trackers: list[Any] = []
    for number, device in enumerate(rig.device, 1):
        config: Any = check_config(device.driver, device.options, f"{where}: device[{number}] ({device.name})")
        if not is_loopback(host := getattr(config, "host", "localhost")):
            raise InputError(
                where, f"device {device.name}: host {host} is not loopback; simulators answer on 127.0.0.1 only"
            )
        amperes = device.driver.endswith("isabellenhuette_ivts")
        wires = puma.wires(
            world,
            trigger,
            _encoders(rig, device.name, config),
            _currents(rig, device.name, amperes=amperes),
            gear=gear,
            target=rig.tracker.target if rig.tracker else (0.0, 0.0, 0.0),
            tracker_from_base=_tracker_from_base(rig),
        )
        if hasattr(config, "full_speed"):
            wires.arm = puma.ArmBehindTerminal(world, gear, list(config.full_speed), list(config.full_acceleration))
        simulator = modules[device.name].make(device.name, config, wires)
        if hasattr(simulator, "start"):
            trackers.append(simulator)
        wires.line = _start_line(rig, device.name, world, trackers)
        simulators.append(simulator)
    return simulators


def _simulator_of(device: DeviceTable, where: str | Path) -> Any:
    """``sim_backend.protocol.X`` for ``drivers.X``."""
    name = SIMULATORS + device.driver.removeprefix(PREFIX)
    try:
        if device.driver.startswith(PREFIX):
            return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name != name:
            raise
    what = f"device {device.name}: there is no simulator for {device.driver}"
    raise InputError(where, f"{what}; sim-devices is for rigs of drivers.* devices")


def _encoders(rig: Rig, device: str, config: Any) -> dict[int, EncoderWire]:
    from sim_backend.protocol import EncoderWire

    wires = {}
    for j, joint in enumerate(rig.joint):
        encoder = joint.encoder
        if encoder is None or encoder.device != device:
            continue
        if encoder.lines is not None and not hasattr(config, "nodes"):
            wires[encoder.channel] = EncoderWire(j)
            continue
        scale = joint.scale
        assert scale is not None  # there is an encoder
        # An absolute encoder of the simulator stands at half its range where its wires show 0.
        middle = 1 << (config.bits - 1) if hasattr(config, "nodes") else 0
        wires[encoder.channel] = EncoderWire(j, scale, encoder.offset + middle / scale)
    return wires


def _currents(rig: Rig, device: str, *, amperes: bool) -> dict[int, CurrentWire]:
    from sim_backend.protocol import CurrentWire

    sensors = [(j, joint.current) for j, joint in enumerate(rig.joint)]
    return {s.channel: CurrentWire(j, amperes) for j, s in sensors if s is not None and s.device == device}


def _tracker_from_base(rig: Rig) -> np.ndarray:
    pose = None if rig.tracker is None else rig.tracker.base_from_tracker
    return np.linalg.inv(np.eye(4) if pose is None else np.array(pose))


def _start_line(rig: Rig, device: str, world: Any, trackers: list[Any]) -> Any:
    """What the device's outputs switch: the rig's start line sets trackers (and the world's own start line) going."""
    start = rig.outputs.get("start")

    def switched(name: str, high: bool, at: int) -> None:
        if start is None or start.device != device or start.line != name:
            return
        world.write_start(high)
        for tracker in trackers:
            tracker.start(at) if high else tracker.stop()

    return switched
