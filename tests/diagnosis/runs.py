"""Recordings of a model with hidden effects, for tests of the parts of a diagnosis.

Two excitations, with white noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from arm_model.description import Arm, EffectTerm
from arm_model.sensing import recorded
from arm_model.simulation.simulation import simulate
from diagnosis.cause import Cause
from diagnosis.residual.generation import residual_run
from diagnosis.residual.run import Run
from experiment import demand_of, read_experiment

NOISE = 0.01


@dataclass(frozen=True)
class Seen:
    """The part of a Diagnosis that the choice of an experiment looks at."""

    arm: Arm
    fit: tuple[Run, ...]
    causes: list[Cause] = field(default_factory=list)


def seen(root: Path, arm: Arm, terms: Sequence[EffectTerm], names: Sequence[str] = ("excitation",)) -> Seen:
    """The arm with ``terms`` in it, on the named experiments, and their residuals under the arm without them."""
    rng = np.random.default_rng(7)
    runs = []
    for name in names:
        demand = demand_of(read_experiment(root / f"config/experiments/{name}.toml"))
        hidden = replace(arm, effects=(*arm.effects, *terms))
        motion = simulate(hidden, demand, duration=demand.duration, rate=500.0)
        shown = recorded(hidden, motion)
        noisy = shown.current + rng.normal(scale=NOISE, size=shown.current.shape)
        runs.append(residual_run(name, arm, motion.t, shown.q + rng.normal(scale=1e-6, size=shown.q.shape), noisy))
    return Seen(arm, tuple(runs))


def group_of(*members: tuple[str, int | None], felt_at: int = 1) -> Cause:
    """A cause that the data cannot tell from others."""
    effect, joint = members[0]
    return Cause(
        effect=effect,
        joint=joint,
        parameters=[],
        confidence=0.97,
        before=0.0,
        after=0.0,
        group=tuple(members),
        evidence="",
        felt_at=felt_at,
        unit="A",
    )
