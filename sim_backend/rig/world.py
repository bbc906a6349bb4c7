"""The world of one simulated rig: the arm, the wires from its motors, the start line, the trigger line, and time.

Devices, and simulators of devices on their own wires, sample it; it knows none of them. Times are int64 ns of the
host's monotonic clock, of the present or the past few seconds. Every method may be called from any thread.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from arm_io import DeviceFault, InputError, check_table
from arm_io.types import Array
from drivers import RigContext, SystemClock
from drivers.protocols import CounterMode, HostClock
from experiment import Experiment
from sim_backend.arm.signals import Mover, Run
from sim_backend.electronics import quadrature
from sim_backend.electronics.electronics import electronics_of
from sim_backend.rig.clock import FastClock
from sim_backend.rig.faults import ClockDrift, Fault, Unplugged
from sim_backend.rig.settings import Simulation
from sim_backend.rig.trigger_line import TriggerLine

Times = NDArray[np.int64]


class Plant(Protocol):
    """What is on the test floor; ``sim_backend.arm.plant`` is the one there is.

    encoder_lines  (n,) lines per motor revolution
    rest           (n,) rad: the pose before anything was asked
    standing       a mover that holds the pose (n,) rad with the brakes on
    moving         a mover that follows an experiment; ``loadable`` says what it cannot do, "" where all is well
    tracker_latency  s by which what a tracker says of the target is late
    thrusters      of a floating base; None: the base is fixed
    target         (k, 3) m: a point of the last link's frame in the base frame, at link-side joint positions (k, n)
    """

    encoder_lines: Array
    rest: Array
    tracker_latency: float
    thrusters: int | None

    def standing(self, pose: Array) -> Mover: ...
    def loadable(self, experiment: Experiment) -> str: ...
    def moving(self, experiment: Experiment) -> Mover: ...
    def target(self, position: Array, point: tuple[float, float, float]) -> Array: ...


class World:
    """One simulated rig. ``clock`` is the host's, of either pace."""

    def __init__(self, settings: Simulation, plant: Plant, clock: HostClock) -> None:
        self.settings, self.plant, self.clock = settings, plant, clock
        self.faults: list[Fault] = list(settings.fault)
        self.changes = 0  # counts whatever makes signals that were computed ahead untrue
        self.line: TriggerLine | None = None
        self.start_ns: int | None = None  # when the start line rose; None while it is low
        self._lock = threading.RLock()
        self.electronics = electronics_of(settings.encoder, settings.transducer, settings.seed, plant.encoder_lines)
        self._pulses: Callable[[int], TriggerLine] | None = None
        self._waiting: Mover | None = None
        self._watchers: list[Callable[[], None]] = []
        self._epoch = self._woken = clock.monotonic_ns()
        self._run = Run(plant.standing(plant.rest), self.electronics)
        self._earlier: tuple[int, Run] = (self._epoch, self._run)

    def now(self) -> int:
        """The host's monotonic clock, ns."""
        return self.clock.monotonic_ns()

    # Signals

    def motor_counts(self, at: Times) -> NDArray[np.int64]:
        """(k, n) x4 counts of the motors' encoders, never wrapped, at times (k,)."""
        return quadrature.count(*self.edges_passed(at), CounterMode.X4)

    def edges_passed(self, at: Times) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Edges of the square lines A and B that each motor is past, (k, n) each, at times (k,)."""
        passed = self._signal(lambda run, t: np.stack(run.edges_passed(t), axis=1), at)
        return passed[:, 0], passed[:, 1]

    def transducer_volts(self, at: Times) -> Array:
        """(k, n) V of the current transducers at times (k,), or (k, n) where each joint has its own."""
        return self._signal(lambda run, t: run.transducer_volts(t), at)

    def motor_angle(self, at: Times) -> Array:
        """(k, n) rad, with the gear's sign, at times (k,)."""
        return self._signal(lambda run, t: run.motor_angle(t), at)

    def joint_position(self, at: Times) -> Array:
        """(k, n) rad, link side, at times (k,)."""
        return self._signal(lambda run, t: run.joint_position(t), at)

    def base(self, at: Times) -> Array:
        """(k, 13 + thrusters) of a floating base at times (k,): position, attitude, velocity, demands."""
        return self._signal(lambda run, t: run.base(t), at)

    def target(self, at: Times, point: tuple[float, float, float]) -> Array:
        """(k, 3) m in the base frame at times (k,): where a point of the last link's frame is, as a tracker sees it."""
        late = round(self.plant.tracker_latency * 1e9)
        return self.plant.target(self.joint_position(at - late), point)

    def oldest_ns(self) -> int:
        """Signals before this time are forgotten."""
        with self._lock:
            oldest = self._run.oldest_ns()
            return self._epoch + oldest if oldest else self._earlier[0] + self._earlier[1].oldest_ns()

    def watch(self, look: Callable[[], None]) -> None:
        """Has ``look`` called every now and then before signals are forgotten."""
        self._watchers.append(look)

    def _wake(self, now: int) -> None:
        if now - self._woken > 1_000_000_000:
            self._woken = now
            for look in self._watchers:
                look()

    def _signal(self, signal: Callable[[Run, Times], NDArray], at: Times) -> NDArray:
        """The signal of the present run, or of the one before it for times before the present one began."""
        with self._lock:
            self._wake(self.now())
            rows = at if at.ndim == 1 else at.min(axis=1)
            before = rows < self._epoch
            if not before.any():
                return signal(self._run, at - self._epoch)
            epoch, run = self._earlier
            earlier = signal(run, np.maximum(at[before] - epoch, 0))
            if before.all():
                return earlier
            out = np.empty((len(rows), *earlier.shape[1:]), earlier.dtype)
            out[before], out[~before] = earlier, signal(self._run, at[~before] - self._epoch)
            return out

    # The arm

    def stand(self, pose: Array) -> None:
        """Drives the arm to a pose (n,) rad, at once, and brakes it there; encoders count all the way."""
        self._replace(self.plant.standing(pose), self.now())

    def move(self, mover: Mover, *, on_start_line: bool) -> None:
        """Sets a motion going: now, or when the start line rises, if it is low and ``on_start_line``."""
        with self._lock:
            if on_start_line and self.start_ns is None:
                self._waiting = mover
            else:
                self._replace(mover, self.now())

    def moved_s(self) -> float | None:
        """s since the motion set going began; None where it waits for the start line."""
        with self._lock:
            return None if self._waiting is not None else (self.now() - self._epoch) * 1e-9

    def stop(self) -> float:
        """Slows the present motion down from now on, or calls off the one that waits.

        Returns s, from its beginning, of the stop.
        """
        with self._lock:
            waited, self._waiting = self._waiting is not None, None
            if waited:
                return 0.0
            began = self._run.stop(self.now() - self._epoch)
            self.changed()
            return began

    def changed(self) -> None:
        """Something happened that signals computed ahead do not know of."""
        self.changes += 1

    def epoch_ns(self) -> int:
        """When the present motion (or standstill) began."""
        return self._epoch

    def _replace(self, mover: Mover, now: int) -> None:
        with self._lock:
            self._earlier = (self._epoch, self._run)
            self._run = Run(mover, self.electronics, (self._run, now - self._epoch))
            self._epoch = now
            self._waiting = None
            self.changed()

    # Lines

    def pulse_by(self, pulses: Callable[[int], TriggerLine]) -> None:
        """Sets the source of the edges of the trigger line, as a function of the time at which the start line rises.

        The previous source makes no further edges.
        """
        with self._lock:
            self._pulses, self.line = pulses, None
            if self.start_ns is not None:
                self.line = pulses(self.now())
            self.changed()

    def write_start(self, high: bool) -> None:
        """The start line: its rise sets the arm and the source of the trigger line going, its fall ends the latter."""
        with self._lock:
            if high == (self.start_ns is not None):
                return
            now = self.now()
            self.changed()
            if not high:
                self.start_ns = None
                if self.line is not None:
                    self.line = TriggerLine(self.line.first_ns, self.line.period_ns, self.line.made(now))
                return
            self.start_ns = now
            if self._pulses is not None:
                self.line = self._pulses(now)
            if self._waiting is not None:
                self._replace(self._waiting, now)

    # Faults

    def inject(self, fault: Fault) -> None:
        """A fault from now on (those with times or numbers, at theirs)."""
        self.faults.append(fault)
        self.changed()

    def faults_of(self, device: str) -> list[Fault]:
        """The faults of one device."""
        return [fault for fault in self.faults if fault.device == device]

    def drift(self, device: str) -> float:
        """How fast a device's clock is: true is 1."""
        return 1.0 + sum(fault.ppm for fault in self.faults_of(device) if isinstance(fault, ClockDrift)) * 1e-6

    def check_plugged(self, device: str, since_ns: int) -> None:
        """DeviceFault while the device is unplugged; ``since_ns`` is what its faults' times count from."""
        now = (self.now() - since_ns) * 1e-9
        for fault in self.faults_of(device):
            if isinstance(fault, Unplugged) and fault.at <= now and (fault.back is None or now < fault.back):
                raise DeviceFault(device, "stopped answering; check its plug and its power")


