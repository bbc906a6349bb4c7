"""What an identified model left over along each effect, in the recordings of its identification.

The model is no exact one of its arm. A part of what it leaves looks like an effect by chance: of a friction curve that
is a little off, more like a current offset than like a delay of all currents. Each recording shows by how much, of its
own motion. An effect is allowed as much of it on another day.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from diagnosis.another_day import known_on_another_day
from diagnosis.measurements.currents.columns import candidates
from diagnosis.measurements.currents.design_matrix import columns_of, dataset_of
from diagnosis.measurements.currents.model_errors import ALIASED_SHARE, directions_of, named, stacked
from diagnosis.residual.run import Run
from diagnosis.selection.beyond_model import Evidence
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.design import Dataset


def aliased_shares(arm: Arm, runs: Sequence[Run], left_over: Sequence[float]) -> dict[str, float]:
    """Effect, as ``named``, -> share of the squares left over that it explains, at most 1.

    runs: residuals of the recordings; left_over: per joint, rms N m (N) along the motion. It is the mean of what every
    recording shows at every joint, as their errors are independent, weighted by how well they show it. What is assumed
    of any effect counts as one of them, because a few may agree by chance. Of effects without nonlinear parameters.
    """
    linear = [candidate for candidate in candidates(arm) if not candidate.shape]
    shown: dict[str, list[tuple[float, float]]] = {}
    for run in runs:
        for name, one in _of_recording(arm, dataset_of([run]), linear, left_over):
            shown.setdefault(name, [(ALIASED_SHARE, 1.0)]).append(one)
    return {name: _mean(several) for name, several in shown.items()}


def _mean(several: Sequence[tuple[float, float]]) -> float:
    """Of values, each with its weight, in three digits."""
    mean = sum(value * weight for value, weight in several) / sum(weight for _, weight in several)
    return float(f"{mean:.3g}")


def _of_recording(
    arm: Arm, data: Dataset, every: Sequence[Candidate], left_over: Sequence[float]
) -> Iterator[tuple[str, tuple[float, float]]]:
    """By effect, what one recording shows at each joint."""
    (run,) = data.runs
    known = known_on_another_day(arm)
    squares = (np.asarray(left_over) / arm.joint_array("drive_constant")) ** 2 * np.mean(run.instruments**-2.0, axis=0)
    variance = 1.0 + squares * (1.0 + ALIASED_SHARE * data.rows)
    weight = np.repeat(1.0 / np.sqrt(variance), data.rows)
    nothing = np.zeros((len(data.y), 0))
    directions = nothing if known is None else stacked([run.whiten(directions_of(run, known))])
    joint = np.repeat(np.arange(len(arm)), data.rows)
    evidence = Evidence(data.y * weight, nothing, directions * weight[:, None], data.block, float(run.alike), joint)
    allowed = np.repeat(data.rows * squares / variance, data.rows)
    for candidate in every:
        columns = columns_of(candidate, data).dense(len(data.y)) * weight[:, None]
        for number in np.flatnonzero(squares > 0.0).tolist():
            x = np.where((joint == number)[:, None], columns, 0.0)
            if x.any() and (one := _shown(evidence, x, allowed)) is not None:
                yield named(candidate), one


def _shown(evidence: Evidence, x: Array, allowed: Array) -> tuple[float, float] | None:
    """The share that columns x (N, k) explain of what is left over, ``allowed`` (N,) per row, and its weight.

    The weight is 1 without noise: the std of a share is that of share and noise together. None where they do not differ
    from errors of the model.
    """
    apart = evidence.apart(x)
    if apart is None:
        return None
    of_left = (apart.columns * allowed[:, None]).T @ apart.columns
    inverse, c = np.linalg.pinv(of_left, hermitian=True), apart.coefficients
    noise = float(np.trace(inverse @ apart.of_noise)) / len(c)
    share = float(np.clip(c @ inverse @ c / len(c) - noise, 0.0, 1.0))
    return share, (ALIASED_SHARE / (ALIASED_SHARE + noise)) ** 2
