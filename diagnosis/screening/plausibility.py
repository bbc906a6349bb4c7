"""Recordings that were mixed up rather than a model that is wrong: nothing that moves, degrees, currents of the other sign or in another unit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm_io import InputError
from arm_model import Arm
from daq.recording import Recording
from diagnosis.measurements.currents.detectability import STOOD
from diagnosis.residual.run import Run

BEYOND = 4.0
"""Times the limits of a joint: no arm was there, but one in degrees was."""
ALIKE, AGAINST = 0.8, -0.5
"""Correlations of measured and expected currents: the same but for its size; the other way round."""
OTHER_UNIT = 5.0
"""Times what is expected."""
LOUD = 10.0
"""Times the noise that a current swings by, to be compared at all."""


def check_motion(arm: Arm, recordings: Sequence[Recording], words: str) -> None:
    """InputError where no joint moves in any of the recordings (``words``: which they are), or where angles are no radians."""
    for r in recordings:
        for j, joint in enumerate(arm.joints):
            most = float(np.abs(r.q[:, j]).max())
            if joint.revolute and joint.limits and most > BEYOND * max(map(abs, joint.limits)):
                raise InputError(
                    r.path, f"joint {j + 1} reads up to {most:.3g} rad, far beyond its limits; are these degrees?"
                )
    if all(np.ptp(r.q, axis=0).max() < STOOD for r in recordings):
        raise InputError(recordings[0].path, f"no joint moves in the {words} recordings; a motion is wanted")


def mixed_up(runs: Sequence[Run]) -> tuple[str, ...]:
    """Warnings of currents that are the expected ones with the other sign, or many times as large or small."""
    said = []
    for run in runs:
        swings = np.flatnonzero((np.std(run.current, axis=0) > LOUD * run.noise) & (np.ptp(run.expected, axis=0) > 0.0))
        pairs = [
            (run.current[:, j] - run.current[:, j].mean(), run.expected[:, j] - run.expected[:, j].mean())
            for j in swings
        ]
        alike = np.array([np.corrcoef(seen, wanted)[0, 1] for seen, wanted in pairs])
        times = np.array([np.std(seen) / np.std(wanted) for seen, wanted in pairs])
        if len(swings) and np.mean(alike < AGAINST) > 0.5:
            said.append(f"currents of {run.name} run against what the model expects; is their sign that of the angles?")
        elif len(swings) and np.mean((alike > ALIKE) & (np.abs(np.log(times)) > np.log(OTHER_UNIT))) > 0.5:
            said.append(
                f"currents of {run.name} are {np.median(times):.2g} times what the model expects; are they in its unit?"
            )
    return tuple(said)
