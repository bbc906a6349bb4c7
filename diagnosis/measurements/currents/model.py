"""The currents of all joints as a measurement model of the selection: candidates, their scores, and what may enter."""

from __future__ import annotations

from collections.abc import Sequence, Set
from dataclasses import dataclass, field, replace
from functools import cached_property

from arm_io.parallel import in_parallel
from arm_io.types import Array
from arm_model import Arm
from arm_model.effects import same_columns
from diagnosis.cause import EffectKey
from diagnosis.measurements.currents.design_matrix import Library, columns_of
from diagnosis.measurements.currents.limits import LIMITS, CurrentLimits, leakage, matters
from diagnosis.measurements.currents.long_delays import long_delays
from diagnosis.measurements.currents.model_errors import ModelUncertainty
from diagnosis.measurements.currents.pairs import pair_of
from diagnosis.measurements.currents.possible import is_physical
from diagnosis.measurements.currents.refinement import refined
from diagnosis.measurements.currents.replacement.exchange import exchanged
from diagnosis.measurements.currents.replacement.next_orders import rival_with_term
from diagnosis.measurements.currents.state import Rivals, State, corrected
from diagnosis.measurements.currents.structure.noise_ratio import joints_above_noise
from diagnosis.selection.bodies import body_of, likely_share, link_of
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.design import Dataset, Pair
from diagnosis.selection.harmonics import is_further_order, is_of_ripple
from diagnosis.selection.next_order import next_orders, of_last_term, term_share
from diagnosis.selection.regression import SPARSE_P, Fitted, best_of_each, score
from diagnosis.selection.ripple_orders import detectable
from diagnosis.selection.unseen_inertia import explained, unseen_inertia
from identification.selection import MeasurementModel, Score, Split, p_value

CONFIRMED = 0.05
"""Probability of a held-out gain by chance below which it confirms what all recordings show together."""


