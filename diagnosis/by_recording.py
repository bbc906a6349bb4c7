"""Causes whose values differ between recordings: a load mounted differently, a transducer set to another gain.

A property of an arm is the same in every recording. Where the causes that serve all of them leave structure, or their
values by single recordings contradict each other, each ``settable`` effect is tried with a value per recording. It is
named so if, with it, nothing is left but noise and no recording contradicts another.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arm_io import InputError
from arm_io.types import Array
from arm_model import EffectTerm
from arm_model.effects import Instrument
from diagnosis.against_noise import ratios
from diagnosis.cause import Cause, Estimate, confidence_of
from diagnosis.measurements.currents.model import State
from diagnosis.measurements.currents.possible import exists
from diagnosis.measurements.link_encoders.by_recording import CHANCE, SAME, Alone, chance_of
from diagnosis.residual.comparable_rows import comparable_rows
from diagnosis.residual.run import Run, with_own
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.design import Pair
from diagnosis.selection.estimates import estimates
from identification.selection import p_value, scaled_lstsq
from identification.selection.cluster_covariance import cluster_covariance

MATTERS = 0.1
"""Share of the noise energy of a joint's rows by which own values must explain more than one value for all."""
CORRECTIONS = 2
"""Evaluations of the exact model per recording."""
EQUAL = 0.02
"""Relative difference of gains below which the one with fewer coefficients is tried first."""
IMPOSSIBLE = 2.0
"""std by which a load of one recording must be negative to be none."""
QUIET = 1.5
"""Times the noise that may remain at a joint: values per recording also follow what no effect explains, in part."""
INDEPENDENT = 1e-3
"""Relative singular value below which columns of one recording are dependent."""


@dataclass(frozen=True, kw_only=True)
class OwnValues:
    """One cause with values per recording, fitted recordings first.

    terms     as effects of a model; alone: coefficients of its columns, with covariance
    parameters  with std
    gains     (blocks,) fall of the whitened squared residual of every block, by coefficients from its neighbours
    """

    candidate: Candidate
    terms: tuple[EffectTerm, ...]
    alone: tuple[Alone, ...]
    parameters: tuple[list[Estimate], ...]
    gains: Array

    @property
    def contradict(self) -> bool:
        """Whether one value cannot serve all recordings."""
        return chance_of(self.alone, slice(0, len(self.alone[0].values))) < CHANCE


def contradicted(state: State) -> Candidate | None:
    """The chosen candidate whose values by single recordings contradict each other most; None where all agree."""
    chosen, runs = state.chosen, _runs(state)
    if not chosen or len(runs) < 2 or state.data.two_fold:
        return None
    columns = _of_runs([*(state.model.columns(c) for c in chosen), *state.model.free], state)
    largest = np.concatenate([[c.largest(k) for k in range(len(own))] for c, own in zip(chosen, state.coefficients)])
    unknown = np.concatenate([largest, np.zeros(columns[0].shape[1] - len(largest))])
    seen = [_alone(run, x, y, unknown) for run, x, y in zip(runs, columns, _residuals(state))]
    chances, first = dict[Candidate, float](), 0
    for c, own in zip(chosen, state.coefficients):
        chances[c] = chance_of(seen, slice(first, first + len(own)))
        first += len(own)
    worst = min(chances, key=lambda c: chances[c])
    return worst if chances[worst] < CHANCE / len(chosen) else None


def promising(state: State, most: int = 2) -> list[OwnValues]:
    """Settable effects that explain most by values of their own, where one value for all explains much less.

    Conditional on nothing else: another cause may have been chosen for what the recordings differ in. Whether the
    values contradict each other shows when nothing else is missing.
    """
    if state.model.data.two_fold:
        return []
    found, rows = [], sum(part.rows for part in state.model.data)
    for c, pair in list(state.model.library.items()):
        if not c.definition.settable or c.key in state.model.excluded:
            continue
        own = own_values(c, pair, state)
        more = own.gains.sum() - _common_gain(pair, state)
        if more > MATTERS * rows and exists_in_all(own, state):
            found.append(own)
    best = max((float(own.gains.sum()) for own in found), default=0.0)

    def rank(own: OwnValues) -> tuple[int, float]:
        gain = float(own.gains.sum())
        return (0, len(own.alone[0].values)) if gain > (1 - EQUAL) * best else (1, -gain)

    return sorted(found, key=rank)[:most]


def quiet(state: State) -> bool:
    """Whether no joint has more than ``QUIET`` times the noise left, in fitted and in held-out recordings."""
    sides = ((state.data.fit, state.fitted.fit), (state.data.held_out, state.fitted.held_out))
    return all(one.ratio <= QUIET for side, left in sides for one in ratios(side.runs, left))


def exists_in_all(own: OwnValues, state: State) -> bool:
    """Whether an arm can be described with the values of every recording, and no load is negative."""
    masses = [p for values in own.parameters for p in values if p.name == "mass"]
    possible = all(p.value > -IMPOSSIBLE * p.std for p in masses)
    return possible and all(exists(state.model.arm, [term]) for term in own.terms)


