"""Model distortion: the smallest variation in time of one parameter that makes the model match.

Source: Butterfield & Thomas, 1986.

The deviation x of the parameter from the model is a random walk that the weighted residual y observes by the column H
of the parameter: x' = x + w, y = H x + e. Kalman filters forwards and backwards (together the smoother of Rauch, Tung &
Striebel) yield x with its uncertainty; the strength of the walk and the scale of the noise have the greatest
likelihood. A correlation of x with position, direction, speed, load, time or temperature hints at what the model
lacks.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from arm_io import InputError
from arm_io.types import Array
from arm_model import Arm, Joint, parameter, with_parameters
from arm_model.system import inverse_dynamics
from arm_report.numbers import with_two_std
from daq.recording import Recording
from diagnosis.distortion.dependence import Path, Share, shares_of
from diagnosis.distortion.random_walk import GAP, STEP, gains_of, likelihood, memory, predicted, smoothed, strength
from diagnosis.measurements.currents.design_matrix import dataset_of, free_columns
from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.residual.comparable_rows import comparable_rows
from diagnosis.residual.filters import TRANSIENT
from diagnosis.residual.run import Run
from identification.selection import p_value

ROUNDS = 3
"""In which a walk, free columns and what sampling hides are estimated in turns."""
SIGNIFICANT = 0.01
"""p-value of the gain of a walk, or of a share, below which it is significant.

