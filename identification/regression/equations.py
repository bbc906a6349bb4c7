"""The equations of motion as rows of a linear regression.

Y(q, q', q'') delta + rest = torque, for all runs of an identification.

``rest`` is what an arm with effects shows beyond its columns times its parameters
(``identification.regression.effect_columns``); without effects it is nothing. Through the same parallel filter on both
sides; samples for which they do not hold (``signals.equation_weight``) are zero on both sides before it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from arm_model import Arm, parameter
from arm_model.effects import coupled
from arm_model.friction_split import departures, follows
from arm_model.rigid_body import jacobian
from arm_model.rigid_body.regressor import parameter_names, parameter_vector, regressor
from arm_model.tables import Temperatures
from identification.preprocessing.setpoint_ripple import drifting
from identification.preprocessing.signals import (
    Motion,
    equation_rows,
    equation_weight,
    parallel_filter,
    parallel_window,
    sliding_rows,
)
from identification.regression.base_parameters import BaseParameters, base_parameters, reading_order
from identification.regression.effect_columns import effect_columns, effect_parameters, shown_torque
from identification.regression.generic_arm import generic_arms

Friction = Literal["symmetric", "asymmetric"]
LEVEL = 1e-6
"""Sine of the slope below which a sliding joint counts as level."""

PER_ROW = ("columns", "torque", "joint", "run", "t", "rest", "systematic", "sliding")


@dataclass(frozen=True)
class Equations:
    """columns (rows, p) of the standard parameters ``names``, torque (rows,) N m or N, and where each row comes from.

    Joint (rows,) from 0, run (rows,) from 0, t (rows,) s within the run. Rows of one run and joint follow in time. rest
    (rows,): the part of the torque that no column carries; None: nothing. systematic (rows, s): errors that the torques
    may have and no residual shows, each one standard deviation of its own cause. sliding (rows,): those that rest on
    samples alone in which the direction of motion is known; None: all.
    """

    columns: Array
    torque: Array
    joint: NDArray[np.intp]
    run: NDArray[np.intp]
    t: Array
    names: tuple[str, ...]
    rest: Array | None = None
    systematic: Array | None = None
    sliding: NDArray[np.bool_] | None = None

    def __len__(self) -> int:
        return len(self.torque)

    def of(self, rows: NDArray[np.bool_]) -> Equations:
        """Only those rows."""
        given = {name: value[rows] for name in PER_ROW if (value := getattr(self, name)) is not None}
        return replace(self, **given)


def column_names(arm: Arm, friction: Friction) -> list[str]:
    """Names of ``model_columns``: regressor, friction as requested, rotors where the model has one or a gear, effects.

    symmetric   viscous, coulomb, offset: with a constant offset, Coulomb friction may differ by direction
    asymmetric  viscous_positive, viscous_negative, coulomb_positive, coulomb_negative; an offset could not be
                identified separately from these
    Of a friction curve those values from which the others follow (``arm_model.friction_split``).
    """
    described = [name for name in parameter_names(arm, friction=friction) if not _left_out(arm, name, friction)]
    return described + effect_parameters(arm)


def model_columns(
    arm: Arm, q: Array, qd: Array, qdd: Array, friction: Friction = "symmetric", t: Array | None = None
) -> Array:
    """(N, n, p) regressor with the columns ``column_names(arm, friction)``.

    t (N,) s matters to effects that change in time.
    """
    described = described_columns(arm, q, qd, qdd, friction)
    if not arm.effects:
        return described
    t = np.zeros(len(q)) if t is None else t
    shown = shown_torque(arm, arm, q, qd, qdd, t)
    return np.concatenate([described, effect_columns(arm, arm, q, qd, qdd, t, shown)], axis=2)


def described_columns(arm: Arm, q: Array, qd: Array, qdd: Array, friction: Friction) -> Array:
    """(N, n, p - e) columns of links and drives, these with the couplings that effects of the arm make.

    Of other effects a Gauss-Newton step needs nothing here: links and drives move alike.

    With symmetric friction, the offset of a joint whose Coulomb friction the model has by direction is half of that
    difference, and goes through zero with the velocity: sign^2 instead of 1. Not so where the offset is also a weight
    (``lifts``): there the difference is a constant, with either friction.
    """
    full, names = regressor(coupled(arm), q, qd, qdd, friction=friction)
    for j, joint in enumerate(arm.joints):
        if friction == "asymmetric" and lifts(arm, j):
            forwards, backwards = (names.index(f"joint{j + 1}.coulomb_{way}") for way in ("positive", "negative"))
            sign = full[:, j, forwards] + full[:, j, backwards]
            full[:, j, forwards], full[:, j, backwards] = (sign + 1.0) / 2.0, (sign - 1.0) / 2.0
        elif friction == "symmetric" and joint.coulomb[0] != joint.coulomb[1] and not lifts(arm, j):
            sign = full[:, j, names.index(f"joint{j + 1}.coulomb")]
            full[:, j, names.index(f"joint{j + 1}.offset")] = sign**2
    for j, joint in enumerate(arm.joints):
        if joint.friction_curve is not None:
            basis, kept = departures(joint.friction_curve.speed)
            ends = ("_positive", "_negative") if friction == "asymmetric" else ("",)
            for points in (curve_names(j, len(basis), end) for end in ends):
                own = np.array([names.index(point) for point in points])
                full[:, j, own[kept]] = full[:, j, own] @ basis
    return full[:, :, [k for k, name in enumerate(names) if not _left_out(arm, name, friction)]]


def lifts(arm: Arm, j: int) -> bool:
    """Whether joint j (from 0) slides and bears weight: a constant force, indistinguishable from an offset."""
    if arm.joints[j].revolute:
        return False
    axis = jacobian(arm, np.zeros(len(arm)))[:3, j]
    return bool(abs(axis @ arm.gravity) > LEVEL * np.linalg.norm(arm.gravity))


def lifted_masses(arm: Arm) -> list[float]:
    """(n,) kg that each joint lifts; 0 where it turns or slides on the level."""
    masses = arm.joint_array("mass")
    return [float(masses[j:].sum()) if lifts(arm, j) else 0.0 for j in range(len(arm))]


def curve_names(j: int, count: int, direction: str) -> list[str]:
    """Names of the values of the friction curve of joint j (from 0), for "_positive", "_negative" or both, ""."""
    return [f"joint{j + 1}.curve{k}{direction}" for k in range(1, count + 1)]


def model_values(arm: Arm, friction: Friction = "symmetric") -> Array:
    """(p,) the arm's own values of the parameters ``column_names(arm, friction)``.

    While a joint moves, a constant torque cannot be distinguished from a difference of the two Coulomb magnitudes: with
    symmetric friction the offset carries half of that difference, with asymmetric friction the magnitudes carry the
    offset.
    """
    values = []
    for name, value in zip(parameter_names(arm, friction=friction), parameter_vector(arm, friction=friction)):
        if _left_out(arm, name, friction):
            continue
        head, _, rest = name.partition(".")
        joint = arm.joints[int(head.removeprefix("joint")) - 1] if head.startswith("joint") else None
        if joint is not None and rest == "offset":
            value += joint.ratio * (joint.coulomb[0] - joint.coulomb[1]) / 2
        elif joint is not None and rest in ("coulomb_positive", "coulomb_negative"):
            value += joint.ratio * joint.offset * (1 if rest.endswith("positive") else -1)
        values.append(value)
    return np.array(values + [parameter(arm, name) for name in effect_parameters(arm)])


def _left_out(arm: Arm, name: str, friction: Friction) -> bool:
    head, _, rest = name.partition(".")
    if rest == "offset":
        return friction == "asymmetric"
    if rest.startswith("curve"):
        return follows(arm.joints[int(head.removeprefix("joint")) - 1], rest)
    if rest != "rotor_inertia":
        return False
    return not _has_rotor(arm, int(head.removeprefix("joint")) - 1)


def _has_rotor(arm: Arm, j: int) -> bool:
    """Whether the rotor inertia of joint j (from 0) is a parameter of its own.

    Without rotor and gear in the model it is part of what the joint moves: behind a gear it turns as fast as the motor,
    and no link's inertia is felt as it is. A joint that lifts is driven by a screw or a belt whatever the model says,
    and a rotor counted as mass would have a weight, which only an offset could take away.
    """
    joint = arm.joints[j]
    return joint.rotor_inertia != 0.0 or joint.ratio != 1.0 or lifts(arm, j)


def freed_rotors(arm: Arm) -> list[int]:
    """Joints (from 1) whose model has no rotor inertia although they have a gear or lift: it is identified."""
    return [j + 1 for j, joint in enumerate(arm.joints) if joint.rotor_inertia == 0.0 and _has_rotor(arm, j)]


def structural_base(arm: Arm, friction: Friction = "symmetric", *, states: int = 0, seed: int = 1) -> BaseParameters:
    """What any motion of this arm could show: base parameters from random states within its limits.

    Columns of effects depend on the other parameters, so that arms with other bodies decide too (``generic_arms``).
    """
    # Where friction only turns about, Coulomb's magnitudes and an offset are not the same: let it turn at once.
    arm = replace(arm, joints=tuple(replace(joint, sign_velocity=1e-7) for joint in arm.joints))
    names = column_names(arm, friction)
    random = np.random.default_rng(seed)
    count = states or 4 * len(names)
    limits = [joint.limits or ((-np.pi, np.pi) if joint.revolute else (-1.0, 1.0)) for joint in arm.joints]
    q = random.uniform([low for low, _ in limits], [high for _, high in limits], (count, len(arm)))
    qd, qdd = random.uniform(-2, 2, q.shape), random.uniform(-5, 5, q.shape)
    for j, joint in enumerate(arm.joints):
        if joint.friction_curve is not None:  # most of its speeds are low
            speed = np.array([0.0, *joint.friction_curve.speed, 2 * joint.friction_curve.speed[-1]])
            qd[:, j] = np.sign(qd[:, j]) * np.interp(random.uniform(size=count), np.linspace(0, 1, len(speed)), speed)
    t = random.uniform(0.0, 60.0, count)
    arm = replace(arm, temperatures=_any_temperatures(arm, random))
    columns = [model_columns(one, q, qd, qdd, friction, t) for one in generic_arms(arm, random)]
    # what lifts has a weight, an offset only beside it: sums of masses and rotors read better than sums of offsets
    last = {f"joint{j + 1}.offset" for j in range(len(arm)) if lifts(arm, j)}
    order = sorted(reading_order(tuple(names)), key=lambda column: names[column] in last)
    return base_parameters(np.concatenate(columns).reshape(-1, len(names)), names, order=order)


def _any_temperatures(arm: Arm, random: np.random.Generator) -> Temperatures:
    """Of motors that warm up and cool down within the minute of ``structural_base``, each in its own way."""
    usual = [joint.temperature or 0.0 for joint in arm.joints]
    courses = tuple(tuple((one + random.uniform(-20.0, 20.0, 6)).tolist()) for one in usual)
    return Temperatures(tuple(np.linspace(0.0, 60.0, 6).tolist()), courses)


def equations(
    arm: Arm, motions: Sequence[Motion], friction: Friction = "symmetric", base: BaseParameters | None = None
) -> Equations:
    """The rows of all runs.

    ``rest`` is what the arm shows beyond the columns of its ``base`` parameters (default: of all).
    """
    (rows,) = equations_of(arm, [motions], friction, base)
    return rows


def equations_of(
    arm: Arm, views: Sequence[Sequence[Motion]], friction: Friction = "symmetric", base: BaseParameters | None = None
) -> list[Equations]:
    """``equations`` of several views of the same runs, which differ in the rows that they trust.

    The regressor is made once for all.
    """
    found = []
    parts = [_run_equations(arm, same, run, friction) for run, same in enumerate(zip(*views))]
    for motions, own in zip(views, zip(*parts)):
        columns, torque, joint, run, t = (np.concatenate(part) for part in zip(*own))
        rows = Equations(columns, torque, joint, run, t, tuple(column_names(arm, friction)))
        sliding = np.concatenate([sliding_rows(motion).T[equation_rows(motion)[1].T] for motion in motions])
        rows = replace(rows, systematic=_systematic(rows, motions), sliding=sliding)
        found.append(with_effects(rows, arm, arm, motions, friction, base))
    return found


def _systematic(rows: Equations, motions: Sequence[Motion]) -> Array | None:
    """(rows, s) what folded ripple may have added, each joint and run for itself.

    All along and as two clocks drift apart; None: nothing.
    """
    found = []
    for run, motion in enumerate(motions):
        if motion.folded is None:
            continue
        unseen = drifting(motion.folded, motion.t) * equation_weight(motion)[:, None]
        added = parallel_filter(motion, unseen)
        joint, row = np.nonzero(equation_rows(motion)[1].T)
        for j in np.flatnonzero(motion.folded.any(axis=0)):
            columns = np.zeros((len(rows), 2))
            columns[rows.run == run] = np.where((joint == j)[:, None], added[row, :, j], 0.0)
            found.append(columns)
    return np.concatenate(found, axis=1) if found else None


def _run_equations(
    arm: Arm, views: Sequence[Motion], number: int, friction: Friction
) -> list[tuple[Array, Array, NDArray[np.intp], NDArray[np.intp], Array]]:
    """columns of links and drives, torque, joint, run and t of one run's rows, for each view of it."""
    found = []
    for motion, columns in zip(views, _filtered(arm, views, views[0], friction)):
        t, trusted = equation_rows(motion)
        torque = parallel_filter(motion, motion.torque * equation_weight(motion))
        joint, row = np.nonzero(trusted.T)
        found.append((columns[row, joint], torque[row, joint], joint, np.full(len(row), number, np.intp), t[row]))
    return found


