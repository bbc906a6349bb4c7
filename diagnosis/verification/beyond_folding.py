"""Joints whose residuals show more along their acceleration than sampling may put there.

Along what sampling may fold a residual counts for next to nothing (``Run.whiten``), also an inertia that is many times
as large. But what folds is bounded: two of its std hold at any phase of the two clocks
(``identification.preprocessing.setpoint_ripple``). A residual that is beyond that in every recording, and of one sign,
is not folded, and may be searched for causes as it is. What may have folded beside it remains in their std.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from arm_io.types import Array
from diagnosis.measurements.currents.state import State
from diagnosis.residual.filters import rate_of
from diagnosis.residual.other_effects import residual_with
from diagnosis.residual.run import Run
from diagnosis.verification.slope_by_blocks import slope_by_blocks
from identification.preprocessing.folding import unbounded

BEYOND = 3.0
"""Std of what may fold that a residual must show: more than the two that bound it."""
CERTAIN = 2.0
"""Std, by blocks, by which it must show more."""
RECORDINGS = 2
"""That must show it."""


def beyond_folding(state: State) -> tuple[int, ...]:
    """The joints (from 1) of which every recording that may hide an inertia shows one beyond what folds.

    Conditional on the causes of the state.
    """
    runs = [run for run in state.all_runs if not unbounded(run.setpoints, rate_of(run.raw[0]))]
    hiding = [run for run in runs if run.folded.any() and not run.resolved]
    if len(hiding) < RECORDINGS:
        return ()
    least = np.array([_shown(run, residual_with(run, state.terms)) for run in hiding])
    joints = []
    for joint, of_joint in enumerate(least.T, 1):
        judged = of_joint[np.isfinite(of_joint)]
        if len(judged) >= RECORDINGS and np.all(judged * np.sign(judged[0]) > BEYOND):
            joints.append(joint)
    return tuple(joints)


def resolved(runs: Sequence[Run], joints: Sequence[int]) -> list[Run]:
    """The runs, of whose ``joints`` what lies along ``folded`` counts in full."""
    return [replace(run, resolved=tuple(joints)) for run in runs]


def _shown(run: Run, residual: Array) -> Array:
    """(n,) std of what may fold that a residual (m, n) A shows with certainty at least; NaN where nothing folds."""
    shown, deviation = slope_by_blocks([(run.folded / run.deviation, residual / run.deviation, run.block)])
    return np.asarray(np.sign(shown) * np.maximum(np.abs(shown) - CERTAIN * deviation, 0.0))