Like a cause, it must also explain more than ``LIMITS.min_gain``.
"""
LEAST_SHARE = 0.1
"""Share of the variance of a parameter from which a variable is named that it depends on."""
DETERMINED = 0.1
"""Information of a step over the median one, above which its value is drawn: with less it is interpolated."""
LEAST_PREDICTED = 3
"""Steps: more than the two unknowns that prediction errors determine, the strength of the walk and the noise."""
JOINT_SIDE = (
    "viscous",
    "coulomb",
    "coulomb_positive",
    "coulomb_negative",
    "rotor_inertia",
    "offset",
    "torque_constant",
)
UNITS = {
    "viscous": "N m s/rad",
    "coulomb": "N m",
    "coulomb_positive": "N m",
    "coulomb_negative": "N m",
    "rotor_inertia": "kg m2",
    "offset": "N m",
    "torque_constant": "N m/A",
    "mass": "kg",
    "mx": "kg m",
    "my": "kg m",
    "mz": "kg m",
}


@dataclass(frozen=True)
class Distortion:
    """One parameter as a function of time.

    joint, drive  joint of the parameter (from 1), as number and as the model describes it
    model         value in the model
    paths         one per recording
    strength      of the walk per square root of a second; 0 where no variation is significant
    constant      best value that does not vary, and its std
    shares        of the variables, largest first
    """

    parameter: str
    joint: int
    drive: Joint
    unit: str
    model: float
    paths: tuple[Path, ...]
    strength: float
    constant: tuple[float, float]
    shares: tuple[Share, ...]

    @property
    def varies(self) -> bool:
        """Whether the variation is significant."""
        return self.strength > 0.0


def named_parameter(arm: Arm, name: str) -> tuple[str, int]:
    """The parameter's name in ``arm_model.parameters``, and its joint; ``link2.viscous`` is that of joint 2.

    InputError for a parameter that the arm does not have.
    """
    match = re.fullmatch(r"(link|joint)(\d+)\.(.+)", name)
    if not match:
        raise InputError(
            "--distort",
            f"{name!r} is not a parameter; must be one such as joint2.viscous, link3.mass or joint1.torque_constant",
        )
    kind, number, quantity = match.groups()
    name_in_model = f"joint{number}.{quantity}" if kind == "link" and quantity in JOINT_SIDE else name
    parameter(arm, name_in_model)
    return name_in_model, int(number)


def distort(arm: Arm, name: str, runs: Sequence[Run], recordings: Sequence[Recording]) -> Distortion:
    """The variation of one parameter that makes the model match ``runs``.

    ``recordings``: for temperatures that they may contain.
    InputError: a parameter that the motion does not excite, or not for long enough.
    """
    full_name, joint = named_parameter(arm, name)
    model = parameter(arm, full_name)
    pairs = [(run, recording) for run, recording in zip(runs, recordings) if run.powered]
    columns = [_column(run, full_name, model) for run, _ in pairs]
    residuals = _residuals([run for run, _ in pairs], columns, arm)
    steps = [_steps(run, *both) for (run, _), *both in zip(pairs, residuals, columns)]
    information = float(sum(seen.sum() for _, seen in steps))
    if information <= 0.0:
        raise InputError("--distort", f"{full_name} does not affect these recordings; must be excited by the motion")
    if predicted(steps) < LEAST_PREDICTED:
        shown = sum(int(np.sum(seen > 0.0)) for _, seen in steps) * STEP
        raise InputError(
            "--distort",
            f"{full_name} affects {shown:.1f} s of these recordings, which is too short to say how it varies; must be "
            f"excited by the motion for longer than {GAP:g} s",
        )
    constant = float(sum(score.sum() for score, _ in steps)) / information
    ratio, scale = strength(steps)
    enough = LIMITS.min_gain * sum(int(np.any(column != 0.0, axis=1).sum()) for column in columns)
    gains = gains_of(steps, ratio, constant)

    against = [_variables(run, recording, joint) for run, recording in pairs]

    def paths_of(ratio: float, scale: float) -> tuple[Path, ...]:
        walks = [smoothed(*step, ratio) for step in steps]
        return tuple(
            _path(run, (model + x, np.sqrt(scale * variance)), step, variables)
            for (run, _), (x, variance), step, variables in zip(pairs, walks, steps, against)
        )

    paths = paths_of(ratio, scale)
    shares = shares_of(paths, memory(steps, ratio))
    significant = gains.sum() > enough and p_value(gains) < SIGNIFICANT
    if not significant and not any(one.p < SIGNIFICANT and one.gain > enough for one in shares):
        ratio, scale, shares = 0.0, likelihood(steps, 0.0)[1], ()
        paths = paths_of(ratio, scale)
    drive = arm.joints[joint - 1]
    return Distortion(
        full_name,
        joint,
        drive,
        drive.unit(UNITS.get(full_name.rpartition(".")[2], "")),
        model,
        paths,
        float(np.sqrt(scale * ratio / STEP)),
        (model + constant, float(np.sqrt(scale / information))),
        shares,
    )


def _column(run: Run, name: str, value: float) -> Array:
    """(m, n): change of the expected currents, over their noise std, for a unit of the parameter.

    0 near standstill, where the std is a bound of the friction rather than noise with a likelihood.
    """
    step = 1e-3 * max(abs(value), 1e-3)
    before, after = (with_parameters(run.arm, {name: value + sign * step}) for sign in (-1.0, 1.0))
    low, high = (
        inverse_dynamics(one, run.q, run.v, run.a) / one.joint_array("drive_constant") for one in (before, after)
    )
    column: Array = (high - low) / (2 * step) / run.deviation * comparable_rows(run)
    return column


def _residuals(runs: Sequence[Run], columns: Sequence[Array], arm: Arm) -> list[Array]:
    """(m, n) weighted residual of every run after the columns that are always free and aliased setpoint ripple.

    These are estimated in turns with the walk of the parameter, as each may take what belongs to the others; first with
    a constant parameter.
    """
    side = dataset_of([run.without_ripple for run in runs])
    # near standstill the parameter has no column: its effect there would be taken for the free columns'
    comparable = _flat(comparable_rows(run).astype(float) for run in runs)
    y, none = comparable * side.y, np.empty((len(side.y), 0))
    free = np.column_stack([none, *(one.dense(len(y)) for one in free_columns(side, arm))]) * comparable[:, None]
    own = _flat(columns)
    always = free @ np.linalg.lstsq(np.column_stack([own, free]), y, rcond=None)[0][1:]
    hidden = np.zeros_like(y)
    for _ in range(ROUNDS if own.any() else 0):
        steps = [_steps(*one) for one in zip(runs, side.by_recording(y - always - hidden), columns)]
        ratio, _ = strength(steps)
        walk = _flat(
            column * _at_rows(run, smoothed(*step, ratio)[0]) for run, step, column in zip(runs, steps, columns)
        )
        hidden = _flat(run.hidden_in(one) for run, one in zip(runs, side.by_recording(y - walk - always)))
        always = free @ np.linalg.lstsq(free, y - walk - hidden, rcond=None)[0]
    return side.by_recording(y - always - hidden)


def _flat(parts: Iterable[Array]) -> Array:
    """(n * rows,) of (m, n) of every run, joint after joint."""
    return np.concatenate(list(parts)).T.ravel()


def _at_rows(run: Run, x: Array) -> Array:
    """(m, 1) of values (s,) of every ``STEP``."""
    return np.interp(run.t, run.t[0] + _rows(run) * (np.arange(len(x)) + 0.5) / run.per_second, x)[:, None]


def _rows(run: Run) -> int:
    """Rows of a run in one ``STEP``."""
    return round(STEP * run.per_second)


def _steps(run: Run, residual: Array, column: Array) -> tuple[Array, Array]:
    """Score H^T y and information H^T H of every ``STEP`` of a run, all joints together."""
    rows = _rows(run)
    count = len(residual) // rows

    def summed(values: Array) -> Array:
        total: Array = values[: count * rows].sum(axis=1).reshape(count, rows).sum(axis=1)
        return total

    return summed(column * residual), summed(column**2)


def _path(run: Run, walk: tuple[Array, Array], step: tuple[Array, Array], against: dict[str, Array]) -> Path:
    """The parameter along one recording.

    walk: value and std (s,) in every ``STEP``; step: score and information (s,), see ``_steps``; against: variables.
    """
    (value, std), (score, information) = walk, step
    shown = information > 0
    seen = information > DETERMINED * np.median(information[shown]) if shown.any() else shown
    return Path(run.name, _means(run, run.t), value, std, seen, against, score, information, run.alike)


def _variables(run: Run, recording: Recording, joint: int) -> dict[str, Array]:
    """(s,) each, SI units, degrees Celsius: what a parameter of a joint (from 1) may depend on, in every ``STEP``."""
    j = joint - 1
    t, speed = _means(run, run.t), _means(run, run.v[:, j])
    found = {
        "position": _means(run, run.q[:, j]),
        "direction": np.sign(speed),
        "speed": np.abs(speed),
        "load torque": _means(run, run.rigid[:, j]),
        "time": t,
    }
    if recording.temp is not None and np.isfinite(recording.temp[:, j]).any():
        there = np.isfinite(recording.temp[:, j])
        first = run.raw[0][0] + TRANSIENT
        found["temperature"] = np.interp(t + first, recording.t[there], recording.temp[there, j])
    return found


def _means(run: Run, values: Array) -> Array:
    """(s,) means of values (m,) of the rows of a run in every ``STEP``."""
    rows = _rows(run)
    count = len(values) // rows
    means: Array = values[: count * rows].reshape(count, rows).mean(axis=1)
    return means


def sentence(result: Distortion) -> str:
    """The result in words."""
    value, std = result.constant
    unit = f" {result.unit}" if result.unit else ""
    if not result.varies:
        return (
            f"{result.parameter} does not vary: {with_two_std(value, std, mark='±')}{unit} throughout (the model has "
            f"{result.model:.4g}); no variation predicts more of the residual."
        )
    low, high = np.quantile(np.concatenate([p.value[p.seen] for p in result.paths]), [0.05, 0.95])
    first = (
        f"{result.parameter} would have to vary between {low:.4g} and {high:.4g}{unit} (the model has "
        f"{result.model:.4g})"
    )
    real = [one for one in result.shares if one.p < SIGNIFICANT and one.share > LEAST_SHARE]
    if not real:
        return f"{first}; it correlates with none of {', '.join(one.against for one in result.shares)}."
    others = "".join(f", {one.against} {one.share:.0%}" for one in real[1:])
    rest = f" (others{others.replace(',', ':', 1)})" if others else ""
    return (
        f"{first}; {real[0].against} explains {real[0].share:.0%} of that variance{rest}, beyond chance "
        f"(p = {real[0].p:.2g})."
    )
