"""What a simulated device does at each edge on its trigger input: latch, number, stamp, keep until it is read."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from arm_io import DeviceFault
from drivers import join
from drivers.protocols import Block, Plan
from sim_backend.electronics import noise
from sim_backend.rig.faults import Unplugged
from sim_backend.rig.trigger_line import Seen, TriggerLine, seen
from sim_backend.rig.world import World

PASS = 2.0
"""s of rows made at most in one go."""
AHEAD = 0.2
"""s of rows made at a time, ahead of the reader: signals and edges are known, and long arrays are cheap."""
TICK_RATE = 1e6
"""Hz of every simulated device's own clock."""

Acquire = Callable[[Seen], Block]


class Latch:
    """Rows of one device.

    acquire  makes the rows of edges: a Block whose number, host and tick are replaced here
    line     what comes in at the trigger input; left out: the rig's trigger line
    """

    def __init__(
        self, world: World, device: str, acquire: Acquire, line: Callable[[], TriggerLine | None] | None = None
    ) -> None:
        self._world, self._device, self._acquire = world, device, acquire
        self._line = line or (lambda: world.line)
        self._jitter = noise.keys(world.settings.seed, f"stamps of {device}", 1)
        self._armed_ns = world.now()
        self._opened = self._armed = False
        self._edge = self._number = 0  # the next edge of the line to look at, the device's next number
        self._ahead = _NO_EDGES  # seen, and not yet come to pass; their rows are in _block from row _taken on
        self._block: Block | None = None
        self._taken = 0
        self._seen_at = -1

    def open(self) -> None:
        """DeviceFault while the device is unplugged."""
        self.check_plugged()
        self._opened = True

    def close(self) -> None:
        self._opened = self._armed = False

    def arm(self, plan: Plan) -> None:
        """Begins a new numbering. DeviceFault where the device is not open, or unplugged."""
        if not self._opened:
            raise DeviceFault(self._device, "is not open; open it before arming it")
        self.check_plugged()
        self._armed_ns, self._armed = self._world.now(), True
        self._edge = self._number = 0
        self._ahead, self._block, self._seen_at = _NO_EDGES, None, -1

    def disarm(self) -> None:
        self._armed = False

    def since_ns(self) -> int:
        """What the times of the device's faults count from."""
        start = self._world.start_ns
        return self._armed_ns if start is None else start

    def check_plugged(self) -> None:
        """DeviceFault while the device is unplugged."""
        self._world.check_plugged(self._device, self.since_ns())

    def check_open(self) -> None:
        """DeviceFault where the device is not open, or unplugged."""
        if not self._opened:
            raise DeviceFault(self._device, "is not open; open it first")
        self.check_plugged()

    def read(self) -> Block:
        """All rows since the last call, up to now."""
        self.check_open()
        now, line = self._world.now(), self._line()
        if not self._armed or line is None:
            return self._rows(_NO_EDGES)
        if self._seen_at != self._world.changes:
            self._forget_ahead(line)
        parts = [self._take(now)]
        while len(self._ahead.edge) == 0 and self._edge < line.made(now):
            most = self._edge + int(PASS * 1e9 / line.period_ns) + 1
            self._look_ahead(line, min(line.made(now + round(AHEAD * 1e9)), most))
            parts.append(self._take(now))
        return joined(parts)

    def _take(self, now: int) -> Block:
        """The rows made ahead that have come to pass."""
        if self._block is None:
            return self._rows(_NO_EDGES)
        ready = int(np.searchsorted(self._ahead.time, now, side="right"))
        rows = rows_of(self._block, slice(self._taken, self._taken + ready))
        self._taken += ready
        self._ahead = self._ahead[ready:]
        return rows

    def single(self) -> Block:
        """One row, now: number -1."""
        self.check_open()
        now = np.array([self._world.now()])
        return self._rows(Seen(_MINUS_ONE, _MINUS_ONE, now, np.zeros(1, bool)))

    def _look_ahead(self, line: TriggerLine, until: int) -> None:
        """Makes the rows of the edges before ``until``; none are left from the last time."""
        edges = self._present(seen(line, self._world.faults_of(self._device), self._edge, until, self._number))
        self._edge = until
        self._number += len(edges.edge)
        forgotten = edges.time < self._world.oldest_ns()  # not read for seconds: the buffer has overflowed
        self._ahead = edges[~(edges.missed | forgotten)]
        self._block, self._taken = self._rows(self._ahead), 0

    def _forget_ahead(self, line: TriggerLine) -> None:
        """Something has changed since the rows ahead were made: they are made again."""
        self._seen_at = self._world.changes
        ahead = self._ahead
        if len(ahead.edge):
            # From the first edge of the line itself: the line's edge of a glitch may have been handed over already.
            first = int(np.argmax(ahead.time == line.times(ahead.edge)))
            self._edge, self._number = int(ahead.edge[first]), int(ahead.number[0])
            self._ahead = _NO_EDGES

    def _present(self, edges: Seen) -> Seen:
        """The edges that came while the device was plugged in."""
        time = (edges.time - self.since_ns()) * 1e-9
        for fault in self._world.faults_of(self._device):
            if isinstance(fault, Unplugged):
                here = (time < fault.at) | (time >= (np.inf if fault.back is None else fault.back))
                gone = int(np.count_nonzero(~here))
                edges, time = edges[here], time[here]
                number = edges.number - np.where(time >= fault.at, gone, 0)
                edges = Seen(edges.edge, number, edges.time, edges.missed)
        return edges

    def _rows(self, edges: Seen) -> Block:
        values = self._acquire(edges)
        late = (
            np.abs(noise.normals(self._jitter, edges.time - self.since_ns(), 1)[0]) * self._world.settings.stamp_jitter
        )
        clock = (edges.time - self._armed_ns) * (self._world.drift(self._device) * TICK_RATE * 1e-9)
        return Block(
            number=edges.number,
            host=edges.time + np.rint(late * 1e9).astype(np.int64),
            tick=np.floor(clock).astype(np.int64),
            quality=values.quality,
            counts=values.counts,
            volts=values.volts,
            points=values.points,
            readings=values.readings,
        )


def rows_of(block: Block, rows: slice) -> Block:
    """Some of the rows of a block."""
    return Block(*(None if column is None else column[rows] for column in _columns(block)))  # type: ignore[arg-type]


def joined(blocks: list[Block]) -> Block:
    """The rows of blocks of one device, at least one block."""
    first = blocks[0]
    counts, volts, points, readings = (column is not None for column in _columns(first)[4:])
    return join(blocks, counts, volts, points=points, readings=readings)


def _columns(block: Block) -> tuple[NDArray | None, ...]:
    values = (block.counts, block.volts, block.points, block.readings)
    return (block.number, block.host, block.tick, block.quality, *values)


_NONE = np.empty(0, np.int64)
_NO_EDGES = Seen(_NONE, _NONE, _NONE, np.empty(0, bool))
_MINUS_ONE = np.array([-1])
