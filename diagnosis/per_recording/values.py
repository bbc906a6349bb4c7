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
from numpy.typing import NDArray

from arm_io import InputError
from arm_io.parallel import in_parallel
from arm_io.types import Array
from arm_model import EffectTerm
from arm_model.effects import Instrument
from diagnosis.cause import Cause, Estimate, confidence_of
from diagnosis.measurements.currents.design_matrix import columns_of
from diagnosis.measurements.currents.estimates import slow_variance_of
from diagnosis.measurements.currents.possible import exists
from diagnosis.measurements.currents.state import State
from diagnosis.measurements.currents.structure.unseen_friction import as_shown, unseen_by_joint
from diagnosis.remainder.against_noise import ratios
from diagnosis.residual.comparable_rows import comparable_rows, rms_where
from diagnosis.residual.other_effects import with_own
from diagnosis.residual.run import Run, with_free
from diagnosis.selection.candidate import RELATIVE_STEP, Candidate
from diagnosis.selection.contradiction import CHANCE, SAME, SingleEstimate, chance_of
from diagnosis.selection.design import Pair
from diagnosis.selection.estimates import estimates
from diagnosis.selection.regression import INDEPENDENT
from diagnosis.units import fall, recorded_quantity
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


def contradicted(state: State) -> Candidate | None:
    """The chosen candidate whose values by single recordings contradict each other most; None where all agree."""
    chosen, runs = state.chosen, state.all_runs
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


def promising(
    state: State, limit: int = 2, given: Sequence[Candidate] = (), others: Sequence[EffectTerm] = ()
) -> list[Candidate]:
    """Settable effects that explain most by values of their own, where one value for all explains much less.

    Conditional on values per recording of those ``given``, with ``others`` in the arm, and on nothing else: another
    cause may have been chosen for what the recordings differ in. Whether the values contradict each other shows when
    nothing else is missing.
    """
    if state.model.data.two_fold:
        return []
    rows, missed = sum(part.rows for part in state.model.data), _missed(state, others)
    taken = {*state.model.excluded, *(c.key for c in given)}
    tried = [c for c in state.model.library if c.definition.settable and c.key not in taken]

    def judged(c: Candidate) -> ValuesPerRecording | None:
        own = _values([*given, c], state, others, missed)[-1]
        more = own.gains.sum() - (0.0 if given else _common_gain(state.model.columns(c), state, missed))
        return own if more > MATTERS * rows and exists_in_all(own, state) else None

    contradicting = [own for own in in_parallel(judged, tried) if own is not None]
    best = max((float(own.gains.sum()) for own in contradicting), default=0.0)

    def rank(own: ValuesPerRecording) -> tuple[int, float]:
        gain = float(own.gains.sum())
        return (0, len(own.alone[0].values)) if gain > (1 - EQUAL) * best else (1, -gain)

    return [own.candidate for own in sorted(contradicting, key=rank)[:limit]]


def noise_alone(state: State) -> bool:
    """Whether no joint has more than ``QUIET`` times the noise left, in fitted and in held-out recordings."""
    parts = zip(state.runs, state.residual)
    return all(one.ratio <= QUIET for runs, residual in parts for one in ratios(runs, residual))


def exists_in_all(own: ValuesPerRecording, state: State) -> bool:
    """Whether the values of every recording give a possible arm, and no load is negative."""
    masses = [p for values in own.parameters for p in values if p.name == "mass"]
    possible = all(p.value > -IMPOSSIBLE * p.std for p in masses)
    return possible and all(exists(state.model.arm, [term]) for term in own.terms)


def values_per_recording(
    several: Sequence[Candidate], state: State, others: Sequence[EffectTerm] = ()
) -> list[ValuesPerRecording]:
    """Candidates with a value per recording each, fitted together, with ``others`` in the arm."""
    return _values(several, state, others, _missed(state, others))


def _missed(state: State, others: Sequence[EffectTerm]) -> list[Array]:
    """(n * rows,) whitened residual of each recording, the fitted ones first, with ``others`` in the arm."""
    return [_flat(with_own(run, others)) for run in _runs(state)]


