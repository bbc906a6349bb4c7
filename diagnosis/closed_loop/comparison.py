"""Measured and simulated currents: in closed loop on the recorded demands, and along the measured motion.

Where the controller of the model is that of the arm, the currents of the closed loop contain no encoder quantisation,
and it is the more sensitive test. Where it is not, its errors are those of the controller, and the currents that the
model predicts for the measured motion are compared instead (Leboutet et al., Applied Sciences 11, 2021: output-error
methods depend on the controller).

Errors are compared in the band of the residual and where friction is known: at standstill the current depends on how
the servo came to rest. What sampling may fold onto the acceleration counts as little as along the measured motion: the
loop has its setpoints at other instants than the arm, so that another share of its ripple folds.

Where a recording has no sample, what stands there was interpolated and lacks all that the loop does: such rows have no
error, and means are over the others.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from scipy.signal import welch

from arm_io import InputError
from arm_io.parallel import in_parallel
from arm_io.types import Array
from arm_model import Arm
from arm_model.sensing import recorded
from arm_model.simulation import simulate_at, simulate_batch
from daq.recording import Recording
from diagnosis.residual.comparable_rows import comparable_rows, rms_where
from diagnosis.residual.filters import COMPARE_BAND, kept_rows, low_pass, rate_of
from diagnosis.residual.other_effects import residual_under, with_own
from diagnosis.residual.run import Run, Span
from diagnosis.residual.run_setup import has_demand, set_up
from identification.preprocessing import demand_of_run

FAITHFUL = 1.5
"""Ratio to the error along the measured motion above which the controller of the model is not that of the arm."""
SMOOTHING = np.array([0.12, 0.2, 0.3, 0.45, 0.65, 1.0, 1.6, 2.5])
"""Candidate Coulomb smoothing velocities, as multiples of the model's own; one lane of the engine each."""
STEEP = slice(0, 4)
"""The steepest of ``SMOOTHING``: friction changes so quickly that their loops take three times as long as all others.
They are tried where the steepest of the others is the best at a joint, and reduces its squared error to ``STEEPER``."""
GENTLE = slice(4, None)
"""All others of ``SMOOTHING``."""
STEEPER = 0.99
"""Share of a joint's squared error that the steepest of ``GENTLE`` must leave at most for ``STEEP`` to be tried."""
REDUCED = 0.9
"""Share of a joint's squared error in closed loop that another smoothing velocity may leave to replace the model's."""


def identity(values: Array) -> Array:
    """The values (r, n) A themselves: nothing folds."""
    return values


@dataclass(frozen=True)
class LoopComparison:
    """One recording and the closed loop of a model on its demands: t (m,) s, currents (m, n) A and angles (m, n) rad.

    known: (r, n) rows of the run that are compared; less_folded: of values (r, n) A, as ``Run.less_folded``;
    unmeasured: where there is no sample, as ``Run.unmeasured``.
    """

    name: str
    t: Array
    current: Array
    simulated_current: Array
    angle: Array
    simulated_angle: Array
    known: NDArray[np.bool_]
    less_folded: Callable[[Array], Array] = identity
    unmeasured: tuple[Span, ...] = ()

    @cached_property
    def _errors(self) -> dict[str, Array]:
        return {}

    def error(self, signal: str) -> Array:
        """(r, n) measured less simulated ``current`` (A) or ``angle`` (rad), at the rows of the run."""
        # each of the five steps below needs it
        if signal not in self._errors:
            self._errors[signal] = self._error(signal)
        return self._errors[signal]

    def measured(self, signal: str) -> NDArray[np.bool_]:
        """(m, n): whether ``current`` or ``angle`` was measured; of a current at a row without angles, it was not."""
        rows = np.ones(self.current.shape, bool)
        since = self.t - self.t[0]
        for start, end, joint in self.unmeasured:
            if joint is None or signal == "current":
                rows[(since > start) & (since < end), slice(None) if joint is None else joint - 1] = False
        return rows

    def difference(self, signal: str) -> Array:
        """(m, n) measured less simulated ``current`` (A) or ``angle`` (rad); 0 in rows that were not measured."""
        return (getattr(self, signal) - getattr(self, f"simulated_{signal}")) * self.measured(signal)

    def spectrum(self, signal: str, joint: int, rows: int) -> tuple[Array, Array]:
        """Hz, and power density per Hz of the ``difference`` of a joint (from 1), in segments of so many rows.

        Per row that was measured: what is as strong throughout is shown by as much less as rows are missing.
        """
        share = float(np.mean(self.measured(signal)[:, joint - 1]))
        frequency, power = welch(self.difference(signal)[:, joint - 1], rate_of(self.t), nperseg=rows)
        return frequency, power / max(share, 1.0 / len(self.t))

    def _error(self, signal: str) -> Array:
        rate = rate_of(self.t)
        error = low_pass(self.difference(signal), COMPARE_BAND, rate)[kept_rows(rate)]
        return self.less_folded(error) if signal == "current" else error

    def error_rms(self, signal: str) -> Array:
        """(n,) root mean square of ``error`` where friction is known."""
        return rms_where(self.error(signal), self.known)


