"""Motor encoder less link encoder as a measurement model of the selection, where recordings have both.

Where both sets are parts of the same recordings, each part is predicted from the other, so that a short run has blocks
enough to judge by. A constant per joint is always free (no two encoders have the same zero) and named last, where it is
large.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from daq.recording import Recording
from diagnosis.cause import EffectKey
from diagnosis.measurements.link_encoders.columns import (
    Rows,
    candidates,
    columns,
    joints_with_both,
    rows_of,
    standing_waves,
    variant,
    width,
)
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.candidate_model import CandidateModel, Chosen
from identification.selection import BLOCK_SECONDS, Limits, Score, Split, p_value, scaled

LIMITS = Limits(
    max_causes=20,
    # of the squared difference that is left at a joint
    min_gain=0.2,
    kept_gain=0.1,
    # ... of what it explains in the place of a cause; conditional on the cause, less than the rest of this share
    ambiguity=0.95,
    # at most: blocks are twice as long as the residual is correlated, from SHORTEST on
    block_seconds=BLOCK_SECONDS,
)
OVER_NOISE = 3.0
"""Times the scatter from row to row: what is left below is noise."""
SHORTEST = 0.3
"""s: a run of ten seconds has few blocks of ``Limits.block_seconds``."""


@dataclass(frozen=True)
class LinkEncoders(CandidateModel):
    """rows: fit and held-out rows.

    Whole: the rows that parameters are estimated from: those of fit, or of two parts of the same recordings all.

    scale (k,) rad: spread of each joint's difference, so that joints weigh alike.
    """

    rows: Split[Rows]
    whole: Rows
    scale: Array
    limits: Limits = LIMITS
    cache: dict[tuple[int, Candidate, int], Array] = field(default_factory=dict, repr=False)

    def admissible(self, score: Score[Candidate], state: Chosen) -> bool:
        """Whether a candidate matters, also in the held-out set alone.

        It must do so where the residual is above the noise, and is physically admissible.
        """
        candidate = score.candidate
        return (
            score.share > self.limits.min_gain
            and self._ahead(candidate, state)
            and self._over_noise(candidate, state)
            and self.is_physical(candidate, state)
        )

    def entered(self, score: Score[Candidate], admissible: Sequence[Score[Candidate]], state: Chosen) -> Chosen:
        """With the candidate."""
        return (*state, score.candidate)

    def score(self, candidate: Candidate, chosen: Sequence[Candidate]) -> Score[Candidate]:
        """Gain in units of the joints' scales, and its share of what was left where the candidate is felt."""
        felt = self.felt(candidate)
        energy, correlated, falls = 0.0, 0.0, []
        for learned, judged in self.rows.folds():
            before, after = (
                self.residual(some, learned, judged)[:, felt] / self.scale[felt]
                for some in (chosen, [*chosen, candidate])
            )
            energy += float(np.sum(before**2))
            correlated = max(correlated, _correlated(after, float(judged.t[1] - judged.t[0])))
            falls.append((judged, before**2 - after**2))
        seconds = float(np.clip(2.0 * correlated, SHORTEST, self.limits.block_seconds))
        blocks = np.concatenate(
            [np.bincount(j.blocks(seconds), weights=fall) for j, falling in falls for fall in falling.T]
        )
        gain = float(blocks.sum())
        return Score(
            candidate=candidate,
            gain=gain,
            p=p_value(blocks),
            blocks=blocks,
            coefficients=np.zeros(width(candidate)),
            share=gain / max(energy, 1e-300),
        )

    def best(self, chosen: Sequence[Candidate]) -> list[Candidate]:
        """For each effect at each joint, the nonlinear parameter that fits best conditional on those chosen.

        a wave that is chosen may come again with another order only.
        """
        fit, everything = self.rows.fit, list(candidates(self.rows.fit))
        taken: set[EffectKey] = {c.key for c in chosen if variant(c)[0] != "order"}
        best: dict[EffectKey, tuple[float, Candidate]] = {}
        for k, joint in enumerate(int(j) for j in fit.joints):
            x = np.column_stack([np.ones(fit.rows), *(self.columns(c, fit, k) for c in chosen)])
            basis = np.linalg.qr(x / np.linalg.norm(x, axis=0))[0]
            residual = _off(basis, fit.difference[:, k])
            for candidate in [*everything, *standing_waves(residual, fit, k)]:
                key = candidate.key
                if candidate.joint != joint or key in taken or candidate in chosen:
                    continue
                own = _off(basis, self.columns(candidate, fit, k))
                gain = float(np.sum((np.linalg.qr(own)[0].T @ residual) ** 2))
                if key not in best or gain > best[key][0]:
                    best[key] = gain, candidate
        everywhere = [c for c in everything if c.joint is None and c.key not in taken]
        return everywhere + [candidate for _, candidate in best.values()]

    def columns(self, candidate: Candidate, rows: Rows, k: int) -> Array:
        """(m, c) rad: ``columns``, each computed once."""
        key = id(rows), candidate, k
        if key not in self.cache:
            self.cache[key] = columns(candidate, rows, k)
        return self.cache[key]

    def stacked(self, chosen: Sequence[Candidate], rows: Rows) -> Array:
        """(k m, c) columns over the joints' scales, joint after joint.

        a constant per joint, then those of every candidate.
        """
        joints = len(rows.joints)
        x = np.zeros((joints, rows.rows, joints + sum(map(width, chosen))))
        for k in range(joints):
            x[k, :, k] = 1.0
            at = joints
            for candidate in chosen:
                own = self.columns(candidate, rows, k)
                x[k, :, at : at + own.shape[1]] = own
                at += width(candidate)
            x[k] /= self.scale[k]
        return x.reshape(joints * rows.rows, -1)

    def response(self, rows: Rows) -> Array:
        """(k m,) differences over the joints' scales, joint after joint."""
        return np.asarray((rows.difference / self.scale).T.ravel(), float)

    def fitted(self, chosen: Sequence[Candidate], rows: Rows) -> Array:
        """(c,) coefficients of all joints together."""
        x, size = scaled(self.stacked(chosen, rows))
        coefficients: Array = np.linalg.lstsq(x.T @ x, x.T @ self.response(rows), rcond=1e-11)[0] / size
        return coefficients

    def residual(self, chosen: Sequence[Candidate], learned: Rows, judged: Rows) -> Array:
        """(m, k) rad: difference of ``judged`` less what is predicted from ``learned``; its own constant is free."""
        predicted = (self.stacked(chosen, judged) @ self.fitted(chosen, learned)).reshape(len(judged.joints), -1).T
        residual = judged.difference - predicted * self.scale
        return np.asarray(residual - residual.mean(axis=0), float)

    def is_physical(self, candidate: Candidate, chosen: Sequence[Candidate]) -> bool:
        """Whether a compliance or a gap comes out positive."""
        effect = candidate.definition
        return (effect.spring is None and effect.gap is None) or bool(
            self.fitted([*chosen, candidate], self.rows.fit)[-1] > 0.0
        )

    def felt(self, candidate: Candidate) -> list[int]:
        """Columns of the difference (from 0) in which a candidate shows."""
        return [k for k, joint in enumerate(self.rows.fit.joints) if candidate.joint in (None, joint)]

    def _ahead(self, candidate: Candidate, chosen: Sequence[Candidate]) -> bool:
        felt = self.felt(candidate)
        before, after = (
            float(np.sum((self.residual(some, *self.rows)[:, felt] / self.scale[felt]) ** 2))
            for some in (chosen, [*chosen, candidate])
        )
        return before > after

    def _over_noise(self, candidate: Candidate, chosen: Sequence[Candidate]) -> bool:
        felt = self.felt(candidate)
        rms = np.sqrt(np.mean(self.residual(chosen, *self.rows) ** 2, axis=0))
        return bool(np.any(rms[felt] > OVER_NOISE * self.rows.fit.noise[felt]))


