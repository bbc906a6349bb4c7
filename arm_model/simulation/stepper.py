"""An arm that is simulated block by block, for a simulated rig."""

from __future__ import annotations

from copy import copy
from dataclasses import replace

import numpy as np

from arm_io import InputError
from arm_io.types import Array
from arm_model.description import Arm
from arm_model.motion import Motion
from arm_model.simulation.advance import advance
from arm_model.simulation.engine import aligned
from arm_model.simulation.lanes import BASE, prepared
from arm_model.simulation.motion_rows import motion_of_rows
from arm_model.simulation.simulation import single
from arm_model.system.floating_base import POSE


class Stepper:
    """A simulation that is run on block by block, for a simulated rig. The same however time is cut into blocks.

    Starts at rest at q0 (n,) rad, held by its motors ((n + 13,): as ``simulate_batch``). Time is counted in servo ticks
    of ``period`` s.
    """

    def __init__(self, arm: Arm, q0: Array, *, substeps: int | None = None) -> None:
        self.arm = arm
        self._run = prepared(arm, None, np.asarray(q0, float), substeps)
        self.period = self._run.period

    @property
    def tick(self) -> int:
        """Ticks run so far; time is tick period."""
        return self._run.tick

    @property
    def motors(self) -> tuple[Array, Array]:
        """(n,) rad (m), (n,) rad/s: where the motors stand now, over their gear ratios, and their speeds."""
        n = len(self.arm)
        now = self._run.states[0, :, 0]
        return now[:n].copy(), now[n : 2 * n].copy()

    @property
    def base(self) -> Array:
        """(13,) position, attitude and velocity of a floating base now."""
        place = self._run.program.system.states.index(POSE[0])
        return self._run.states[0, place : place + BASE, 0].copy()

    def copy(self) -> Stepper:
        """An independent copy that continues from here; the machine code is shared."""
        other, run = copy(self), self._run
        states, memories, currents = (aligned(*array.shape) for array in (run.states, run.memories, run.currents))
        states[:], memories[:], currents[:] = run.states, run.memories, run.currents
        other._run = replace(run, states=states, memories=memories, currents=currents)
        return other

    def advance(self, demands: Array, times: Array) -> Motion:
        """Runs len(demands) ticks with the servos given ``demands`` (ticks, n) rad (``references``).

        Returns rows at ``times``.

        times (R,) s from the start of the simulation, increasing, from tick period up to (tick + len(demands)) period,
        exclusive.
        """
        demands, times = np.asarray(demands, float), np.asarray(times, float)
        if demands.ndim != 2 or demands.shape[1] not in (len(self.arm), len(self.arm) + self.arm.thrusters):
            raise InputError("demands", f"have shape {demands.shape}; expected (ticks, {len(self.arm)})")
        first = self._run.tick
        rows = advance(self._run, demands, times)
        shown = demands[np.clip((times / self.period + 1e-9).astype(int) - first, 0, len(demands) - 1)]
        return single(motion_of_rows(self._run, rows, times, shown[:, : len(self.arm)]))