def own_values(c: Candidate, pair: Pair, state: State, others: Sequence[EffectTerm] = ()) -> OwnValues:
    """A candidate with a value per recording, with ``others`` in the arm."""
    unknown = np.array([c.largest(k) for k in range(pair.fit.x.shape[1])])
    joint = state.model.arm.joints[c.joint - 1] if c.joint else None
    terms, alone, parameters, gains = [], [], [], []
    for run, x in zip(_runs(state), _of_runs([pair], state)):
        y = without = _flat(with_own(run, others))
        for _ in range(CORRECTIONS):
            values = scaled_lstsq(x, y, INDEPENDENT)
            try:
                y = _flat(with_own(run, (*others, _term(c, values)))) + x @ values
            except InputError:
                break
        one = _alone(run, x, y, unknown)
        alone.append(one)
        terms.append(_term(c, one.values))
        parameters.append(estimates(c, one.values.tolist(), one.covariance, joint))
        gains.append(_predicted_gains(x, y, without, np.tile(run.block, run.q.shape[1])))
    return OwnValues(
        candidate=c,
        terms=tuple(terms),
        alone=tuple(alone),
        parameters=tuple(parameters),
        gains=np.concatenate(gains),
    )


def cause_of(own: OwnValues, state: State, others: Sequence[EffectTerm]) -> Cause:
    """The cause with its values per recording; it is of the recordings, not of the arm.

    Its parameters are the mean of the recordings, with their scatter as std.
    """
    c, held_out = own.candidate, len(state.data.fit.runs)
    runs = _runs(state)[held_out:]
    rms = []
    for extra in ([()] * len(runs), [(term,) for term in own.terms[held_out:]]):
        several = [with_own(run, (*others, *more)) for run, more in zip(runs, extra)]
        squares = np.concatenate([np.where(comparable_rows(run), run.residual, np.nan) ** 2 for run in several])
        rms.append(np.sqrt(np.nan_to_num(np.nanmean(squares, axis=0))))
    noise = np.mean([run.noise for run in runs], axis=0)
    joint = c.joint or int(np.argmax((rms[0] ** 2 - rms[1] ** 2) / noise**2)) + 1
    unit = state.model.arm.joints[joint - 1].command_unit
    before, after = (float(one[joint - 1]) for one in rms)
    mean = [
        Estimate(several[0].name, float(np.mean(values)), float(np.std(values)), several[0].unit)
        for several in zip(*own.parameters)
        for values in [[p.value for p in several]]
    ]
    aliases = (*c.definition.aliases, *c.definition.observed_by[Instrument.CURRENT].aliases)
    return Cause(
        effect=c.effect,
        joint=c.joint,
        parameters=mean,
        confidence=confidence_of(p_value(own.gains)),
        before=before,
        after=after,
        group=(c.key, *dict.fromkeys((name, c.joint) for name in aliases if name != c.effect)),
        evidence=f"{c.definition.shows}, differently in each recording: with values of their own, the held-out current "
        f"error of joint {joint} falls from {before:.3g} to {after:.3g} {unit} rms; no one value serves them all",
        felt_at=joint,
        unit=unit,
        of_arm=False,
        of_recordings={run.name: values for run, values in zip(_runs(state), own.parameters)},
    )


def _runs(state: State) -> list[Run]:
    """Every recording without values of its own, the fitted ones first."""
    return [with_own(run, ()) for part in state.data for run in part.runs]


def _term(c: Candidate, values: Array) -> EffectTerm:
    return EffectTerm(c.effect, c.joint, c.parameters(values.tolist()))


def _flat(run: Run) -> Array:
    """(n * rows,) whitened residual, joint after joint."""
    return np.asarray(run.whitened.T.ravel())


def _of_runs(pairs: Sequence[Pair], state: State) -> list[Array]:
    """(n * rows, k) columns of each recording, the fitted ones first."""
    found = []
    for part, columns in zip(state.model.data, zip(*pairs)):
        whole = np.hstack([own.dense(len(part.y)) for own in columns]).reshape(-1, part.rows, _width(pairs))
        ends = np.cumsum([len(run.t) for run in part.runs])[:-1]
        found += [rows.reshape(-1, rows.shape[2]) for rows in np.split(whole, ends, axis=1)]
    return found


def _width(pairs: Sequence[Pair]) -> int:
    return sum(pair.fit.x.shape[1] for pair in pairs)


def _residuals(state: State) -> list[Array]:
    """(n * rows,) of each recording: its residual as the chosen are fitted to it."""
    found = []
    for part in state.data:
        ends = np.cumsum([len(run.t) for run in part.runs])[:-1]
        found += [rows.ravel() for rows in np.split(part.y.reshape(-1, part.rows), ends, axis=1)]
    return found


def _alone(run: Run, x: Array, y: Array, unknown: Array) -> Alone:
    """Coefficients by one recording; ``unknown`` (k,): std of those that it says nothing of."""
    values = scaled_lstsq(x, y, INDEPENDENT)
    block = np.tile(run.block, run.q.shape[1])
    covariance = cluster_covariance(x, [y - x @ values], block, independent=INDEPENDENT, unknown=unknown)
    return Alone(run.name, values, covariance + np.diag((SAME * values) ** 2))


def _predicted_gains(x: Array, y: Array, without: Array, block: NDArray[np.intp]) -> Array:
    """(blocks,) fall of the squared residual ``without`` in every second block by coefficients from the others."""
    gains = np.zeros(int(block.max()) + 1)
    for fold in (0, 1):
        here = block % 2 == fold
        left = y[here] - x[here] @ scaled_lstsq(x[~here], y[~here], INDEPENDENT)
        gains += np.bincount(block[here], without[here] ** 2 - left**2, len(gains))
    return gains


def _common_gain(pair: Pair, state: State) -> float:
    """Fall of the squared residual of all recordings by one value for all."""
    x, y = np.concatenate(_of_runs([pair], state)), np.concatenate([_flat(run) for run in _runs(state)])
    return float(np.sum(y**2) - np.sum((y - x @ scaled_lstsq(x, y, INDEPENDENT)) ** 2))
