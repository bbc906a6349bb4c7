"""One axis with an encoder fine enough to judge reversals, as a measurement model of the selection.

Coefficients and nonlinear parameters come from the fit rows, acceptance from the held-out ones; parts of one recording
are predicted from each other. A drive that repeats one motion would confirm anything that repeats with it. So an effect
that is not a difference between directions must hold across them: each direction is predicted from the other. A wave
over position is chosen only where other recordings show it at the same positions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import optimize

from arm_io.types import Array
from arm_model.effects import driven
from diagnosis.measurements.single_axis.columns import Rows, candidates, columns, waves
from diagnosis.measurements.single_axis.model_errors import ModelErrors
from diagnosis.selection.beyond_model import BEYOND_MODEL
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.candidate_model import CandidateModel
from identification.selection import Limits, Score, Split, p_value, scaled_lstsq

Chosen = tuple[Candidate, ...]


@dataclass(frozen=True, kw_only=True)
class AxisLimits(Limits):
    """Gains are shares of the squared residual: a drive repeats its motion, and with it what no effect explains.

    presliding     coefficients of friction that builds up gradually, which is the model's own: one outside says that
                   the data shows something else
    encoder_noise  share of the friction current that the steps of the encoder may leave in the residual: above it, the
                   encoder is too coarse to judge reversals
    beyond_model   probability that an effect looks as it does while only parameters of the model move, within what is
                   known of them
    """

    presliding: tuple[float, float] = (0.6, 1.6)
    encoder_noise: float = 1 / 30
    beyond_model: float = BEYOND_MODEL


LIMITS = AxisLimits(
    max_causes=6,
    min_gain=0.08,
    kept_gain=0.04,
    ambiguity=0.95,
    # a stroke lasts a second or less
    block_seconds=0.3,
)


def of_true_current(candidate: Candidate, coefficients: Array) -> Array:
    """(k,) coefficients of the law itself, of those of its columns.

    A gain is a share g of the true current, and its column is the reading, of which it is c: i_read = (1 + g) i and
    i_read - i = c i_read, so that g = c / (1 - c). A reading that is all error (c = 1) would explain anything.
    """
    effect = candidate.definition
    if effect.current is None or not effect.aliases:
        return coefficients
    return np.where(coefficients < 1.0, coefficients / np.maximum(1.0 - coefficients, 1e-300), np.inf)


@dataclass(frozen=True)
class SingleAxis(CandidateModel[Candidate]):
    """The held-out error of the current of one axis.

    rows     of the fit set and of the held-out set
    whole    rows from which parameters are estimated: those of the fit set; all, of two parts of the same recordings
    one_run  the held-out set continues the run of the fit set, whether it was split here or into tables before
    errors   what is known of the model, if it says so
    """

    rows: Split[Rows]
    whole: Rows
    one_run: bool
    errors: ModelErrors | None = None
    limits: AxisLimits = LIMITS
    cache: dict[tuple[int, Candidate], Array] = field(default_factory=dict, repr=False)

    def admissible(self, score: Score[Candidate], state: Chosen) -> bool:
        """Whether a candidate matters, is physically admissible, holds across directions, and is beyond the model."""
        candidate = score.candidate
        return (
            score.share > self.limits.min_gain
            and self.is_physical(candidate, state)
            and self.holds_across_directions(candidate, state)
            and not (candidate.definition.wave and self.one_run)
            and self.beyond_model(candidate, state)
        )

    def beyond_model(self, candidate: Candidate, others: Chosen) -> bool:
        """Whether a candidate is significant with the parameters of the model free; always with it exact."""
        return self.errors is None or self.chance(candidate, others, self.errors) < self.limits.beyond_model

    def chance(self, candidate: Candidate, others: Chosen, errors: ModelErrors) -> float:
        """p-value of a candidate, conditional on others."""
        x = self.rows.map(lambda rows: self.columns(candidate, rows))
        return errors.chance(x, self.rows.map(lambda rows: self.stacked(others, rows)), self.rows)

    def entered(self, score: Score[Candidate], admissible: Sequence[Score[Candidate]], state: Chosen) -> Chosen:
        """With the candidate; each then refined conditional on the others."""
        chosen = [*state, score.candidate]
        return tuple(self._refined(candidate, [c for c in chosen if c is not candidate]) for candidate in chosen)

    def best(self, chosen: Sequence[Candidate]) -> list[Candidate]:
        """For every effect that is not chosen, the nonlinear parameters with the smallest residual of the fit rows."""
        taken = {c.effect for c in chosen}
        best: dict[str, tuple[float, Candidate]] = {}
        for candidate in [
            *candidates(self.rows.fit),
            *waves(self.residual(chosen, self.rows.fit, self.rows.fit), self.rows.fit),
        ]:
            if candidate.effect not in taken:
                energy = float(np.sum(self.residual([*chosen, candidate], self.rows.fit, self.rows.fit) ** 2))
                if candidate.effect not in best or energy < best[candidate.effect][0]:
                    best[candidate.effect] = energy, candidate
        return [candidate for _, candidate in best.values()]

    def score(self, candidate: Candidate, chosen: Sequence[Candidate]) -> Score[Candidate]:
        """Gain A2 per block of held-out rows; share 0 where the held-out set itself gains nothing."""
        falls, energy = [], 0.0
        for learned, judged in self.rows.folds():
            before, after = (self.residual(some, learned, judged) for some in (chosen, [*chosen, candidate]))
            falls.append(np.bincount(judged.block, weights=before**2 - after**2).astype(float))
            energy += float(np.sum(before**2))
        blocks = np.concatenate(falls)
        gain = float(blocks.sum())
        return Score(
            candidate=candidate,
            gain=gain,
            p=p_value(blocks),
            blocks=blocks,
            coefficients=self.fitted([*chosen, candidate], self.rows.fit)[
                -self.columns(candidate, self.rows.fit).shape[1] :
            ],
            share=gain / max(energy, 1e-300) if falls[0].sum() > 0 else 0.0,
        )

    def columns(self, candidate: Candidate, rows: Rows) -> Array:
        """(m, c) A: ``columns``, each computed once."""
        key = id(rows), candidate
        if key not in self.cache:
            self.cache[key] = columns(candidate, rows)
        return self.cache[key]

    def stacked(self, chosen: Sequence[Candidate], rows: Rows) -> Array:
        """(m, c) A: columns of several candidates, side by side."""
        return np.column_stack([np.empty((len(rows.residual), 0)), *(self.columns(c, rows) for c in chosen)])

    def fitted(self, chosen: Sequence[Candidate], rows: Rows) -> Array:
        """(c,) coefficients of the chosen candidates together."""
        return scaled_lstsq(self.stacked(chosen, rows), rows.residual)

    def residual(self, chosen: Sequence[Candidate], learned: Rows, judged: Rows) -> Array:
        """(m,) A: residual of ``judged`` with coefficients from ``learned``."""
        return np.asarray(judged.residual - self.stacked(chosen, judged) @ self.fitted(chosen, learned), float)

    def is_physical(self, candidate: Candidate, chosen: Sequence[Candidate]) -> bool:
        """Whether total friction opposes the motion at every speed, and all sizes are possible together.

        Gradual friction is the model's own: a share between none and all of it. Beside a candidate, the sizes of those
        that were chosen before may become impossible.
        """
        rows, together = self.rows.fit, [*chosen, candidate]
        coefficients = self.fitted(together, rows)
        ends = np.cumsum([self.columns(one, rows).shape[1] for one in together])
        possible = all(self._admitted(one, own) for one, own in zip(together, np.split(coefficients, ends[:-1])))
        return possible and (not candidate.definition.friction or self._opposes_motion(together, coefficients))

    def _admitted(self, candidate: Candidate, own: Array) -> bool:
        """Whether an effect other than friction can have these coefficients (k,)."""
        effect = candidate.definition
        if effect.friction:
            return True
        if effect.unit_amplitude:
            return self.limits.presliding[0] < float(own[-1]) < self.limits.presliding[1]
        values = candidate.parameters(of_true_current(candidate, own).tolist())
        return all(effect.admits(name, value) for name, value in values.items())

    def _opposes_motion(self, candidates: Sequence[Candidate], coefficients: Array) -> bool:
        """Whether friction is dissipative with all these candidates at these coefficients, up to the highest speed."""
        arm, at = self.rows.fit.arm, 0
        for candidate in candidates:
            count = self.columns(candidate, self.rows.fit).shape[1]
            if candidate.definition.friction:
                values = candidate.parameters(coefficients[at : at + count].tolist())
                arm = arm.with_effect(candidate.effect, candidate.joint, **values)
            at += count
        return not driven(arm, [max(float(np.abs(rows.v).max()) for rows in self.rows)])

    def holds_across_directions(self, candidate: Candidate, chosen: Sequence[Candidate]) -> bool:
        """Whether its contribution, estimated in one direction of motion, predicts the other, in both sets."""
        if candidate.definition.directional:
            return True
        for rows in self.rows:
            others, own = self.stacked(chosen, rows), self.columns(candidate, rows)
            before = rows.residual - others @ self.fitted(chosen, rows)
            own = own - others @ np.linalg.lstsq(others, own, rcond=1e-9)[0]
            for learned in (rows.v > 0, rows.v < 0):
                c = np.linalg.lstsq(own[learned], before[learned], rcond=1e-9)[0]
                judged = ~learned
                if np.sum((before[judged] - own[judged] @ c) ** 2) >= np.sum(before[judged] ** 2):
                    return False
        return True

    def _refined(self, candidate: Candidate, others: Sequence[Candidate]) -> Candidate:
        """Each nonlinear parameter at its best between its neighbours on the grid."""
        rows = self.rows.fit
        fixed = self.stacked(others, rows)

        def energy(trial: Candidate) -> float:
            x = np.column_stack([fixed, columns(trial, rows)])
            return float(np.sum((rows.residual - x @ scaled_lstsq(x, rows.residual)) ** 2))

        for name, value in candidate.shape:
            if candidate.definition[name].fixed:
                continue

            def worse(log_value: float, name: str = name, now: Candidate = candidate) -> float:
                return energy(now.at(name, float(np.exp(log_value))))

            reach = 2.0
            if candidate.definition.wave:
                # at least half a wave within the travel: over longer waves, neighbouring ones fit as well
                reach = 1.0 + np.pi / (value * rows.arm.joints[0].ratio * float(np.ptp(rows.q)))
            optimum = optimize.minimize_scalar(
                worse, bounds=(np.log(value / reach), np.log(value * reach)), method="bounded", options={"maxiter": 12}
            )
            if optimum.fun < worse(float(np.log(value))):
                candidate = candidate.at(name, float(np.exp(optimum.x)))
        return candidate
