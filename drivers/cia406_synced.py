"""CANopen encoders whose SYNCs are made by a node of the bus, or by a controller that makes them anyway.

The SYNCs are the trigger line: as regular as that node's crystal, and waiting for nobody, so that the bus may be filled. This computer
listens; a row's time is that of its SYNC, as stamped on arrival. It is complete when the next SYNC has come. Each SYNC has its
number by its time: one that was not heard, and a bus that was off for a while, leave a gap in the numbers.
"""

from __future__ import annotations

import time

import numpy as np

from drivers import cia406_protocol as cia
from drivers.blocks import join
from drivers.can_bus import CanBus
from drivers.cia406_nodes import ADVICE, Config, EncoderNodes
from drivers.reconnect import or_fault
from drivers.shapes import Block, EdgeSource, HostClock, Plan, Quality

LOOK = 5  # SYNCs by which their rate is judged
SLACK = 0.5  # s for them, beyond their periods
WRONG = 0.1  # of the rate: a node's crystal is nearer than that


class SyncedEncoders(EncoderNodes):
    """The device (shapes: Latched, Reconnecting, TriggerInput, QuadratureCounter)."""

    numbered = True

    def __init__(self, name: str, config: Config, bus: CanBus, clock: HostClock) -> None:
        super().__init__(name, config, bus, clock)
        self._frames = bus.listen([cia.SYNC, *(cia.TPDO1 + n for n in config.nodes)])
        self._plan: Plan | None = None

    def arm(self, plan: Plan) -> None:
        if plan.source is not EdgeSource.TIMER:
            raise self._fault(f"its SYNCs are not this computer's: trigger source {plan.source} wants to be timer")
        super().arm(plan)
        self._heard = cia.Heard(self.config.nodes)
        self._first = self._last = (-1, 0)  # number and ns of the first and of the last SYNC
        self._rows: list[Block] = []
        self._edges: list[Block] = []
        with or_fault(self.name, ADVICE):
            self._make_syncs(plan.rate)
        self._check_syncs(plan.rate)
        self._frames.take()
        self._plan = plan

    def _check_syncs(self, rate: float) -> None:
        """DeviceFault where no SYNCs come, or at another rate than the rig expects."""
        self._frames.take()
        came: list[int] = []
        deadline = time.monotonic() + SLACK + 2 * LOOK / rate
        while len(came) < LOOK and time.monotonic() < deadline:
            came += [at for at, identifier, _ in self._frames.wait(deadline) if identifier == cia.SYNC]
        if len(came) < LOOK:
            raise self._fault(
                f"{len(came)} SYNCs were heard in {SLACK + 2 * LOOK / rate:.2g} s: who makes them ('sync')?"
            )
        found = 1e9 / float(np.median(np.diff(came)))
        if abs(found / rate - 1) > WRONG:
            raise self._fault(f"SYNCs come at {found:.4g}/s, the rig expects {rate:g}: correct the trigger's rate")

    def disarm(self) -> None:
        if self._plan is not None and self._bus.is_open:
            with or_fault(self.name, ADVICE):
                self._make_syncs(0.0)
        self._plan = None

    def _make_syncs(self, rate: float) -> None:
        """Has the node make SYNCs, ``rate`` a second (0: none); a controller that makes them anyway is not asked."""
        node = self.config.sync
        if not isinstance(node, int):
            return
        self._download(node, cia.SYNC_IDENTIFIER, 0, cia.SYNC, 4)
        if rate:
            self._download(node, cia.SYNC_PERIOD, 0, round(1e6 / rate), 4)
            self._download(node, cia.SYNC_IDENTIFIER, 0, cia.SYNC | cia.MAKES_SYNC, 4)
            self._bus.send(0x000, bytes([0x01, node]))  # NMT: operational

    def close(self) -> None:
        self._plan = None
        super().close()

    @property
    def seeking(self) -> bool:
        """True while a bus that is off is sought."""
        return self._plan is not None and self._reconnect.lost

    def read(self) -> Block:
        self._pump()
        blocks, self._rows = self._rows, []
        return join(blocks, len(self.config.nodes))

    def read_edges(self) -> Block:
        self._pump()
        blocks, self._edges = self._edges, []
        return join(blocks)

    def _pump(self) -> None:
        """Takes in what has come over the bus."""
        if self._plan is None:
            raise self._fault("is not armed")
        now = self._clock.monotonic_ns()
        if not self._reconnect.there(now, self._reopen):
            return
        frames = self._frames.take()
        if self.config.sync in self._heed_events():
            with or_fault(self.name, ADVICE):
                self._make_syncs(self._plan.rate)
        rounds = [r for at, i, data in frames if (r := self._heard.take(i, data, at)) is not None]
        if rounds:
            self._keep(rounds)
        if not self._bus.is_open:
            self._reconnect.lose(now)

    def _keep(self, rounds: list[cia.Round]) -> None:
        host = np.array([r.at for r in rounds], np.int64)
        number = self._numbers(host)
        counts = np.array([r.values for r in rounds], np.int64)
        quality = np.array([r.quality for r in rounds], np.uint8)
        quality[:, [n in self._restarted for n in self.config.nodes]] |= np.uint8(Quality.DEVICE_RESET)
        tick = np.zeros_like(host)
        self._rows.append(Block(number, host, tick, quality, counts))
        self._edges.append(Block(number, host, tick, np.zeros((len(host), 0), np.uint8)))

    def _numbers(self, host: np.ndarray) -> np.ndarray:
        """Numbers of the SYNCs that came at ``host`` (n,) ns: how many periods they are apart."""
        assert self._plan is not None
        if self._last[0] < 0:
            self._first = self._last = (0, int(host[0]))
            before = np.concatenate([host[:1], host[:-1]])
        else:
            before = np.concatenate([[self._last[1]], host[:-1]])
        steps = np.maximum(np.rint((host - before) / self._period()), 1).astype(np.int64)
        steps[0] *= host[0] != self._first[1]
        number: np.ndarray = self._last[0] + np.cumsum(steps)
        self._last = int(number[-1]), int(host[-1])
        return number

    def _period(self) -> float:
        """ns between SYNCs: the rig's, until enough of them have come."""
        assert self._plan is not None
        syncs = self._last[0] - self._first[0]
        return (self._last[1] - self._first[1]) / syncs if syncs > LOOK else 1e9 / self._plan.rate

    def _reopen(self) -> None:
        assert self._plan is not None
        super()._reopen()
        self._make_syncs(self._plan.rate)
        self._frames.take()
        self._heard.restart()