def simulated_behind(loops: Sequence[LoopComparison], joint: int) -> tuple[float, float]:
    """s by which simulated angles of a joint (from 1) are behind measured ones, and the share of the error that is so.

    The least-squares factor of the simulated speed in the error, and the part of the error's squares that it takes up.
    """
    errors, speeds = [], []
    for loop in loops:
        rows, rate = loop.known[:, joint - 1], rate_of(loop.t)
        speed = np.gradient(loop.simulated_angle[:, joint - 1], 1.0 / rate)
        errors.append(loop.error("angle")[rows, joint - 1])
        speeds.append(low_pass(speed, COMPARE_BAND, rate)[kept_rows(rate)][rows])
    error, speed = np.concatenate(errors), np.concatenate(speeds)
    both, delayed = float(error @ speed), float(speed @ speed)
    if both == 0.0:
        return 0.0, 0.0
    return both / delayed, both**2 / delayed / float(error @ error)


LoopPair = tuple[LoopComparison, LoopComparison]
"""One recording with the closed loop of the model, and with that of the extended model."""

Case = tuple[Recording, Arm, Run]
"""A recording, the model of its closed loop, and its residual along the measured motion."""


def compare(recording: Recording, arm: Arm, run: Run) -> LoopComparison | None:
    """A recording and the closed loop of the model on its demands; None without demand, controller or stable loop."""
    return compare_all([(recording, arm, run)])[0]


def compare_all(cases: Sequence[Case]) -> list[LoopComparison | None]:
    """``compare`` of several, their loops simulated on all cores."""
    return [
        None if shown is None else _compared(recording, run, *shown)
        for (recording, _, run), shown in zip(cases, in_parallel(_simulated, cases))
    ]


def _simulated(case: Case) -> tuple[Array, Array] | None:
    """Currents (m, n) A and angles (m, n) rad that instruments show of the closed loop."""
    recording, arm, run = case
    if arm.controller is None or not has_demand(recording):
        return None
    arm = set_up(replace(arm, effects=(*arm.effects, *run.own)), recording)
    knots, demand = recording.t, demand_of_run(recording, arm)
    try:
        motion = simulate_at(arm, demand, knots - knots[0])
    except InputError:  # the loop is unstable
        return None
    shown = recorded(arm, motion)
    return shown.current, shown.q


def _compared(recording: Recording, run: Run, current: Array, angle: Array) -> LoopComparison:
    return LoopComparison(
        name=recording.path.name,
        t=recording.t,
        current=recording.i,
        simulated_current=current,
        angle=recording.q,
        simulated_angle=angle,
        known=comparable_rows(run),
        less_folded=run.less_folded,
        unmeasured=run.unmeasured,
    )


def before_and_after(
    recordings: Sequence[Recording], runs: Sequence[Run], arm: Arm, extended: Arm
) -> list[LoopPair | None]:
    """Recordings in closed loop by the model, and by the extended one with the causes of each recording alone."""
    bare: list[Case] = [(r, arm, replace(run, own=())) for r, run in zip(recordings, runs)]
    more: list[Case] = [(r, extended, run) for r, run in zip(recordings, runs) if extended is not arm or run.own]
    compared = compare_all([*bare, *more])
    of_extended = iter(compared[len(bare) :])
    pairs = [
        (before, next(of_extended) if extended is not arm or run.own else before) for before, run in zip(compared, runs)
    ]
    return [None if before is None or after is None else (before, after) for before, after in pairs]


def along_motion(run: Run, before: Arm, after: Arm) -> tuple[Array, Array]:
    """(n,) A each: rms of the residual current along the measured motion, of the model and of the extended model.

    The extended model has also those causes that hold for this recording alone (``Run.own``).
    """
    rows, bare = comparable_rows(run), with_own(run, ())
    return rms_where(residual_under(bare, before.effects), rows), rms_where(residual_under(run, after.effects), rows)


def faithful(pairs: Sequence[LoopPair], along: Sequence[tuple[Array, Array]]) -> bool:
    """Whether the closed loop of the extended model follows the recordings as well as the model their motion."""
    return _follow([after for _, after in pairs], [after for _, after in along])


def _follow(loops: Sequence[LoopComparison], along: Sequence[Array]) -> bool:
    """Whether closed loops follow recordings as well as the same model their motion; along: (n,) A rms of each."""
    if not loops or len(loops) != len(along):
        return False
    in_loop = np.sqrt(np.mean([one.error_rms("current") ** 2 for one in loops], axis=0))
    return bool(np.all(in_loop < FAITHFUL * np.sqrt(np.mean([rms**2 for rms in along], axis=0))))


