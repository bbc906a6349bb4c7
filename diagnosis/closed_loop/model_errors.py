"""Errors of simulated closed loops that follow from the stated uncertainty of a model.

Arms are drawn from the distribution of the parameters, and each is simulated on the demands. An error of the model's
own closed loop that is within the spread of their currents is no sign of a fault.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from arm_io import InputError
from arm_io.types import Array
from arm_model import Arm, parameter, with_parameters
from daq.recording import Recording
from diagnosis.another_day import known_on_another_day
from diagnosis.closed_loop.comparison import LoopComparison, compare
from diagnosis.residual.run import Run

DRAWS = 8
"""Arms that are drawn: their spread is then known to a quarter, which is enough for the limits that it widens."""
SEED = 0
"""Seed of the draws, so that the same recordings have the same verdict."""


def sampled_arms(arm: Arm) -> list[Arm]:
    """``DRAWS`` arms drawn at random from the stated uncertainty of ``arm``; empty if it states none."""
    uncertainty = known_on_another_day(arm)
    if uncertainty is None or not uncertainty.parameters:
        return []
    root, random = uncertainty.directions, np.random.default_rng(SEED)
    values = np.array([parameter(arm, name) for name in uncertainty.parameters])
    return [
        with_parameters(arm, dict(zip(uncertainty.parameters, (values + root @ draw).tolist())))
        for draw in random.standard_normal((DRAWS, root.shape[1]))
    ]


def spreads(
    arm: Arm, recordings: Sequence[Recording], runs: Sequence[Run], nominal: Sequence[LoopComparison]
) -> list[list[LoopComparison]]:
    """For each drawn arm: every recording's closed loop by ``arm``, compared with that by the drawn arm.

    nominal: the loops of ``arm``. An arm whose loop is not stable is left out.
    """
    loops_of_arms = []
    for sampled in sampled_arms(arm):
        try:
            loops = [compare(recording, sampled, run) for recording, run in zip(recordings, runs)]
        except InputError:  # the drawn inertia or friction is physically impossible
            continue
        both = [
            replace(own, current=loop.simulated_current, angle=loop.simulated_angle)
            for own, loop in zip(nominal, loops)
            if loop is not None
        ]
        if len(both) == len(nominal):
            loops_of_arms.append(both)
    return loops_of_arms


def left_over_rms(arm: Arm) -> tuple[Array, Array] | None:
    """(n,) A rms each: what an identified model left on its own recordings, along the motion and in closed loop.

    The second is what it left in closed loop beyond the first. None if the model does not state it.
    """
    uncertainty = arm.uncertainty
    if uncertainty is None:
        return None
    constant, nothing = arm.joint_array("drive_constant"), np.zeros(len(arm))
    along, in_loop = (np.array(one) if one else nothing for one in (uncertainty.left_over, uncertainty.in_loop))
    return along / constant, in_loop / constant
