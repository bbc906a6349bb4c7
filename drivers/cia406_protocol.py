"""CANopen encoders (CiA 301, CiA 406 v3.1), sans-IO: identifiers, objects, and which position frame belongs to which SYNC."""

from __future__ import annotations

import struct
from dataclasses import dataclass

SYNC = 0x080
EMERGENCY, TPDO1, SDO_REPLY, SDO_REQUEST, HEARTBEAT = 0x080, 0x180, 0x580, 0x600, 0x700  # + node
ASK_DEVICE_TYPE = bytes([0x40, 0x00, 0x10, 0, 0, 0, 0, 0])  # SDO: upload of 1000h
BOOT_UP = b"\x00"  # heartbeat of a node that has just started

DEVICE_TYPE = 0x1000  # low word 406
IDENTITY = 0x1018  # 1 vendor, 2 product, 3 revision, 4 serial number
TPDO1_PARAMETERS = 0x1800  # 1 identifier (bit 31: off), 2 transmission type
TPDO1_MAPPING = 0x1A00
UNITS_PER_REVOLUTION, TOTAL_RANGE, PRESET, POSITION = 0x6001, 0x6002, 0x6003, 0x6004
CYCLIC_TIMER = 0x6200  # ms; 0: off
ALARMS, WARNINGS = 0x6503, 0x6505

PROFILE = 406
EVERY_SYNC = 1
POSITION_MAPPED = POSITION << 16 | 0x20  # object, sub-index 0, 32 bit
OFF = 1 << 31
ABSENT = 10  # rounds without an answer after which a node is not waited for


def position(data: bytes) -> int | None:
    """Position of a TPDO that maps 6004h alone; None if it is no such frame."""
    return struct.unpack("<I", data)[0] if len(data) == 4 else None


@dataclass
class Node:
    """What one encoder still owes, and what it gave in this round."""

    owes: bool = False  # the answer to the last SYNC
    value: int | None = None
    doubtful: bool = False  # two answers to one SYNC
    silent: int = 0  # rounds in a row without an answer


class Rounds:
    """One SYNC, one position from every node. A frame that is late for its SYNC must not pass for the answer to the next one.

    A lost answer and a late one look the same until no answer can be under way any more. So no SYNC goes out while a node owes
    one, for ``latest`` s at most: what comes in that time pays the debt, and what comes after the next SYNC is its answer. A
    node that has been silent for ``ABSENT`` rounds holds nobody up; when it is heard again, there is one such pause.
    Frames that arrived before the SYNC (the one that a node sends by itself when it becomes operational) never count.
    """

    def __init__(self, nodes: tuple[int, ...], latest: float) -> None:
        self.nodes = {node: Node() for node in nodes}
        self._latest = int(latest * 1e9)
        self._begun = self._heard = -self._latest
        self._open = False  # between begin and end

    def blocked(self, now: int) -> bool:
        """True while an answer may be under way: no SYNC may go out at host ns ``now``."""
        if now - self._begun < self._latest and any(n.owes and n.silent < ABSENT for n in self.nodes.values()):
            return True
        return now - self._heard < self._latest

    def begin(self, now: int) -> None:
        """The SYNC goes out at host ns ``now``."""
        self._begun, self._open = now, True
        for node in self.nodes.values():
            node.owes, node.value, node.doubtful = True, None, False

    def skip(self) -> None:
        """A round without a SYNC: nobody has a value."""
        for node in self.nodes.values():
            node.value, node.doubtful = None, False

    def take(self, number: int, data: bytes, arrived: int) -> None:
        """A TPDO of node ``number`` that arrived at host ns ``arrived``."""
        value, node = position(data), self.nodes.get(number)
        if value is None or node is None or arrived < self._begun:
            return
        if node.silent >= ABSENT:
            node.silent, self._heard = 0, arrived
        elif not node.owes:
            node.doubtful = node.value is not None
        elif self._open:
            node.value = value
        node.owes = False

    @property
    def complete(self) -> bool:
        """True when nobody is to be waited for."""
        return not any(node.owes and node.silent < ABSENT for node in self.nodes.values())

    def end(self) -> None:
        """No more waiting: an answer that still comes is too late for this round."""
        self._open = False
        for node in self.nodes.values():
            node.silent = node.silent + 1 if node.owes else 0

    def forget(self, number: int) -> None:
        """The node has restarted: what it owed is gone."""
        self.nodes[number].owes = False
