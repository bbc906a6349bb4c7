"""Gaps whose teeth chatter: where the load is near zero for long, no law says when they meet.

Setpoints then throw the link from flank to flank. An angle that is off by a tenth of an encoder step, or
teeth that rebound a little more, make it meet at other instants, and along the measured motion the right gap predicts
the current no better than none. What is predicted is where the current is uncertain, and by how much. A gap is named if
the residual under it is as large as that, in the sense of the likelihood: with normal errors, squared residual over
variance, plus the logarithm of the variance.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arm_io.parallel import in_parallel
from arm_io.types import Array
from arm_model import EffectTerm
from arm_model.effects import CATALOGUE, Effect
from diagnosis.cause import Cause, EffectKey, Estimate, confidence_of
from diagnosis.measurements.currents.columns import column_of_gap
from diagnosis.residual.gap import AS_FOUND, POSSIBLE
from diagnosis.residual.other_effects import residual_with
from diagnosis.residual.run import Run
from identification.selection import Split, p_value

LEAST_GAIN = 0.25
"""Of the log-likelihood (twice, per row), in fitted and held-out recordings: what a quarter of the noise would gain."""
EXPLAINED = 0.75
"""Least share of the excess over the noise that lies where the gap makes the current uncertain, in both."""
SIGNIFICANT = 0.05
"""Probability below which the held-out gain over blocks is not chance, among all joints; and the fitted one."""


@dataclass(frozen=True)
class Judged:
    """One gap in some recordings; rows (m,) of all of them.

    before, after  residual over its std without it, and with it
    gain           twice the gain of the log-likelihood; block (m,): of one second, from 0
    deviation      A: std of the residual without it
    """

    before: Array
    after: Array
    gain: Array
    block: NDArray[np.intp]
    deviation: Array

    @property
    def by_block(self) -> Array:
        """(blocks,) gain."""
        return np.bincount(self.block, weights=self.gain).astype(float)

    @property
    def explained(self) -> float:
        """Share of the squared residual above the noise that the gap explains."""
        left, excess = (max(float(np.mean(one**2)) - 1.0, 0.0) for one in (self.after, self.before))
        return 1.0 - left / excess if excess > 0.0 else 0.0


def chattering_gaps(
    runs: Split[Sequence[Run]], terms: Sequence[EffectTerm], taken: Container[EffectKey]
) -> list[Cause]:
    """Gaps that recordings show in addition to the effects ``terms``; none at a joint with a ``taken`` transmission."""
    elastic = [effect.name for effect in CATALOGUE.values() if effect.spring is not None]
    number = len(runs.fit[0].arm)
    joints = [j for j in range(1, number + 1) if not any((name, j) in taken for name in elastic)]
    gaps = [effect for effect in CATALOGUE.values() if effect.gap is not None]
    by_joint = in_parallel(lambda one: _of_joint(*one, runs, terms), [(effect, j) for effect in gaps for j in joints])
    return [cause for cause in by_joint if cause is not None]


def _of_joint(effect: Effect, joint: int, runs: Split[Sequence[Run]], terms: Sequence[EffectTerm]) -> Cause | None:
    assert effect.gap is not None
    white = runs.map(lambda part: [run.whiten(residual_with(run, terms))[:, joint - 1] for run in part])
    if float(np.mean(np.concatenate(white.held_out) ** 2)) < 1.0 + LEAST_GAIN:
        return None
    values = effect.gap.search
    fits = [_judged(runs.fit, white.fit, joint, value) for value in values]
    best = int(np.argmax([fitted.gain.sum() for fitted in fits]))
    held_out = _judged(runs.held_out, white.held_out, joint, values[best])
    chance = min(1.0, p_value(held_out.by_block) * len(runs.fit[0].arm))
    enough = all(one.gain.mean() > LEAST_GAIN and one.explained > EXPLAINED for one in (fits[best], held_out))
    if not enough or chance > SIGNIFICANT or p_value(fits[best].by_block) > SIGNIFICANT:
        return None
    alike = np.log(
        [v for v, fitted in zip(values, fits) if p_value(fits[best].by_block - fitted.by_block) > SIGNIFICANT]
    )
    # between two neighbouring values of the grid the size is undetermined
    std = float(np.hypot(alike.std(), np.log(values[1] / values[0]) / 2))
    drive, value = runs.fit[0].arm.joints[joint - 1], float(np.exp(alike.mean()))
    size = Estimate(effect.gap.name, value, value * std, drive.unit(effect.gap.unit, effect.gap.name))
    before, after = (
        float(np.sqrt(np.mean((one * held_out.deviation) ** 2))) for one in (held_out.before, held_out.after)
    )
    blocks = held_out.by_block
    evidence = (
        f"{held_out.explained:.0%} of the squared residual above the noise are where the load changes sign, where "
        f"teeth meet at instants that no law predicts, in {int(np.sum(blocks > LEAST_GAIN))} of {len(blocks)} "
        "one-second blocks"
    )
    return Cause(
        effect=effect.name,
        joint=joint,
        parameters=[size],
        confidence=confidence_of(chance),
        before=before,
        after=after,
        group=((effect.name, joint),),
        evidence=evidence,
        felt_at=joint,
        unit=drive.command_unit,
    )


def _judged(runs: Sequence[Run], white: Sequence[Array], joint: int, half_gap: float) -> Judged:
    """A gap of a joint (from 1), by residuals (m,) over their std of every recording."""
    found, first = [], 0
    for run, before in zip(runs, white):
        law, *others = _whitened(run, joint, half_gap)
        variance = 1.0 + sum(((one - law) ** 2 for one in others), np.zeros_like(law))
        after = before - law
        gain = before**2 - after**2 / variance - np.log(variance)
        found.append((before, after / np.sqrt(variance), gain, first + run.block, run.deviation[:, joint - 1]))
        first += int(run.block[-1]) + 1
    return Judged(*(np.concatenate(part) for part in zip(*found)))


def _whitened(run: Run, joint: int, half_gap: float) -> Iterator[Array]:
    """(m,) current of a gap over the std of its row: as the law says, and as teeth may do instead."""
    for teeth in (AS_FOUND, *POSSIBLE):
        yield run.whiten_at(column_of_gap(run, joint, half_gap, teeth), joint)[:, 0]
