"""Friction tuned until the simulated motors draw the measured current: thesis section 5.3.1, as an optimisation.

There, friction was turned by hand, joint by joint, until simulated and measured currents looked alike (table 5.4). Here
viscous and Coulomb friction of all joints are varied together in the simulated closed loop, the Jacobian from one batch
of simulations (a lane for each parameter), and Gauss-Newton steps of limited length (Levenberg-Marquardt) are taken on
the currents' and positions' errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg

from arm_io import InputError
from arm_io.progress import Step
from arm_io.types import Array, Progress
from arm_model import Arm, parameter, with_parameters
from arm_model.simulation import simulate_batch
from daq.recording import Recording
from identification.preprocessing.demands import demand_of_run
from identification.preprocessing.setpoint_ripple import drifting
from identification.preprocessing.signals import Motion, parallel_filter, parallel_rows
from identification.regression.equations import Equations
from identification.regression.least_squares import Fit
from identification.regression.uncertainty import FitUncertainty, fit_uncertainty
from identification.result import Prediction

ITERATIONS = 12
"""Levenberg-Marquardt steps, at most."""
STEP = 0.05
"""Share of a parameter by which it is changed for its column of the Jacobian."""
DIRECTIONS = ("coulomb_positive", "coulomb_negative")


@dataclass(frozen=True)
class Tuning:
    """The tuned friction: names and values (p,) at the joint side with their uncertainty, and the arm with them.

    Also the relative torque error of the closed-loop simulation before and after.
    """

    names: tuple[str, ...]
    values: Array
    uncertainty: FitUncertainty
    arm: Arm
    before: float
    after: float
    simulations: int


def tune_friction(
    recordings: Sequence[Recording],
    motions: Sequence[Motion],
    arm: Arm,
    *,
    progress: Progress,
) -> Tuning:
    """Viscous and Coulomb friction (either direction) of the joints that move.

    InputError without demands or controller, and where the closed loop is not stable.
    """
    _check_closed_loop(recordings, motions, arm)
    moving = [j for j in range(len(arm)) if any(motion.moves(j) for motion in motions)]
    names = tuple(f"joint{j + 1}.{kind}" for j in moving for kind in ("viscous", *DIRECTIONS))
    loops, floor = _Loops(recordings, motions, arm, names), _floors(names, motions)
    start = np.maximum(np.array([parameter(arm, name) for name in names]), floor)
    before = loops.relative_error(start)
    values, error, jacobian, simulations = _minimised(loops, start, floor, progress)
    # a joint whose friction no row shows keeps that of the model
    seen = np.linalg.norm(jacobian, axis=0) > 0.0
    names, values, jacobian = tuple(n for n, there in zip(names, seen) if there), values[seen], jacobian[:, seen]
    if not names:
        raise InputError(
            ", ".join(str(recording.path) for recording in recordings),
            "do not excite the friction of any joint in closed loop; they must move a joint for longer, in both "
            "directions",
        )
    return Tuning(
        names=names,
        values=values,
        uncertainty=fit_uncertainty(
            jacobian,
            _rows(motions, jacobian, error, names),
            Fit(values, np.ones(len(error)), error, jacobian * values),
        ),
        arm=with_parameters(arm, dict(zip(names, map(float, values)))),
        before=before,
        after=replace(loops, names=names).relative_error(values),
        simulations=simulations,
    )


@dataclass(frozen=True)
class _Loops:
    """Closed loops of an arm on the demands of recordings, with values of p of its parameters (``names``)."""

    recordings: Sequence[Recording]
    motions: Sequence[Motion]
    arm: Arm
    names: tuple[str, ...]

    def errors(self, lanes: Array) -> Array:
        """(lanes, rows) filtered torque errors over their scale, of the trusted rows of all runs; lanes (lanes, p)."""
        return self._errors(lanes, _scales(self.motions))

    def relative_error(self, values: Array) -> float:
        """Norm of the filtered torque error with values (p,) over that of the measured torque."""
        off = self._errors(values[None], np.ones(len(self.arm)))
        measured = [parallel_filter(motion, motion.torque)[parallel_rows(motion)[1]] for motion in self.motions]
        return float(np.linalg.norm(off) / np.linalg.norm(np.concatenate(measured)))

    def jacobian(self, values: Array, step: Array) -> Array:
        """(rows, p) of the errors, by central differences of ``step`` (p,); none of the values below 0."""
        lanes = np.maximum(values + np.concatenate([np.diag(step), -np.diag(step)]), 0.0)
        up, down = np.split(_stable(self.errors(lanes)), 2)
        width = np.diag(lanes[: len(values)] - lanes[len(values) :])
        return np.asarray(((up - down) / width[:, None]).T)

    def _errors(self, lanes: Array, scale: Array) -> Array:
        parts = []
        for recording, motion in zip(self.recordings, self.motions):
            simulated = _simulated(recording, motion, self.arm, self.names, lanes)
            filtered = parallel_filter(motion, np.moveaxis((simulated - motion.torque) / scale, 0, -1))
            parts.append(filtered[parallel_rows(motion)[1]].T)
        return np.concatenate(parts, axis=1)


def _minimised(loops: _Loops, values: Array, floor: Array, progress: Progress) -> tuple[Array, Array, Array, int]:
    """Values (p,) with the least error, starting at ``values``; the error (rows,), its Jacobian, loops simulated.

    In every iteration the best of five dampings, of which each is a lane. floor (p,): least values in the step of a
    derivative.
    """
    error = _stable(loops.errors(values[None]))[0]
    jacobian = np.zeros((len(error), len(values)))
    damping, simulations = 1e-3, 0
    for number in range(ITERATIONS):
        progress(Step("friction", number, detail=f"error {np.linalg.norm(error) / np.sqrt(len(error)):.4g}"))
        jacobian = loops.jacobian(values, STEP * np.maximum(values, floor))
        gram, slope = jacobian.T @ jacobian, jacobian.T @ error
        dampings = damping * 10.0 ** np.arange(-1, 4)
        trials = np.array([np.maximum(values - _step(gram, slope, d), 0.0) for d in dampings])
        errors = loops.errors(trials)
        simulations += 2 * len(values) + len(trials)
        # of an unstable loop NaN
        costs = np.nan_to_num(np.sum(errors**2, axis=1), nan=np.inf)
        best = int(np.argmin(costs))
        if not costs[best] < np.sum(error**2) * (1 - 1e-6):
            break
        values, error, damping = trials[best], errors[best], float(np.clip(dampings[best], 1e-9, 1e3))
    return values, error, jacobian, simulations


def _check_closed_loop(recordings: Sequence[Recording], motions: Sequence[Motion], arm: Arm) -> None:
    """InputError where the closed loop cannot be simulated, or no joint moves in it."""
    for recording in recordings:
        if recording.qref is None:
            raise InputError(
                recording.path,
                "has no demanded positions (qref); friction is tuned in the closed loop that follows them",
            )
    if arm.controller is None:
        raise InputError("model", "has no [controller]; friction is tuned in the closed loop")
    if not any(parallel_rows(motion)[1].any() for motion in motions):
        raise InputError(
            ", ".join(str(recording.path) for recording in recordings),
            "have no row in which a joint moves for long enough",
        )


def _stable(errors: Array) -> Array:
    """Errors (lanes, rows) of closed loops; InputError where one was not stable."""
    if not np.isfinite(errors).all():
        raise InputError(
            "model",
            "its closed loop is unstable on the recorded demands; correct masses, rotor inertias or [controller], or "
            "use another method",
        )
    return errors


def _rows(motions: Sequence[Motion], jacobian: Array, error: Array, names: Sequence[str]) -> Equations:
    """What ``_Loops.errors`` strings together, as rows that know their run, joint and time."""
    run, joint, t, unseen = [], [], [], []
    scale = _scales(motions)
    for number, motion in enumerate(motions):
        stamps, trusted = parallel_rows(motion)
        row, here = np.nonzero(trusted)
        run.append(np.full(len(row), number))
        joint.append(here)
        t.append(stamps[row])
        folded = np.zeros(motion.q.shape) if motion.folded is None else motion.folded / scale
        added = parallel_filter(motion, drifting(folded, motion.t))[row, :, here]
        unseen.append(np.concatenate([added * (here == j)[:, None] for j in range(len(scale))], axis=1))
    return Equations(
        jacobian,
        error,
        np.concatenate(joint),
        np.concatenate(run),
        np.concatenate(t),
        tuple(names),
        systematic=linalg.block_diag(*unseen),
    )


def _step(gram: Array, slope: Array, damping: float) -> Array:
    """(p,) step of Levenberg and Marquardt in units of the columns' own sizes (Marquardt, 1963).

    gram (p, p) J^T J and slope (p,) J^T e of the errors e.
    """
    size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    scaled = gram / size[:, None] / size
    return np.asarray(np.linalg.solve(scaled + damping * np.eye(len(size)), slope / size) / size)


def _floors(names: Sequence[str], motions: Sequence[Motion]) -> Array:
    """(p,) friction that makes a hundredth of its joint's torque: the least start, and what least steps refer to."""
    floor = []
    for name in names:
        j = int(name.partition(".")[0].removeprefix("joint")) - 1
        torque = max(float(np.std(motion.torque[:, j])) for motion in motions)
        speed = max(float(np.std(motion.qd[:, j])) for motion in motions)
        floor.append(0.01 * torque / speed if name.endswith("viscous") else 0.01 * torque)
    return np.array(floor)


