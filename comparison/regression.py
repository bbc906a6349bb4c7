"""The regression of one recording, with columns that mean the same in every recording of a comparison.

Columns: base parameters of links, rotors and effects of the model, which depend on the structure of the arm alone
(``structural_base``); points of friction curves (``friction_curves``) in place of Coulomb and viscous friction; and
friction by load (``load_friction``).
What the recording's setup adds (a known payload) is subtracted first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from arm_model import Arm
from arm_model.rigid_body.inertia import PARAMETERS
from comparison.friction_curves import Curve, common_curves, hats, knots_of, model_friction
from comparison.load_friction import EFFECT, load_columns, loaded_joints, mean_loads
from identification.preprocessing.signals import Motion, equation_rows, equation_weight, low_passed, parallel_filter
from identification.regression.base_parameters import BaseParameters, base_parameters
from identification.regression.effect_columns import is_effect
from identification.regression.equations import Equations, equations
from identification.regression.least_squares import least_squares
from identification.regression.model_parameters import model_values
from identification.regression.uncertainty import fit_uncertainty, student_factor

EXCITED = 1e-3
"""Share of a column that no other explains; below it, a recording says nothing about the parameter."""
UNKNOWN = 0.1
"""Least uncertainty of a value taken from the model, over the largest value of its unit."""


@dataclass(frozen=True)
class Rows:
    """The rows of one recording.

    columns  (k, c) of the c = s + f + l values: s structural base parameters, f compared points of friction curves, l
             coefficients of load friction
    own      (k, o) of points of its own, fitted and not compared
    y        (k,) N m or N
    """

    equations: Equations
    columns: Array
    own: Array
    y: Array

    @property
    def weight(self) -> Array:
        """(k,) one over the spread of the torque of each row's joint."""
        joints = self.equations.joint
        of = [self.y[joints == j] for j in range(int(joints.max(initial=0)) + 1)]
        # a joint at rest has no rows
        return np.array([1 / max(float(np.std(mine)) if len(mine) else 1.0, 1e-12) for mine in of])[joints]


@dataclass(frozen=True)
class Fitted:
    """(c,) values, NaN where the recording does not show them; covariance with zeros there, of white noise blocks.

    plain    (c, c) covariance with the correlations of the formula, which can be inverted where values are shown
    by_scale (c, J) change of each value by a unit relative change of all currents of a joint
    widened  factor between the raw standard deviations and those two of which hold 95 %
    leakage  (c, c) change of each value by a unit error of one that was taken from the model
    residual (k,) N m or N of every row; block: s of the blocks of time by which the covariance goes
    """

    values: Array
    covariance: Array
    plain: Array
    by_scale: Array
    freedom: float
    widened: float
    leakage: Array
    residual: Array
    block: float


@dataclass(frozen=True)
class Structure:
    """Structural base parameters that are no friction: rows (s,) of ``base``; the compared friction curves; mean loads.

    loads  (J,) N m (N), NaN of joints without a column of load friction
    """

    arm: Arm
    base: BaseParameters
    rows: NDArray[np.intp]
    curves: Sequence[Curve]
    loads: Array

    @property
    def kept(self) -> NDArray[np.intp]:
        """(s,) their columns among the standard parameters."""
        return np.asarray(self.base.kept[self.rows])

    @property
    def points(self) -> list[tuple[Curve, int]]:
        """The f compared points, each with its place on its curve."""
        return [(curve, k) for curve in self.curves for k in range(len(curve.speeds))]

    @property
    def size(self) -> int:
        """Number of compared values."""
        return len(self.rows) + len(self.points) + len(loaded_joints(self.loads))

    def model(self) -> Array:
        """(c,) values of the model."""
        base = self.base.grouping[self.rows] @ model_values(self.arm, "asymmetric")
        points = [model_friction(self.arm, curve, curve.speeds) for curve in self.curves]
        return np.concatenate([base, *points, np.zeros(len(loaded_joints(self.loads)))])

    def by_body(self, link: int) -> Array:
        """(c, 10) change of the values by the inertial PARAMETERS of a link (from 1).

        Where a joint slides and bears weight, a mass is a constant force, which the points of its friction curve show.
        """
        columns = [self.base.names.index(f"link{link}.{name}") for name in PARAMETERS]
        change = np.zeros((self.size, len(columns)))
        change[: len(self.rows)] = self.base.grouping[self.rows][:, columns]
        levels = {self.base.names[column]: row for row, column in enumerate(self.base.kept)}
        for k, (curve, _) in enumerate(self.points, len(self.rows)):
            level = levels.get(f"joint{curve.joint + 1}.coulomb_{'positive' if curve.direction > 0 else 'negative'}")
            if level is not None:
                change[k] = self.base.grouping[level, columns]
        return change

    def uncertain(self, units: Sequence[str]) -> Array:
        """(c,) possible error of the model's values: their size, at least UNKNOWN of the largest of the unit."""
        base = np.abs(self.base.grouping[self.rows]) @ np.abs(model_values(self.arm, "asymmetric"))
        size = np.concatenate([base, np.abs(self.model()[len(base) :])])
        size[len(size) - len(loaded_joints(self.loads)) :] = EFFECT.linear[0].typical[1]
        kinds = np.array(units)
        floor = np.array([UNKNOWN * size[kinds == unit].max() for unit in units])
        return np.asarray(np.maximum(size, floor))


