"""Causes whose values differ between recordings: a load mounted differently, friction of a warmer day.

A property of an arm is the same in every recording. What each recording alone says of a cause shows whether one value
serves them all; ``search`` beside it finds them.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from arm_io import InputError
from arm_io.types import Array
from arm_model import EffectTerm
from diagnosis.cause import Estimate
from diagnosis.measurements.currents.design_matrix import columns_of
from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.measurements.currents.state import State
from diagnosis.per_recording.single_recordings import (
    columns_of_recordings,
    estimated_alone,
    predicted_gains,
    runs_of,
    whitened_of,
)
from diagnosis.residual.other_effects import with_own
from diagnosis.residual.run import Run
from diagnosis.selection.candidate import RELATIVE_STEP, Candidate
from diagnosis.selection.contradiction import CHANCE, SingleEstimate, chance_of
from diagnosis.selection.design import Pair
from diagnosis.selection.estimates import estimates
from diagnosis.selection.regression import INDEPENDENT
from identification.selection import scaled_lstsq


@dataclass(frozen=True, kw_only=True)
class ValuesPerRecording:
    """One cause with values per recording, fitted recordings first.

    terms     as effects of a model; alone: coefficients of its columns, with covariance
    parameters  with std
    gains     (blocks,) fall of the whitened squared residual of every block, by coefficients from its neighbours
    """

    candidate: Candidate
    terms: tuple[EffectTerm, ...]
    alone: tuple[SingleEstimate, ...]
    parameters: tuple[list[Estimate], ...]
    gains: Array

    @property
    def contradict(self) -> bool:
        """Whether the values of the recordings differ significantly."""
        return chance_of(self.alone, slice(0, len(self.alone[0].values))) < CHANCE


def values_per_recording(
    several: Sequence[Candidate], state: State, others: Sequence[EffectTerm] = ()
) -> list[ValuesPerRecording]:
    """Candidates with a value per recording each, fitted together, with ``others`` in the arm."""
    return fitted_values(several, state, others, residuals_with(state, others))


def residuals_with(state: State, others: Sequence[EffectTerm]) -> list[Array]:
    """(n * rows,) whitened residual of each recording, the fitted ones first, with ``others`` in the arm."""
    return [whitened_of(with_own(run, others)) for run in runs_of(state)]


def fitted_values(
    several: Sequence[Candidate], state: State, others: Sequence[EffectTerm], missed: Sequence[Array]
) -> list[ValuesPerRecording]:
    """``values_per_recording``; missed: as ``residuals_with`` gives it."""
    pairs = [state.model.columns(c) for c in several]
    widths = [pair.fit.x.shape[1] for pair in pairs]
    places = [slice(a, b) for a, b in itertools.pairwise(np.cumsum([0, *widths]).tolist())]
    unknown = np.array([c.largest(k) for c, width in zip(several, widths) for k in range(width)])
    bends = [_bends(c, pair, state) for c, pair in zip(several, pairs)]
    found: list[list[_OfRecording]] = [[] for _ in several]
    for k, (run, x, first) in enumerate(zip(runs_of(state), columns_of_recordings(pairs, state), missed)):
        y = _corrected(run, x, first, list(zip(several, places)), others)
        together = estimated_alone(run, x, y, unknown)
        for own, place, bend in zip(found, places, bends):
            rest = np.delete(x, place, axis=1)
            # of what was there to explain: the corrections of values that nothing has are large
            without = first - rest @ scaled_lstsq(rest, first, INDEPENDENT)
            alone = SingleEstimate(run.name, together.values[place], together.covariance[place, place])
            covariance = alone.covariance
            if bend:
                slopes = np.column_stack([by[k] @ alone.values for _, by in bend])
                wider = estimated_alone(
                    run, np.hstack([x, slopes]), y, np.append(unknown, [value for value, _ in bend])
                )
                those = [*range(x.shape[1])[place], *range(x.shape[1], x.shape[1] + len(bend))]
                covariance = wider.covariance[np.ix_(those, those)]
            gains = predicted_gains(x, y, without, np.tile(run.block, run.q.shape[1]))
            own.append(_OfRecording(alone, covariance, gains))
    return [_values_of(c, own, state) for c, own in zip(several, found)]


def _corrected(
    run: Run, x: Array, missed: Array, several: Sequence[tuple[Candidate, slice]], others: Sequence[EffectTerm]
) -> Array:
    """(n * rows,) of one recording: residual of the exact model with its values, plus first-order columns x times them.

    As ``diagnosis.measurements.currents.state`` corrects. missed (n * rows,): residual with ``others`` alone; several:
    candidates with the places of their columns in x. Values of which there is no arm correct nothing.
    """
    y = missed
    for _ in range(LIMITS.corrections):
        values = scaled_lstsq(x, y, INDEPENDENT)
        terms = [_term(c, values[place]) for c, place in several]
        try:
            y = whitened_of(with_own(run, (*others, *terms))) + x @ values
        except InputError:
            break
    return y


@dataclass(frozen=True)
class _OfRecording:
    """covariance: of the coefficients, then of the nonlinear parameters, whose one value serves all recordings."""

    alone: SingleEstimate
    covariance: Array
    gains: Array


def _bends(c: Candidate, pair: Pair, state: State) -> list[tuple[float, list[Array]]]:
    """Each nonlinear parameter of a candidate, with the change (n * rows, k) of its columns per unit of the parameter.

    One array per recording, the fitted ones first.
    """
    found = []
    for name in c.searched():
        value = dict(c.shape)[name]
        other = c.at(name, (1.0 + RELATIVE_STEP) * value)
        moved = state.model.data.map(partial(columns_of, other))
        both = zip(columns_of_recordings([moved], state), columns_of_recordings([pair], state))
        found.append((value, [(after - before) / (RELATIVE_STEP * value) for after, before in both]))
    return found


def _values_of(c: Candidate, of_recordings: Sequence[_OfRecording], state: State) -> ValuesPerRecording:
    joint = state.model.arm.joints[c.joint - 1] if c.joint else None
    alone = tuple(one.alone for one in of_recordings)
    return ValuesPerRecording(
        candidate=c,
        terms=tuple(_term(c, one.values) for one in alone),
        alone=alone,
        parameters=tuple(estimates(c, one.alone.values.tolist(), one.covariance, joint) for one in of_recordings),
        gains=np.concatenate([one.gains for one in of_recordings]),
    )


def _term(c: Candidate, values: Array) -> EffectTerm:
    return EffectTerm(c.effect, c.joint, c.parameters(values.tolist()))