def check_wired(name: str, joints: Sequence[int], world: World) -> None:
    """InputError where a channel of a card is wired to a joint (from 1; 0: open) that the arm does not have."""
    there = len(world.plant.encoder_lines)
    if (last := max(joints)) > there:
        raise InputError(name, f"joints: the arm has no joint {last}; must be 1 to {there}, or 0 for an open channel")


def world_of(context: RigContext) -> World:
    """The world that a rig's drivers share, made when the first of them asks; its clock becomes the rig's."""
    return context.shared("sim_backend", lambda: _make_world(context))


def _make_world(context: RigContext) -> World:
    from sim_backend.arm.plant import Drives, read_arm

    settings = check_table("simulation", context.simulation, Simulation)
    clock: HostClock = FastClock() if settings.pace == "fast" else SystemClock()
    path, known = _models(settings, context)
    drives = Drives(context.gears, context.counts, settings.controller, tuple(settings.rotor_inertia))
    plant = read_arm(path, known, drives, settings.settle + settings.hold)
    plant.excite(settings.thrusters, settings.seed)
    try:
        world = World(settings, plant, clock)
    except ValueError as error:
        raise InputError("simulation", str(error)) from None
    context.clock = clock
    return world


def _models(settings: Simulation, context: RigContext) -> tuple[Path, Path | None]:
    """The model file of the arm that moves, and the rig's own model if that is another."""
    if settings.model is not None:
        return context.folder / settings.model, context.model
    if context.model is None:
        raise InputError("simulation", "model: no arm to move; give the rig a model, or name one here")
    return context.model, None
