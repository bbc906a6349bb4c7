"""How strong a hidden effect is: the change of the motor currents that it makes, over the noise of the currents.

Measured by simulating the same motions with and without it. The noise is all that the instruments add to a current:
white, and what is correlated. An effect that is drawn where its motions hardly show it is made stronger, or hidden in
another laboratory, until they do: an effect that is not detectable is no case.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.ndimage import uniform_filter1d

from experiment import Experiment
from tests.blind.hide import Hidden
from tests.blind.laboratory import WHITE, Laboratory
from tests.blind.record import Truth, truth

COUNTED = {"missed_counts": "counts", "dropped_trigger": "count"}
"""Effects that no current shows: their strength is what they are counted by, one count for one noise."""
ASKED = 0.03
"""s."""


@dataclass(frozen=True)
class Wanted:
    """Strength over the noise: at least, and at most (None: as drawn)."""

    least: float
    most: float | None


@lru_cache(maxsize=16)
def _bare(experiment: str, laboratory: Laboratory) -> Truth:
    return truth(Experiment.model_validate_json(experiment), (), laboratory)


def bare(experiment: Experiment, laboratory: Laboratory) -> Truth:
    """The motion with nothing hidden; kept, for several ask."""
    return _bare(experiment.model_dump_json(), laboratory)


def strength(hidden: Hidden, experiments: Sequence[Experiment], laboratory: Laboratory) -> float:
    """Change of current over noise, rms over the experiments, at the joint.

    For the whole arm, at the joint that shows it most.
    """
    if hidden.effect in COUNTED:
        return abs(hidden.parameters[COUNTED[hidden.effect]])
    noise = float(np.hypot(WHITE, laboratory.colour))
    power = np.zeros(6)
    for experiment in experiments:
        changed, plain = truth(experiment, (hidden,), laboratory), bare(experiment, laboratory)
        power += np.mean((changed.signals.current - plain.signals.current) ** 2, axis=0) / len(experiments)
    ratio = np.sqrt(power) / noise
    return float(ratio.max() if hidden.joint is None else ratio[hidden.joint - 1])


def scaled(
    at: Callable[[float], Hidden],
    experiments: Sequence[Experiment],
    laboratory: Laboratory,
    wanted: Wanted,
    most: float,
) -> tuple[float, float]:
    """(factor, ``most`` at most; strength over the noise) of the effect ``at(factor)``.

    Nearly proportional: three steps are enough.
    """
    factor = 1.0
    reached = strength(at(factor), experiments, laboratory)
    for _ in range(3):
        goal = np.clip(reached, wanted.least, wanted.most if wanted.most is not None else np.inf)
        if reached == 0.0 or abs(reached - goal) < 0.1 * goal:
            break
        factor = min(factor * float(goal) / reached, most)
        reached = strength(at(factor), experiments, laboratory)
    return factor, reached


def limit_below(peak_share: float, joint: int, experiments: Sequence[Experiment], laboratory: Laboratory) -> float:
    """A: a share of the largest current that the motions ask of a joint for ``ASKED`` s.

    Shorter transients of the setpoints have decayed by then.
    """
    rows = round(ASKED * laboratory.rate)
    currents = [bare(e, laboratory).signals.current[:, joint - 1] for e in experiments]
    return peak_share * max(float(np.max(uniform_filter1d(np.abs(current), rows))) for current in currents)