def with_smoothing_velocities(arm: Arm, recordings: Sequence[Recording]) -> Arm:
    """The arm with the Coulomb smoothing velocities (``sign_velocity``) that these recordings show in closed loop.

    No data sheet states them, and simulations differ in them. A joint keeps its own where no other reduces its squared
    error to ``REDUCED`` of it.
    """
    usable = [r for r in recordings if has_demand(r)]
    moving = [j for j, joint in enumerate(arm.joints) if max(joint.rest_friction) > 0.0]
    if arm.controller is None or not usable or not moving:
        return arm
    errors = _smoothing_errors(arm, usable, moving, GENTLE)
    if errors is None:
        return arm
    tried, unchanged = SMOOTHING[GENTLE], errors[SMOOTHING[GENTLE] == 1.0][0]
    if np.any((np.argmin(errors, axis=0) == 0) & (errors[0] < STEEPER * unchanged)):
        steep = _smoothing_errors(arm, usable, moving, STEEP)
        if steep is not None:
            tried, errors = SMOOTHING, np.concatenate([steep, errors])
    velocities = arm.joint_array("sign_velocity")
    for j in moving:
        best = int(np.argmin(errors[:, j]))
        if errors[best, j] < REDUCED * unchanged[j]:
            velocities[j] *= tried[best]
    return arm.with_sign_velocities(velocities)


_errors_found: WeakKeyDictionary[Recording, dict[int, tuple[Arm, Array | None]]] = WeakKeyDictionary()
"""By recording and first lane, the last arm whose loops were simulated, and their errors: two steps ask for the same
arm."""


def _smoothing_errors(arm: Arm, recordings: Sequence[Recording], moving: Sequence[int], lanes: slice) -> Array | None:
    """(lanes, n) A2: squared errors of closed loops with these of ``SMOOTHING`` of the ``moving`` joints (from 0).

    Over all recordings; infinite where a loop is not stable. None if a closed loop cannot be compared.
    """
    found = [_errors_found.setdefault(recording, {}) for recording in recordings]
    missing = [k for k, known in enumerate(found) if known.get(lanes.start, (None, None))[0] != arm]
    work = partial(_smoothing_error, arm, moving, SMOOTHING[lanes])
    for k, errors in zip(missing, in_parallel(work, [recordings[k] for k in missing])):
        found[k][lanes.start] = arm, errors
    several = [known[lanes.start][1] for known in found]
    each = [errors for errors in several if errors is not None]
    return np.nan_to_num(np.sum(each, axis=0), nan=np.inf) if len(each) == len(several) else None


def _smoothing_error(arm: Arm, moving: Sequence[int], factors: Array, recording: Recording) -> Array | None:
    carrying = set_up(arm, recording)
    lanes = {f"joint{j + 1}.sign_velocity": arm.joints[j].sign_velocity * factors for j in moving}
    demand = demand_of_run(recording, carrying)
    try:
        motion = simulate_batch(carrying, demand, recording.t - recording.t[0], parameters=lanes)
    except InputError:  # a spring that the model has no rotor for
        return None
    rate = 1.0 / recording.dt
    differences = recording.i - recorded(carrying, motion).current
    return np.stack([np.sum(low_pass(d, COMPARE_BAND, rate)[kept_rows(rate)] ** 2, axis=0) for d in differences])


def refuted(
    full: Arm, less: Sequence[Arm], felt_at: Sequence[int], recordings: Sequence[Recording], runs: Sequence[Run]
) -> int | None:
    """Index of the cause whose removal reduces the closed-loop error most, or None.

    None if no removal reduces it, or if closed loops cannot be compared.

    full: the model with all causes; less: without each of them; felt_at: the joint (from 1) where each has its largest
    effect. A cause must hold in both comparisons: the residual along the measured motion, by which it was found, and
    the closed loop on held-out recordings.
    """
    every: list[Case] = [(recording, full, run) for recording, run in zip(recordings, runs)]
    cases = [(case, loop) for case, loop in zip(every, compare_all(every)) if loop is not None]
    with_all = [loop for _, loop in cases]
    if not _follow(with_all, [along_motion(run, run.arm, full)[1] for (_, _, run), _ in cases]):
        return None
    loops = iter(compare_all([(recording, arm, run) for arm in less for (recording, _, run), _ in cases]))
    ratios = []
    for joint in felt_at:
        without = [next(loops) for _ in cases]
        # an arm that is not stable without a cause needs it
        error = sum(np.inf if one is None else _squared_error(one, joint) for one in without)
        complete = sum(_squared_error(one, joint) for one in with_all)
        ratios.append(error / complete if complete > 0.0 else np.inf)
    least = int(np.argmin(ratios))
    return least if ratios[least] < 1.0 else None


def _squared_error(loop: LoopComparison, joint: int) -> float:
    """A2: mean squared error of the current of a joint (from 1)."""
    return float(loop.error_rms("current")[joint - 1] ** 2)