@dataclass(frozen=True)
class Currents(MeasurementModel[Candidate, State]):
    """Residuals under the model as given, all candidates' columns, and the columns that are always free.

    ripples   candidates whose columns are computed only for the strongest orders of the residual
    excluded  effects that may not be chosen
    extended  columns of candidates with next-order terms, which are candidates only once their effect is chosen, and of
              bodies with smaller coefficients
    uncertain what is known of the model, if it says so
    """

    arm: Arm
    data: Split[Dataset]
    library: Library
    free: Sequence[Pair]
    ripples: tuple[Candidate, ...] = ()
    excluded: Set[EffectKey] = frozenset()
    uncertain: ModelUncertainty | None = None
    limits: CurrentLimits = LIMITS
    extended: dict[Candidate, Pair] = field(default_factory=dict, repr=False)

    def start(self) -> State:
        """Nothing chosen."""
        return State(self, (), self.data, {})

    def chosen(self, state: State) -> Sequence[Candidate]:
        """The candidates of a state."""
        return state.chosen

    def scores(self, state: State) -> list[Score[Candidate]]:
        """Every effect at every joint, at the nonlinear parameters that fit best; the largest gain first."""
        self._add_ripples(state.residual.fit)
        long = long_delays(self.library, state.fitted, self.taken(state))
        self.library.compute_grids()
        every = [c for c in self.library if not c.about or c in long]
        best = best_of_each(every, self.library.where_shown, state.fitted, self.taken(state))
        self.library.compute(best)
        best = [self._with_likely_sizes(c, state.fitted) for c in best]
        scores = [self.scored(c, self.columns(c), state) for c in best]
        scores += [
            self.scored(alone, self._of_column(c, k), state) for c in best for k, alone in enumerate(c.single_sizes())
        ]
        scores += [
            self.scored(body, self._of_inertia(body), state)
            for body in (body_of(c) for c in state.chosen if not c.body)
            if body is not None
        ]
        scores += [
            self.scored(c, of_last_term(self.columns(c)), state)
            for k, (chosen, own) in enumerate(zip(state.chosen, state.coefficients))
            if not is_further_order(chosen, state.chosen[:k])
            for c in next_orders(chosen, own, self.seconds)
        ]
        scores += [
            self.scored(c, self.library[c], state)
            for c in self.library
            if is_further_order(c, state.chosen) and c.key not in self.excluded
        ]
        return sorted(scores, key=lambda score: -score.gain * (1.0 + LIMITS.family * self._of_chosen(score, state)))

    def scored(self, candidate: Candidate, pair: Pair, state: State) -> Score[Candidate]:
        """A candidate of these columns conditional on those chosen.

        The signs of few held-out blocks may agree by chance. Where they confirm an effect of the whole arm, its
        probability by chance is that of all recordings together (Wald test), without the joint that shows it most: what
        another law leaves at a joint is at no other.
        """
        own = score(candidate, pair, state.fitted, state.data.held_out)
        if candidate.joint is not None or own.gain <= 0.0 or not SPARSE_P < own.p < CONFIRMED:
            return own
        chances = []
        for joint in range(1, len(self.arm) + 1):
            fit, held_out = (columns.without(side.of(joint)) for columns, side in zip(pair, self.data))
            chances.append(state.significance.chance(Split(fit, held_out), candidate))
        return replace(own, p=min(own.p, max(chances)))

    def _of_chosen(self, score: Score[Candidate], state: State) -> bool:
        """Whether a candidate extends an effect that is already chosen; at equal gain it precedes a new effect."""
        return bool(score.candidate.terms) or is_of_ripple(score.candidate, state.chosen, self.arm)

    def extends(self, score: Score[Candidate]) -> bool:
        """Whether a candidate is a chosen effect with a next-order term of its law."""
        return bool(score.candidate.terms)

    def tolerance(self, score: Score[Candidate], best: Score[Candidate]) -> float:
        """Gain by which a score may fall short of the best and still count as equal to it.

        It is a share of the gain for every coefficient that the best has more (counting only those that the data
        determine), and no less than the noise decides.
        """
        more = max(1, best.determined - score.determined)
        return max(LIMITS.tie * best.gain * more, LIMITS.tie_floor * self.data.held_out.rows)

    def admissible(self, score: Score[Candidate], state: State) -> bool:
        """Whether a candidate is physically admissible, matters, and is beyond what is known of the model.

        Whether a body is one is decided when all causes are known (``search.attributed_to_body``).
        """
        if score.candidate.terms:
            return self.needed(score, state) and self.is_next_order(score, state)
        physical = score.candidate.body or is_physical(score.candidate, score.coefficients)
        if not (physical and self.needed(score, state)):
            return False
        return score.candidate.body or state.significance.beyond_model(self.columns(score.candidate), score.candidate)

    def needed(self, score: Score[Candidate], state: State) -> bool:
        """Whether the gain is large against the noise.

        Above what may have leaked from the chosen ones, and what sampling may have put onto the acceleration unseen.
        """
        held_out, count = state.data.held_out, len(score.coefficients)
        allowance = leakage(held_out, state.fitted)
        if not matters(score.by_joint, count, allowance, held_out):
            return False
        if not self._unseen.any():
            return True
        unseen = explained(self._unseen, self.columns(score.candidate).held_out, held_out)
        return matters(score.by_joint - unseen, count, allowance, held_out)

    def entered(self, score: Score[Candidate], admissible: Sequence[Score[Candidate]], state: State) -> State:
        """With the candidate refined.

        Its rivals are those that gain as much, or that the blocks do not distinguish from it.
        """
        rivals = self._rivals(score, admissible)
        if score.candidate.terms:
            before = next(c for c in state.chosen if c.key == score.candidate.key)
            sharp = refined(score.candidate, self.without(before, state).fitted, self.data.fit)
            return state.replaced(before, sharp)
        if score.candidate.body:
            return self._with_body(score.candidate, rivals, state)
        if is_further_order(score.candidate, state.chosen):
            return replace(state, chosen=(*state.chosen, score.candidate))
        sharp = refined(score.candidate, state.fitted, self.data.fit)
        return State(self, (*state.chosen, sharp), state.data, {**state.rivals, sharp.key: rivals})

    def _rivals(self, score: Score[Candidate], admissible: Sequence[Score[Candidate]]) -> list[Score[Candidate]]:
        best = max(admissible, key=lambda one: one.gain)
        fewest = score.determined
        return [
            one
            for one in admissible
            if (one.gain >= best.gain - self.tolerance(one, best) and one.determined <= fewest)
            or (one.gain > LIMITS.ambiguity * best.gain and p_value(score.blocks - one.blocks) > LIMITS.ambiguity_p)
        ]

    def rivals_of(self, candidate: Candidate, state: State) -> list[Score[Candidate]]:
        """The candidates that would gain as much as a chosen one in its place."""
        own, every = self._in_place_of(candidate, state)
        return self._rivals(own, [own, *every])

    def nearly_rivals_of(self, candidate: Candidate, state: State) -> list[Score[Candidate]]:
        """The candidates that gain nearly as much in the place of a chosen one, to first order; the exact law decides.

        So large an angle as 0.25 rad gains 98 % of what it does by its exact law.
        """
        own, every = self._in_place_of(candidate, state)
        return [one for one in every if one.gain > LIMITS.ambiguity * own.gain]

    def _in_place_of(self, candidate: Candidate, state: State) -> tuple[Score[Candidate], list[Score[Candidate]]]:
        """A chosen candidate, and all of other effects that are admissible in its place."""
        others = self.without(candidate, state)
        every = [one for one in self.scores(others) if one.candidate.key != candidate.key]
        own = self.conditional(candidate, others, state)
        return own, [one for one in every if self.admissible(one, others)]

    def stalled(self, state: State) -> State | None:
        """The state with two effects that enter together because each hides the other, or with a cause exchanged."""
        joints = joints_above_noise(state.residual.held_out, state.data.held_out, self.arm)
        both = pair_of(self.library, state.fitted, state.data, joints, self.taken(state))
        if not both:
            # a residual that one law leaves in the fitted recordings only may also be explained by another law
            in_fit = joints_above_noise(state.residual.fit, state.data.fit, self.arm)
            return rival_with_term(state, {*joints, *in_fit}) or exchanged(state)
        held_out = state.data.held_out
        alone = {c.key: [score(c, self.library[c], state.fitted, held_out)] for c in both}
        return State(self, (*state.chosen, *both), state.data, {**state.rivals, **alone})

    def without(self, candidate: Candidate, state: State) -> State:
        """Without the candidate, the data as it is."""
        return replace(state, chosen=tuple(c for c in state.chosen if c is not candidate))

    def conditional(self, candidate: Candidate, without: State, state: State) -> Score[Candidate]:
        """One candidate conditional on all others."""
        return self.scored(candidate, self.columns(candidate), without)

    def after_round(self, state: State) -> State:
        """The data corrected by the exact model of the chosen."""
        for c in (c for c in state.chosen if c.link_parameters):
            state = state.replaced(c, self._with_likely_sizes(c, self.without(c, state).fitted))
        return corrected(state)

    def columns(self, candidate: Candidate) -> Pair:
        """Columns of a candidate, each computed once."""
        if candidate.body:
            return self.columns(link_of(candidate, self.arm))
        if candidate.expected != 1.0:
            if candidate not in self.extended:
                every = self.columns(replace(candidate, expected=1.0))
                self.extended[candidate] = every.map(lambda own: own.expecting(candidate.expected))
            return self.extended[candidate]
        if not candidate.terms:
            self.library.add(candidate)
            return self.library[candidate]
        if candidate not in self.extended:
            self.extended[candidate] = self.data.map(lambda data: columns_of(candidate, data))
        return self.extended[candidate]

    def refitted(self, chosen: Sequence[Candidate], rivals: Rivals) -> State:
        """Other candidates, the data corrected from the start."""
        state = State(self, tuple(chosen), self.data, rivals)
        return corrected(state) if chosen else state

    def is_next_order(self, score: Score[Candidate], state: State) -> bool:
        """Whether a term explains no more than a next order of what its effect and it explain together."""
        chosen = next(c for c in state.chosen if c.key == score.candidate.key)
        alone = self.conditional(chosen, self.without(chosen, state), state).gain
        return score.gain <= term_share(score.candidate) * (alone + score.gain)

    @cached_property
    def _unseen(self) -> Array:
        """(n rows,) of the held-out recordings."""
        return unseen_inertia(self.data.held_out.runs)

    @property
    def seconds(self) -> float:
        """s of the longest recording."""
        return max(float(run.t[-1]) for part in self.data for run in part.runs)

    def _of_inertia(self, body: Candidate) -> Pair:
        """The columns of a body's inertia, which a mass point does not have."""
        first = body.definition.link_parameters
        return self.columns(body).map(lambda own: own.of(columns=slice(first, None)))

    def _with_likely_sizes(self, candidate: Candidate, fitted: Fitted) -> Candidate:
        """A body with the most likely scale of its coefficients conditional on those fitted; others as they are."""
        if not candidate.link_parameters:
            return candidate
        every = self.columns(replace(candidate, expected=1.0)).fit
        return replace(candidate, expected=likely_share(every, fitted, self.data.fit.runs[0].alike))

    def _of_column(self, candidate: Candidate, k: int) -> Pair:
        """One column of a candidate."""
        return self.columns(candidate).map(lambda own: own.of(columns=slice(k, k + 1)))

    def _with_body(self, body: Candidate, rivals: Sequence[Score[Candidate]], state: State) -> State:
        """With a body in the place of the mass point."""
        chosen = tuple(body if c.key == body.key else c for c in state.chosen)
        return State(self, chosen, state.data, {**state.rivals, body.key: [*state.rivals[body.key], *rivals]})

    def taken(self, state: State) -> set[EffectKey]:
        """Keys of the excluded and the chosen candidates and of their aliases.

        An effect together with its alias would explain anything, because the difference of the two is free.
        """
        aliases = {(other, c.joint) for c in state.chosen for other in same_columns(c.definition)}
        return {c.key for c in state.chosen} | aliases | set(self.excluded)

    def _add_ripples(self, residual: Array) -> None:
        """Adds the strongest ripples of the whitened residual of the fit set to the library."""

        def of_joint(joint: int) -> list[Candidate]:
            own = [c for c in self.ripples if c.joint == joint]
            return detectable(self.data.fit, residual, self.arm, joint, own)

        for strongest in in_parallel(of_joint, sorted({c.joint for c in self.ripples if c.joint})):
            for c in strongest:
                self.library.add(c)