def is_friction(name: str) -> bool:
    """Whether a standard parameter is contained in a friction curve: joint2.viscous_positive, joint2.drag."""
    head, _, quantity = name.partition(".")
    kind = quantity.partition("_")[0].rstrip("0123456789")
    friction = ("viscous", "coulomb", "curve", "drag", "offset")
    return head.startswith("joint") and not is_effect(name) and kind in friction


def structure_of(
    arm: Arm, base: BaseParameters, motions: Sequence[Motion], names: Sequence[str], is_before: NDArray[np.bool_]
) -> Structure:
    """What all ``motions`` are compared by; ``names`` of their recordings, ``is_before`` (n,) True for those before."""
    rows = [row for row, column in enumerate(base.kept) if not is_friction(base.names[column])]
    curves = common_curves(motions, names, arm, is_before)
    return Structure(arm, base, np.array(rows, np.intp), curves, mean_loads(arm, motions))


def rows_of(structure: Structure, motion: Motion, carrying: Arm, whole: Motion) -> Rows:
    """The rows of one recording.

    carrying  the arm with the known payload of its setup, which is subtracted
    whole     the motion with all its samples, by which it shows friction or does not (``identification.ripples.wide``)
    """
    arm, base = structure.arm, structure.base
    rows = equations(arm, [motion], "asymmetric")
    y = rows.torque if rows.rest is None else rows.torque - rows.rest
    added = base.grouping @ (model_values(carrying, "asymmetric") - model_values(arm, "asymmetric"))
    y = y - rows.columns[:, base.kept] @ added
    _, trusted = equation_rows(motion)
    joint, row = np.nonzero(trusted.T)

    def through_filters(torque: Array, weight: Array) -> Array:
        """(k, ...) torques (m, ...) with all samples, which step at reversals, in the rows of the regression."""
        smooth = low_passed(torque, whole.band, whole.dt)[:: round(motion.dt / whole.dt)]
        return parallel_filter(motion, smooth * weight)

    compared, own = [], []
    for curve in structure.curves:
        knots, place = knots_of(curve, whole)
        if not len(knots):
            compared.append(np.zeros((len(row), len(curve.speeds))))
            continue
        weight = equation_weight(motion)[:, curve.joint, None]
        shown = through_filters(hats(whole, curve, knots), weight)
        block = np.where((joint == curve.joint)[:, None], shown[row], 0.0)
        # a recording does not determine points at speeds that it does not reach
        shared = np.zeros((len(row), len(curve.speeds)))
        shared[:, place[place >= 0]] = block[:, place >= 0]
        compared.append(shared)
        own.append(block[:, place < 0])
    joints = loaded_joints(structure.loads)
    by_load = through_filters(load_columns(carrying, whole, structure.loads), equation_weight(motion)[:, joints])
    compared.append(np.where(joint[:, None] == joints, by_load[row], 0.0))
    columns = np.concatenate([rows.columns[:, structure.kept], *compared], axis=1)
    return Rows(rows, columns, np.concatenate([np.empty((len(y), 0)), *own], axis=1), y)


