"""Recordings of two sides -> changes of the arm: one regression each, the same columns for all, and the difference."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from arm_io import InputError
from arm_io.progress import Step
from arm_io.types import Array, Progress
from arm_model import Arm
from comparison.change import Change, Estimate, Quantity
from comparison.circumstances import circumstances, warmer
from comparison.current_limits import limit_changes
from comparison.friction_drift import assumed, friction_drift
from comparison.joint_fit.fewest import Recorded, with_fewest
from comparison.outcome import Comparison
from comparison.quantities import friction_maps, values_quantities
from comparison.regression import Fitted, Rows, Structure, fit, rows_of, shown_by, structure_of, unfitted
from comparison.significance import changes
from comparison.summary import summaries
from daq.recording import Recording
from daq.recording.shared_rows import overlaps
from diagnosis.residual.run_setup import set_up, setup_of
from identification.preprocessing.signals import Motion
from identification.regression.base_parameters import structural_base
from identification.regression.problem import motions_of
from identification.ripples import wide

ROWS_PER_VALUE = 2
"""Rows of a regression per value that it asks for, at least."""


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
    names = [recording.path.name for recording in recordings]
    side = np.array([True] * len(before) + [False] * len(after))
    structure, fits, shown, short = _alone(arm, recordings, motions, side, progress)
    quantities, maps = _quantities(structure, fits, shown, side, names)
    quantities = _of_short_sides(quantities, names, short, side)
    progress("changes")
    estimates = [_estimate(name, each, maps) for name, each in zip(names, fits)]
    drift = friction_drift(structure, _mean_values(fits), warmer(recordings, side, len(arm)))
    alone = changes(
        quantities,
        [one for one, mine in zip(estimates, side) if mine],
        [one for one, mine in zip(estimates, side) if not mine],
        np.hypot(
            _leaked(structure, *_long(fits, side, short), maps), np.linalg.norm(np.nan_to_num(maps) @ drift, axis=1)
        ),
    )
    band = [wide(motion) for motion in motions]
    in_band, _, rows, _ = _fits(structure, recordings, band, motions, progress)
    progress("the fewest changes")
    decided, added, found = with_fewest(Recorded(structure, band, rows, in_band, side, drift), alone)
    return Comparison(
        what="recordings",
        arm=arm,
        before=tuple(str(recording.path) for recording in before),
        after=tuple(str(recording.path) for recording in after),
        changes=[*decided, *added, *limit_changes(before, after, arm)],
        circumstances=circumstances(recordings, motions, side, arm),
        summaries=summaries(structure, *_long(fits, side, short), _as_decided(alone, decided), found, added),
        alternatives=[
            f"{one.tested.hypothesis.words}: these recordings are explained as well by {rivals}"
            for one in found
            if (rivals := ", or by ".join(each.words for each in one.rivals))
        ],
        assumptions=[assumed(len(recordings))],
        warnings=[
            *(
                f"{name} {why}; its rows count in the fit of all recordings only"
                for name, why in zip(names, short)
                if why
            ),
            *(warning for run in runs for warning in run.warnings),
        ],
    )


def _alone(
    arm: Arm,
    recordings: Sequence[Recording],
    motions: Sequence[Motion],
    side: NDArray[np.bool_],
    progress: Progress,
) -> tuple[Structure, list[Fitted], NDArray[np.bool_], list[str]]:
    """What is compared, and the regressions of single recordings, as of ``_fits``.

    Where both sides have recordings that are long enough, what these show of friction is compared.
    """
    base = structural_base(arm, "asymmetric")
    names = [recording.path.name for recording in recordings]
    structure = structure_of(arm, base, motions, names, side)
    fits, shown, _, short = _fits(structure, recordings, motions, motions, progress)
    long = [k for k, why in enumerate(short) if not why]
    if any(short) and side[long].any() and not side[long].all():
        structure = structure_of(arm, base, [motions[k] for k in long], [names[k] for k in long], side[long])
        fits, shown, _, short = _fits(structure, recordings, motions, motions, progress)
    return structure, fits, shown, short


def _mean_values(fits: Sequence[Fitted]) -> Array:
    """(c,) of all recordings that show them; NaN where none does."""
    values = np.array([one.values for one in fits])
    seen = np.isfinite(values)
    total = np.where(seen, values, 0.0).sum(axis=0)
    return np.where(seen.any(axis=0), total / np.maximum(seen.sum(axis=0), 1), np.nan)


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


def _fits(
    structure: Structure,
    recordings: Sequence[Recording],
    motions: Sequence[Motion],
    whole: Sequence[Motion],
    progress: Progress,
) -> tuple[list[Fitted], NDArray[np.bool_], list[Rows], list[str]]:
    """One fit per recording, (recordings, c) what each shows, its rows, and why it is too short ("": it is not).

    One that is too short shows nothing alone. InputError where all are; ``whole`` as of ``rows_of``.
    """
    data: list[Rows] = []
    seen: list[NDArray[np.bool_]] = []
    short: list[str] = []
    for recording, motion, of_all in zip(recordings, motions, whole):
        progress(Step("equations", len(data), len(recordings), detail=recording.path.name))
        rows, mine, why = _enough_rows(structure, recording, motion, of_all)
        data.append(rows)
        seen.append(mine)
        short.append(why)
    if all(short):
        raise InputError(recordings[0].path, short[0])
    model = structure.model()
    fits: list[Fitted | None] = []
    for recording, rows, mine, why in zip(recordings, data, seen, short):
        progress(Step("regression", len(fits), len(recordings), detail=recording.path.name))
        fits.append(None if why else fit(rows, mine, model, len(structure.arm)))
    block = max(one.block for one in fits if one is not None)
    filled = [unfitted(rows, structure, block) if one is None else one for one, rows in zip(fits, data)]
    return filled, np.array(seen), data, short


def _enough_rows(
    structure: Structure, recording: Recording, motion: Motion, whole: Motion
) -> tuple[Rows, NDArray[np.bool_], str]:
    """The rows of a recording, (c,) what they show, and why it is too short to judge alone; "" where it is not.

    Rows come at 2.5 times the band of the motion. Of a slow one, with rests, they may be fewer than deviations need: it
    is then taken in the band of the joint fit, if it shows friction as the others do.
    """
    carrying = set_up(structure.arm, recording)
    rows = rows_of(structure, motion, carrying, whole)
    shown = shown_by(rows, structure)
    least = ROWS_PER_VALUE * (int(shown.sum()) + rows.own.shape[1])
    if len(rows.y) >= least:
        return rows, shown, ""
    more = rows_of(structure, wide(whole), carrying, whole)
    shown_more = shown_by(more, structure)
    friction = shown_more[len(structure.rows) : len(structure.rows) + len(structure.points)]
    if friction.any() and len(more.y) >= ROWS_PER_VALUE * (int(shown_more.sum()) + more.own.shape[1]):
        return more, shown_more, ""
    length = float(whole.t[-1] - whole.t[0])
    lacking = np.ceil(length * (least / max(len(rows.y), 1) - 1.0))
    why = (
        f"is too short to judge alone: at least {lacking:.0f} s more of such motion are needed (it has {length:.2g} s, "
        f"which leave {len(rows.y)} rows for {least // ROWS_PER_VALUE} parameters)"
    )
    return rows, np.zeros_like(shown), why


def _of_short_sides(
    quantities: Sequence[Quantity], names: Sequence[str], short: Sequence[str], side: NDArray[np.bool_]
) -> list[Quantity]:
    """The quantities with the reason where a side has no recording that is long enough."""
    for which in (True, False):
        mine = [(name, why) for name, why, of in zip(names, short, side) if of == which]
        if all(why for _, why in mine):
            return [one.not_comparable(f"{mine[0][0]} {mine[0][1]}") for one in quantities]
    return list(quantities)


def _long(
    fits: Sequence[Fitted], side: NDArray[np.bool_], short: Sequence[str]
) -> tuple[list[Fitted], NDArray[np.bool_]]:
    """The fits of recordings that are long enough, and their sides."""
    return [one for one, why in zip(fits, short) if not why], side[np.array([not why for why in short])]


def _quantities(
    structure: Structure,
    fits: Sequence[Fitted],
    shown: NDArray[np.bool_],
    side: NDArray[np.bool_],
    names: Sequence[str],
) -> tuple[list[Quantity], Array]:
    """What is compared, friction of the joints first, and (r, c) how it follows from the values."""
    comparable = np.asarray(shown[side].any(axis=0) & shown[~side].any(axis=0), bool)
    variance = np.zeros(shown.shape[1])
    for mine in (side, ~side):
        parts = np.array([np.where(seen, np.diag(f.covariance), np.inf) for f, seen in zip(fits, shown)])[mine]
        with np.errstate(divide="ignore"):
            variance += 1 / np.sum(1 / parts, axis=0)
    variance[~comparable] = np.nan
    friction, maps = friction_maps(structure, variance)
    values = []
    for k, quantity in enumerate(values_quantities(structure)):
        if not comparable[k]:
            blind = [name for name, seen in zip(names, shown[:, k]) if not seen]
            quantity = quantity.not_comparable(f"not excited in {', '.join(blind)}")
        values.append(quantity)
    return friction + values, np.concatenate([maps, np.eye(len(comparable))])


def _estimate(name: str, fitted: Fitted, maps: Array) -> Estimate:
    """The quantities of one recording; NaN where a value that they need is not shown."""
    seen = np.isfinite(fitted.values)
    whole = ~(np.nan_to_num(maps, nan=1.0)[:, ~seen] != 0).any(axis=1) & np.isfinite(maps).all(axis=1)
    clean = np.nan_to_num(maps)
    values = np.where(whole, clean @ np.nan_to_num(fitted.values), np.nan)
    raw = np.sqrt(np.maximum(np.sum(clean @ fitted.covariance * clean, axis=1), 0.0))
    raw = np.where(whole, raw, np.nan)
    return Estimate(source=name, values=values, std=fitted.widened * raw, raw=raw, freedom=fitted.freedom)


def _leaked(structure: Structure, fits: Sequence[Fitted], side: NDArray[np.bool_], maps: Array) -> Array:
    """(r,) std of each change by errors of values that were taken from the model, as the sides differ in which.

    What both sides take from the model alike cancels; nothing where a side has no fit.
    """
    if side.all() or not side.any():
        return np.zeros(len(maps))
    units = [quantity.unit for quantity in values_quantities(structure)]
    leakage = [np.mean([f.leakage for f, mine in zip(fits, side) if mine == which], axis=0) for which in (True, False)]
    difference = np.nan_to_num(maps) @ (leakage[1] - leakage[0])
    return np.asarray(np.linalg.norm(difference * structure.uncertain(units), axis=1))
