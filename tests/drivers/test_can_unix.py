"""The CAN bus of Unix sockets: what one sends all others have, in order.

Whoever dies, wedges or comes late holds nobody up.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from drivers.can_bus import CanConfig
from drivers.can_unix import UnixBus


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "can"


@pytest.fixture
def three(folder: Path) -> Iterator[list[UnixBus]]:
    with ExitStack() as stack:
        yield [stack.enter_context(UnixBus(folder)) for _ in range(3)]


def frame(number: int, identifier: int = 0x181) -> can.Message:
    return can.Message(arbitration_id=identifier, data=number.to_bytes(4, "little"), is_extended_id=False)


def received(bus: can.BusABC, seconds: float = 0.0) -> list[int]:
    """The numbers that have come; waits ``seconds`` for the first."""
    numbers = []
    while (message := bus.recv(seconds)) is not None:
        numbers.append(int.from_bytes(message.data, "little"))
        seconds = 0.0
    return numbers


def test_everybody_else_has_every_frame_in_order(three: list[UnixBus]) -> None:
    first, second, third = three
    for number in range(100):
        first.send(frame(number))
    second.send(frame(1000))
    assert received(second, 1.0) == list(range(100))
    assert received(first, 1.0) == [1000]
    assert sorted(received(third, 1.0)) == [*range(100), 1000]


@given(
    identifier=st.integers(0, 0x1FFFFFFF),
    data=st.binary(max_size=8),
    remote=st.booleans(),
    error=st.booleans(),
)
def test_a_frame_arrives_as_it_was_sent(
    tmp_path_factory: pytest.TempPathFactory, identifier: int, data: bytes, remote: bool, error: bool
) -> None:
    sent = can.Message(
        arbitration_id=identifier,
        is_extended_id=identifier > 0x7FF,
        is_remote_frame=remote,
        is_error_frame=error,
        data=b"" if remote else data,
    )
    folder = tmp_path_factory.getbasetemp() / "frames"
    with UnixBus(folder) as here, UnixBus(folder) as there:
        before = time.time()
        here.send(sent)
        came = there.recv(1.0)
        assert came is not None and came.equals(sent, timestamp_delta=None, check_channel=False, check_direction=False)
        assert before <= came.timestamp <= time.time()


def test_whoever_comes_later_hears_what_is_sent_from_then_on(folder: Path) -> None:
    with UnixBus(folder) as first:
        first.send(frame(1))
        for turn in range(20):
            with UnixBus(folder) as second:
                first.send(frame(turn))
                assert received(second, 1.0) == [turn]


def test_a_process_killed_on_the_bus_leaves_nothing(folder: Path) -> None:
    code = (
        f"import time; from drivers.can_unix import UnixBus; b = UnixBus({str(folder)!r}); print('on', "
        "flush=True); time.sleep(60)"
    )
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    with UnixBus(folder) as here, UnixBus(folder) as there:
        assert process.stdout.readline() == "on\n"
        here.send(frame(1))
        assert len(os.listdir(folder)) == 3
        process.send_signal(signal.SIGKILL)
        process.wait()
        here.send(frame(2))
        here.send(frame(3))
        assert received(there, 1.0) == [1, 2, 3]
        assert len(os.listdir(folder)) == 2
    assert os.listdir(folder) == []


def test_a_receiver_that_does_not_read_holds_nobody_up(three: list[UnixBus]) -> None:
    """It loses frames, from some point on, and the newest: what fits is some hundred frames."""
    first, second, wedged = three
    for number in range(5000):
        first.send(frame(number))
        assert received(second) == [number]
    kept = received(wedged, 1.0)
    assert 100 < len(kept) < 5000 and kept == list(range(len(kept)))
    first.send(frame(7))
    assert received(wedged, 1.0) == [7]


def test_the_folder_is_this_users_alone(tmp_path: Path) -> None:
    with UnixBus(tmp_path / "new"):
        assert (tmp_path / "new").stat().st_mode & 0o777 == 0o700
    (tmp_path / "open").mkdir(mode=0o755)
    with pytest.raises(can.CanInitializationError, match="open to others"):
        UnixBus(tmp_path / "open")
    with pytest.raises(can.CanInitializationError, match="too long"):
        UnixBus(tmp_path / ("long" * 40))
    with UnixBus(tmp_path / "new") as bus, pytest.raises(can.CanOperationError, match="CAN FD"):
        bus.send(can.Message(data=bytes(12), is_fd=True))


def test_an_interface_that_listens_to_the_network_is_refused() -> None:
    with pytest.raises(ValidationError, match="listens to the whole network"):
        CanConfig(interface="udp_multicast", channel="239.74.163.2")
