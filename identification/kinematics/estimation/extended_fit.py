"""A fit extended: by sag, encoder errors and delay, by rows that belong to another trigger, by zeros of the runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from arm_io.types import Array
from identification.kinematics.data.blocks import blocks
from identification.kinematics.data.row_shifts import Shift, find_constant, find_step
from identification.kinematics.data.runs import Run, points_of, shifted, thinned, velocity_of
from identification.kinematics.estimation.cross_validation import choose
from identification.kinematics.estimation.extensions import Extension, candidates, deflections, prior_scales
from identification.kinematics.estimation.map_estimation import fit
from identification.kinematics.estimation.run_zeros import with_own_zeros, with_zeros
from identification.kinematics.estimation.work import MOST, Work


def extend_and_realign(work: Work) -> None:
    """Fits the extensions, then moves rows that belong to another trigger.

    If rows were moved, fit and extensions are repeated.
    """
    if work.settings.extend:
        _extend(work)
    if _realign(work):
        work.rows = thinned(work.runs, MOST)
        work.points = points_of(work.runs, work.rows)
        work.estimate = fit(work.parameters, work.points, start=work.estimate.values)
        if work.settings.extend:
            _extend(work)


def estimate_run_zeros(work: Work) -> None:
    """A zero of its own for every run whose counters were set at its start."""
    if all(run.count is None for run in work.runs):
        return
    work.tell("zeros of the encoders, run by run")
    gravity = work.settings.gravity
    work.points, work.estimate, zeros = with_own_zeros(
        work.parameters, work.runs, work.rows, work.estimate, work.extensions, gravity
    )
    work.runs = with_zeros(work.runs, zeros)
    work.held_out = with_zeros(work.held_out, zeros) if work.judged_by != "held_out" else work.held_out


def _extend(work: Work) -> None:
    """Selects the extensions that improve the error on points that the fit has not seen, and fits them."""
    points, velocity = points_of(work.runs, work.rows), velocity_of(work.runs, work.rows)
    gravity = work.settings.gravity
    prismatic = [not j.revolute for j in work.arm.joints]
    coupled = [(int(j) + 1, int(k) + 1) for j, k in np.argwhere(work.coupling) if j != k]
    tried = candidates(work.moving, prismatic, gravity=gravity, velocity=_moves(velocity), coupled=coupled)

    def deflect(extensions: Sequence[Extension]) -> Array:
        return deflections(extensions, points.q, velocity=velocity, gravity=gravity)

    numbers = blocks(work.runs, work.rows)
    work.extensions, work.trials = choose(work.parameters, points, numbers, tried, deflect, work.estimate, work.tell)
    if work.extensions:
        points = points.deflected(deflect(work.extensions))
        scale = prior_scales(work.extensions)
        work.estimate = fit(work.parameters, points, start=work.estimate.values, extension_scale=scale)
    work.points = points


def _realign(work: Work) -> bool:
    """Moves points back to their own rows where their delay changes within a run, or is whole rows throughout it.

    Returns whether any was moved.

    Blocks of one run, some held out, are moved alike: as the fitted half of the run shows.
    """
    chain, extension = work.parameters.chain.at(work.estimate.values), work.estimate.extension
    still = [0.0 if e.definition.late is not None else 1.0 for e in work.extensions for _ in e.parameters]

    def bent(run: Run) -> Run:
        bend = deflections(work.extensions, np.nan_to_num(run.q), velocity=None, gravity=work.settings.gravity)
        return replace(run, q=run.q + bend @ (extension * still))

    def aligned_rows(run: Run) -> tuple[Run, list[Shift]]:
        shifts: list[Shift] = []
        if run.still or run.lever:
            return run, shifts
        for search in (find_step, find_step, find_step, find_constant):
            shift = search(bent(run), chain, work.estimate.noise)
            if shift is not None:
                shifts.append(shift)
                run = shifted(run, shift.first, shift.rows)
        return run, shifts

    for k, run in enumerate(work.runs):
        work.runs[k], shifts = aligned_rows(run)
        work.shifts += shifts
        for shift in shifts if work.judged_by != "held_out" else []:
            work.held_out[k] = shifted(work.held_out[k], shift.first, shift.rows)
    if work.judged_by == "held_out":
        for k, run in enumerate(work.held_out):
            work.held_out[k], shifts = aligned_rows(run)
            work.shifts += shifts
    return bool(work.shifts)


def _moves(velocity: Array) -> bool:
    return bool(np.abs(velocity).max(initial=0.0) > 0.01)