def _values(
    several: Sequence[Candidate], state: State, others: Sequence[EffectTerm], missed: Sequence[Array]
) -> list[ValuesPerRecording]:
    """``values_per_recording``; missed: as ``_missed`` gives it."""
    pairs = [state.model.columns(c) for c in several]
    widths = [pair.fit.x.shape[1] for pair in pairs]
    places = [slice(a, b) for a, b in itertools.pairwise(np.cumsum([0, *widths]).tolist())]
    unknown = np.array([c.largest(k) for c, width in zip(several, widths) for k in range(width)])
    bends = [_bends(c, pair, state) for c, pair in zip(several, pairs)]
    found: list[list[_OfRecording]] = [[] for _ in several]
    for k, (run, x, first) in enumerate(zip(_runs(state), _of_runs(pairs, state), missed)):
        y = _corrected(run, x, first, list(zip(several, places)), others)
        together = _alone(run, x, y, unknown)
        for own, place, bend in zip(found, places, bends):
            rest = np.delete(x, place, axis=1)
            # of what was there to explain: the corrections of values that nothing has are large
            without = first - rest @ scaled_lstsq(rest, first, INDEPENDENT)
            alone = SingleEstimate(run.name, together.values[place], together.covariance[place, place])
            covariance = alone.covariance
            if bend:
                slopes = np.column_stack([by[k] @ alone.values for _, by in bend])
                wider = _alone(run, np.hstack([x, slopes]), y, np.append(unknown, [value for value, _ in bend]))
                those = [*range(x.shape[1])[place], *range(x.shape[1], x.shape[1] + len(bend))]
                covariance = wider.covariance[np.ix_(those, those)]
            gains = _predicted_gains(x, y, without, np.tile(run.block, run.q.shape[1]))
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
    for _ in range(CORRECTIONS):
        values = scaled_lstsq(x, y, INDEPENDENT)
        terms = [_term(c, values[place]) for c, place in several]
        try:
            y = _flat(with_own(run, (*others, *terms))) + x @ values
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
        both = zip(_of_runs([moved], state), _of_runs([pair], state))
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


def cause_of(
    own: ValuesPerRecording, every: Sequence[ValuesPerRecording], state: State, others: Sequence[EffectTerm]
) -> Cause:
    """The cause with its values per recording; it is not in the extended model.

    Its parameters are the mean of the recordings, with their scatter as std, or with that of the recording that
    determines it best where they scatter less: a nonlinear parameter does not scatter, since one value serves all
    recordings. every: all that have such values; others: the causes of the arm.
    """
    c, held_out = own.candidate, len(state.data.fit.runs)
    runs, rms = _runs(state)[held_out:], []
    for having in ([one for one in every if one is not own], every):
        extra = [[one.terms[held_out + k] for one in having] for k in range(len(runs))]
        several = [with_own(run, (*others, *more)) for run, more in zip(runs, extra)]
        left, rows = (np.concatenate(of) for of in zip(*((run.residual, comparable_rows(run)) for run in several)))
        rms.append(rms_where(left, rows))
    noise = np.mean([run.noise for run in runs], axis=0)
    joint = c.joint or int(np.argmax((rms[0] ** 2 - rms[1] ** 2) / noise**2)) + 1
    unit = state.model.arm.joints[joint - 1].command_unit
    before, after = (float(one[joint - 1]) for one in rms)
    mean = [_mean(several) for several in zip(*own.parameters)]
    aliases = (*c.definition.aliases, *c.definition.observed_by[Instrument.CURRENT].aliases)
    return Cause(
        effect=c.effect,
        joint=c.joint,
        parameters=mean,
        confidence=confidence_of(p_value(own.gains)),
        before=before,
        after=after,
        group=(c.key, *dict.fromkeys((name, c.joint) for name in aliases if name != c.effect)),
        evidence=f"{c.definition.shows}, differently in each recording: with one value per recording, the held-out "
        f"{recorded_quantity(state.model.arm.joints[joint - 1])} error of joint {joint} falls "
        f"{fall(before, after, unit)}; no single value fits all recordings",
        felt_at=joint,
        unit=unit,
        of_arm=False,
        of_recordings={run.name: values for run, values in zip(_runs(state), own.parameters)},
    )


