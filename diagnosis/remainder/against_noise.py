"""A model's error in units of the instruments' noise, per joint: the one yardstick of ``identify`` and ``diagnose``."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from daq.recording import Recording
from diagnosis.measurements.currents.design_matrix import dataset_of
from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.measurements.currents.structure.noise_ratio import noise_ratio
from diagnosis.residual.generation import residual_run
from diagnosis.residual.noise.channels import KnownNoise, still_noise
from diagnosis.residual.run import Run
from diagnosis.residual.run_setup import known_setpoints, set_up, setup_of
from diagnosis.screening.even_rows import even_samples, known_noise
from diagnosis.screening.lost_rows.blank_samples import blanks_of, unweighted, without_blanks
from diagnosis.screening.lost_rows.skipped_rows import filled, holes_of, without_skipped
from diagnosis.screening.plausibility import check
from identification import JointNoise


def against_noise(arm: Arm, recordings: Sequence[Recording], others: Sequence[Recording] = ()) -> list[JointNoise]:
    """The residual currents of recordings under an arm, over the noise floor, per joint whose noise floor is known.

    others: of the same rig, whose standstills show its noise as well.
    InputError where a recording is not one that ``diagnose`` takes.
    """
    runs = runs_of(arm, recordings, others)
    return ratios(runs, dataset_of(runs).y)


def runs_of(arm: Arm, recordings: Sequence[Recording], others: Sequence[Recording]) -> list[Run]:
    """Residuals of recordings under an arm, with the noise that they and the ``others`` show at standstill."""
    check(arm, recordings)
    blanks = [blanks_of(r) for r in recordings]
    recordings, others = ([without_blanks(r) for r in of_side] for of_side in (recordings, others))
    still = still_noise([r for r in (*others, *recordings) if not setup_of(r).drives_off])
    runs = []
    for recording, none in zip(recordings, blanks):
        holes = holes_of(recording.t)
        r = filled(recording, holes)
        samples, powered = even_samples((r.t, r.q, r.i)), not setup_of(r).drives_off
        known = known_noise(r.t, r.q, KnownNoise(still=still, setpoints=known_setpoints(arm, r), demands=r.qref))
        run = residual_run(r.path.name, set_up(arm, r), *samples, powered=powered, known=known)
        runs.append(unweighted(without_skipped(run, holes), none))
    return runs


def ratios(runs: Sequence[Run], whitened: Array) -> list[JointNoise]:
    """Errors over the noise floor, per joint, from residuals (n * rows,) of ``runs`` over their deviations.

    Rows count in which the noise is that of the instruments: where a joint moves, away from its reversals. A joint
    without any is left out. Of a joint whose residual is exactly 0, as where all of it lies in what is free in its
    recording (``Run.own_directions``), the error and its ratio are 0.
    """
    data, joint_noises = dataset_of(runs), []
    for j, joint in enumerate(runs[0].arm.joints):
        sure = data.comparable(j + 1)
        if not sure.any():
            continue
        deviation = np.concatenate([run.deviation[:, j] for run in runs])
        error = float(np.sqrt(np.mean((whitened[data.of(j + 1)] * deviation)[sure] ** 2)))
        ratio = noise_ratio(whitened, data, j + 1)
        # noise that is as large in the quietest seconds counts as the floor, even if the standstill shows less
        floor = error / ratio if ratio > 0.0 else float(np.sqrt(np.mean(deviation[sure] ** 2)))
        limit = LIMITS.above_noise
        joint_noises.append(
            JointNoise(joint=j + 1, error=error, floor=floor, ratio=ratio, limit=limit, unit=joint.command_unit)
        )
    return joint_noises
