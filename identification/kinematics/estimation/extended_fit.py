"""A fit extended: by sag, encoder errors and delay, by rows that belong to another trigger, by zeros of the runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from arm_io.types import Array, Progress
from identification.kinematics.data.blocks import blocks
from identification.kinematics.data.measured import Measured
from identification.kinematics.data.row_shifts import Shift, find_constant, find_step
from identification.kinematics.data.runs import Run, shifted, velocity_of
from identification.kinematics.estimation.cross_validation import choose
from identification.kinematics.estimation.estimated import Estimated
from identification.kinematics.estimation.extensions import Extension, candidates, deflections, prior_scales
from identification.kinematics.estimation.map_estimation import fit
from identification.kinematics.estimation.run_zeros import with_own_zeros, with_zeros

MOVES = 0.01
"""rad/s (m/s): joints that are never faster are at rest, and show no delay."""


def extended(estimated: Estimated, progress: Progress) -> Estimated:
    """Fits the extensions, then moves rows that belong to another trigger.

    If rows were moved, fit and extensions are repeated.
    """
    found = _with_extensions(estimated, progress)
    measured = _realigned(found)
    if measured is found.measured:
        return found
    again = fit(found.parameters, measured.points, start=found.fit.values)
    return _with_extensions(replace(found, measured=measured, points=measured.points, fit=again), progress)


def with_run_zeros(estimated: Estimated, progress: Progress) -> Estimated:
    """A zero of its own for every run whose counters were set at its start."""
    measured, gravity = estimated.measured, estimated.settings.gravity
    if all(run.count is None for run in measured.runs):
        return estimated
    progress("zeros of the encoders, run by run")
    points, found, zeros = with_own_zeros(
        estimated.parameters, measured.runs, measured.rows, estimated.fit, estimated.extensions, gravity
    )
    own = replace(measured, runs=tuple(with_zeros(measured.runs, zeros)))
    if measured.judged_by != "held_out":
        own = replace(own, held_out=tuple(with_zeros(measured.held_out, zeros)))
    return replace(estimated, measured=own, points=points, fit=found)


def _with_extensions(estimated: Estimated, progress: Progress) -> Estimated:
    """Selects the extensions that improve the error on points that the fit has not seen, and fits them."""
    settings, measured, parameters = estimated.settings, estimated.measured, estimated.parameters
    if not settings.extend:
        return estimated
    points, velocity = measured.points, velocity_of(measured.runs, measured.rows)
    prismatic = [not j.revolute for j in estimated.arm.joints]
    coupled = [(int(j) + 1, int(k) + 1) for j, k in np.argwhere(measured.coupling) if j != k]
    moves = bool(np.abs(velocity).max(initial=0.0) > MOVES)
    tried = candidates(estimated.moving, prismatic, gravity=settings.gravity, velocity=moves, coupled=coupled)

    def deflect(extensions: Sequence[Extension]) -> Array:
        return deflections(extensions, points.q, velocity=velocity, gravity=settings.gravity)

    numbers = blocks(measured.runs, measured.rows)
    chosen, trials = choose(parameters, points, numbers, tried, deflect, estimated.fit, progress)
    found = estimated.fit
    if chosen:
        points = points.deflected(deflect(chosen))
        found = fit(parameters, points, start=found.values, extension_scale=prior_scales(chosen))
    return replace(estimated, extensions=tuple(chosen), trials=tuple(trials), points=points, fit=found)


def _realigned(estimated: Estimated) -> Measured:
    """Points moved back to their own rows where their delay changes within a run, or is whole rows throughout it.

    Blocks of one run, some held out, are moved alike: as the fitted half of the run shows.
    """
    measured, extensions = estimated.measured, estimated.extensions
    still = [0.0 if e.definition.late is not None else 1.0 for e in extensions for _ in e.parameters]

    def bent(run: Run) -> Run:
        q = np.nan_to_num(run.q)
        bend = deflections(extensions, q, velocity=None, gravity=estimated.settings.gravity)
        return replace(run, q=run.q + bend @ (estimated.fit.extension * still))

    def shifts_of(run: Run) -> list[Shift]:
        shifts: list[Shift] = []
        if run.still or run.lever:
            return shifts
        for search in (find_step, find_step, find_step, find_constant):
            shift = search(bent(run), estimated.chain, estimated.fit.noise)
            if shift is not None:
                shifts.append(shift)
                run = shifted(run, shift.first, shift.rows)
        return shifts

    of_runs = [shifts_of(run) for run in measured.runs]
    of_held_out = of_runs
    if measured.judged_by == "held_out":
        of_held_out = [shifts_of(run) for run in measured.held_out]
    found = [*of_runs, *(of_held_out if measured.judged_by == "held_out" else [])]
    if not any(found):
        return measured
    return replace(
        measured,
        runs=tuple(map(_moved, measured.runs, of_runs)),
        held_out=tuple(map(_moved, measured.held_out, of_held_out)),
        shifts=tuple(shift for shifts in found for shift in shifts),
    )


def _moved(run: Run, shifts: Sequence[Shift]) -> Run:
    for shift in shifts:
        run = shifted(run, shift.first, shift.rows)
    return run
