"""Motor minus link encoder as a measurement model of the selection, where recordings have both.

Where both sets are parts of the same recordings, each part is predicted from the other, so that a short run has enough
blocks. A constant per joint is always free (no two encoders have the same zero) and named last, where it is large.
"""

from __future__ import annotations

from collections.abc import Sequence, Set
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import block_diag

from arm_io.types import Array
from arm_model import Arm
from daq.recording import Recording
from diagnosis.cause import EffectKey
from diagnosis.measurements.link_encoders.candidates import LOWEST_ORDER, LinkCandidate, candidates, standing_waves
from diagnosis.measurements.link_encoders.columns import columns
from diagnosis.measurements.link_encoders.model_errors import directions
from diagnosis.measurements.link_encoders.rows import Rows, joints_with_both, rows_of
from diagnosis.selection.beyond_model import BEYOND_MODEL, Evidence
from diagnosis.selection.candidate_model import CandidateModel
from identification.selection import BLOCK_SECONDS, Limits, Score, Split, p_value, scaled

Chosen = tuple[LinkCandidate, ...]


@dataclass(frozen=True, kw_only=True)
class LinkLimits(Limits):
    """Gains are shares of the squared residual at a joint.

    above_noise     residual over the scatter from row to row below which a residual is noise
    shortest_block  s: blocks are twice as long as the residual is correlated, from this length on to ``block_seconds``,
                    of which a run of ten seconds has few
    offset          rad (m): least constant between two encoders that is named; a smaller one is how they were zeroed
    offset_stds     ... and how many std it must be from zero
    predicted       share of the residual energy that one variable must predict to be reported
    beyond_model    probability that an effect looks as it does while only the load moves, within what is known of it
    """

    above_noise: float = 3.0
    shortest_block: float = 0.3
    offset: float = 1e-3
    offset_stds: float = 5.0
    predicted: float = 0.3
    beyond_model: float = BEYOND_MODEL


LIMITS = LinkLimits(
    max_causes=20,
    min_gain=0.2,
    kept_gain=0.1,
    # a rival explains this share of what a cause does; conditional on the cause, less than the rest of it
    ambiguity=0.95,
    block_seconds=BLOCK_SECONDS,
)
MOST = 0.5
"""Share of the squares left at a joint that a wave slower than LOWEST_ORDER must explain: of any smooth error it
explains some."""


