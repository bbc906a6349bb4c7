"""A T7 that two threads command, the sampler's and the guard's: over a real socket, to a server that answers late."""

from __future__ import annotations

import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from drivers import RigContext
from drivers import modbus_tcp as modbus
from drivers.labjack_t7 import device as driver
from drivers.labjack_t7 import protocol as t7
from drivers.labjack_t7 import setup
from drivers.labjack_t7.link import LinkLost, T7Link
from sim_backend.protocol import labjack_t7 as simulator
from tests.drivers.swing import swing_wires
from tests.drivers.test_labjack_t7 import config

TIMEOUT = 2.0  # s for an answer: a hundred times what the server takes, whatever else the machine does
LATE = 0.02
LINES = (4, 5)
LOW = {t7.DIO + 4: b"\0\0", t7.DIO + 5: b"\0\0", t7.DAC: bytes(4), t7.DAC + 2: bytes(4)}


class Server:
    """The T7's registers. ``answer(connection, frame)``: the reply to a request, or None for none at all."""

    def __init__(self, answer: Callable[[int, modbus.Frame], modbus.Frame | None]) -> None:
        self._answer = answer
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self.written: dict[int, bytes] = {}
        threading.Thread(target=self._accept, daemon=True).start()

    def close(self) -> None:
        self._listener.close()

    def _accept(self) -> None:
        number = 0
        while True:
            try:
                connection, _ = self._listener.accept()
            except OSError:
                return
            threading.Thread(target=self._serve, args=(number, connection), daemon=True).start()
            number += 1

    def _serve(self, number: int, connection: socket.socket) -> None:
        frames = modbus.Frames()
        with connection:
            while data := connection.recv(4096):
                for frame in frames.feed(data):
                    time.sleep(LATE)
                    reply = self._answer(number, frame)
                    if reply is not None and frame.function == modbus.WRITE and reply.function == modbus.WRITE:
                        self.written[struct.unpack(">H", frame.body[:2])[0]] = frame.body[5:]
                    if reply is not None:
                        connection.sendall(modbus.encode(reply))


def obey(_: int, frame: modbus.Frame) -> modbus.Frame:
    if frame.function == modbus.READ:
        registers = struct.unpack(">HH", frame.body)[1]
        body = bytes([2 * registers]) + bytes(2 * registers)
        return modbus.Frame(frame.transaction, 1, modbus.READ, body)
    return modbus.Frame(frame.transaction, 1, modbus.WRITE, frame.body[:4])


@contextmanager
def linked(
    answer: Callable[[int, modbus.Frame], modbus.Frame | None], timeout: float = TIMEOUT
) -> Iterator[tuple[T7Link, Server]]:
    server, stream = Server(answer), socket.create_server(("127.0.0.1", 0))
    link = T7Link("127.0.0.1", server.port, stream.getsockname()[1], timeout)
    link.connect()
    yield link, server
    link.close()
    server.close()
    stream.close()


def test_a_late_answer_goes_to_the_thread_that_asked() -> None:
    with linked(obey) as (link, server):
        wrong: list[OSError] = []

        def read_all_the_time() -> None:
            try:
                for _ in range(10):
                    link.read_uint(t7.CORE_TIMER)
            except OSError as error:
                wrong.append(error)

        sampler = threading.Thread(target=read_all_the_time)
        sampler.start()
        for _ in range(2):
            setup.set_outputs_low(link, LINES)
        sampler.join()
        assert wrong == [] and link.connected and link.strays == 0
        assert server.written == LOW


def test_outputs_are_low_though_the_connection_stops_answering() -> None:
    """As behind a network that has lost it: whoever waits for the answer learns nothing, the next one is refused."""
    with linked(lambda number, frame: obey(number, frame) if number else None, timeout=0.3) as (link, server):
        with pytest.raises(LinkLost):
            setup.set_outputs_low(link, LINES)
        setup.force_outputs_low(link, LINES)
        assert server.written == LOW


@pytest.mark.parametrize("broken", LOW)
def test_an_output_that_is_refused_leaves_no_other_as_it_is(broken: int) -> None:
    def refuse_one(number: int, frame: modbus.Frame) -> modbus.Frame:
        if struct.unpack(">H", frame.body[:2])[0] == broken:
            return modbus.Frame(frame.transaction, 1, modbus.WRITE | modbus.EXCEPTION, b"\x04")
        return obey(number, frame)

    with linked(refuse_one) as (link, server):
        setup.force_outputs_low(link, LINES)
        assert server.written == {address: data for address, data in LOW.items() if address != broken}


def test_the_driver_makes_safe_over_a_connection_of_its_own_where_an_answer_is_lost() -> None:
    box = simulator.make("t7", config(counters=(0,), inputs=(0,)), swing_wires())
    box.open()
    device = driver.make("t7", box.config, RigContext())
    device.safe()
    assert not device._link.connected and box.outputs == {}, "a device that was never opened is not connected to"
    device.open()
    device.write_line("start", True)
    device.write_volts(0, 1.5)
    device.write_volts(1, 2.5)
    send, answers = box._command.send, [b"lost"]
    box._command.send = lambda data: len(data) if answers and answers.pop() else send(data)
    device.safe()
    assert box.outputs[4] == 0 and box.dacs == [0.0, 0.0]
    device.close()
    box.close()
