"""CANopen encoders on a CAN bus: each a ``canopen.LocalNode`` with the objects of CiA 406, answering every SYNC.

Frames take their time on the wire, one after the other, though the virtual bus knows of none. Any of the nodes can make
the SYNCs.
"""

from __future__ import annotations

import contextlib
import struct
import threading
import time
from typing import Any

import numpy as np

from drivers.can_bus import CanBus, frame_bits
from drivers.cia406 import Config
from drivers.cia406 import protocol as cia
from sim_backend.protocol.serving import Loop
from sim_backend.protocol.wires import Wires

OPERATIONAL, PRE_OPERATIONAL = 5, 127


def object_dictionary(bits: int, serial: int) -> Any:
    """The objects, at power-up values, of an absolute multi-turn encoder (CiA 406 v3.1, C2) that the driver uses."""
    import canopen.objectdictionary as od

    dictionary = od.ObjectDictionary()
    kinds = {8: od.UNSIGNED8, 16: od.UNSIGNED16, 32: od.UNSIGNED32}

    def variable(name: str, index: int, sub: int, size: int, value: int, access: str = "rw") -> Any:
        entry = od.ODVariable(name, index, sub)
        entry.data_type, entry.access_type, entry.default = kinds[size], access, value
        return entry

    def record(name: str, index: int, members: list[tuple[str, int, int]]) -> None:
        group = od.ODRecord(name, index)
        group.add_member(variable("count", index, 0, 8, len(members)))
        for sub, (member, size, value) in enumerate(members, 1):
            group.add_member(variable(member, index, sub, size, value))
        dictionary.add_object(group)

    dictionary.add_object(variable("device type", cia.DEVICE_TYPE, 0, 32, 2 << 16 | cia.PROFILE, "ro"))
    record(
        "identity", cia.IDENTITY, [("vendor", 32, 0), ("product", 32, 0), ("revision", 32, 1), ("serial", 32, serial)]
    )
    record("TPDO1", cia.TPDO1_PARAMETERS, [("identifier", 32, cia.OFF), ("transmission", 8, 0xFE)])
    record("TPDO1 mapping", cia.TPDO1_MAPPING, [("first", 32, cia.POSITION_MAPPED)])
    total = (1 << bits) & 0xFFFFFFFF
    for name, index, size, value, access in (
        ("units per revolution", cia.UNITS_PER_REVOLUTION, 32, 4096, "rw"),
        ("total range", cia.TOTAL_RANGE, 32, total, "rw"),
        ("preset", cia.PRESET, 32, 0, "rw"),
        ("position", cia.POSITION, 32, 0, "ro"),
        ("cyclic timer", cia.CYCLIC_TIMER, 16, 0, "rw"),
        ("alarms", cia.ALARMS, 16, 0, "ro"),
        ("warnings", cia.WARNINGS, 16, 0, "ro"),
        ("heartbeat", 0x1017, 16, 0, "rw"),
        ("SYNC identifier", cia.SYNC_IDENTIFIER, 32, cia.SYNC, "rw"),
        ("SYNC period", cia.SYNC_PERIOD, 32, 0, "rw"),
    ):
        dictionary.add_object(variable(name, index, 0, size, value, access))
    return dictionary


class Encoder:
    """One encoder: its node, its offset (the preset), its place on the wires."""

    def __init__(self, node: Any, channel: int, offset: int) -> None:
        self.node, self.channel, self.offset = node, channel, offset
        self.delay = 0.0  # s between SYNC and answer
        self.mute = False