def described_rows(arm: Arm, motions: Sequence[Motion], moved: Sequence[Motion], friction: Friction) -> Array:
    """(rows, p - e) ``described_columns`` of ``equations`` of ``motions``, for positions ``moved`` on their grids."""
    parts = []
    for motion, other in zip(motions, moved):
        (columns,) = _filtered(arm, [motion], other, friction)
        joint, row = np.nonzero(equation_rows(motion)[1].T)
        parts.append(columns[row, joint])
    return np.concatenate(parts)


def _filtered(arm: Arm, views: Sequence[Motion], moved: Motion, friction: Friction) -> list[Array]:
    """(k, n, p - e) ``described_columns`` of the positions of ``moved`` through the parallel filter of some views.

    The views are of one run. A stretch at a time, to save memory.
    """
    motion = views[0]
    window, step = parallel_window(motion)
    weights = [equation_weight(view)[..., None] for view in views]
    kept = (len(motion.t) - window) // step + 1
    stretch = max(1, 4 * window // step)
    parts: list[list[Array]] = [[] for _ in views]
    for first in range(0, kept, stretch):
        last = min(first + stretch, kept)
        rows = slice(first * step, (last - 1) * step + window)
        unfiltered = described_columns(arm, moved.q[rows], moved.qd[rows], moved.qdd[rows], friction)
        for part, weight in zip(parts, weights):
            part.append(parallel_filter(motion, unfiltered * weight[rows]))
    return [np.concatenate(part) for part in parts]


def with_effects(
    rows: Equations,
    arm: Arm,
    model: Arm,
    motions: Sequence[Motion],
    friction: Friction,
    base: BaseParameters | None = None,
    moved: Sequence[Motion] | None = None,
) -> Equations:
    """``rows`` with the columns of the effects at the values of ``arm``, and the ``rest``.

    ``model``: that of the readings (``shown_torque``); ``moved``: other positions on the grids of ``motions``,
    simulated ones.
    """
    if not arm.effects:
        return rows
    parts = [_effect_rows(arm, model, motion, other) for motion, other in zip(motions, moved or motions)]
    found = np.concatenate(parts)
    values = model_values(arm, friction)
    effects = len(effect_parameters(arm))
    described = rows.columns[:, : len(values) - effects]
    columns = np.concatenate([described, found[:, 1:]], axis=1)
    linear = columns @ values if base is None else columns[:, base.kept] @ (base.grouping @ values)
    return replace(rows, columns=columns, rest=found[:, 0] - linear)


def _effect_rows(arm: Arm, model: Arm, motion: Motion, moved: Motion) -> Array:
    """(rows of this run, 1 + e): the torque that the arm shows, then its derivatives by the effects' parameters."""
    q, qd, qdd = moved.q, moved.qd, moved.qdd
    arm = replace(arm, temperatures=motion.temperatures)
    shown = shown_torque(arm, model, q, qd, qdd, motion.t)
    columns = effect_columns(arm, model, q, qd, qdd, motion.t, shown)
    joint, row = np.nonzero(equation_rows(motion)[1].T)
    both = np.concatenate([shown[..., None], columns], axis=2) * equation_weight(motion)[..., None]
    return np.asarray(parallel_filter(motion, both)[row, joint])


def measured_rows(motions: Sequence[Motion]) -> Equations:
    """The rows of ``equations`` without columns: measured torques, and where they come from."""
    parts = []
    for run, motion in enumerate(motions):
        t, usable = equation_rows(motion)
        joint, row = np.nonzero(usable.T)
        torque = parallel_filter(motion, motion.torque * equation_weight(motion))[row, joint]
        sliding = sliding_rows(motion)[row, joint]
        parts.append((torque, joint, np.full(len(row), run, np.intp), t[row], sliding))
    torque, joint, run_of, t, sliding = (np.concatenate(part) for part in zip(*parts))
    return Equations(np.empty((len(torque), 0)), torque, joint, run_of, t, (), sliding=sliding)


def shown_rows(arm: Arm, model: Arm, motions: Sequence[Motion]) -> Array:
    """(rows,) the torque that a recording of ``arm`` shows on these motions, as the rows of ``equations``."""
    parts = []
    for motion in motions:
        joint, row = np.nonzero(equation_rows(motion)[1].T)
        warm = replace(arm, temperatures=motion.temperatures)
        shown = shown_torque(warm, model, motion.q, motion.qd, motion.qdd, motion.t)
        parts.append(parallel_filter(motion, shown * equation_weight(motion))[row, joint])
    return np.concatenate(parts)