@dataclass(frozen=True)
class LinkEncoders(CandidateModel[LinkCandidate]):
    """The difference of motor and link encoders of k joints.

    rows   of the fit set and of the held-out set
    recordings  rows of every recording alone
    whole  rows from which parameters are estimated: those of the fit set; all, of two parts of the same recordings
    scale  (k,) rad: std of the difference of each joint, so that joints have equal weight
    excluded  effects that may not be chosen
    """

    rows: Split[Rows]
    recordings: tuple[Rows, ...]
    whole: Rows
    scale: Array
    limits: LinkLimits = LIMITS
    excluded: Set[EffectKey] = frozenset()
    cache: dict[tuple[int, LinkCandidate, int], Array] = field(default_factory=dict, repr=False)

    def admissible(self, score: Score[LinkCandidate], state: Chosen) -> bool:
        """Whether a candidate matters, also in the held-out set alone and above the noise, and is admissible."""
        candidate = score.candidate
        return (
            score.share > self.limits.min_gain
            and self._ahead(candidate, state)
            and self._over_noise(candidate, state)
            and self.is_physical(candidate, state)
            and self.beyond_model(candidate, state)
        )

    def beyond_model(self, candidate: LinkCandidate, others: Chosen) -> bool:
        """Whether a candidate is significant with the masses of the model free; always with them exact."""
        return not self.knows_errors or self.chance(candidate, others) < self.limits.beyond_model

    @property
    def knows_errors(self) -> bool:
        """Whether the model says how well its masses are known."""
        return self.rows.fit.load_errors.shape[2] > 0

    def chance(self, candidate: LinkCandidate, others: Chosen, *, exact: bool = False) -> float:
        """p-value of a candidate, conditional on others.

        exact: were the masses so. Each recording set has constants of its own.
        """
        chosen = (*others, candidate)
        coefficients = self.fitted(chosen, self.rows.fit)
        parts: list[tuple[Array, ...]] = []
        for side in self.rows:
            noise = np.repeat(side.noise, side.rows)[:, None]
            x = self.stacked(chosen, side) * np.repeat(self.scale, side.rows)[:, None] / noise
            errors = directions(chosen, coefficients, side)
            parts.append(
                (
                    self.response(chosen, side) * np.repeat(self.scale, side.rows) / noise[:, 0],
                    x,
                    errors.reshape(len(noise), -1) / noise * (not exact),
                    np.tile(side.blocks(self.limits.block_seconds), len(side.joints)),
                )
            )
        y, columns, errors_of_model, block = zip(*parts)
        joints, width = len(self.rows.fit.joints), candidate.width
        free = np.hstack([block_diag(*(one[:, :joints] for one in columns)), np.concatenate(columns)[:, joints:-width]])
        blocks = np.concatenate([block[0], block[1] + int(block[0].max()) + 1])
        evidence = Evidence(np.concatenate(y), free, np.concatenate(errors_of_model), blocks)
        return evidence.chance(np.concatenate(columns)[:, -width:])

    def allowed(self, chosen: Chosen, rows: Rows) -> Array:
        """(k,) times the noise that differences may be by errors of the load behind ``chosen``: 1 if it is exact."""
        errors = directions(chosen, self.fitted(chosen, self.rows.fit), rows)
        return np.asarray(np.sqrt(1.0 + np.mean(np.sum(errors**2, axis=2), axis=1) / rows.noise**2))

    def score(self, candidate: LinkCandidate, chosen: Sequence[LinkCandidate]) -> Score[LinkCandidate]:
        """Gain in units of the joints' scales, and its share of what was left where the candidate acts."""
        affected = self.affected(candidate)
        energy, correlated, falls = 0.0, 0.0, []
        for learned, judged in self.rows.folds():
            before, after = (
                self.residual(some, learned, judged, self.counted([*chosen, candidate], judged))[:, affected]
                / self.scale[affected]
                for some in (chosen, [*chosen, candidate])
            )
            energy += float(np.sum(before**2))
            correlated = max(correlated, _correlated(after, float(judged.t[1] - judged.t[0])))
            falls.append((judged, before**2 - after**2))
        seconds = float(np.clip(2.0 * correlated, self.limits.shortest_block, self.limits.block_seconds))
        blocks = np.concatenate(
            [np.bincount(j.blocks(seconds), weights=fall) for j, falling in falls for fall in falling.T]
        )
        gain = float(blocks.sum())
        return Score(
            candidate=candidate,
            gain=gain,
            p=p_value(blocks),
            blocks=blocks,
            coefficients=np.zeros(candidate.width),
            share=gain / max(energy, 1e-300),
        )

    def best(self, chosen: Sequence[LinkCandidate]) -> list[LinkCandidate]:
        """For each effect at each joint, the nonlinear parameters that fit best conditional on those chosen.

        A ripple may be chosen several times, with different orders; of slow ones, the best is one more candidate if it
        explains ``MOST`` of what is left at the joint, since they also follow what is smooth.
        """
        fit, everything = self.rows.fit, list(candidates(self.rows.fit))
        taken: set[EffectKey] = {c.key for c in chosen if c.variant[0] != "order"} | set(self.excluded)
        best: dict[tuple[EffectKey, bool], tuple[float, LinkCandidate]] = {}
        for k, joint in enumerate(int(j) for j in fit.joints):
            x = np.column_stack([np.ones(fit.rows), *(self.columns(c, fit, k) for c in chosen)])
            length = np.linalg.norm(x, axis=0)
            # a coupling has ratios that turn other axes
            basis = np.linalg.qr(x[:, length > 0.0] / length[length > 0.0])[0]
            residual = _off(basis, fit.difference[:, k])
            for candidate in [*everything, *standing_waves(residual, fit, k)]:
                key = candidate.key
                if candidate.joint != joint or key in taken or candidate in chosen:
                    continue
                orthogonal = _off(basis, self.columns(candidate, fit, k))
                gain = float(np.sum((np.linalg.qr(orthogonal)[0].T @ residual) ** 2))
                slow = candidate.variant[0] == "order" and candidate.variant[1] < LOWEST_ORDER
                if slow and gain < MOST * float(residual @ residual):
                    continue
                if (key, slow) not in best or gain > best[key, slow][0]:
                    best[key, slow] = gain, candidate
        everywhere = [c for c in everything if c.joint is None and c.key not in taken]
        return everywhere + [candidate for _, candidate in best.values()]

    def columns(self, candidate: LinkCandidate, rows: Rows, k: int) -> Array:
        """(m, c) rad: ``columns``, each computed once."""
        key = id(rows), candidate, k
        if key not in self.cache:
            self.cache[key] = columns(candidate, rows, k)
        return self.cache[key]

    def stacked(self, chosen: Sequence[LinkCandidate], rows: Rows) -> Array:
        """(k m, c) columns over the joints' scales, joint after joint: a constant per joint, then the candidates."""
        joints = len(rows.joints)
        x = np.zeros((joints, rows.rows, joints + sum(c.width for c in chosen)))
        for k in range(joints):
            x[k, :, k] = 1.0
            at = joints
            for candidate in chosen:
                of_candidate = self.columns(candidate, rows, k)
                x[k, :, at : at + of_candidate.shape[1]] = of_candidate
                at += candidate.width
            x[k] /= self.scale[k]
        return np.asarray(x.reshape(joints * rows.rows, -1) * self.counted(chosen, rows).T.reshape(-1, 1), float)

    def response(self, chosen: Sequence[LinkCandidate], rows: Rows) -> Array:
        """(k m,) differences over the joints' scales, joint after joint; 0 in rows that do not count."""
        return np.asarray((rows.difference / self.scale * self.counted(chosen, rows)).T.ravel(), float)

    def counted(self, chosen: Sequence[LinkCandidate], rows: Rows) -> Array:
        """(m, k) 1 in rows that count, 0 where a link without load is anywhere in a chosen gap."""
        counted = np.ones(rows.difference.shape)
        for candidate in chosen:
            if candidate.variant[0] == "by_load":
                counted *= rows.borne | (rows.joints != candidate.joint)
        return counted

    def fitted(self, chosen: Sequence[LinkCandidate], rows: Rows) -> Array:
        """(c,) coefficients of all joints together."""
        x, size = scaled(self.stacked(chosen, rows))
        coefficients: Array = np.linalg.lstsq(x.T @ x, x.T @ self.response(chosen, rows), rcond=1e-11)[0] / size
        return coefficients

    def residual(
        self, chosen: Sequence[LinkCandidate], learned: Rows, judged: Rows, counted: Array | None = None
    ) -> Array:
        """(m, k) rad: difference of ``judged`` less what is predicted from ``learned``; its own constant is free.

        0 in rows that do not count (``counted``, of ``chosen`` if not given).
        """
        counted = self.counted(chosen, judged) if counted is None else counted
        predicted = (self.stacked(chosen, judged) @ self.fitted(chosen, learned)).reshape(len(judged.joints), -1).T
        residual = (judged.difference - predicted * self.scale) * counted
        return np.asarray(residual - counted * residual.sum(axis=0) / np.maximum(counted.sum(axis=0), 1.0), float)

    def is_physical(self, candidate: LinkCandidate, chosen: Sequence[LinkCandidate]) -> bool:
        """Whether the fitted compliance or gap is positive."""
        effect = candidate.definition
        return (effect.spring is None and effect.gap is None) or bool(
            self.fitted([*chosen, candidate], self.rows.fit)[-1] > 0.0
        )

    def affected(self, candidate: LinkCandidate) -> list[int]:
        """Columns of the difference (from 0) in which a candidate shows."""
        joints: list[int] = self.rows.fit.joints.tolist()
        axes = {axis for axis, _ in candidate.turns} or {candidate.joint or joint for joint in joints}
        return [k for k, joint in enumerate(joints) if joint in axes]

    def _ahead(self, candidate: LinkCandidate, chosen: Sequence[LinkCandidate]) -> bool:
        affected, counted = self.affected(candidate), self.counted([*chosen, candidate], self.rows.held_out)
        before, after = (
            float(
                np.sum(
                    (
                        self.residual(some, self.rows.fit, self.rows.held_out, counted)[:, affected]
                        / self.scale[affected]
                    )
                    ** 2
                )
            )
            for some in (chosen, [*chosen, candidate])
        )
        return before > after

    def _over_noise(self, candidate: LinkCandidate, chosen: Sequence[LinkCandidate]) -> bool:
        affected = self.affected(candidate)
        rms = np.sqrt(np.mean(self.residual(chosen, *self.rows) ** 2, axis=0))
        return bool(np.any(rms[affected] > self.limits.above_noise * self.rows.fit.noise[affected]))


