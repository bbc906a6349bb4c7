"""A law of friction near rest, beside another smoothing velocity of the joint's own friction.

In the search, an error of the smoothing velocity is a column of the first order. Where friction changes its sign over a
third of the speed that the model says, the exact residual is another one, and bristles that yield over less than an
encoder shows explain it: they change the sign at once. Such a law is judged against every other smoothing velocity,
exactly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm_io.types import Array
from arm_model import Arm, EffectTerm
from arm_model.effects import friction_near_rest
from diagnosis.cause import Cause, EffectKey
from diagnosis.closed_loop.comparison import SMOOTHING
from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.measurements.currents.state import State
from diagnosis.residual.comparable_rows import comparable_rows
from diagnosis.residual.expected_current import predicted_current
from diagnosis.residual.filters import COMPARE_BAND, kept_rows, low_pass, rate_of
from diagnosis.residual.run import Run


@dataclass(frozen=True)
class OtherSmoothing:
    """That friction of a joint has another smoothing velocity, and that a cause explained nothing else.

    cause: the key of the cause; velocity: the joint's ``sign_velocity``, rad/s (m/s)
    """

    cause: EffectKey
    velocity: float

    def of(self, arm: Arm) -> Arm:
        """The arm with that smoothing velocity."""
        velocities = arm.joint_array("sign_velocity")
        velocities[(self.cause[1] or 1) - 1] = self.velocity
        return arm.with_sign_velocities(velocities)


def other_smoothing(state: State, causes: Sequence[Cause]) -> OtherSmoothing | None:
    """Of the first cause that gains less than what matters beside another smoothing velocity of its joint's friction.

    Of laws of friction near rest; None where all gain. The held-out recordings choose the smoothing velocity, with the
    law and without.
    """
    near, runs = {effect.name for effect in friction_near_rest()}, state.data.held_out.runs
    terms = [term for cause in causes for term in cause.terms]
    for cause in causes:
        if cause.effect not in near or cause.joint is None:
            continue
        other_terms = [term for term in terms if term not in cause.terms]
        without, with_it = (_energies(runs, effects, cause.joint) for effects in (other_terms, terms))
        if without.min() - with_it.min() < LIMITS.min_gain * state.data.held_out.rows:
            velocity = runs[0].arm.joints[cause.joint - 1].sign_velocity
            return OtherSmoothing(cause.key, float(velocity * SMOOTHING[int(np.argmin(without))]))
    return None


def _energies(runs: Sequence[Run], terms: Sequence[EffectTerm], joint: int) -> Array:
    """Squared whitened residuals of the rows that are compared, with ``SMOOTHING`` of a joint (from 1)."""
    return np.array([sum(_energy(run, terms, joint, float(factor)) for run in runs) for factor in SMOOTHING])


def _energy(run: Run, terms: Sequence[EffectTerm], joint: int, factor: float) -> float:
    """The same of one recording, with ``factor`` times the joint's smoothing velocity."""
    velocities = run.arm.joint_array("sign_velocity")
    velocities[joint - 1] *= factor
    arm = run.arm.with_sign_velocities(velocities)
    arm = replace(arm, effects=(*arm.effects, *terms, *run.own))
    (t, q), rate = run.raw, rate_of(run.raw[0])
    expected = low_pass(predicted_current(arm, t, q, powered=run.powered), COMPARE_BAND, rate)[kept_rows(rate)]
    return float(np.sum(run.whiten(run.current - expected) ** 2 * comparable_rows(run)))
