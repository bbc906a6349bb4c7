"""Candidates that a search of the currents has chosen, fitted together, and the correction of their first order.

Columns are first order in their effects. After every round the model extended by the chosen causes is evaluated exactly
(``diagnosis.residual.expected_current``), and what its first-order columns had wrong is taken out of the data (deferred
correction: Stetter, Numerische Mathematik 29, 1978), so that it is not taken for another cause. Linear algebra stays as
it is; its solution is that of the exact model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from arm_io import InputError
from arm_io.types import Array
from arm_model import EffectTerm
from diagnosis.cause import EffectKey
from diagnosis.measurements.currents.design_matrix import dataset_with
from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.measurements.currents.model_errors import Significance
from diagnosis.residual.run import Run
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.design import Columns, Dataset, Pair
from diagnosis.selection.regression import Fitted, fit_together
from identification.selection import Score, Split

if TYPE_CHECKING:
    from diagnosis.measurements.currents.model import Currents

Rivals = Mapping[EffectKey, Sequence[Score[Candidate]]]


@dataclass(frozen=True)
class State:
    """Chosen candidates in the order of acceptance, fitted together.

    data    residuals, corrected for what the chosen do beyond first order
    rivals  for each of the chosen, the candidates that gained as much
    """

    model: Currents = field(repr=False)
    chosen: tuple[Candidate, ...]
    data: Split[Dataset] = field(repr=False)
    rivals: Rivals = field(repr=False)

    @cached_property
    def free(self) -> list[Pair]:
        """The free columns of the model, without those that make held-out residuals clearly worse.

        What they fit is then no smoothing of friction: correlated noise of a few fast moves, say, which at a tenth of
        their speed is a hundred times as large.
        """
        allowed, unrestricted = LIMITS.min_gain * self.data.held_out.rows, self._with_every_free
        return [
            pair
            for pair, c in zip(self.model.free, unrestricted.coefficients)
            if _harm(pair.held_out.x[:, 0] * c, unrestricted.residual.held_out[pair.held_out.where]) < allowed
        ]

    @cached_property
    def fitted(self) -> Fitted:
        """All chosen candidates with the free columns; the coefficients of these come first."""
        return self._with_every_free if len(self.free) == len(self.model.free) else self._with(self.free)

    @cached_property
    def _with_every_free(self) -> Fitted:
        return self._with(self.model.free)

    def _with(self, free: Sequence[Pair]) -> Fitted:
        return fit_together(self.data, [*free, *(self.model.columns(c) for c in self.chosen)])

    @property
    def residual(self) -> Split[Array]:
        """(n * rows,) each: whitened, as all chosen candidates and the free columns leave it."""
        return self.fitted.residual

    @property
    def runs(self) -> Split[tuple[Run, ...]]:
        """The recordings."""
        return self.data.map(lambda part: part.runs)

    @property
    def all_runs(self) -> list[Run]:
        """The fitted recordings, then the held-out ones."""
        return [run for part in self.runs for run in part]

    @property
    def coefficients(self) -> list[Array]:
        """(k,) of each chosen candidate."""
        widths = [self.model.columns(c).fit.x.shape[1] for c in self.chosen]
        of_chosen = self.fitted.coefficients[len(self.free) :]
        return np.split(of_chosen, np.cumsum(widths)[:-1]) if self.chosen else []

    def replaced(self, old: Candidate, new: Candidate) -> State:
        """The same with a candidate in the place of another, the data as it is."""
        return replace(self, chosen=tuple(new if c is old else c for c in self.chosen))

    @property
    def energy(self) -> Split[float]:
        """Squared residual, in units of the noise variance."""
        return self.residual.map(lambda part: float(np.sum(part**2)))

    @property
    def terms(self) -> list[EffectTerm]:
        """The chosen candidates as effects of a model."""
        return terms(self.chosen, self.coefficients)

    @cached_property
    def significance(self) -> Significance:
        """Of further columns conditional on the chosen ones, with the model as uncertain as it is."""
        model = self.model
        chosen = [*self.free, *(model.columns(c) for c in self.chosen)]
        return Significance(self.data, chosen, model.uncertain)


def _harm(explained: Array, remaining: Array) -> float:
    """Squared residual that a column adds: it explains ``explained`` (rows,) and leaves ``remaining`` (rows,)."""
    return float(remaining @ remaining - (remaining + explained) @ (remaining + explained))


def terms(chosen: Sequence[Candidate], coefficients: Sequence[Array]) -> list[EffectTerm]:
    """Candidates with coefficients (k,) each, as effects of a model."""
    return [EffectTerm(c.effect, c.joint, c.parameters(values.tolist())) for c, values in zip(chosen, coefficients)]


CONVERGED = 0.01
"""Of a std, rms over the rows of a joint: corrections that would change by less are not computed again."""


def corrected(state: State) -> State:
    """The state with y = (residual of the exact extended model) + (first-order columns times their coefficients).

    Where the exact model leaves more than its first order did, or there is no such arm (parameters out of its range),
    nothing is corrected.
    """
    model = state.model
    for _ in range(LIMITS.corrections):
        first_order, extended = _first_order(state), state.terms
        columns = [model.columns(c) for c in state.chosen]
        try:
            data = Split(
                _exact(model.data.fit, [pair.fit for pair in columns], first_order, extended),
                _exact(model.data.held_out, [pair.held_out for pair in columns], first_order, extended),
                model.data.two_fold,
            )
        except InputError:
            return state
        trial = replace(state, data=data)
        if np.sum(trial.residual.fit**2) > LIMITS.worse * np.sum(state.residual.fit**2):
            return state
        before, state = state, trial
        if _converged(before, state):
            break
    return state


def _first_order(state: State) -> list[Array]:
    """(k,) coefficients of each chosen candidate, as the exact model has them."""
    return [np.ones_like(c) if one.unit_amplitude else c for one, c in zip(state.chosen, state.coefficients)]


def _converged(before: State, after: State) -> bool:
    """Whether one more correction would change the rows by less than ``CONVERGED``.

    What an exact model has beyond first order grows as the square of an effect: by twice the share by which the last
    correction moved what the effects explain.
    """
    rows, side = np.sqrt(after.data.fit.rows), after.data.fit
    sizes = _first_order(before), _first_order(after)
    moved, explained = np.zeros(len(side.y)), np.zeros(len(side.y))
    for c, was, now in zip(after.chosen, *sizes):
        columns = after.model.columns(c).fit
        moved[columns.where] += columns.x @ (now - was)
        explained[columns.where] += columns.x @ now
    beyond = np.linalg.norm(side.y - before.data.fit.y)
    return bool(2.0 * beyond * np.linalg.norm(moved) < CONVERGED * rows * np.linalg.norm(explained))


def _exact(
    data: Dataset, columns: Sequence[Columns], first_order: Sequence[Array], extended: Sequence[EffectTerm]
) -> Dataset:
    y = dataset_with(data, extended)
    for part, c in zip(columns, first_order):
        y[part.where] += part.x @ c
    return replace(data, y=y, corrected=data.by_joint((y - data.y) ** 2))
