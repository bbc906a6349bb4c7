"""A held-out gain that matters, with all other causes in the final model.

A cause is accepted by what it gains when it enters, while others are missing. What enters after it, or leaves, may take
that gain away.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from arm_io.types import Array
from arm_model import EffectTerm
from diagnosis.cause import Cause
from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.measurements.currents.model_errors import Significance
from diagnosis.measurements.currents.possible import exists
from diagnosis.measurements.currents.state import State
from diagnosis.measurements.currents.structure.unseen_friction import unseen_friction
from diagnosis.residual.other_effects import residual_under
from diagnosis.residual.run import Run
from diagnosis.selection.beyond_model import in_deviations
from diagnosis.selection.design import Columns
from diagnosis.selection.unseen_inertia import explained
from diagnosis.verification.encoder_noise import gain_from_encoder_noise

OPPOSED = 0.1
"""Share of what an effect of the whole arm gains at a joint that it may lose at all others, as no law is exact."""
SMOOTHED = 0.1
"""Share of a gain that is of the noise of encoders, from which on what is left with an effect is no measure of it."""


@dataclass(frozen=True)
class FinalGain:
    """Held-out gain of one cause beside all others, in units of the noise variance.

    needed: whether its columns matter; by_columns, exact: the gain with the others refitted to do without it, and that
    of its law in the exact model, whose columns are not of the first order
    """

    needed: bool
    by_columns: float
    exact: float


@dataclass(frozen=True)
class FinalModel:
    """The candidates chosen in a state as causes of one model, and what each gains there.

    Each must gain twice, over all held-out rows: by its columns and by its exact law. Where it acts, what is left
    without it must be above the noise, which is no larger than what is left with it unless that was smoothed: below a
    noise that is overestimated, any law of many rows gains something. An effect of the whole arm acts at all joints
    alike: what gains at one and loses at the others is another error of that one.
    """

    state: State
    causes: Sequence[Cause]

    @property
    def needless(self) -> int | None:
        """The candidate that is not beyond what is known of the model, or whose gain does not matter; None: all do."""
        removed = within_model(self.state)
        return self.negligible if removed is None else removed

    @property
    def negligible(self) -> int | None:
        """The candidate that gains least, if that does not matter; None where all matter."""
        idle = [
            (min(one.by_columns, one.exact), index)
            for index, one in enumerate(self.gains)
            if not one.needed or one.exact < self._least
        ]
        return min(idle)[1] if idle else None

    @property
    def disproved(self) -> int | None:
        """The candidate whose columns gain what matters, and whose exact law gains least and too little; None: none.

        Its law is then another than its columns, such as that of a mass whose lever the data says nothing of.
        """
        lost = [(one.exact, index) for index, one in enumerate(self.gains) if one.needed and one.exact < self._least]
        return min(lost)[1] if lost else None

    @property
    def _least(self) -> float:
        return LIMITS.min_gain * self.state.data.held_out.rows

    @cached_property
    def gains(self) -> list[FinalGain]:
        """Of each candidate; empty where no arm can be as the causes say: the impossible one is refuted first."""
        terms = [term for cause in self.causes for term in cause.terms]
        return list(_gains(self.state, self.causes)) if exists(self.state.model.arm, terms) else []


def _gains(state: State, causes: Sequence[Cause]) -> Iterator[FinalGain]:
    """Of each chosen candidate, the causes in the same order.

    Of a joint that creeps, what the law explains of one std of friction near rest does not count (``unseen_friction``),
    nor what it gains of the noise of encoders.
    """
    model, runs = state.model, state.data.held_out.runs
    arms = [run.arm.effects for run in runs]
    terms = [term for cause in causes for term in cause.terms]
    full, unseen = _energy(runs, [(*of_run, *terms) for of_run in arms]), unseen_friction(runs)
    for c, cause in zip(state.chosen, causes, strict=True):
        without = model.without(c, state)
        alone = model.conditional(c, without, state)
        others = [term for term in terms if term not in cause.terms]
        by_joint = _energy(runs, [(*of_run, *others) for of_run in arms]) - full
        gain, of_noise = float(by_joint.sum()), 0.0
        if gain < state.data.held_out.y.size:  # more than all noise is no gain of noise
            lacking, complete = ([(*of_run, *more) for of_run in arms] for more in (others, terms))
            of_noise = gain_from_encoder_noise(runs, lacking, complete)
        of_unseen = float(explained(unseen, model.columns(c).held_out, state.data.held_out).sum())
        with_it, without_it = (
            left_where_it_acts(model.columns(c).held_out, alone.coefficients, at) for at in (state, without)
        )
        noise = min(with_it, 1.0) if of_noise < SMOOTHED * gain else 1.0
        needed = model.needed(alone, state) and without_it > LIMITS.noise * noise
        needed = needed and not (c.joint is None and _opposed(by_joint, state.data.held_out.rows))
        yield FinalGain(needed, alone.gain, gain - of_unseen - of_noise)


def _opposed(by_joint: Array, rows: int) -> bool:
    """Whether gains (n,) at all joints but the one with the most are a loss that matters; rows: of a joint."""
    most = float(by_joint.max())
    return most - float(by_joint.sum()) > max(LIMITS.min_gain * rows, OPPOSED * most)


def left_where_it_acts(columns: Columns, coefficients: Array, state: State) -> float:
    """Held-out residual of a state over the noise, rms weighted by the squares of what an effect predicts.

    columns: its own, whitened; coefficients (k,). 0 of an effect that predicts nothing.
    """
    residual = state.residual.held_out
    weight = columns.contribution(coefficients, len(residual)) ** 2
    return float(np.sqrt(weight @ residual**2 / max(float(weight.sum()), 1e-300)))


def within_model(state: State) -> int | None:
    """The chosen candidate that is least beyond what is known of the model, if it is not; None where all are.

    Conditional on all others: what enters after a cause, or in a pair, may take its significance away.
    """
    model = state.model
    if model.uncertain is None or not state.chosen:
        return None
    chances = [model.without(c, state).significance.chance(model.columns(c), c) for c in state.chosen]
    weakest = int(np.argmax(chances))
    return weakest if chances[weakest] > LIMITS.beyond_model else None


def with_significance(state: State, causes: Sequence[Cause]) -> list[Cause]:
    """The causes, of the chosen candidates in their order, with how much of their significance the model leaves."""
    model, judged = state.model, []
    if model.uncertain is None:
        return list(causes)
    for c, cause in zip(state.chosen, causes, strict=True):
        without = model.without(c, state)
        exact = Significance(state.data, [*without.free, *(model.columns(other) for other in without.chosen)], None)
        chances = [of.chance(model.columns(c), c) for of in (exact, without.significance)]
        judged.append(replace(cause, deviations=(in_deviations(chances[0]), in_deviations(chances[1]))))
    return judged


def _energy(runs: Sequence[Run], effects: Sequence[Sequence[EffectTerm]]) -> Array:
    """(n,) squared whitened residuals under the arms of ``runs`` with these effects."""
    total = np.zeros(len(runs[0].arm))
    for run, of_run in zip(runs, effects):
        white = run.whiten(residual_under(run, of_run))
        total += np.sum(white**2, axis=0)
    return total
