"""Isabellenhuette IVT-S current sensors on a CAN bus: configured by commands, then sending by themselves."""

from __future__ import annotations

import contextlib
import threading

import numpy as np

from drivers.can_bus import CanBus
from drivers.isabellenhuette_ivts import Config
from drivers.isabellenhuette_ivts import protocol as ivt
from sim_backend.protocol.serving import Loop
from sim_backend.protocol.wires import Wires

SERIAL = bytes([0, 0, 0x16, 0x2E])
WAITING, WAITING_NS = 3, 10_000_000
"""Periods, and ns, for which a result may wait for the bus; later ones overwrite it, as in a controller's mailboxes."""


class Sensor:
    """One sensor's settings, as delivered: current and voltages every 20 ms, running from power-up on."""

    def __init__(self) -> None:
        self.running = True
        self.period = [0.02] * 4 + [0.0] * (len(ivt.CHANNELS) - 4)
        self.due = [0] * len(ivt.CHANNELS)
        self.counter = [0] * len(ivt.CHANNELS)
        self.drop = 0  # frames that will be lost on the way


class SimulatedIvts:
    """All sensors of one Config. Faults for tests: ``sensors[k].drop`` (frames to lose), ``mute``, ``restart(k)``."""

    def __init__(self, name: str, config: Config, wires: Wires) -> None:
        self.name, self.config, self.wires = name, config, wires
        self.bus = CanBus(config)
        self.sensors = [Sensor() for _ in config.sensors]
        self.mute = False
        self._commands = self.bus.listen([s.command for s in config.sensors])
        self._lock = threading.RLock()
        self._loop = Loop(self._step, list, 0.0005)

    @property
    def address(self) -> str:
        return f"{self.config.interface} {self.config.channel}, {len(self.sensors)} sensors"

    def open(self) -> None:
        self.bus.open()
        self._loop.start()

    def close(self) -> None:
        self._loop.stop()
        self.bus.close()

    def restart(self, k: int) -> None:
        """Power off and on: settings as delivered, and the word that it is alive, where the bus is there."""
        with self._lock:
            self.sensors[k] = Sensor()
            wiring = self.config.sensors[k]
            alive = bytes([ivt.ALIVE]) + wiring.command.to_bytes(2, "big") + SERIAL + b"\0"
            with contextlib.suppress(OSError):
                self.bus.send(wiring.reply, alive)

    def _step(self, now: int) -> None:
        with self._lock, contextlib.suppress(OSError):
            for _, identifier, data in self._commands.take():
                for sensor, wiring in zip(self.sensors, self.config.sensors):
                    if wiring.command == identifier and len(data) == 8:
                        self.bus.send(wiring.reply, self._answer(sensor, data, now))
            for k, sensor in enumerate(self.sensors):
                if sensor.running and not self.mute:
                    self._measure(k, sensor, now)

    def _answer(self, sensor: Sensor, data: bytes, now: int) -> bytes:
        command = data[0]
        if command == ivt.SET_MODE:
            sensor.running = bool(data[1] & 1)
            sensor.due = [now] * len(sensor.due)
            return bytes([ivt.reply_to(command)]) + data[1:]
        if ivt.SET_RESULT <= command < ivt.SET_RESULT + len(ivt.CHANNELS) and not sensor.running:
            channel = command - ivt.SET_RESULT
            cyclic = data[1] & 0xF == ivt.CYCLIC
            sensor.period[channel] = int.from_bytes(data[2:4], "big") / 1000 if cyclic else 0.0
            return bytes([ivt.reply_to(command)]) + data[1:]
        if command == ivt.GET_SERIAL:
            return bytes([ivt.reply_to(command)]) + SERIAL + b"\0\0\0"
        if command == ivt.GET_VERSION:  # hardware 3, version 1.7 of 2020-08-12
            return bytes([ivt.reply_to(command), 3, 1, 7, 20, 8, 12, 0])
        if command == ivt.GET_DEVICE:  # an IVT-S without voltage channels on CAN, 24 V
            rated = round(self.config.rated_current)
            return bytes([ivt.reply_to(command), 2, rated >> 4, (rated & 0xF) << 4, 3, 1, 1, 0])
        return bytes([0xFF]) + data[:7]  # refused, as every configuration is while it runs

    def _measure(self, k: int, sensor: Sensor, now: int) -> None:
        for channel, period in enumerate(sensor.period):
            while period and now >= sensor.due[channel]:
                step = int(period * 1e9)
                at = (sensor.due[channel] or now) // step * step  # all sensors on one grid
                sensor.due[channel] = at + step
                if now - at > max(WAITING * step, WAITING_NS):
                    sensor.counter[channel] = (sensor.counter[channel] + 1) % 16
                    continue
                value = int(np.rint(1000 * self.wires.volts(k, np.array([at], np.int64))[0])) if channel == 0 else 0
                state = sensor.counter[channel]
                sensor.counter[channel] = (state + 1) % 16
                if sensor.drop and channel == 0:
                    sensor.drop -= 1
                    continue
                data = bytes([channel, state]) + value.to_bytes(4, "big", signed=True)
                self.bus.send(self.config.sensors[k].result + channel, data)


make = SimulatedIvts
