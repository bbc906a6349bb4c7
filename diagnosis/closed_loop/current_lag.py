"""How late recorded currents are against recorded angles, by the closed loop of the model.

Along the measured motion a lag of a millisecond is below the noise: differentiated encoder steps hide what is quick.
The closed loop on the same demands has none of them, and predicts angles and currents alike. Where its angles are those
recorded, demands and servos are those of the arm, and a change of lag of its currents, from 10 to 100 Hz, is one of
the recorded currents. A lag that is there throughout may be of the servos: when they read encoders is in no model.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from arm_io import InputError
from arm_io.types import Array
from arm_model import Arm
from daq.recording import Recording
from diagnosis.closed_loop.loop_errors import band_sections, delay_between, loop_of
from diagnosis.residual.filters import COMPARE_BAND
from diagnosis.residual.run_setup import has_demand
from identification.preprocessing import tracked_as_recorded, zero_phase

PIECE = 0.25
"""s: length of the pieces over which errors are summed."""
FEWEST = 4
"""Pieces on either side of a change, at least."""
END = 0.5
"""s at either end of a recording that filters spoil."""
LONGEST = 0.014
"""s: longest lag that is looked for."""
COARSE = 1e-3
"""s between lags at which errors are computed: ten per period of the highest frequency."""
FINE = 1e-4
"""s between the lags that errors are interpolated to."""
MOVES = 0.01
"""rad (m) that a joint must move to count."""
SAME_ANGLES = 0.2
"""Servo periods by which angles of a loop may be late: those of other servos are by more."""


@dataclass(frozen=True, kw_only=True)
class Change:
    """The lag of the currents changes at ``time`` (std ``time_std``) s from ``before`` to ``after`` s (``std``).

    place: of the first piece after it; gain: (n,) fall of the cost by it at the joints that move.
    """

    place: int
    time: float
    time_std: float
    before: float
    after: float
    std: float
    gain: Array


@dataclass(frozen=True, kw_only=True)
class LagCosts:
    """Closed-loop errors of one recording as a function of the lag that is given to its currents.

    lags   (L,) s, by which recorded currents are behind
    edges  (B + 1,) s: of the pieces
    energy (L, B, n) A2 s: squared errors in the band, of the joints that move; joints (n,) their numbers from 1
    cost   (L, B, n) the same as a negative log-likelihood. Errors of a loop come in bursts: it grows with their
           logarithm, a piece of some forty independent rows counts as one
    """

    lags: Array
    edges: Array
    energy: Array
    cost: Array
    joints: Array

    def costs(self, change: Change) -> tuple[Array, Array]:
        """(B, n) costs of the one lag that is best throughout, and of a change."""
        return self._pair(self.cost, change)

    def energies(self, change: Change) -> tuple[Array, Array]:
        """(B, n) squared errors of the same."""
        return self._pair(self.energy, change)

    def _pair(self, values: Array, change: Change) -> tuple[Array, Array]:
        throughout = int(np.argmin(self.cost.sum(axis=(1, 2))))
        first, second = (int(np.argmin(np.abs(self.lags - lag))) for lag in (change.before, change.after))
        with_it = np.concatenate([values[first, : change.place], values[second, change.place :]])
        return values[throughout], with_it

    def change(self) -> Change:
        """The change of lag at one instant with the smallest error."""
        start = np.zeros((len(self.lags), 1))
        cost = self.cost.sum(axis=2)
        before = np.concatenate([start, np.cumsum(cost, axis=1)], axis=1)
        after = before[:, -1:] - before
        profile = before.min(axis=0) + after.min(axis=0)
        inside = np.arange(FEWEST, len(profile) - FEWEST)
        place = int(inside[np.argmin(profile[inside])])
        likely = np.exp(profile[place] - profile[inside])
        likely /= likely.sum()
        time = float(np.sum(likely * self.edges[inside]))
        spread = float(np.sqrt(np.sum(likely * (self.edges[inside] - time) ** 2) + PIECE**2 / 12.0))
        (first, first_std), (second, second_std) = self._best(cost[:, :place]), self._best(cost[:, place:])
        change = Change(
            place=place,
            time=time,
            time_std=spread,
            before=first,
            after=second,
            std=float(np.hypot(first_std, second_std)),
            gain=np.zeros(len(self.joints)),
        )
        without, with_it = self.costs(change)
        return replace(change, gain=(without - with_it).sum(axis=0))

    def _best(self, cost: Array) -> tuple[float, float]:
        """s: the lag of least cost (L, B), and its std from the scatter between pieces; infinite at the last lag."""
        total, wide = cost.sum(axis=1), round(COARSE / FINE)
        k = int(np.argmin(total))
        if not wide <= k < len(total) - wide:
            return float(self.lags[k]), np.inf
        bend = (total[k - wide] - 2.0 * total[k] + total[k + wide]) / COARSE**2
        slopes = (cost[k + wide] - cost[k - wide]) / (2.0 * COARSE)
        return float(self.lags[k]), float(np.sqrt(np.sum(slopes**2)) / bend) if bend > 0.0 else np.inf


def lag_costs(arm: Arm, recording: Recording, current: Array) -> LagCosts | None:
    """Closed-loop errors of an arm on the recorded demands, for every lag of the currents (m, n) A.

    current: those recorded, with the rows put back that are known to be lost. None where no loop can judge: without
    demand or controller, unstable, with setpoints whose instants are not recorded, or by servos that are not the arm's.
    """
    if arm.controller is None or not has_demand(recording) or not tracked_as_recorded(recording, arm):
        return None
    moving = np.flatnonzero(np.ptp(recording.q, axis=0) > MOVES)
    t, rate = recording.t - recording.t[0], 1.0 / recording.dt
    pieces = int((t[-1] - 2 * (END + LONGEST)) / PIECE)
    if not len(moving) or pieces < 2 * FEWEST + 1 or rate < 4 * COMPARE_BAND:
        return None
    try:
        angle, shown = (one[0] for one in loop_of(arm, recording))
    except InputError:  # a spring that the model has no rotor for
        return None
    behind = delay_between(recording.q - angle, np.gradient(angle, recording.dt, axis=0))
    if not np.isfinite(shown).all() or not abs(behind) < SAME_ANGLES * arm.servo_period:
        return None
    measured, simulated = (
        CubicSpline(t, zero_phase(band_sections(rate), signal[:, moving])) for signal in (current, shown)
    )
    step, reach = round(PIECE / COARSE), round(LONGEST / COARSE)
    rows = np.arange(pieces * step) * COARSE + END + LONGEST
    measured_rows = measured(rows)
    around = simulated(np.arange(-reach, len(rows) + reach) * COARSE + rows[0] - behind)
    shifts = np.arange(-reach, reach + 1)
    energy = np.stack([_energy(measured_rows - around[reach - by : reach - by + len(rows)], pieces) for by in shifts])
    lags = np.arange(-reach * COARSE, (reach + 0.5 * FINE / COARSE) * COARSE, FINE)
    energy = np.maximum(CubicSpline(shifts * COARSE, energy)(lags), 1e-12 * energy.max())
    usual = np.median(energy, axis=1).min(axis=0)
    return LagCosts(
        lags=lags,
        edges=rows[0] + PIECE * np.arange(pieces + 1),
        energy=energy,
        cost=np.log1p(energy / np.maximum(usual, 1e-300)),
        joints=np.asarray(moving + 1, float),
    )


def _energy(error: Array, pieces: int) -> Array:
    """(pieces, n) A2 s: squared errors (m, n), summed over pieces."""
    return np.asarray((error**2).reshape(pieces, -1, error.shape[1]).sum(axis=1) * COARSE)
