"""Recordings of two sides -> changes of the arm: one regression each, the same columns for all, and the difference."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from arm_io import InputError
from arm_io.types import Array, Progress
from arm_model import Arm
from comparison.change import Change, Estimate, Quantity
from comparison.circumstances import circumstances, warmer
from comparison.current_limits import limit_changes
from comparison.friction_drift import assumed, friction_drift
from comparison.joint_fit.delays import delay_between, put_back
from comparison.joint_fit.effect_columns import EffectColumns
from comparison.joint_fit.encoder_noise import without_noise
from comparison.joint_fit.fewest_changes import AcceptedChange, fewest_changes
from comparison.joint_fit.search import Recorded, first_fit
from comparison.outcome import Comparison
from comparison.quantities import friction_maps, values_quantities
from comparison.regression import Fitted, Structure
from comparison.separate_regressions import SeparateRegressions, regressions_of, separate_regressions
from comparison.significance import changes
from comparison.summaries import summaries
from daq.recording import Recording
from daq.recording.shared_rows import overlaps
from diagnosis.residual.run_setup import setup_of
from identification import without_rotors
from identification.preprocessing.signals import Motion
from identification.regression.problem import motions_of
from identification.ripples import wide


def compare_recordings(
    before: Sequence[Recording], after: Sequence[Recording], arm: Arm, *, progress: Progress = lambda _: None
) -> Comparison:
    """What changed in ``arm`` between the recordings of two sides.

    InputError where a recording is on both sides, cannot be identified, or was made with the drives off, or where all
    are too short.
    """
    recordings = [*before, *after]
    _check(before, after)
    motions, _, runs = motions_of(recordings, [], arm, progress)
    is_before = np.array([True] * len(before) + [False] * len(after))
    separate = separate_regressions(arm, recordings, motions, is_before, progress)
    drift = friction_drift(separate.structure, separate.mean_values(), warmer(recordings, is_before, len(arm)))
    joint = _in_joint_band(separate, recordings, motions, drift, progress)
    progress("delay of the currents")
    first = first_fit(joint)
    if delay := delay_between(joint, first):
        motions = put_back(motions, is_before, delay)
        separate = separate_regressions(arm, recordings, motions, is_before, progress)
        joint = replace(_in_joint_band(separate, recordings, motions, drift, progress), delay=delay)
        first = first_fit(joint)
    progress("changes")
    alone = _separate_changes(separate, drift)
    progress("the fewest changes")
    decided, added, accepted = fewest_changes(joint, first, alone)
    return Comparison(
        what="recordings",
        arm=arm,
        before=tuple(str(recording.path) for recording in before),
        after=tuple(str(recording.path) for recording in after),
        changes=[*decided, *added, *limit_changes(before, after, arm)],
        circumstances=circumstances(recordings, motions, is_before, arm),
        summaries=summaries(separate.structure, *separate.long_enough(), _as_decided(alone, decided), accepted, added),
        alternatives=list(_alternatives(accepted)),
        assumptions=[assumed(len(recordings))],
        warnings=[
            *_short_recordings(separate),
            *(warning for run in runs for warning in run.warnings),
            *filter(None, [without_rotors(arm)]),
        ],
    )


def _as_decided(alone: Sequence[Change], decided: Sequence[Change]) -> list[Change]:
    """Each with the value and the deviation of the regressions of single recordings, whose correlations are known."""
    return [replace(one, corrected=other.corrected) for one, other in zip(alone, decided)]


def _check(before: Sequence[Recording], after: Sequence[Recording]) -> None:
    every = [*before, *after]
    for pair in overlaps(every):
        one, other = every[pair.one].path, every[pair.other].path
        rows = f"{pair.share:.0%} of its rows are in {one}"
        if pair.one < len(before) <= pair.other:
            raise InputError(other, f"{rows}; before and after must be two recordings")
        raise InputError(other, f"{rows}, which is on the same side; give each recording once")
    for recording in [*before, *after]:
        if setup_of(recording).drives_off:
            raise InputError(recording.path, "was recorded with the drives off; must be a recording of driven motion")


def _separate_changes(separate: SeparateRegressions, drift: Array) -> list[Change]:
    """Change of every compared quantity by the regressions of single recordings.

    drift: (c, d) as of ``friction_drift``.
    """
    quantities, maps = _quantities(separate)
    estimates = [_estimate(name, fitted, maps) for name, fitted in zip(separate.names, separate.fits)]
    drifted = np.linalg.norm(np.nan_to_num(maps) @ drift, axis=1)
    leaked = _leaked(separate.structure, *separate.long_enough(), maps)
    return changes(
        _of_short_sides(quantities, separate),
        [estimate for estimate, first in zip(estimates, separate.is_before) if first],
        [estimate for estimate, first in zip(estimates, separate.is_before) if not first],
        np.hypot(leaked, drifted),
    )


def _in_joint_band(
    separate: SeparateRegressions,
    recordings: Sequence[Recording],
    motions: Sequence[Motion],
    drift: Array,
    progress: Progress,
) -> Recorded:
    """The recordings in the wider band of the joint regression, and the regression of each alone in that band."""
    band = [wide(motion) for motion in motions]
    clean = [without_noise(motion, separate.structure.arm) for motion in band]
    one = regressions_of(separate.structure, recordings, clean, motions, separate.is_before, progress)
    columns = [EffectColumns(one.structure.arm, motion) for motion in band]
    return Recorded(one.structure, clean, one.rows, one.fits, columns, one.is_before, drift)


def _alternatives(accepted: Sequence[AcceptedChange]) -> Iterator[str]:
    """Per accepted change, what explains the recordings as well in its place."""
    for one in accepted:
        # a body, and a mass at a point of the same link, are named alike
        words = one.tested.hypothesis.words
        if rivals := dict.fromkeys(rival.words for rival in one.rivals if rival.words != words):
            yield f"{words} from {', '.join(rivals)}"


def _short_recordings(separate: SeparateRegressions) -> Iterator[str]:
    """A warning per recording that is too short to be judged alone."""
    for name, why in zip(separate.names, separate.too_short):
        if why:
            yield f"{name} {why}; its rows count in the fit of all recordings only"


def _of_short_sides(quantities: Sequence[Quantity], separate: SeparateRegressions) -> list[Quantity]:
    """The quantities with the reason where a side has no recording that is long enough."""
    for side in (True, False):
        mine = [
            (name, why)
            for name, why, first in zip(separate.names, separate.too_short, separate.is_before)
            if first == side
        ]
        if all(why for _, why in mine):
            return [quantity.not_comparable(f"{mine[0][0]} {mine[0][1]}") for quantity in quantities]
    return list(quantities)


def _quantities(separate: SeparateRegressions) -> tuple[list[Quantity], Array]:
    """What is compared, friction of the joints first, and (r, c) how it follows from the values."""
    structure, shown, is_before = separate.structure, separate.shown, separate.is_before
    comparable = np.asarray(shown[is_before].any(axis=0) & shown[~is_before].any(axis=0), bool)
    variance = np.zeros(shown.shape[1])
    parts = np.array([np.where(seen, np.diag(f.covariance), np.inf) for f, seen in zip(separate.fits, shown)])
    for side in (is_before, ~is_before):
        with np.errstate(divide="ignore"):
            variance += 1 / np.sum(1 / parts[side], axis=0)
    variance[~comparable] = np.nan
    friction, maps = friction_maps(structure, variance)
    values = []
    for k, quantity in enumerate(values_quantities(structure)):
        if not comparable[k]:
            blind = [name for name, seen in zip(separate.names, shown[:, k]) if not seen]
            quantity = quantity.not_comparable(f"not excited in {', '.join(blind)}")
        values.append(quantity)
    return friction + values, np.concatenate([maps, np.eye(len(comparable))])


def _estimate(name: str, fitted: Fitted, maps: Array) -> Estimate:
    """The quantities of one recording; NaN where a value that they need is not shown."""
    seen = np.isfinite(fitted.values)
    determined = ~(np.nan_to_num(maps, nan=1.0)[:, ~seen] != 0).any(axis=1) & np.isfinite(maps).all(axis=1)
    clean = np.nan_to_num(maps)
    values = np.where(determined, clean @ np.nan_to_num(fitted.values), np.nan)
    raw = np.sqrt(np.maximum(np.sum(clean @ fitted.covariance * clean, axis=1), 0.0))
    raw = np.where(determined, raw, np.nan)
    return Estimate(source=name, values=values, std=fitted.widened * raw, raw=raw, freedom=fitted.freedom)


def _leaked(structure: Structure, fits: Sequence[Fitted], is_before: NDArray[np.bool_], maps: Array) -> Array:
    """(r,) std of each change by errors of the values that one side took from the model and the other estimated.

    What both sides take from the model cancels in the difference. 0 where a side has no fit.
    """
    if is_before.all() or not is_before.any():
        return np.zeros(len(maps))
    units = [quantity.unit for quantity in values_quantities(structure)]
    leakage = np.array([fitted.leakage for fitted in fits])
    difference = np.nan_to_num(maps) @ (leakage[~is_before].mean(axis=0) - leakage[is_before].mean(axis=0))
    return np.asarray(np.linalg.norm(difference * structure.uncertain(units), axis=1))
