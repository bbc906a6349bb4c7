"""Inertias that all joints lack alike, where nothing shows how often setpoints come: sampling puts them there.

With one row per setpoint, what a servo does at setpoints looks like a share of its joint's own inertia, of one sign:
its gain on speed times the time between setpoints (``diagnosis.selection.unseen_inertia``). The gains of an arm's
servos are nearly alike, and so are these shares. Wrong inertias are not: a link, a rotor or a load changes that of some
joints, and each by another share. Gains are constant: where the inertia depends on the pose, what folds does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from arm_io.types import Array
from arm_model import EffectTerm
from arm_model.effects import CATALOGUE, Excitation
from diagnosis.measurements.currents.state import State
from diagnosis.residual.filters import rate_of
from diagnosis.residual.other_effects import residual_with
from diagnosis.residual.run import Run
from diagnosis.selection.unseen_inertia import FOLDS, mean_inertia, setpoints_unknown
from diagnosis.verification.slope_by_blocks import slope_by_blocks
from identification.preprocessing import Setpoints

JOINTS = 3
"""That must show it."""
CERTAIN = 3.0
"""Std of a joint's share, at most a third of it, from which on the joint is judged."""
ALIKE = 2.0
"""Ratio to the median share, or of it, within which all that are judged must lie."""
MOST = 50.0
"""Hz: largest share that a servo may put there, times the rate of the rows: that of a gain on speed of 150/s."""


def folded_alike(state: State) -> float | None:
    """The share of their own inertia that all joints lack alike; None where they do not, or setpoints are known.

    Conditional on the causes of the state but inertias.
    """
    runs = [run for run in state.all_runs if setpoints_unknown(run)]
    if not runs:
        return None
    share, std = _shares(runs, [term for term in state.terms if not _is_inertia(term)])
    judged = share[CERTAIN * std < abs(float(np.nanmedian(share)))] if np.isfinite(share).any() else share[:0]
    if len(judged) < JOINTS:
        return None
    common = float(np.median(judged))
    rate = min(rate_of(run.raw[0]) for run in runs)
    alike = np.all((judged / common > 1.0 / ALIKE) & (judged / common < ALIKE))
    return abs(common) if alike and FOLDS / rate < abs(common) < MOST / rate else None


def with_folding(runs: Sequence[Run], share: float) -> list[Run]:
    """The runs of unknown setpoints as of one row per setpoint, which may put such a share of an inertia there."""
    return [
        replace(
            run,
            setpoints=Setpoints(1.0 / rate_of(run.raw[0]), "currents", within=True),
            may_fold=(folded := share * mean_inertia(run)),
            folded=folded,
        )
        if setpoints_unknown(run)
        else run
        for run in runs
    ]


def _is_inertia(term: EffectTerm) -> bool:
    """Whether an effect follows the acceleration, or nearly contains one that does."""
    every = (term.name, *CATALOGUE[term.name].near_cases)
    return any(CATALOGUE[name].excited_by is Excitation.ACCELERATION for name in every)


def _shares(runs: Sequence[Run], terms: Sequence[EffectTerm]) -> tuple[Array, Array]:
    """(n,) each: share of its own inertia that each joint lacks or has too much of, and its std by blocks."""
    return slope_by_blocks(
        (run.whiten(mean_inertia(run)), run.whiten(residual_with(run, terms)), run.block) for run in runs
    )
