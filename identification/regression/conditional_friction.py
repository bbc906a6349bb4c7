"""Columns of friction that depends on load and temperature, in a problem that had none.

The laws are the ``conditional`` effects of the catalogue (Bittencourt, Gunnarsson, 2012). The transmitted torque
follows from the masses that are identified with them: Gauss-Newton steps
(``identification.regression.effect_columns``). The velocity at which a part at low speed has faded, and the rise of
temperature after which grease is thin, are chosen from a few values by the residual of the joint alone.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm_io.types import Array
from arm_model import Arm, EffectTerm
from arm_model.effects import CATALOGUE, Excitation, Signals, Values
from arm_model.system import rigid_torque_along
from identification.preprocessing.signals import Motion, equation_rows, equation_weight, parallel_filter, with_reversals
from identification.regression.base_parameters import structural_base
from identification.regression.equations import Equations, with_effects
from identification.regression.model_parameters import column_names
from identification.regression.problem import Problem, excited_of, unexcited

_CONDITIONAL = [effect for effect in CATALOGUE.values() if effect.conditional]
LOAD = tuple(effect.name for effect in _CONDITIONAL if effect.excited_by is Excitation.LOAD)
TEMPERATURE = tuple(effect.name for effect in _CONDITIONAL if effect.excited_by is Excitation.TEMPERATURE)
RESOLVED = 2.0
"""Times the lowest speed: reversals leave the same as a hump that is narrower."""


@dataclass(frozen=True)
class Conditions:
    """Load and warmth of one joint in one motion: load (m,) N m (N), warmer (m,) K above ``reference`` degC or None."""

    motion: Motion
    joint: int
    load: Array
    warmer: Array | None

    def signals(self, sign_velocity: float) -> Signals:
        """What the laws look at."""
        v = self.motion.qd[:, self.joint]
        warmer = 0.0 if self.warmer is None else self.warmer
        return Signals(v=v, sign=v / np.hypot(v, sign_velocity), load=self.load, warmer=warmer)


def conditions_of(arm: Arm, motions: Sequence[Motion], j: int, reference: float | None) -> list[Conditions]:
    """Of joint j (from 0) in each motion, its load by ``arm``; ``reference``: degC at which its friction holds."""
    conditions = []
    for motion in motions:
        load = rigid_torque_along(arm, motion.q, motion.qd, motion.qdd)[:, j]
        temperature = None if motion.temperatures is None else motion.temperatures.at(j, motion.t)
        conditions.append(
            Conditions(motion, j, load, None if temperature is None or reference is None else temperature - reference)
        )
    return conditions


def terms_for(
    problem: Problem, residual: Array, seen: Sequence[Conditions], names: Sequence[str], speeds: tuple[float, float]
) -> list[EffectTerm]:
    """Effects ``names`` of one joint with coefficients 0, their other parameters those that explain ``residual`` most.

    residual (rows,) of ``problem.rows``; speeds: lowest and highest speed at which the joint surely slides, rad/s
    (m/s).
    """
    j = seen[0].joint
    of_joint = problem.rows.joint == j
    columns, residual = problem.rows.columns[np.ix_(of_joint, problem.columns)], residual[of_joint]
    basis = np.linalg.qr(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300))[0]
    terms: list[EffectTerm] = []
    known: list[Array] = []
    for name in names:
        tried = [(held, [*known, _columns(problem, seen, name, held)]) for held in _choices(name, speeds)]
        best = min(tried, key=lambda one: _squared_residual(np.concatenate(one[1], axis=1), basis, residual))[0]
        known.append(_columns(problem, seen, name, best))
        coefficients = {p.name: 0.0 for p in CATALOGUE[name].linear}
        terms.append(EffectTerm(name, j + 1, {**coefficients, **best}))
    return terms


def _choices(name: str, speeds: tuple[float, float]) -> list[dict[str, float]]:
    """All combinations of the searched parameters of an effect; velocities far enough above the lowest speed."""
    searched, (low, top) = CATALOGUE[name].nonlinear, speeds
    grids = [[max(share * top, RESOLVED * low) for share in p.shares] if p.shares else p.search for p in searched]
    grids = [sorted(set(grid)) for grid in grids]
    return [dict(zip((p.name for p in searched), values)) for values in itertools.product(*grids)]


def _columns(problem: Problem, seen: Sequence[Conditions], name: str, held: Mapping[str, float]) -> Array:
    """(rows of the joint, k): a column per coefficient of an effect, as the rows of ``problem``."""
    effect, parts = CATALOGUE[name], []
    assert effect.torque is not None
    # next-order terms are parameters too, and 0 here
    zero = dict.fromkeys((p.name for p in effect.parameters), 0.0) | dict(held)
    for one in seen:
        signals = one.signals(problem.arm.joints[one.joint].sign_velocity)
        torque = np.stack([effect.torque(Values(zero | {p.name: 1.0}), signals) for p in effect.linear], axis=1)
        filtered = parallel_filter(one.motion, torque * equation_weight(one.motion)[:, one.joint, None])
        parts.append(filtered[equation_rows(one.motion)[1][:, one.joint]])
    return np.concatenate(parts)


def _squared_residual(columns: Array, basis: Array, residual: Array) -> float:
    """Sum of squares that ``columns`` (rows, k) leave of a residual, conditional on the arm's own (``basis``)."""
    x, y = columns - basis @ (basis.T @ columns), residual - basis @ (basis.T @ residual)
    return float(np.sum((y - x @ np.linalg.lstsq(x, y, rcond=1e-10)[0]) ** 2))


def with_terms(problem: Problem, near: Arm, terms: Sequence[EffectTerm], references: Mapping[int, float]) -> Problem:
    """The problem with more effects in its arm, linearised at the values of an arm ``near`` the solution.

    references: degC at which the friction of joints (from 0) holds.
    """

    def extended(arm: Arm) -> Arm:
        joints = (replace(one, temperature=references.get(j, one.temperature)) for j, one in enumerate(arm.joints))
        return replace(arm, joints=tuple(joints), effects=(*arm.effects, *terms))

    arm, start = extended(problem.arm), extended(near)
    base, names = structural_base(arm, problem.friction), tuple(column_names(arm, problem.friction))

    def wider(rows: Equations, motions: Sequence[Motion]) -> Equations:
        return replace(with_effects(rows, start, arm, motions, problem.friction, base), names=names)

    rows = wider(problem.rows, problem.motions)
    excited = excited_of(rows, base, arm)
    old = unexcited(problem.base, problem.excited)
    return replace(
        problem,
        arm=arm,
        start=start,
        rows=rows,
        judged=wider(problem.judged, list(map(with_reversals, problem.motions))),
        held=None if problem.held is None else wider(problem.held, problem.held_motions),
        base=base,
        excited=excited,
        warnings=[warning for warning in problem.warnings if warning not in old] + unexcited(base, excited),
    )