class SimulatedCia406:
    """All encoders of one Config. Faults for tests: ``encoders[n].delay``, ``encoders[n].mute``, ``restart(n)``."""

    def __init__(self, name: str, config: Config, wires: Wires) -> None:
        self.name, self.config, self.wires = name, config, wires
        self.bus = CanBus(config)
        self.encoders: dict[int, Encoder] = {}
        self._mask = (1 << config.bits) - 1
        self._timers: list[threading.Timer] = []
        self._syncs = Loop(self._make_syncs, list, self._until_sync)
        self._due = 0  # ns: the next SYNC

    @property
    def address(self) -> str:
        nodes = ", ".join(map(str, self.config.nodes))
        return f"{self.config.interface} {self.config.channel}, nodes {nodes}"

    def open(self) -> None:
        """Puts the encoders on the bus; they have power all the time, and keep their settings while they are off it."""
        self.bus.open()
        if not self.encoders:
            self._power_up()
        self._syncs.start()

    def _power_up(self) -> None:
        import canopen

        network = self.bus.network()
        for channel, number in enumerate(self.config.nodes):
            node = canopen.LocalNode(number, object_dictionary(self.config.bits, 0xE0000000 + number))
            network.add_node(node)
            encoder = self.encoders[number] = Encoder(node, channel, 1 << (self.config.bits - 1))
            node.add_read_callback(lambda index, e=encoder, **_: self._position(e) if index == cia.POSITION else None)
            node.add_write_callback(lambda index, data, e=encoder, **_: self._preset(e, index, data))
            node.nmt.send_command(0)
            node.nmt._state = PRE_OPERATIONAL
        network.subscribe(cia.SYNC, self._on_sync)

    def close(self) -> None:
        self._syncs.stop()
        for timer in self._timers:
            timer.cancel()
        self.bus.close()

    def restart(self, number: int) -> None:
        """Power off and on: factory settings, and a boot-up message if the bus is connected.

        Position and preset are kept.
        """
        encoder = self.encoders[number]
        encoder.node.data_store.clear()
        encoder.node.nmt._state = PRE_OPERATIONAL
        with contextlib.suppress(OSError):
            self.bus.send(cia.HEARTBEAT + number, cia.BOOT_UP)

    def _position(self, encoder: Encoder, now: int | None = None) -> int:
        at = np.array([time.monotonic_ns() if now is None else now], np.int64)
        return (int(self.wires.counts(encoder.channel, at)[0]) + encoder.offset) & self._mask

    def _preset(self, encoder: Encoder, index: int, data: bytes) -> None:
        if index == cia.PRESET:
            encoder.offset += (int.from_bytes(data, "little") - self._position(encoder)) & self._mask

    def _period(self) -> int:
        """ns between the SYNCs that a node makes; 0: none does."""
        for encoder in self.encoders.values():
            get = encoder.node.get_data
            if cia.SYNC_IDENTIFIER not in encoder.node.object_dictionary:
                continue  # it cannot
            made = int.from_bytes(get(cia.SYNC_IDENTIFIER, 0), "little") & cia.MAKES_SYNC
            if made and encoder.node.nmt._state == OPERATIONAL:
                return 1000 * int.from_bytes(get(cia.SYNC_PERIOD, 0), "little")
        return 0

    def _until_sync(self) -> float:
        return max(0.0, (self._due - time.monotonic_ns()) * 1e-9) if self._due else 0.005

    def _make_syncs(self, now: int) -> None:
        if not (period := self._period()):
            self._due = 0
        elif not self._due:
            self._due = now + period
        elif now >= self._due:
            sent = time.monotonic_ns()
            with contextlib.suppress(OSError):
                self.bus.send(cia.SYNC, b"")
            self._latch(sent)
            self._due += period * max(1, (time.monotonic_ns() - self._due) // period)

    def _on_sync(self, _identifier: int, _data: bytes, stamp: float) -> None:
        if self._due:
            return  # the node that sends the SYNCs receives none
        # Sent when it is stamped, not when this process got round to it; latched when its last bit has come.
        now = time.monotonic_ns()
        now -= max(0, time.time_ns() - int(stamp * 1e9)) if stamp else 0
        self._latch(now + self._on_wire(0))

    def _on_wire(self, data_bytes: int) -> int:
        """ns that a frame takes."""
        return frame_bits(data_bytes) * 1_000_000_000 // self.config.bitrate

    def _latch(self, at: int) -> None:
        """All nodes that answer SYNCs, in the order of their identifiers: each frame is there when its last bit is."""
        done = at
        _sleep_until(at)
        for number, encoder in sorted(self.encoders.items()):
            get = encoder.node.get_data
            off = int.from_bytes(get(cia.TPDO1_PARAMETERS, 1), "little") & cia.OFF
            synced = get(cia.TPDO1_PARAMETERS, 2)[0] == cia.EVERY_SYNC
            if encoder.mute or off or not synced or encoder.node.nmt._state != OPERATIONAL:
                continue
            answer = struct.pack("<I", self._position(encoder, at))
            done += self._on_wire(4)
            if encoder.delay:
                timer = threading.Timer(encoder.delay, self._answer, (number, answer))
                self._timers.append(timer)
                timer.start()
            else:
                _sleep_until(done)
                self._answer(number, answer)

    def _answer(self, number: int, data: bytes) -> None:
        with contextlib.suppress(OSError):
            self.bus.send(cia.TPDO1 + number, data)


def _sleep_until(at: int) -> None:
    if (left := at - time.monotonic_ns()) > 0:
        time.sleep(left * 1e-9)


make = SimulatedCia406
