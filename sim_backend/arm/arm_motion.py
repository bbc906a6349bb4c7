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

ROWS_PER_TICK = 4
"""Rows of the motion in one servo period."""


class Standing:
    """Brakes on, no current, from ``row`` on.

    The motors at ``theta`` (n,) rad (over their gears), the joints at ``q``.
    """

    still_from = 0.0
    current_lag = math.inf

    def __init__(self, arm: Arm, theta: Array, q: Array, row: int = 0) -> None:
        self._instruments = Instruments(arm)
        self._theta, self._q, self._row = theta, q, row
        self.current_delay = self._instruments.current_delay
        self.step_ns = round(servo_period(arm) * 1e9 / ROWS_PER_TICK)

    def advance(self) -> Steps:
        times = np.arange(self._row, self._row + CHUNK_ROWS, dtype=np.float64) * (self.step_ns * 1e-9)
        self._row += CHUNK_ROWS
        rows, nothing = (CHUNK_ROWS, 1), np.zeros((CHUNK_ROWS, len(self._theta)))
        q, theta = np.tile(self._q, rows), np.tile(self._theta, rows)
        return self._instruments.see(Motion(times, q, nothing, theta, nothing, nothing, nothing, theta))

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

    def __init__(self, arm: Arm, experiment: Experiment, hold: float) -> None:
        assert arm.controller is not None
        self._arm, self._hold = arm, hold
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
            self._braked = Standing(self._arm, self._last.qm[-1], self._last.q[-1], first * ROWS_PER_TICK)
        if self._braked is not None:
            return self._braked.advance()
        rows = np.arange(first * ROWS_PER_TICK, first * ROWS_PER_TICK + CHUNK_ROWS, dtype=np.float64)
        times = rows * (self._stepper.period / ROWS_PER_TICK)
        self._last = self._stepper.advance(references(self._arm, self._demand, first, ticks), times)
        if not np.isfinite(self._last.q).all():
            raise DeviceFault(
                self._arm.name,
                f"its simulation left all bounds before t = {times[-1]:.3g} s; give each joint a rotor inertia, less "
                "friction or a weaker servo",
            )
        return self._instruments.see(self._last)

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
