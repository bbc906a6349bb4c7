"""A LabJack T7 on loopback.

Registers by Modbus TCP, stream on the second port, buffer, auto-recovery and watchdog included.
"""

from __future__ import annotations

import struct
import threading

import numpy as np
from numpy.typing import NDArray

from drivers import modbus_tcp as modbus
from drivers.labjack_t7 import Config
from drivers.labjack_t7 import protocol as t7
from sim_backend.protocol.serving import Listener, Loop
from sim_backend.protocol.wires import Wires

MOST_SKIPPED = 0xFFFF
EF_READ_A_AND_RESET = 3100


class Registers:
    """The register map: plain memory, but for those that do something when read or written."""

    def __init__(self, serial: int) -> None:
        self.words: dict[int, int] = {}
        self.put(t7.PRODUCT_ID, struct.pack(">f", 7.0))
        self.put(t7.FIRMWARE, struct.pack(">f", 1.0292))
        self.put(t7.SERIAL, struct.pack(">I", serial))
        self.put(t7.STREAM_EXTERNAL_CLOCK_DIVISOR, struct.pack(">I", 1))

    def put(self, address: int, data: bytes) -> None:
        for k in range(len(data) // 2):
            self.words[address + k] = int.from_bytes(data[2 * k : 2 * k + 2], "big")

    def get(self, address: int, registers: int) -> bytes:
        return b"".join(self.words.get(address + k, 0).to_bytes(2, "big") for k in range(registers))

    def uint(self, address: int) -> int:
        return int.from_bytes(self.get(address, 2), "big")

    def float(self, address: int) -> float:
        return float(struct.unpack(">f", self.get(address, 2))[0])


class Buffer:
    """The T7's stream buffer and its behaviour when full.

    Sources: datasheet 3.2; U3 guide 5.2.12 for the separator scan.
    """

    def __init__(self, capacity: int, slots: int, packet: int) -> None:
        self.capacity, self.slots, self.packet = capacity // 2, slots, packet
        self.samples = np.empty(0, np.uint16)
        self.separator: int | None = None  # sample index at which the separator stands
        self.skipping = False
        self.skipped = 0
        self.info = 0
        self.status = t7.Status.RECOVERED

    def add(self, scans: NDArray[np.uint16]) -> None:
        """Keeps the scans that fit; after the first that does not, skips all until the buffer is empty."""
        if self.skipping and len(self.samples) < self.packet:
            self._resume()
        room = 0 if self.skipping else (self.capacity - len(self.samples)) // self.slots
        self.samples = np.concatenate([self.samples, scans[:room].ravel()])
        if room < len(scans):
            self.skipping = True
            self.skipped += len(scans) - room

    def _resume(self) -> None:
        self.separator, self.info = len(self.samples), min(self.skipped, MOST_SKIPPED)
        self.status = t7.Status.RECOVERY_OVERFLOW if self.skipped > MOST_SKIPPED else t7.Status.RECOVERED
        self.samples = np.concatenate([self.samples, np.full(self.slots, t7.SEPARATOR, np.uint16)])
        self.skipping, self.skipped = False, 0

    def packet_ready(self) -> t7.Packet | None:
        if len(self.samples) < self.packet:
            return None
        samples, self.samples = self.samples[: self.packet], self.samples[self.packet :]
        status, info = (t7.Status.RECOVERING if self.skipping else t7.Status.OK), 0
        if self.separator is not None:
            if self.separator < self.packet:
                status, info, self.separator = self.status, self.info, None
            else:
                self.separator -= self.packet
        return t7.Packet(min(2 * len(self.samples), 0xFFFF), status, info, samples)


class SimulatedT7:
    """The box.

    Faults for tests: ``pull_cable``/``plug_cable``, ``reset`` (power cycle), ``clock_ppm`` (its crystal), ``piece``
    (bytes that leave at once), ``cut_after`` (bytes of the stream after which its connection is cut, once).
    """

    def __init__(self, name: str, config: Config, wires: Wires, serial: int = 470012345) -> None:
        self.name, self.config, self.wires, self._serial = name, config, wires, serial
        self.clock_ppm = 0.0
        self.piece: int | None = None
        self.cut_after: int | None = None
        self.outputs: dict[int, int] = {}  # DIO line -> level
        self.dacs = [0.0, 0.0]
        self.tripped = 0  # times the watchdog has acted
        self._command, self._stream = Listener(config.host, config.port), Listener(config.host, config.stream_port)
        self._lock = threading.RLock()
        self._loop = Loop(self._step, lambda: self._command.files() + self._stream.files())
        self._power_up(0)

    @property
    def address(self) -> str:
        return f"{self._command.host}:{self._command.port} (stream {self._stream.port})"

    # -- life ---------------------------------------------------------------------------------------------------------

    def open(self) -> None:
        self.plug_cable()
        self._loop.start()

    def close(self) -> None:
        self._loop.stop()
        self.pull_cable()

    def pull_cable(self) -> None:
        with self._lock:
            self._command.close()
            self._stream.close()

    def plug_cable(self) -> None:
        with self._lock:
            self._command.open()
            self._stream.open()

    def reset(self, now: int) -> None:
        """Power off and on: connections cut, counters and timer at zero, stream off, outputs low."""
        with self._lock:
            self._command.drop()
            self._stream.drop()
            self._power_up(now)

    def _power_up(self, now: int) -> None:
        self._since, self._fed = now, now
        self.registers = Registers(self._serial)
        self._zero: dict[int, int] = {}  # DIO line -> count of the wires when its counter was enabled
        self._scan: t7.ScanList | None = None
        self._buffer = Buffer(0, 1, 1)
        self._outgoing = bytearray()
        self._frames = modbus.Frames()
        self._transaction = 0
        for line in list(self.outputs):
            self._set_line(line, 0, now)

    def _step(self, now: int) -> None:
        with self._lock:
            if self._command.accept():
                self._frames = modbus.Frames()
            if self._stream.accept():
                self._outgoing.clear()
            for frame in self._frames.feed(self._command.receive()):
                self._fed = now
                self._command.send(modbus.encode(self._answer(frame, now)))
            self._stream.receive()
            self._watchdog(now)
            self._acquire(now)
            self._send()

    # -- registers ----------------------------------------------------------------------------------------------------

    def timer(self, at: NDArray[np.int64]) -> NDArray[np.int64]:
        """CORE_TIMER at host times ``at``."""
        ticks = (at - self._since) * (t7.CORE_TIMER_HZ * 1e-9 * (1 + self.clock_ppm * 1e-6))
        return ticks.astype(np.int64) & 0xFFFFFFFF

    def _answer(self, frame: modbus.Frame, now: int) -> modbus.Frame:
        body = frame.body
        if frame.function == modbus.READ and len(body) == 4:
            address, registers = struct.unpack(">HH", body)
            self._refresh(address, now)
            data = self.registers.get(address, registers)
            return modbus.Frame(frame.transaction, frame.unit, modbus.READ, bytes([len(data)]) + data)
        if frame.function == modbus.WRITE and len(body) >= 5 and len(body) == 5 + body[4]:
            address, registers = struct.unpack_from(">HH", body)
            if self._refuses(address):
                return modbus.Frame(frame.transaction, frame.unit, modbus.WRITE | modbus.EXCEPTION, b"\x04")
            self.registers.put(address, body[5:])
            self._written(address, now)
            return modbus.Frame(frame.transaction, frame.unit, modbus.WRITE, struct.pack(">HH", address, registers))
        return modbus.Frame(frame.transaction, frame.unit, frame.function | modbus.EXCEPTION, b"\x01")

    def _refresh(self, address: int, now: int) -> None:
        at = np.array([now], np.int64)
        if address == t7.CORE_TIMER:
            self.registers.put(address, struct.pack(">I", int(self.timer(at)[0])))
        elif address == t7.STREAM_ENABLE:
            self.registers.put(address, struct.pack(">I", self._scan is not None))
        elif t7.EF_READ_A <= address < t7.EF_READ_A + 46:
            line = (address - t7.EF_READ_A) // 2
            self.registers.put(address, struct.pack(">I", int(self._counts(line, at)[0]) & 0xFFFFFFFF))
        elif EF_READ_A_AND_RESET <= address < EF_READ_A_AND_RESET + 46:
            line = (address - EF_READ_A_AND_RESET) // 2
            self.registers.put(address, struct.pack(">I", int(self._counts(line, at)[0]) & 0xFFFFFFFF))
            if line in self._zero:
                self._zero[line] = int(self._wired(line, at)[0])
        elif address == t7.FLASH_READ and self.registers.uint(t7.FLASH_POINTER) == t7.CALIBRATION_IN_FLASH:
            nominal = t7.InputCalibration()
            values = (nominal.positive_slope, nominal.negative_slope, nominal.center, -10.586956522)
            self.registers.put(address, struct.pack(">4f", *values))

    def _refuses(self, address: int) -> bool:
        streaming = self._scan is not None and t7.STREAM_SCANRATE_HZ <= address < t7.STREAM_ENABLE
        guarded = t7.WATCHDOG_ENABLE < address <= t7.WATCHDOG_DAC + 11 and self.registers.uint(t7.WATCHDOG_ENABLE)
        enabled = t7.EF_INDEX <= address < t7.EF_INDEX + 46 and self.registers.uint(address - 100)
        return bool(streaming or guarded or enabled)

    def _written(self, address: int, now: int) -> None:
        if t7.EF_ENABLE <= address < t7.EF_ENABLE + 46:
            line = (address - t7.EF_ENABLE) // 2
            self._zero.pop(line, None)
            pair = [t7.EF_ENABLE + 2 * (line & ~1), t7.EF_ENABLE + 2 * (line | 1)]
            if all(self.registers.uint(a) and self.registers.uint(a + 100) == t7.QUADRATURE for a in pair):
                self._zero[line & ~1] = int(self._wired(line & ~1, np.array([now], np.int64))[0])
        elif t7.DIO <= address < t7.DIO + 23:
            self._set_line(address - t7.DIO, self.registers.words[address] & 1, now)
        elif address in (t7.DAC, t7.DAC + 2):
            self.dacs[(address - t7.DAC) // 2] = min(max(self.registers.float(address), 0.0), 5.0)
        elif address == t7.STREAM_ENABLE:
            self._start(now) if self.registers.uint(address) else self._stop()

    def _set_line(self, line: int, level: int, now: int) -> None:
        self.outputs[line] = level
        name = next((n for n, dio in self.config.lines.items() if dio == line), None)
        if name is not None:
            self.wires.line(name, bool(level), now)

    def _wired(self, line: int, at: NDArray[np.int64]) -> NDArray[np.int64]:
        return self.wires.counts(self.config.counters.index(line), at)

    def _counts(self, line: int, at: NDArray[np.int64]) -> NDArray[np.int64]:
        zero = self._zero.get(line)
        return np.zeros(len(at), np.int64) if zero is None else self._wired(line, at) - zero

    def _watchdog(self, now: int) -> None:
        get = self.registers.uint
        if not get(t7.WATCHDOG_ENABLE) or now - self._fed < get(t7.WATCHDOG_TIMEOUT_S) * 1_000_000_000:
            return
        self._fed = now
        self.tripped += 1
        if get(t7.WATCHDOG_DIO_ENABLE):
            for line in range(23):
                if not get(t7.WATCHDOG_DIO_INHIBIT) >> line & 1 and get(t7.WATCHDOG_DIO_DIRECTION) >> line & 1:
                    self._set_line(line, get(t7.WATCHDOG_DIO_STATE) >> line & 1, now)
        for dac in (0, 1):
            if get(t7.WATCHDOG_DAC_ENABLE + 10 * dac):
                self.dacs[dac] = self.registers.float(t7.WATCHDOG_DAC + 10 * dac)

    # -- stream -------------------------------------------------------------------------------------------------------

    def _start(self, now: int) -> None:
        get = self.registers.uint
        addresses = [get(t7.STREAM_SCANLIST + 2 * k) for k in range(get(t7.STREAM_NUM_ADDRESSES))]
        inputs = tuple(a // 2 for a in addresses if a < 28)
        counters = tuple((a - t7.EF_READ_A) // 2 for a in addresses if t7.EF_READ_A <= a < t7.EF_READ_A + 46)
        self._scan = t7.ScanList(inputs, counters, t7.CORE_TIMER in addresses)
        self._rate = self.registers.float(t7.STREAM_SCANRATE_HZ)
        self._external = get(t7.STREAM_CLOCK_SOURCE) == 2
        self._buffer = Buffer(get(t7.STREAM_BUFFER_SIZE_BYTES), len(addresses), get(t7.STREAM_SAMPLES_PER_PACKET))
        self._started, self._made, self._seen = now, 0, now
        self._outgoing.clear()

    def _stop(self) -> None:
        self._scan = None
        self._outgoing.clear()

    def _triggers(self, now: int) -> NDArray[np.int64]:
        if self._external:
            edges = self.wires.trigger.between(self._seen, now)
            self._seen = int(edges[-1]) if len(edges) else self._seen
            return edges
        period = 1e9 / (self._rate * (1 + self.clock_ppm * 1e-6))
        due = int((now - self._started) / period)
        times = self._started + ((np.arange(self._made, due) + 1) * period).astype(np.int64)
        self._made = due
        return times

    def _acquire(self, now: int) -> None:
        if self._scan is None:
            return
        at = self._triggers(now)
        if len(at) or self._buffer.skipping:
            self._buffer.add(self._measure(self._scan, at))

    def _measure(self, scan: t7.ScanList, at: NDArray[np.int64]) -> NDArray[np.uint16]:
        rows = np.empty((len(at), scan.slots), np.uint16)
        calibration = t7.InputCalibration()
        for slot, channel in enumerate(scan.inputs):
            rows[:, slot] = calibration.codes(self.wires.volts(self.config.inputs.index(channel), at))
        wide = [self._counts(line, at) for line in scan.counters] + [self.timer(at)] * scan.timer
        for k, values in enumerate(wide):
            rows[:, len(scan.inputs) + 2 * k] = values & 0xFFFF
            rows[:, len(scan.inputs) + 2 * k + 1] = values >> 16 & 0xFFFF
        return rows

    def _send(self) -> None:
        """As much as the network takes; what it does not take stays in the buffer of the T7."""
        while True:
            if not self._outgoing:
                packet = None
                if self._scan is not None and self._stream.connection is not None:
                    packet = self._buffer.packet_ready()
                if packet is None:
                    return
                self._outgoing += t7.encode_packet(self._transaction, packet)
                self._transaction += 1
            sent = self._stream.send(bytes(self._outgoing[: self.piece]))
            if not sent:
                return
            del self._outgoing[:sent]
            if self.cut_after is not None:
                self.cut_after -= sent
                if self.cut_after <= 0:
                    self.cut_after = None
                    self._stream.drop()
                    self._command.drop()


make = SimulatedT7
