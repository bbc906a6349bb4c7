"""CANopen encoders by CiA 406: every SYNC latches all of them at once; each answers with one frame.

``sync`` "host": this computer sends a SYNC for every row that it is asked for. The row's time is that of the SYNC's
last bit, if it left the host at once; how regular the SYNCs are is up to the host (a Python timer jitters by up to a
millisecond), but each is stamped. The next SYNC waits for the last answer. Otherwise the SYNCs are a node's
(``drivers.cia406.synced``), as regular as its crystal, and wait for no answer. Ceiling: the bus; six encoders at 1
Mbit/s take 0.6 ms of it per row.
"""

from __future__ import annotations

import time

from drivers.blocks import one_row
from drivers.can_bus import CanBus, frame_bits, shared_bus
from drivers.cia406 import protocol as cia
from drivers.cia406.nodes import Config as Config
from drivers.cia406.nodes import EncoderNodes
from drivers.cia406.synced import SyncedEncoders
from drivers.protocols import Block, HostClock, Identity, Plan, Quality
from drivers.rig_context import RigContext

SEARCH = 0.3  # s for all nodes to answer
SHARE = 0.4  # of the bus that the search's requests take: each may be answered by as long a frame


class Cia406Encoders(EncoderNodes):
    """The device (shapes: Polled, QuadratureCounter)."""

    def __init__(self, name: str, config: Config, bus: CanBus, clock: HostClock) -> None:
        super().__init__(name, config, bus, clock)
        self._answers = bus.listen([cia.TPDO1 + n for n in config.nodes])
        self._rounds = cia.Rounds(config.nodes, config.latest)
        self._sync_ns = cia.SYNC_BITS * 1_000_000_000 // config.bitrate

    def open(self) -> Identity:
        self._answers.take()
        self._events.take()
        return super().open()

    def arm(self, plan: Plan) -> None:
        super().arm(plan)
        self._rounds = cia.Rounds(self.config.nodes, self.config.latest)

    def disarm(self) -> None: ...

    def poll(self) -> Block:
        return self._reconnect.poll(self._clock, self._reopen, self._round, (len(self.config.nodes), 0))

    def _round(self, now: int) -> Block:
        """One SYNC and its answers; OSError where the bus is off."""
        answers = self._answers.take()
        for number in self._heed_events():
            self._rounds.forget(number)
        self._seek(self._rounds.absent, now)
        for at, identifier, data in answers:
            self._rounds.take(identifier - cia.TPDO1, data, at)
        if self._rounds.blocked(now):
            self._rounds.skip()
            return self._row(now)
        before = self._clock.monotonic_ns()
        self._rounds.begin(before)
        self._bus.send(cia.SYNC, b"")
        latched = (before + self._clock.monotonic_ns()) // 2 + self._sync_ns  # when its last bit has come
        deadline = time.monotonic() + self.config.timeout
        while not self._rounds.complete and time.monotonic() < deadline:
            for at, identifier, data in self._answers.wait(deadline):
                self._rounds.take(identifier - cia.TPDO1, data, at)
        self._rounds.end()
        return self._row(latched)

    def _row(self, host: int) -> Block:
        values, flags = [], []
        for number, node in self._rounds.nodes.items():
            quality = Quality.GOOD if node.value is not None else Quality.MISSING
            if node.doubtful:
                quality |= Quality.LATE
            if number in self._restarted:
                quality |= Quality.DEVICE_RESET
            values.append(node.value or 0)
            flags.append(int(quality))
        if all(node.value is None for node in self._rounds.nodes.values()) and not self._bus.is_open:
            raise OSError("the bus is off")
        return one_row(host, values, quality=flags)

    def _reopen(self) -> None:
        super()._reopen()
        self._answers.take()


def make(name: str, config: Config, context: RigContext) -> EncoderNodes:
    """The encoders of ``config.nodes``, closed."""
    kind = Cia406Encoders if config.sync == "host" else SyncedEncoders
    return kind(name, config, shared_bus(context, config), context.clock)


def find(config: Config) -> list[str]:
    """The nodes that answer on the bus when all are asked for their device type."""
    bus = CanBus(config)
    answers = bus.listen([cia.SDO_REPLY + n for n in range(1, 128)])
    pause = frame_bits(8) / config.bitrate / SHARE  # s
    try:
        bus.open()
        for number in range(1, 128):
            bus.send(cia.SDO_REQUEST + number, cia.ASK_DEVICE_TYPE)
            time.sleep(pause)
        time.sleep(SEARCH)
        profiles = {i - cia.SDO_REPLY: int.from_bytes(data[4:6], "little") for _, i, data in answers.take()}
    except OSError:
        return []
    finally:
        bus.close()
    return [f"node {n} with profile {p}{' (encoder)' * (p == cia.PROFILE)}" for n, p in sorted(profiles.items())]
