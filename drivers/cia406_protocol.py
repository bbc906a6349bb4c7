"""CANopen encoders (CiA 301, CiA 406 v3.1), sans-IO: identifiers, objects, and which position frame belongs to which SYNC."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

SYNC = 0x080
EMERGENCY, TPDO1, SDO_REPLY, HEARTBEAT = 0x080, 0x180, 0x580, 0x700  # + node
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
DEBT_SECONDS = 0.1  # after which a frame that has not come never will
ABSENT = 10  # rounds without an answer after which a node is not waited for


def position(data: bytes) -> int | None:
    """Position of a TPDO that maps 6004h alone; None if it is no such frame."""
    return struct.unpack("<I", data)[0] if len(data) == 4 else None


@dataclass
class Node:
    """What one encoder still owes, and what it gave in this round."""

    owed: list[int] = field(default_factory=list)  # host ns of the SYNCs without an answer
    value: int | None = None
    doubtful: bool = False
    silent: int = 0  # rounds in a row without an answer


class Rounds:
    """One SYNC, one position from every node. A frame that is late for its SYNC must not pass for the answer to the next one.

    A node answers SYNCs in order: while it owes an answer, its next frame pays that debt. A debt is forgiven after 0.1 s.
    Frames that arrived before the SYNC (the one a node sends by itself when it becomes operational) never count.
    """

    def __init__(self, nodes: tuple[int, ...]) -> None:
        self.nodes = {node: Node() for node in nodes}
        self._begun = 0

    def begin(self, now: int) -> None:
        """The SYNC goes out at host ns ``now``."""
        self._begun = now
        for node in self.nodes.values():
            node.owed = [at for at in node.owed if now - at < DEBT_SECONDS * 1e9]
            node.value, node.doubtful = None, False

    def take(self, number: int, data: bytes, arrived: int) -> None:
        """A TPDO of node ``number`` that arrived at host ns ``arrived``."""
        value, node = position(data), self.nodes.get(number)
        if value is None or node is None:
            return
        if node.owed:
            node.owed.pop(0)
        elif arrived >= self._begun:
            node.doubtful = node.value is not None  # two answers to one SYNC
            node.value = value

    @property
    def complete(self) -> bool:
        """True when nobody is to be waited for; a node that has been silent for long is not."""
        return all(node.value is not None or node.silent >= ABSENT for node in self.nodes.values())

    def end(self) -> None:
        """No more waiting: who has not answered owes."""
        for node in self.nodes.values():
            node.silent = node.silent + 1 if node.value is None else 0
            if node.value is None:
                node.owed.append(self._begun)

    def forget(self, number: int) -> None:
        """The node has restarted: what it owed is gone."""
        self.nodes[number].owed.clear()