def _mean(several: Sequence[Estimate]) -> Estimate:
    """Mean of one parameter over recordings, with its std."""
    values, stds = np.array([(p.value, p.std) for p in several]).T
    std = max(float(np.std(values)), float(np.min(stds)))
    return Estimate(several[0].name, float(np.mean(values)), std, several[0].unit)


def _runs(state: State) -> list[Run]:
    """Every recording without its own values of causes, the fitted ones first."""
    return [with_own(with_free(run, None), ()) for run in state.all_runs]


def _term(c: Candidate, values: Array) -> EffectTerm:
    return EffectTerm(c.effect, c.joint, c.parameters(values.tolist()))


def _flat(run: Run) -> Array:
    """(n * rows,) whitened residual, joint after joint."""
    return np.asarray(run.whitened.T.ravel())


def _of_runs(pairs: Sequence[Pair], state: State) -> list[Array]:
    """(n * rows, k) columns of each recording, the fitted ones first."""
    parts = []
    for part, columns in zip(state.model.data, zip(*pairs)):
        every = np.hstack([own.dense(len(part.y)) for own in columns])
        by_joint = every.reshape(-1, part.rows, every.shape[1])
        parts += [rows.reshape(-1, every.shape[1]) for rows in part.split(by_joint, axis=1)]
    return parts


def _residuals(state: State) -> list[Array]:
    """(n * rows,) of each recording: its residual as the chosen are fitted to it."""
    return [rows.T.ravel() for part in state.data for rows in part.by_recording(part.y)]


def _alone(run: Run, x: Array, y: Array, unknown: Array) -> SingleEstimate:
    """Coefficients by one recording; ``unknown`` (k,): std of those that it says nothing of.

    Where a joint stands, what friction does is one unknown for as long as it stands: its rows are no evidence each.
    Where it creeps, how friction turns round is one unknown of the joint (``unseen_friction``).
    """
    moves = comparable_rows(run)
    rows = moves.T.ravel()
    x, y = np.where(rows[:, None], x, 0.0), np.where(rows, y, 0.0)
    values = scaled_lstsq(x, y, INDEPENDENT)
    residual = y - x @ values
    covariance = cluster_covariance(
        x,
        [residual],
        np.tile(run.block, run.q.shape[1]),
        independent=INDEPENDENT,
        unknown=unknown,
        variance=slow_variance_of([residual.reshape(moves.T.shape).T], [run], [moves]),
    )
    at_rest = scaled_lstsq(x, as_shown(unseen_by_joint([run]), residual), INDEPENDENT)
    return SingleEstimate(run.name, values, covariance + at_rest @ at_rest.T + np.diag((SAME * values) ** 2))


def _predicted_gains(x: Array, y: Array, without: Array, block: NDArray[np.intp]) -> Array:
    """(blocks,) fall of the squared residual ``without`` in every second block by coefficients from the others."""
    gains = np.zeros(int(block.max()) + 1)
    for fold in (0, 1):
        in_fold = block % 2 == fold
        residual = y[in_fold] - x[in_fold] @ scaled_lstsq(x[~in_fold], y[~in_fold], INDEPENDENT)
        gains += np.bincount(block[in_fold], without[in_fold] ** 2 - residual**2, len(gains))
    return gains


def _common_gain(pair: Pair, state: State, missed: Sequence[Array]) -> float:
    """Fall of the squared residual of all recordings, ``missed``, by one value for all."""
    x, y = np.concatenate(_of_runs([pair], state)), np.concatenate(missed)
    return float(np.sum(y**2) - np.sum((y - x @ scaled_lstsq(x, y, INDEPENDENT)) ** 2))
