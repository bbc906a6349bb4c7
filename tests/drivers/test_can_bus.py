"""The bus that drivers share: who reads it, to whom frames go, when they came."""

from __future__ import annotations

import errno
import threading
import time
import types
import uuid
from collections.abc import Iterator
from typing import Any

import can
import pytest

from drivers import can_bus
from drivers.can_bus import CanBus, CanConfig
from drivers.cia406 import device as cia406

MINE, YOURS = 0x181, 0x182


@pytest.fixture
def bus() -> Iterator[tuple[CanBus, Any]]:
    """A bus, and somebody else's end of it."""
    config = CanConfig(interface="virtual", channel=uuid.uuid4().hex)
    bus = CanBus(config)
    bus.open()
    with can.Bus(interface="virtual", channel=config.channel, preserve_timestamps=True) as other:
        yield bus, other
    bus.close()


def frame(identifier: int, number: int, stamp: float | None = None) -> can.Message:
    data = number.to_bytes(4, "little")
    return can.Message(
        arbitration_id=identifier, data=data, is_extended_id=False, timestamp=time.time() if stamp is None else stamp
    )


def within(seconds: float) -> float:
    return time.monotonic() + seconds


def test_two_who_wait_at_once_get_all_that_is_theirs(bus: tuple[CanBus, Any]) -> None:
    """Each reads for the other as well.

    Frames of both alternate, a reader of one must not be left waiting by the other's.
    """
    here, other = bus
    got: dict[int, list[int]] = {MINE: [], YOURS: []}

    def gather(identifier: int, box: can_bus.Mailbox) -> None:
        end = within(20)
        while len(got[identifier]) < 300 and time.monotonic() < end:
            got[identifier] += [int.from_bytes(data, "little") for _, _, data in box.wait(end)]

    threads = [threading.Thread(target=gather, args=(i, here.listen([i]))) for i in got]
    for thread in threads:
        thread.start()
    for number in range(300):
        for identifier in got:
            other.send(frame(identifier, number))
        if number % 20 == 0:
            time.sleep(0.002)
    for thread in threads:
        thread.join()
    assert got == {MINE: list(range(300)), YOURS: list(range(300))}


def test_a_frame_that_another_thread_read_is_not_waited_for(bus: tuple[CanBus, Any]) -> None:
    """Whoever waited for the other's reading to end finds his frame in the mailbox, and reads no further."""
    here, other = bus
    box = here.listen([MINE])
    for number in range(20):
        time.sleep(can_bus.ATTENDED)  # the bus's own thread reads again
        other.send(frame(MINE, number))
        begun = time.monotonic()
        assert len(box.wait(within(20))) == 1
        assert time.monotonic() - begun < 10


def test_frames_come_that_nobody_waits_for(bus: tuple[CanBus, Any]) -> None:
    """The bus's own thread receives them, and keeps no more than there is room for, the newest."""
    here, other = bus
    box = here.listen([MINE])
    for number in range(can_bus.MOST + 100):
        other.send(frame(MINE, number))
    end = within(20)
    while not box._frames or box._frames[-1][2] != (can_bus.MOST + 99).to_bytes(4, "little"):
        assert time.monotonic() < end
        time.sleep(0.005)
    kept = [int.from_bytes(data, "little") for _, _, data in box.take()]
    assert kept == list(range(100, can_bus.MOST + 100))


def test_a_frame_is_of_the_time_at_which_the_kernel_had_it(bus: tuple[CanBus, Any]) -> None:
    """Not of the time at which somebody read it; a stamp by another clock says nothing."""
    here, other = bus
    box = here.listen([MINE])
    for stamp, age in ((time.time() - 0.5, 0.5), (12.25, 0.0), (time.time() + 3600, 0.0)):
        before = time.monotonic_ns()
        other.send(frame(MINE, 1, stamp))
        ((at, _, _),) = box.wait(within(5))
        after = time.monotonic_ns()
        assert before - age * 1e9 - 1e6 <= at <= after - age * 1e9 + (after - before) + 1e6


def test_a_full_transmit_queue_is_waited_for(bus: tuple[CanBus, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """The kernel refuses a frame with ENOBUFS while the interface's queue is full, though its socket takes more."""
    here, other = bus
    send, full = here._bus.send, [True] * 5

    def queue(message: can.Message, timeout: float | None = None) -> None:
        assert timeout is not None, "python-can then fails at once"
        if full and full.pop():
            raise can.CanOperationError("Failed to transmit: No buffer space available", errno.ENOBUFS)
        send(message, timeout)

    monkeypatch.setattr(here._bus, "send", queue)
    here.send(MINE, b"\x07")
    assert here.is_open and other.recv(5.0).data == b"\x07"
    monkeypatch.setattr(can_bus, "SEND", 0.02)
    full += [True] * 1_000_000
    with pytest.raises(OSError, match="cannot send: Failed to transmit: No buffer space"):
        here.send(MINE, b"\x08")
    assert not here.is_open


@pytest.mark.parametrize("rate", [10_000, 125_000, 250_000, 1_000_000])
def test_a_search_for_nodes_leaves_no_frames_waiting(rate: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Frames are handed over no faster than the wire carries them and as many answers."""
    now, queued, most = 0.0, 0.0, 0.0

    def pass_by(seconds: float) -> None:
        nonlocal now, queued
        now, queued = now + seconds, max(queued - seconds, 0.0)

    def send(bus: CanBus, identifier: int, data: bytes) -> None:
        nonlocal queued, most
        queued += 2 * can_bus.frame_bits(8) / rate
        most = max(most, queued * rate / can_bus.frame_bits(8))

    monkeypatch.setattr(cia406, "time", types.SimpleNamespace(sleep=pass_by))
    monkeypatch.setattr(CanBus, "send", send)
    where = {"interface": "virtual", "channel": uuid.uuid4().hex, "bitrate": rate}
    assert cia406.find(cia406.Config(**where, nodes=(1,))) == []
    assert most < 3 and now < 0.5 + 127 * 3 * can_bus.frame_bits(8) / rate


def test_a_bus_that_fails_while_somebody_waits(bus: tuple[CanBus, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    here, other = bus
    box = here.listen([MINE])

    def off(timeout: float | None = None) -> None:
        raise can.CanOperationError("bus off")

    monkeypatch.setattr(here._bus, "recv", off)
    assert box.wait(within(0.3)) == [] and not here.is_open
    with pytest.raises(OSError, match="cannot receive: bus off"):
        here.send(MINE, b"")
    here.reopen()
    other.send(frame(MINE, 5))
    assert [data[0] for _, _, data in box.wait(within(5))] == [5]
