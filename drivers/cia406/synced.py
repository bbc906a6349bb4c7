"""CANopen encoders whose SYNCs are made by a node of the bus, or by a controller that makes them anyway.

The SYNCs are the trigger line: as regular as that node's crystal, and never waiting, so that the bus may be
filled. This computer listens; a row's time is that of its SYNC, as stamped on arrival. It is complete when the next
SYNC has come. SYNCs are counted; a bus that was off for a while, and a node that had to begin anew, leave a gap in the
numbers, by the time that has passed. A single SYNC that was not heard is found by the sampler, by the interval.
"""

from __future__ import annotations

import time

import numpy as np

from drivers.blocks import join
from drivers.can_bus import CanBus
from drivers.cia406 import protocol as cia
from drivers.cia406.nodes import ADVICE, Config, EncoderNodes
from drivers.protocols import Block, EdgeSource, HostClock, Plan, Quality
from drivers.reconnect import or_fault

LOOK, LOOK_FOR = 5, 0.2  # SYNCs at least, and s, by which their rate is judged
SLACK = 0.5  # s for them, beyond their periods
WRONG = 0.2  # of the rate


class SyncedEncoders(EncoderNodes):
    """The device (shapes: Latched, Reconnecting, TriggerInput, QuadratureCounter)."""

    numbered = True

    def __init__(self, name: str, config: Config, bus: CanBus, clock: HostClock) -> None:
        super().__init__(name, config, bus, clock)
        self._frames = bus.listen([cia.SYNC, *(cia.TPDO1 + n for n in config.nodes)])
        self._plan: Plan | None = None

    def arm(self, plan: Plan) -> None:
        if plan.source is not EdgeSource.TIMER:
            raise self._fault(f"its SYNCs are not this computer's: trigger source {plan.source} must be timer")
        super().arm(plan)
        self._heard = cia.Heard(self.config.nodes)
        self._first = self._last = (-1, 0)  # number and ns of the first and of the last SYNC
        self._resume = False  # SYNCs were not heard, or not made, for a while
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
        wanted = max(LOOK, round(rate * LOOK_FOR))
        seconds = SLACK + 2 * wanted / rate
        deadline = time.monotonic() + seconds
        while len(came) < wanted and time.monotonic() < deadline:
            came += [at for at, identifier, _ in self._frames.wait(deadline) if identifier == cia.SYNC]
        if len(came) < LOOK:
            raise self._fault(f"{len(came)} SYNCs were heard in {seconds:.2g} s: who makes them ('sync')?")
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
        """True while a bus that is off is being restarted."""
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
        rounds = [r for at, i, data in frames if (r := self._heard.take(i, data, at)) is not None]
        if rounds:
            self._keep(rounds)
        self._seek(self._heard.absent, now)
        if self.config.sync in self._heed_events():
            with or_fault(self.name, ADVICE):
                self._make_syncs(self._plan.rate)
            self._begin_again()
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
        """Numbers of the SYNCs that came at ``host`` (n,) ns: counted, without those that cannot have been received."""
        assert self._plan is not None
        number, at = self._last
        if number < 0:
            self._first = (0, int(host[0]))
        elif self._resume:
            syncs = number - self._first[0]
            period = (at - self._first[1]) / syncs if syncs > LOOK else 1e9 / self._plan.rate
            number += max(0, round((int(host[0]) - at) / period) - 1)
        self._resume = False
        numbers: np.ndarray = number + 1 + np.arange(len(host))
        self._last = int(numbers[-1]), int(host[-1])
        return numbers

    def _reopen(self) -> None:
        assert self._plan is not None
        super()._reopen()
        self._make_syncs(self._plan.rate)
        self._begin_again()

    def _begin_again(self) -> None:
        """What was under way belongs to no row; the next one is as many SYNCs later as the time that has passed."""
        self._frames.take()
        self._heard.restart()
        self._resume = True
