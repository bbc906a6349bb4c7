"""An arm standing, or moving under its servos: ``sim_backend.arm.signals.Mover``s on ``arm_model``'s dynamics.

Effects of sensing and timing in the arm's model (``arm_model.effects``: an encoder's ripple, a transducer's offset,
late currents) are put where they belong: on the way from the motors to the wires that ``sim_backend`` simulates.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from arm_io import DeviceFault, InputError
from arm_io.types import Array
from arm_model import Arm, Motion
from arm_model.effects import CATALOGUE, Signals, values_of
from arm_model.sensing import recorded
from arm_model.simulation import Stepper, references, servo_period
from experiment import Experiment, demand_of
from sim_backend.arm.signals import CHUNK_ROWS, Steps
from sim_backend.arm.stopping import StoppedDemand
from sim_backend.arm.vehicle import ThrusterSines, at_home, moored, rows_of

ROWS_PER_TICK = 4
"""Rows of the motion in one servo period."""


class Standing:
    """Brakes on, no current, from ``row`` on.

    The motors at ``theta`` (n,) rad (over their gears), the joints at ``q``; a floating base moored at ``base``, a row
    of ``vehicle.rows_of``, or at the world's origin.
    """

    still_from = 0.0
    current_lag = math.inf

    def __init__(self, arm: Arm, theta: Array, q: Array, row: int = 0, base: Array | None = None) -> None:
        self._instruments = Instruments(arm)
        self._base = moored(base) if base is not None else None if arm.floating is None else at_home(arm.thrusters)
        self._theta, self._q, self._row = theta, q, row
        self.current_delay = self._instruments.current_delay
        self.step_ns = round(servo_period(arm) * 1e9 / ROWS_PER_TICK)

    def advance(self) -> Steps:
        times = np.arange(self._row, self._row + CHUNK_ROWS, dtype=np.float64) * (self.step_ns * 1e-9)
        self._row += CHUNK_ROWS
        rows, nothing = (CHUNK_ROWS, 1), np.zeros((CHUNK_ROWS, len(self._theta)))
        q, theta = np.tile(self._q, rows), np.tile(self._theta, rows)
        seen = self._instruments.see(Motion(times, q, nothing, theta, nothing, nothing, nothing, theta))
        return seen if self._base is None else replace(seen, base=np.tile(self._base, rows))

    def state(self) -> object:
        return self._row

    def restore(self, state: object) -> None:
        assert isinstance(state, int)
        self._row = state

    def stop(self, at: float) -> float:
        return at


class Servoed:
    """Follows an experiment's demand under the arm's servos until the brakes come on, ``hold`` s after its end.

    Brakes come on between two chunks, at or after ``still_from``.
    """

    def __init__(self, arm: Arm, experiment: Experiment, hold: float, sines: ThrusterSines | None = None) -> None:
        """sines: what the thrusters of a floating base are asked for while the motion lasts."""
        assert arm.controller is not None
        self._arm, self._hold, self._sines = arm, hold, sines
        self._instruments = Instruments(arm)
        self._deceleration = np.array(experiment.full_acceleration)
        self._asked = demand_of(experiment)
        self._demand: Callable[[Array], Array] = self._asked
        self._stepper = Stepper(arm, np.array(experiment.start))
        self._last: Motion | None = None
        self._braked: Standing | None = None
        self.step_ns = round(self._stepper.period * 1e9 / ROWS_PER_TICK)
        self.still_from = self._asked.duration + hold
        self.current_lag = arm.controller.current_lag
        self.current_delay = self._instruments.current_delay

    def advance(self) -> Steps:
        first, ticks = self._stepper.tick, CHUNK_ROWS // ROWS_PER_TICK
        if self._braked is None and self._last is not None and first * self._stepper.period >= self.still_from:
            base = None if self._last.base is None else rows_of(self._last.base)[-1]
            self._braked = Standing(self._arm, self._last.qm[-1], self._last.q[-1], first * ROWS_PER_TICK, base)
        if self._braked is not None:
            return self._braked.advance()
        rows = np.arange(first * ROWS_PER_TICK, first * ROWS_PER_TICK + CHUNK_ROWS, dtype=np.float64)
        times = rows * (self._stepper.period / ROWS_PER_TICK)
        self._last = self._stepper.advance(self._references(first, ticks), times)
        if not np.isfinite(self._last.q).all():
            raise DeviceFault(
                self._arm.name,
                f"its simulation left all bounds before t = {times[-1]:.3g} s; give each joint a rotor inertia, less "
                "friction or a weaker servo",
            )
        seen = self._instruments.see(self._last)
        return seen if self._last.base is None else replace(seen, base=rows_of(self._last.base))

    def _references(self, first: int, ticks: int) -> Array:
        """(ticks, n) of the joints, with what is added to the demands of thrusters behind them."""
        joints = references(self._arm, self._demand, first, ticks)
        if self._sines is None:
            return joints
        t: Array = np.arange(first, first + ticks, dtype=np.float64) * self._stepper.period
        return np.concatenate([joints, self._sines(t, self.still_from - self._hold)], axis=1)

    def state(self) -> object:
        braked = None if self._braked is None else self._braked.state()
        return self._stepper.copy(), self._last, self._braked, braked

    def restore(self, state: object) -> None:
        assert isinstance(state, tuple)
        self._stepper, self._last, self._braked, braked = state
        if self._braked is not None:
            self._braked.restore(braked)

    def stop(self, at: float) -> float:
        """From the next setpoint on: the one under way has been sent."""
        assert self._arm.controller is not None
        period = self._arm.controller.setpoint_period
        begin = math.ceil(at / period - 1e-9) * period
        stopped = StoppedDemand(self._asked, begin, self._deceleration)
        self._demand, self.still_from = stopped, min(self.still_from, stopped.duration + self._hold)
        return begin


class Instruments:
    """What encoders and transducers of one arm are exposed to. ``current_delay`` s by which the currents are late."""

    def __init__(self, arm: Arm) -> None:
        self._gear = arm.joint_array("gear")
        self.current_delay = sum(_delay(term.name, term.parameters) for term in arm.effects)
        here = tuple(term for term in arm.effects if CATALOGUE[term.name].delay is None)
        self._arm = replace(arm, effects=here)

    def see(self, motion: Motion) -> Steps:
        """Motor angles with the gears' signs, and currents in the motors' own sense."""
        shown = recorded(self._arm, motion)
        added = shown.q - motion.qm
        rate = motion.qmd + np.gradient(added, motion.t, axis=0) if added.any() else motion.qmd
        return Steps(
            q=motion.q,
            qd=motion.qd,
            motor=self._gear * shown.q,
            motor_rate=self._gear * rate,
            current=np.sign(self._gear) * shown.current,
        )


def _delay(name: str, parameters: dict[str, float]) -> float:
    """s by which this effect makes the currents late; InputError for one that does so from some row on only."""
    delay = CATALOGUE[name].delay
    if delay is None:
        return 0.0
    early, late = delay(values_of(CATALOGUE[name], parameters), Signals(t=np.array([0.0, 1e6]))) * np.ones(2)
    if early != late:
        raise InputError(
            "simulation",
            f"effect {name} counts rows, but an arm has none: use [[simulation.fault]] with kind 'lost_edge'",
        )
    return float(late)