def link_encoders(arm: Arm, fit: Sequence[Recording], held_out: Sequence[Recording]) -> LinkEncoders | None:
    """The model of some recordings; None where no joint has a link encoder in all of them."""
    joints = joints_with_both([*fit, *held_out])
    if len(joints) == 0:
        return None
    two_fold = bool({r.path for r in fit} & {r.path for r in held_out})
    every = rows_of([*fit, *held_out], arm, joints)
    rows = Split(fit, held_out, two_fold).map(lambda part: replace(rows_of(part, arm, joints), largest=every.largest))
    scale = np.maximum(np.std(every.difference, axis=0), rows.fit.noise)
    return LinkEncoders(rows, every if two_fold else rows.fit, scale)


def _off(basis: Array, values: Array) -> Array:
    return values - basis @ (basis.T @ values)


def _correlated(residual: Array, dt: float) -> float:
    """s over which the column of ``rest`` (m, k) that does so longest is correlated to more than 1 / e."""
    residual = residual - residual.mean(axis=0)
    power = np.abs(np.fft.rfft(residual, 2 * len(residual), axis=0)) ** 2
    with_itself = np.fft.irfft(power, axis=0)[: len(residual)]
    return float(np.max(np.argmax(with_itself < np.exp(-1.0) * with_itself[0], axis=0))) * dt