def link_encoders(arm: Arm, recordings: Split[Sequence[Recording]]) -> LinkEncoders | None:
    """The model of some recordings; None where no joint has a link encoder in all of them."""
    every = [*recordings.fit, *recordings.held_out]
    joints = joints_with_both(every, arm)
    if len(joints) == 0:
        return None
    all_rows = rows_of(every, arm, joints)
    # of all recordings: where a joint stands, neither its load nor the noise of its encoders shows
    rows = recordings.map(
        lambda part: replace(rows_of(part, arm, joints), largest=all_rows.largest, noise=all_rows.noise)
    )
    scale = np.maximum(np.std(all_rows.difference, axis=0), rows.fit.noise)
    each = tuple(all_rows.of(name) for name in dict.fromkeys(all_rows.names))
    return LinkEncoders(rows, each, all_rows if rows.two_fold else rows.fit, scale)


def _off(basis: Array, values: Array) -> Array:
    return values - basis @ (basis.T @ values)


def _correlated(residual: Array, dt: float) -> float:
    """s: longest correlation time of the columns of a residual (m, k), to 1 / e."""
    residual = residual - residual.mean(axis=0)
    power = np.abs(np.fft.rfft(residual, 2 * len(residual), axis=0)) ** 2
    with_itself = np.fft.irfft(power, axis=0)[: len(residual)]
    return float(np.max(np.argmax(with_itself < np.exp(-1.0) * with_itself[0], axis=0))) * dt
