"""Whether held-out recordings were long enough to judge what is left.

A cause is certain by the blocks of held-out rows in which it gains: n blocks that all agree are chance with probability
2^-n. Where an effect explains what is left in every block and there are too few of them, the structure is not
unexplained: it was not recorded for long enough.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from arm_report.numbers import numbered
from diagnosis.cause import EffectKey, in_words
from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.measurements.currents.search import Selection
from diagnosis.screening.time_split import FITTED
from diagnosis.selection.candidate import Candidate
from identification.selection import Score

NEARLY_ALL = 0.9
"""Share of a joint's residual energy that an effect must explain to be what is left there."""
LASTING = 0.1
"""Share of the largest gain from which the blocks of other effects agree for its reason; below it they do by chance,
and will not in further blocks."""


@dataclass(frozen=True)
class Shortage:
    """``effect`` explains what is left at ``joints`` (from 1), but is certain only with ``seconds`` more.

    split: these are of a recording that is split by time, else of the held-out ones.
    """

    effect: EffectKey
    joints: tuple[int, ...]
    seconds: float
    split: bool = False

    def __str__(self) -> str:
        """``2 s more are needed: payload would explain ...``."""
        where = "recording" if self.split else "held-out recordings"
        return (
            f"{self.seconds:.0f} s more are needed in the {where}: {in_words(self.effect)} would explain the residual "
            f"of {numbered('joint', self.joints)} in every one-second block, but so few blocks may agree by chance"
        )


def shortage(selection: Selection) -> Shortage | None:
    """What the structures that a search left unexplained may be, had more been recorded; None where they are not."""
    state, model = selection.state, selection.state.model
    unexplained_joints = sorted({structure.joint for structure in selection.unexplained.structures if structure.joint})
    if not unexplained_joints:
        return None
    scores = model.scores(state)
    q = stats.false_discovery_control(np.array([score.p for score in scores]))
    energy = state.data.held_out.by_joint(state.residual.held_out**2)
    short = [
        (score, chance, joints)
        for score, chance in zip(scores, q.tolist())
        if (
            joints := tuple(one for one in unexplained_joints if score.by_joint[one - 1] > NEARLY_ALL * energy[one - 1])
        )
        and chance >= (LIMITS.fdr or 1.0)
        and _unanimous(score)
        and model.admissible(score, state)
    ]
    if not short:
        return None
    longest = max(len(joints) for _, _, joints in short)
    short = [one for one in short if len(one[2]) == longest]
    best = max(score.gain for score, _, _ in short)
    # the simplest of those that explain what is left at as many joints, and nearly as much
    score, _, joints = min(
        (one for one in short if one[0].gain > LIMITS.ambiguity * best),
        key=lambda one: (len(one[0].coefficients), -one[0].gain),
    )
    # the false-discovery rate as it will be once those that agree by chance no longer do
    chance = score.p * len(scores) / sum(one.gain > LASTING * best for one in scores)
    # of a recording that is split, only a part is held out
    share = 1.0 - FITTED if state.data.two_fold else 1.0
    blocks = max(1, int(np.floor(np.log2(chance / (LIMITS.fdr or 1.0)))) + 1)
    seconds = float(np.ceil(blocks * LIMITS.block_seconds / share))
    return Shortage(score.candidate.key, joints, seconds, split=state.data.two_fold)


def _unanimous(score: Score[Candidate]) -> bool:
    """Whether every block in which the candidate does anything gains by it."""
    active = np.abs(score.blocks) > 1e-9 * np.abs(score.blocks).max()
    return bool((score.blocks[active] > 0.0).all())
