"""The wrench on a floating base as a measurement model of the stepwise selection.

A candidate is one parameter: of a thruster its gain, the share that it gives in one direction, or its dead zone; a
drag or an added mass of one degree of freedom, the displaced mass or a component of its moment; the arm's reaction or
payload. What it gains is judged on held-out rows, in blocks of time. A gain is both directions together: a direction
that enters beside it takes its place together with the other one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arm_io.types import Array
from diagnosis.selection.candidate_model import CandidateModel
from identification.floating_base import Rows, Sides, fitted
from identification.selection import Index, Limits, Score, p_value

LIMITS = Limits(max_causes=12, fdr=0.01, min_gain=0.02, kept_gain=0.01, ambiguity=0.8, block_seconds=3.0)
"""min_gain, kept_gain: of the held-out residual that is left without the candidate. systematic: a change that makes a
smaller share of the thrusters' wrench is within what thrust, filters and instruments are known by."""

ONE_WAY = ("forward", "reverse")
"""Parameters of a thruster for one sign of its demand."""
Chosen = tuple[str, ...]


@dataclass(frozen=True)
class BaseWrench(CandidateModel[str]):
    """Rows of both sides, the model's values (p,), and the noise (6,) that weighs the degrees of freedom."""

    rows: Sides
    nominal: Array
    scale: Array
    limits: Limits = LIMITS

    @property
    def names(self) -> tuple[str, ...]:
        """Of the parameters, in the order of the columns."""
        return self.rows.fit.names

    def numbers(self, state: Chosen) -> list[int]:
        """Columns of the chosen parameters."""
        return [self.names.index(name) for name in state]

    @property
    def folds(self) -> list[tuple[Rows, Rows]]:
        """(fitted, judged by): once, or of two parts of the same recordings both ways."""
        both = [(self.rows.fit, self.rows.held_out)]
        return [*both, (self.rows.held_out, self.rows.fit)] if self.rows.split else both

    def values(self, state: Chosen, rows: Rows | None = None) -> Array:
        """(p,) with the chosen parameters fitted (to ``rows``, by default of the fit), the others as in the model."""
        if not state:
            return self.nominal
        return fitted(self.rows.fit if rows is None else rows, self.nominal, self.numbers(state), self.scale)

    def residual(self, state: Chosen) -> Array:
        """(k, 6) residual of the rows of all folds that are judged by, over the noise."""
        parts = [judged.residual(self.values(state, rows)) for rows, judged in self.folds]
        return np.asarray(np.concatenate(parts) / self.scale)

    @property
    def block(self) -> Index:
        """(k,) of the same rows, the number of their block, from 0."""
        first, blocks = 0, []
        for _, judged in self.folds:
            blocks.append(judged.block + first)
            first += int(judged.block.max()) + 1
        return np.concatenate(blocks)

    def best(self, chosen: Sequence[str]) -> list[str]:
        """Every parameter that is not chosen, nor a part of one."""
        state = tuple(chosen)
        return [name for name in self.names if name not in state and not contained(name, state)]

    def score(self, candidate: str, chosen: Sequence[str]) -> Score[str]:
        """One candidate conditional on those chosen, on held-out rows; its share of their squared residual."""
        block, without, name = self.block, tuple(chosen), candidate
        before, after = ((self.residual(state) ** 2).sum(axis=1) for state in (without, entered(name, without)))
        blocks = np.bincount(block, weights=before - after).astype(float)
        share = float(blocks.sum()) / max(float(before.sum()), 1e-300)
        return Score(
            candidate=name,
            gain=float(blocks.sum()),
            p=p_value(blocks),
            blocks=blocks,
            coefficients=np.zeros(1),
            share=share,
        )

    def admissible(self, score: Score[str], state: Chosen) -> bool:
        """Whether a candidate gains enough, by a wrench that is not within what thrusters are known by."""
        return score.share > self.limits.min_gain and self.size(score.candidate, state) > self.limits.systematic

    def size(self, name: str, without: Chosen) -> float:
        """Wrench of a candidate's change, as a share of that of the thrusters in its largest degree of freedom."""
        held, at = self.rows.held_out, self.names.index(name)
        values = self.values(entered(name, without))
        unchanged = values.copy()
        unchanged[at] = self.nominal[at]
        wrenches = held.residual(values) - held.residual(unchanged), held.thrust_wrench(values)
        change, thrust = (np.sqrt(np.mean(one**2, axis=0)) for one in wrenches)
        return float(np.max(change / np.maximum(thrust, self.scale)))

    def entered(self, score: Score[str], admissible: Sequence[Score[str]], state: Chosen) -> Chosen:
        """With the candidate, and without what it contains."""
        return entered(score.candidate, state)

    def without(self, candidate: str, state: Chosen) -> Chosen:
        """Without the parameter of that name."""
        return tuple(name for name in state if name != candidate)


def contained(name: str, state: Chosen) -> bool:
    """Whether it is the gain of a thruster of which a direction is in the state."""
    head, _, quantity = name.partition(".")
    return quantity == "gain" and any(f"{head}.{way}" in state for way in ONE_WAY)


def entered(name: str, state: Chosen) -> Chosen:
    """The state with one parameter more; both directions of a thruster in place of its gain."""
    head, _, rest = name.partition(".")
    gain = f"{head}.gain"
    if rest in ONE_WAY and gain in state:
        return (*(other for other in state if other != gain), *(f"{head}.{way}" for way in ONE_WAY))
    return (*state, name)
