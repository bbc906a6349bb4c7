"""Tracked points as a measurement model of the selection.

Screening is linear: about the present fit, what a candidate's columns and all that is free explain of the fit set,
judged on the held-out points. A candidate enters if its gain exceeds a share of what the points leave undetermined.
Refits are not linear, so that a strong effect leaves no residual that resembles another one. Significance is judged
when no candidate enters any more, conditional on all others: before, two effects of one size mask each other.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from arm_model.effects.tracking import LINK_GEOMETRY
from diagnosis.measurements.tracker.candidates import (
    GEOMETRY,
    TrackedCandidate,
    candidates,
    is_of_encoder,
    is_physical,
    yields,
)
from diagnosis.measurements.tracker.joint_fit import State, Survey, at_links, at_motors, fitted
from diagnosis.measurements.tracker.points import Side
from diagnosis.measurements.tracker.regression import by_block, columns_of, energy, linear, point_residual, squares
from identification.kinematics.estimation import stacked
from identification.selection import Limits, MeasurementModel, Score, Split, eliminate, p_value, select

AS_MOVED = 3
"""Refits at motors and links as chosen waves and springs move them: each leaves a tenth of the error or less."""


@dataclass(frozen=True, kw_only=True)
class TrackerLimits(Limits):
    """Gains are shares of the energy that the points leave undetermined (noise, encoder zeros).

    geometry_gain    share of that energy that each geometric error of a link must explain ...
    geometry_stds    ... and how many std it must be from zero
    zero_counts      counts of the encoder that a joint offset must exceed: counters are set to a count
    wrong_points     wrong points, or points missing in a row, from which on they are reported
    detectable       share of the std that the points leave undetermined by which an effect must move them
    structure_noise  residual over that std below which a residual is noise
    far_above_noise  ... and above which it is not noise though no variable predicts it
    structure_share  share of the residual energy that a variable must predict to be reported
    structure_p      its probability by chance
    """

    geometry_gain: float = 0.02
    geometry_stds: float = 2.0
    zero_counts: float = 2.5
    wrong_points: int = 3
    detectable: float = 1 / 3
    structure_noise: float = 1.3
    far_above_noise: float = 1.7
    structure_share: float = 0.1
    structure_p: float = 0.01


LIMITS = TrackerLimits(
    max_causes=8,
    fdr=None,
    final_fdr=0.05,
    min_gain=0.1,
    kept_gain=0.1,
    tie=0.02,
    # share of a cause's linear gain from which a rival is refitted in its place
    ambiguity=0.7,
    attempts=4,
    # covariances come from the fit
    systematic=0.0,
)


@dataclass(frozen=True)
class Accepted:
    """A chosen candidate with its ambiguity group.

    score   conditional on all others
    before  (N, 3) m: held-out residual without it, all others refitted
    """

    candidate: TrackedCandidate
    aliased: tuple[TrackedCandidate, ...]
    score: Score[TrackedCandidate]
    before: Array = field(repr=False)


@dataclass(frozen=True)
class TrackedPoints(MeasurementModel[TrackedCandidate, State]):
    """points: fit and held-out points; survey: what is known of frame and target.

    nominal  values of the chain at which fits start
    level    m: std of a coordinate that the points leave undetermined
    steps    (n,) rad of the encoders
    """

    arm: Arm
    points: Split[Side]
    survey: Survey
    nominal: Array
    level: float
    steps: Array
    every: tuple[TrackedCandidate, ...]
    limits: TrackerLimits = LIMITS

    @property
    def undetermined(self) -> float:
        """m2: energy of what the held-out points leave undetermined."""
        return 3 * len(self.points.held_out) * self.level**2

    def start(self) -> State:
        """Frame and target alone."""
        return self.refit(())

    def refit(self, chosen: Sequence[TrackedCandidate], near: State | None = None) -> State:
        """Candidates fitted together with frame and target, from the values of another state on."""
        start = self.nominal if near is None else near.values
        return fitted(self.arm, chosen, self.points.fit, self.survey, start=start)

    def as_moved(self, state: State) -> tuple[TrackedPoints, State]:
        """The points with motors and links where they are beside what is chosen, and the state refitted there.

        A wave repeats with the angle of the motor: over that which its encoder reads, it is too small, and bent. A
        spring carries the weight of a link where it is, not where the motor is.
        """
        model = self
        for _ in range(AS_MOVED if any(is_of_encoder(c) or yields(c) for c in state.chosen) else 0):
            moved = self.points.map(partial(at_motors, state, self.arm)).map(partial(at_links, state))
            model = replace(self, points=moved)
            state = model.refit(state.chosen, state)
        return model, state

    def precise(self, state: State) -> State:
        """The same candidates fitted together with the zeros of the encoders, for values and std."""
        return fitted(
            self.arm,
            state.chosen,
            self.points.fit,
            self.survey,
            start=state.values,
            steps=self.steps,
        )

    def chosen(self, state: State) -> Sequence[TrackedCandidate]:
        """The candidates of a state."""
        return state.chosen

    def scores(self, state: State) -> list[Score[TrackedCandidate]]:
        """Candidates that are not part of what is chosen, by what they do to first order."""
        return self.linear_scores([c for c in self.every if _new(c, state.chosen)], state)

    def admissible(self, score: Score[TrackedCandidate], state: State) -> bool:
        """Whether a candidate matters."""
        return score.gain > self.limits.min_gain * self.undetermined

    def tolerance(self, score: Score[TrackedCandidate], best: Score[TrackedCandidate]) -> float:
        """A share of what the points leave undetermined."""
        return self.limits.tie * self.undetermined

    def entered(
        self, score: Score[TrackedCandidate], admissible: Sequence[Score[TrackedCandidate]], state: State
    ) -> State | None:
        """All refitted with the candidate; None where it then gains too little, or is not physically admissible."""
        entering = _merged(score.candidate, state.chosen)
        after = self.refit([c for c in state.chosen if not _within(c, entering)] + [entering], state)
        held_out = self.points.held_out
        gain = energy(point_residual(state, held_out)) - energy(point_residual(after, held_out))
        enough = gain > self.limits.min_gain * self.undetermined
        return after if enough and is_physical(entering, after.coefficients(entering)[0]) else None

    def without(self, candidate: TrackedCandidate, state: State) -> State:
        """All others refitted."""
        return self.refit([c for c in state.chosen if c is not candidate], state)

    def conditional(self, candidate: TrackedCandidate, without: State, state: State) -> Score[TrackedCandidate]:
        """One candidate conditional on all others, refitted."""
        held_out = self.points.held_out
        blocks = by_block(
            squares(point_residual(without, held_out)) - squares(point_residual(state, held_out)), held_out
        )
        return _score(candidate, blocks, np.zeros(candidate.size))

    def needed(self, score: Score[TrackedCandidate], state: State) -> bool:
        """Whether it still matters."""
        return score.gain >= (self.limits.kept_gain or 0.0) * self.undetermined

    def linear_scores(self, every: Sequence[TrackedCandidate], state: State) -> list[Score[TrackedCandidate]]:
        """Gains m2 to first order about a fit, everything that is free refitted."""
        parts = self.points.map(lambda side: linear(state, side))
        noise, scores = state.estimate.noise, []
        for candidate in every:
            own = columns_of(candidate, state, self.points.fit, parts.fit)
            held = columns_of(candidate, state, self.points.held_out, parts.held_out)
            keep = parts.fit.good
            a = np.concatenate((parts.fit.free[keep], own[keep]), axis=2)
            flat = stacked(a) / noise
            step = np.linalg.solve(
                flat.T @ flat + np.eye(flat.shape[1]), flat.T @ (parts.fit.residual[keep].ravel() / noise)
            )
            before = parts.held_out.residual
            after = before - np.concatenate((parts.held_out.free, held), axis=2) @ step
            gains = np.where(parts.held_out.good, np.sum(before**2 - after**2, axis=1), 0.0)
            scores.append(
                _score(candidate, by_block(gains, self.points.held_out), np.asarray(step[-candidate.size :], float))
            )
        return scores

    def accepted(self, state: State) -> list[Accepted]:
        """The chosen candidates with their equals and gains, the largest gain first."""
        held_out = self.points.held_out
        enough = energy(point_residual(state, held_out)) + self.limits.tie * self.undetermined
        accepted = []
        for candidate in state.chosen:
            others = [c for c in state.chosen if c is not candidate]
            without = self.refit(others, state)
            (own,) = self.linear_scores([candidate], without)
            alike = [
                score.candidate
                for score in self.linear_scores([c for c in self.every if _new(c, others)], without)
                if score.gain > self.limits.ambiguity * own.gain
            ]
            rivals = [c for c in alike + _of_the_same_errors(alike, candidate) if c.key != candidate.key]
            aliased = [c for c in rivals if self._leaves_less(enough, c, others, without)]
            accepted.append(
                Accepted(candidate, _distinct([candidate, *aliased]), own, point_residual(without, held_out))
            )
        return sorted(accepted, key=lambda one: -one.score.gain)

    def _leaves_less(
        self, enough: float, rival: TrackedCandidate, others: Sequence[TrackedCandidate], without: State
    ) -> bool:
        """Whether a rival beside the other candidates is physical, and leaves less energy of held-out points."""
        swapped = self.refit([*others, rival], without)
        physical = is_physical(rival, swapped.coefficients(rival)[0])
        return physical and energy(point_residual(swapped, self.points.held_out)) < enough


def selected(model: TrackedPoints, progress: Callable[[str], None]) -> tuple[TrackedPoints, State]:
    """The candidates that matter and are significant conditional on all others, and the points at which they are.

    What a large wave is bent by over the angles read is gone at those of the motors, and no other candidate's.
    """
    model, state = model.as_moved(select(model, progress))
    return model, eliminate(model, state, fdr=model.limits.final_fdr, tests=len(model.every))


def tracked_points(
    arm: Arm,
    points: Split[Side],
    survey: Survey,
    *,
    nominal: Array,
    level: float,
    steps: Array,
) -> TrackedPoints:
    """The model of some points with every candidate of an arm."""
    return TrackedPoints(arm, points, survey, nominal, level, steps, tuple(candidates(arm)))


def _score(candidate: TrackedCandidate, blocks: Array, coefficients: Array) -> Score[TrackedCandidate]:
    return Score(
        candidate=candidate, gain=float(blocks.sum()), p=p_value(blocks), blocks=blocks, coefficients=coefficients
    )


def _new(candidate: TrackedCandidate, chosen: Sequence[TrackedCandidate]) -> bool:
    """Whether a candidate is neither chosen nor contained in a chosen one."""
    return not any(_within(candidate, c) for c in chosen)


def _merged(entering: TrackedCandidate, chosen: Sequence[TrackedCandidate]) -> TrackedCandidate:
    """With the geometric errors of the same link that are chosen already."""
    names = {name for c in chosen if c.key == entering.key for name in c.names}
    return replace(entering, names=tuple(name for name in GEOMETRY if name in names | set(entering.names)))


def _within(part: TrackedCandidate, whole: TrackedCandidate) -> bool:
    """Whether ``whole`` contains ``part``: the same candidate, or all of its values and more."""
    if part.names and whole.names:
        return set(part.values) <= set(whole.values)
    return part.key == whole.key


def _of_the_same_errors(alike: Sequence[TrackedCandidate], candidate: TrackedCandidate) -> list[TrackedCandidate]:
    """Other links with the geometric errors of the candidate only: with all five they would fit encoder zeros."""
    if candidate.effect != LINK_GEOMETRY.name:
        return []
    return [replace(c, names=candidate.names) for c in alike if c.effect == LINK_GEOMETRY.name]


def _distinct(aliased: Sequence[TrackedCandidate]) -> tuple[TrackedCandidate, ...]:
    """The first candidate of each effect and joint."""
    return tuple({c.key: c for c in reversed(aliased)}[key] for key in dict.fromkeys(c.key for c in aliased))