def shown_by(rows: Rows, structure: Structure) -> NDArray[np.bool_]:
    """(c,) which values a recording shows: friction curves first, then links, rotors, effects, load friction last."""
    size, first, links = rows.columns.shape[1], rows.own.shape[1], len(structure.rows)
    both = np.concatenate([rows.own, rows.columns], axis=1) * rows.weight[:, None]
    # Base parameters come in the order of reading, effects last.
    curves = range(first + links, first + links + len(structure.points))
    order = [*range(first), *curves, *range(first, first + links), *range(curves.stop, first + size)]
    independent = base_parameters(both, [str(k) for k in range(first + size)], order=order, negligible=EXCITED).kept
    shown = np.zeros(size, bool)
    shown[independent[independent >= first] - first] = True
    return shown


def fit(rows: Rows, shown: NDArray[np.bool_], model: Array, joints: int) -> Fitted:
    """Weighted least squares of the values ``shown`` (c,) of an arm with so many joints.

    The others stay at those of the ``model`` (c,).
    """
    silent = ~shown
    y = rows.y - rows.columns[:, silent] @ model[silent]
    # A column of its own that this recording's other columns contain would make the rest undetermined.
    own = rows.own[:, _independent(rows, shown)]
    columns = np.concatenate([rows.columns[:, shown], own], axis=1)
    solution = least_squares(columns, y, rows.equations.joint, "wls")
    uncertainty = fit_uncertainty(columns, rows.equations, solution)
    count, size = int(shown.sum()), len(shown)
    widened = student_factor(uncertainty.blocks - 1)
    values, covariance, leakage = np.full(size, np.nan), np.zeros((size, size)), np.zeros((size, size))
    values[shown] = solution.values[:count]
    covariance[np.ix_(shown, shown)] = uncertainty.covariance[:count, :count] / widened**2
    weight = solution.weight[:, None]
    plain = np.zeros((size, size))
    plain[np.ix_(shown, shown)] = np.linalg.pinv(uncertainty.information, hermitian=True)[:count, :count]
    of_joint = y[:, None] * (rows.equations.joint[:, None] == np.arange(joints))
    by_scale = np.zeros((size, joints))
    by_scale[shown] = np.linalg.lstsq(columns * weight, of_joint * weight, rcond=None)[0][:count]
    if silent.any():
        both = np.linalg.lstsq(columns * weight, rows.columns[:, silent] * weight, rcond=None)[0]
        leakage[np.ix_(shown, silent)] = both[:count]
    return Fitted(
        values=values,
        covariance=covariance,
        plain=plain,
        by_scale=by_scale,
        freedom=max(uncertainty.blocks - 1, 1),
        widened=widened,
        leakage=leakage,
        residual=solution.residual,
        block=uncertainty.block,
    )


def unfitted(rows: Rows, structure: Structure, block: float) -> Fitted:
    """Of a recording that is too short to say anything alone, with blocks of time of ``block`` s."""
    size, nothing = structure.size, np.zeros((structure.size, structure.size))
    return Fitted(
        values=np.full(size, np.nan),
        covariance=nothing,
        plain=nothing,
        by_scale=np.zeros((size, len(structure.arm))),
        freedom=1.0,
        widened=1.0,
        leakage=nothing,
        residual=np.full(len(rows.y), np.nan),
        block=block,
    )


def _independent(rows: Rows, shown: NDArray[np.bool_]) -> NDArray[np.intp]:
    weight = rows.weight[:, None]
    both = np.concatenate([rows.columns[:, shown], rows.own], axis=1) * weight
    first = int(shown.sum())
    labels = [str(k) for k in range(both.shape[1])]
    kept = base_parameters(both, labels, order=range(both.shape[1]), negligible=EXCITED).kept
    return np.asarray(np.sort(kept[kept >= first]) - first)