def _scales(motions: Sequence[Motion]) -> Array:
    """(n,) what a torque error of each joint is measured in: the standard deviation of its torque."""
    return np.maximum(np.sqrt(np.mean([np.var(motion.torque, axis=0) for motion in motions], axis=0)), 1e-9)


def _simulated(recording: Recording, motion: Motion, arm: Arm, names: Sequence[str], lanes: Array) -> Array:
    """(lanes, m, n) torque of the closed loop on the recording's demands, on the motion's grid."""
    demand = demand_of_run(recording, arm)
    run = simulate_batch(
        arm,
        demand,
        motion.t,
        start=motion.q[0],
        parameters={name: lanes[:, k] for k, name in enumerate(names)},
    )
    return run.torque


def simulated_error(recording: Recording, motion: Motion, arm: Arm, held_out: bool) -> Prediction:
    """Measured torque and that of the simulated closed loop, both through one filter; InputError without demands."""
    if recording.qref is None:
        raise InputError(recording.path, "has no demanded positions (qref); the closed loop is simulated from them")
    simulated = _simulated(recording, motion, arm, (), np.empty((1, 0)))[0]
    t, trusted = parallel_rows(motion)
    measured, predicted = parallel_filter(motion, motion.torque), parallel_filter(motion, simulated)
    joint, row = np.nonzero(trusted.T)
    return Prediction(recording.path.name, held_out, t[row], joint, measured[row, joint], predicted[row, joint])
