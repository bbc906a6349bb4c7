"""CANopen encoders (CiA 301, CiA 406 v3.1), sans-IO: identifiers, objects, and the matching of positions to SYNCs."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from drivers.protocols import Quality

SYNC, SYNC_BITS = 0x080, 44  # its bits until it is valid: no data, no stuffing counted
EMERGENCY, TPDO1, SDO_REPLY, SDO_REQUEST, HEARTBEAT = 0x080, 0x180, 0x580, 0x600, 0x700  # + node
ASK_DEVICE_TYPE = bytes([0x40, 0x00, 0x10, 0, 0, 0, 0, 0])  # SDO: upload of 1000h
ASK_WHEN_SENT = bytes([0x40, 0x00, 0x18, 0x02, 0, 0, 0, 0])  # SDO: upload of 1800h:2, when the position is sent
WHEN_SENT = bytes([0x4F, 0x00, 0x18, 0x02])  # and how its answer begins
BOOT_UP = b"\x00"  # heartbeat of a node that has just started

DEVICE_TYPE = 0x1000  # low word 406
IDENTITY = 0x1018  # 1 vendor, 2 product, 3 revision, 4 serial number
TPDO1_PARAMETERS = 0x1800  # 1 identifier (bit 31: off), 2 transmission type
TPDO1_MAPPING = 0x1A00
UNITS_PER_REVOLUTION, TOTAL_RANGE, PRESET, POSITION = 0x6001, 0x6002, 0x6003, 0x6004
SYNC_IDENTIFIER, SYNC_PERIOD = 0x1005, 0x1006  # bit 30 of the former: this node makes the SYNCs; us between them
MAKES_SYNC = 1 << 30
CYCLIC_TIMER = 0x6200  # ms; 0: off
ALARMS, WARNINGS = 0x6503, 0x6505

PROFILE = 406
EVERY_SYNC = 1
POSITION_MAPPED = POSITION << 16 | 0x20  # object, sub-index 0, 32 bit
OFF = 1 << 31
ALIKE = 0.1  # of a period
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
    """One SYNC, one position from every node: a late frame must not count as the answer to the next SYNC.

    A lost answer and a late one look the same until no answer can be under way any more. So no SYNC goes out while a
    node owes one, for ``latest`` s at most: what comes in that time pays the debt, and what comes after the next SYNC
    is its answer. A node that has been silent for ``ABSENT`` rounds delays no other node; when it answers again, there
    is one such pause. Frames that arrived before the SYNC (the one that a node sends unasked when it becomes
    operational) never count.
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
        """A round without a SYNC: no node has a value."""
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
        """True when no answer is pending."""
        return not any(node.owes and node.silent < ABSENT for node in self.nodes.values())

    @property
    def absent(self) -> list[int]:
        """Nodes that have been silent for so long that no round waits for them."""
        return [number for number, node in self.nodes.items() if node.silent >= ABSENT]

    def end(self) -> None:
        """No more waiting: an answer that still comes is too late for this round."""
        self._open = False
        for node in self.nodes.values():
            node.silent = node.silent + 1 if node.owes else 0

    def forget(self, number: int) -> None:
        """The node has restarted: what it owed is gone."""
        self.nodes[number].owes = False


@dataclass(frozen=True)
class Round:
    """One SYNC of another node.

    Host ns at which it came, and every node's value and quality flags, in the order of the columns.
    """

    at: int
    values: list[int]
    quality: list[Quality]


@dataclass
class Listened:
    """What one node gave since the last SYNC, and how long after a SYNC its answers usually come."""

    answers: list[tuple[int, int]]  # value, ns after the SYNC
    usual: int | None = None
    silent: int = 0  # rounds in a row without an answer
    doubtful: bool = False  # it missed a SYNC: it may have been late, and be one behind from then on


class Heard:
    """Frames as they come over the bus, another node's SYNCs among them -> rounds.

    Each is complete when the next SYNC is heard. A node answers each SYNC once, before the next one. Where it gave
    none, the next single one may be the late one: it counts only if it comes as long after its SYNC as this node's
    answers did before (within ``ALIKE`` of a period). Of two answers, one belongs to an earlier SYNC.
    """

    def __init__(self, nodes: tuple[int, ...]) -> None:
        self._nodes = {node: Listened([]) for node in nodes}
        self._at: int | None = None

    def take(self, identifier: int, data: bytes, arrived: int) -> Round | None:
        """The next frame; returns the round that it ends, if it does."""
        if identifier == SYNC:
            ended = None if self._at is None else self._end(arrived - self._at)
            for node in self._nodes.values():
                node.answers.clear()
            self._at = arrived
            return ended
        answering, value = self._nodes.get(identifier - TPDO1), position(data)
        if self._at is not None and answering is not None and value is not None:
            answering.answers.append((value, arrived - self._at))
        return None

    @property
    def absent(self) -> list[int]:
        """Nodes that have been silent for ``ABSENT`` rounds."""
        return [number for number, node in self._nodes.items() if node.silent >= ABSENT]

    def restart(self) -> None:
        """Frames may have been lost: what is under way belongs to no SYNC."""
        self._at = None

    def _end(self, period: int) -> Round:
        assert self._at is not None
        judged = [self._judge(node, period) for node in self._nodes.values()]
        return Round(self._at, [value for value, _ in judged], [quality for _, quality in judged])

    def _judge(self, node: Listened, period: int) -> tuple[int, Quality]:
        if not node.answers:
            node.doubtful, node.silent = True, node.silent + 1
            return 0, Quality.MISSING
        node.silent = 0
        value, after = node.answers[-1]
        if len(node.answers) > 1:
            node.doubtful = False
            return value, Quality.LATE
        if node.doubtful and node.usual is not None and abs(after - node.usual) > ALIKE * period:
            return value, Quality.LATE
        node.usual, node.doubtful = after, False
        return value, Quality.GOOD
