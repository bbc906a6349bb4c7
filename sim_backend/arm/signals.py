"""One run of the arm from its epoch on: what moves, and every signal of it as a function of time.

The arm is integrated in chunks, ahead of whoever asks; between its steps, motor angles are cubic (Hermite, from angles
and speeds) and currents linear. The encoders' noise lasts ``noise_period`` a value. Of each such *slot* the edges
passed at its start are kept, so that the edges passed at any instant follow from that instant's own slot
(``sine_encoder``). All noise is a function of the time since the epoch: two runs of the same arm and seed give the same
signals, whoever asks, at whatever pace, in whatever blocks.

What is left out: a motor that turns back within a slot is seen at the slot's ends only (2 a (T/4)^2 = 1e-5 rad at a =
1000 rad/s2 motor side, under 1 % of a line); nothing else between samples is.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from sim_backend.arm.history import History
from sim_backend.electronics import hall_transducer, noise, sine_encoder
from sim_backend.electronics.electronics import Electronics

Times = NDArray[np.int64]

CHUNK_ROWS = 256
"""Of the arm, integrated at a time: 2 ms for which no simulated device answers."""
KEEP = 5.0
"""s of signals held."""


@dataclass(frozen=True)
class Steps:
    """States of n joints at m consecutive instants; (m, n).

    q, qd    link side, rad, rad/s
    motor    motor angle, rad, and its rate, with the gear's sign
    current  A, in the motor's own sense
    base     (m, 13 + thrusters) of a floating base (``sim_backend.arm.vehicle``); None where it is fixed
    """

    q: Array
    qd: Array
    motor: Array
    motor_rate: Array
    current: Array
    base: Array | None = None


class Mover(Protocol):
    """What moves. ``step_ns`` ns between the rows that it gives; ``still_from`` s after which nothing changes any more.

    ``advance`` gives the next rows, the first one at the epoch, ``CHUNK_ROWS`` at a time; the same however often it is
    asked. ``state`` is all that ``restore`` needs to go on from here once more. ``stop`` slows the motion down from
    ``at`` s on, or as soon after as it can, which it returns. Between rows currents go exponentially, with time
    constant ``current_lag`` s, towards a command that is constant there (inf: they are linear). ``current_delay`` s:
    how late the transducers show them.
    """

    step_ns: int
    still_from: float
    current_lag: float
    current_delay: float

    def advance(self) -> Steps: ...
    def state(self) -> object: ...
    def restore(self, state: object) -> None: ...
    def stop(self, at: float) -> float: ...


@dataclass(frozen=True)
class _Mark:
    """Where a chunk began: the way back, for a motion that is stopped after more of it was integrated."""

    row: int
    slot: int
    mover: object
    passed: list[NDArray[np.int64]]
    current: Array


class Run:
    """Signals of one mover.

    Times (k,) int64 ns since the epoch, not before it and not more than ``KEEP`` s behind the newest asked for.
    """

    def __init__(self, mover: Mover, electronics: Electronics, after: tuple[Run, int] | None = None) -> None:
        """Signals are computed when they are asked for.

        after: the previous run, and the instant (ns) at which this one continues its encoder counts; None: counts from
        the pose.
        """
        self.mover = mover
        self._electronics = electronics
        self._before = after
        self._begun = False
        self._lines = sine_encoder.lines_of(electronics.encoder)
        joints = len(electronics.encoder.lines)
        self._encoder_noise = noise.keys(electronics.seed, "encoder", joints)
        self._hall_noise = noise.keys(electronics.seed, "transducer", joints)
        rows = int(KEEP * 1e9 / mover.step_ns)
        self._q, self._qd, self._motor, self._rate, self._current = (History((joints,), rows) for _ in range(5))
        self._base: History | None = None
        slots = int(KEEP * 1e9 / electronics.noise_period_ns)
        self._passed = tuple(History((joints,), slots, np.int64) for _ in self._lines)
        self._marks: deque[_Mark] = deque(maxlen=8)
        self._after: list[NDArray[np.int64]] = []  # edges passed at the end of the last slot kept

    def _begin(self) -> None:
        """Computes the first chunk, and which edges the lines are past at its start."""
        first = self.mover.advance()
        self._raw_current = first.current[:1]
        if self._before is not None:
            run, at = self._before
            run.edges_passed(np.array([at]))
            self._after, self._before = run._after, None
        else:
            phi = sine_encoder.phase(self._electronics.encoder, first.motor[0])
            quiet = np.zeros_like(phi)
            self._after = [
                sine_encoder.bounds(*sine_encoder.place(line, phi), *sine_encoder.switching(line, quiet))[0]
                for line in self._lines
            ]
        self._begun = True
        self._keep(first)

    def motor_angle(self, at: Times) -> Array:
        """(k, n) rad."""
        self._extend(at)
        return self._hermite(self._motor, self._rate, at)

    def joint_position(self, at: Times) -> Array:
        """(k, n) rad, link side."""
        self._extend(at)
        return self._hermite(self._q, self._qd, at)

    def base(self, at: Times) -> Array:
        """(k, 13 + thrusters) of the floating base, linear between steps; (k, 0) where it is fixed."""
        self._extend(at if at.size else np.zeros(1, np.int64))
        if self._base is None:
            return np.empty((len(at), 0))
        before, part = self._between(at)
        low = self._base[before]
        return np.asarray(low + part[:, None] * (self._base[before + 1] - low))

    def edges_passed(self, at: Times) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Edges of lines A and B that the motors are past, (k, n) each; see ``sine_encoder``."""
        self._extend(at)
        slot = at // self._electronics.noise_period_ns
        phi = sine_encoder.phase(self._electronics.encoder, self._hermite(self._motor, self._rate, at))
        noises = noise.normals(self._encoder_noise, slot[:, None], 2)
        a, b = (
            np.clip(
                history[slot],
                *sine_encoder.bounds(*sine_encoder.place(line, phi), *sine_encoder.switching(line, its_noise)),
            )
            for line, its_noise, history in zip(self._lines, noises, self._passed)
        )
        return a, b

    def transducer_volts(self, at: Times) -> Array:
        """Outputs of the Hall transducers, (k, n) V, at times (k,), or (k, n) where each joint has its own."""
        at = at if at.ndim == 2 else at[:, None]
        shown = np.maximum(at - round(self.mover.current_delay * 1e9), 0)
        self._extend(shown)
        before, part = self._between(shown)
        if np.isfinite(self.mover.current_lag):
            steepness = -self.mover.step_ns * 1e-9 / max(self.mover.current_lag, 1e-9)
            part = np.expm1(part * steepness) / np.expm1(steepness)
        held, joint = self._current, np.arange(len(self._hall_noise))
        low = held.at(before, joint)
        current = low + part * (held.at(before + 1, joint) - low)
        return hall_transducer.volts(self._electronics.transducer, current, noise.normals(self._hall_noise, at, 1)[0])

    def oldest_ns(self) -> int:
        """Signals before this time are forgotten."""
        return max(self._motor.first * self.mover.step_ns, self._passed[0].first * self._electronics.noise_period_ns)

    def stop(self, at: int) -> float:
        """The motion slows down from a time on; what was integrated beyond it is integrated again.

        Returns s: from when on it does.
        """
        while len(self._marks) > 1 and self._marks[-1].row * self.mover.step_ns > at:
            self._marks.pop()
        if self._marks and self._begun and self._horizon() > at:
            mark = self._marks.pop()
            for history in self._histories():
                history.truncate(mark.row)
            for history in self._passed:
                history.truncate(mark.slot)
            self.mover.restore(mark.mover)
            self._after, self._raw_current = list(mark.passed), mark.current
        return self.mover.stop(at * 1e-9)

    def _between(self, at: Times) -> tuple[NDArray[np.int64], Array]:
        """Number of the step before each time, and the part of the step that has passed since."""
        before = at // self.mover.step_ns
        return before, (at - before * self.mover.step_ns) / self.mover.step_ns

    def _hermite(self, values: History, rates: History, at: Times) -> Array:
        """Cubic through values and rates at both ends of each step: v0 + s (c1 + s (c2 + s c3))."""
        before, part = self._between(at)
        s, step = part[:, None], self.mover.step_ns * 1e-9
        low, low_rate, high_rate = values[before], step * rates[before], step * rates[before + 1]
        rise = values[before + 1] - low
        return low + s * (low_rate + s * (3 * rise - 2 * low_rate - high_rate + s * (low_rate + high_rate - 2 * rise)))

    def _extend(self, at: Times) -> None:
        """Integrates until every signal is known at all of the times."""
        if at.size == 0:
            return
        if not self._begun:
            self._begin()
        until = int(at.max()) + self.mover.step_ns + self._electronics.noise_period_ns
        asleep = (int(at.min()) - self._horizon()) * 1e-9
        if asleep > KEEP and self._horizon() * 1e-9 > self.mover.still_from:
            self._skip(int(at.min()))
        while self._horizon() <= until:
            self._marks.append(
                _Mark(self._motor.end, self._passed[0].end, self.mover.state(), list(self._after), self._raw_current)
            )
            self._keep(self.mover.advance())

    def _histories(self) -> list[History]:
        """Those with a row per step of the mover."""
        histories = (self._q, self._qd, self._motor, self._rate, self._current, self._base)
        return [history for history in histories if history is not None]

    def _horizon(self) -> int:
        """ns: the motion is known up to this time."""
        return (self._motor.end - 1) * self.mover.step_ns

    def _keep(self, steps: Steps) -> None:
        """Appends rows of the motion, and counts the edges of the slots that become known by them."""
        current = np.concatenate([self._raw_current, steps.current])
        before = self._current.last if len(self._current) else current[0]
        step = self.mover.step_ns * 1e-9
        self._current.append(hall_transducer.lagged(self._electronics.transducer, current, step, before))
        self._raw_current = steps.current[-1:]
        self._q.append(steps.q)
        self._qd.append(steps.qd)
        self._motor.append(steps.motor)
        self._rate.append(steps.motor_rate)
        if steps.base is not None:
            if self._base is None:
                self._base = History(steps.base.shape[1:], self._q.keep)
                self._base.restart(self._q.end - len(steps.base))
            self._base.append(steps.base)
        self._count_edges()

    def _count_edges(self) -> None:
        """The slots that have become known: edges passed at each one's start, and after the last."""
        period = self._electronics.noise_period_ns
        slots = np.arange(self._passed[0].end, (self._horizon() - 1) // period)
        if len(slots) == 0:
            return
        ends = np.append(slots, slots[-1] + 1) * period
        phi = sine_encoder.phase(self._electronics.encoder, self._hermite(self._motor, self._rate, ends))
        noises = noise.normals(self._encoder_noise, slots[:, None], 2)
        after = []
        for k, (line, its_noise) in enumerate(zip(self._lines, noises)):
            thresholds = sine_encoder.switching(line, its_noise)
            before, within = sine_encoder.place(line, phi)
            ends_of_slots = ((before[:-1], within[:-1]), (before[1:], within[1:]))
            bounds = zip(*(sine_encoder.bounds(*end, *thresholds) for end in ends_of_slots))
            lowest, highest = (np.stack(pair, axis=1).reshape(-1, phi.shape[1]) for pair in bounds)
            passed = sine_encoder.follow(lowest, highest, self._after[k])
            self._passed[k].append(passed[0::2])
            after.append(passed[-1])
        self._after = after

    def _skip(self, to: int) -> None:
        """Forgets the time up to shortly before ``to``: the arm is at standstill, and no signal was read."""
        row = to // self.mover.step_ns - 2
        self._marks.clear()
        for history in self._histories():
            history.restart(row)
        for history in self._passed:
            history.restart(row * self.mover.step_ns // self._electronics.noise_period_ns + 1)
        self._keep(self.mover.advance())
