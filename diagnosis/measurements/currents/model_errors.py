"""Whether an effect is beyond what is known of the model, in the currents.

A model that was identified is known to a covariance (``arm_model.tables.uncertainty``). Its parameters are nuisances
with a Gaussian prior (``diagnosis.selection.beyond_model``): one direction per independent error, (currents per unit of
the parameters) (root of their covariance). The covariance of an effect's coefficients has three parts: the noise,
clustered by block (Liang & Zeger, 1986); the prior; and what the model left over on the recordings that it was
identified from, of which any one effect may explain ``ALIASED_SHARE``, or as much as it did then, where that is known
(``diagnosis.remainder.aliased_shares``); a ripple what one of all orders does by chance, where the strongest did as
much as it did.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from arm_io.types import Array
from arm_model import Arm, parameter, with_parameters
from arm_model.effects import described
from arm_model.rigid_body.regressor import regressor
from arm_model.system import inverse_dynamics
from arm_model.tables import Uncertainty
from diagnosis.another_day import friction_beyond, friction_near_rest, known_on_another_day
from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.measurements.currents.structure.unseen_friction import unseen_by_joint
from diagnosis.residual.run import Run
from diagnosis.selection.beyond_model import Evidence
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.design import Dataset, Pair
from diagnosis.selection.ripple_orders import independent_orders, joint_of_ripple
from identification.selection import Split

ALIASED_SHARE = 0.1
"""Share of what a model left over that any one effect may explain, though nothing changed, if no more is known."""


@dataclass(frozen=True)
class ModelUncertainty:
    """Of an identified model, in the whitened residuals of some recordings.

    directions  (N, r), (M, r): change of the residual for one standard deviation of each independent error, on another
                day than that of the identification
    left_over   (n,) squared residual per row, in units of the noise, that the model left when it was identified
    rippled     (n,) share of it that either wave of a ripple of that joint may explain; None: as any effect
    orders      (n,) number of orders of such ripples, of which a diagnosis takes the strongest
    of_day      (N, r) of the fitted recordings, by the stated covariance alone; None: as ``directions``
    aliased     share of it that an effect may explain, by its name (``named``); of others: ``ALIASED_SHARE``
    """

    directions: Split[Array]
    left_over: Array
    of_day: Array | None = None
    rippled: Array | None = None
    orders: Array | None = None
    aliased: Mapping[str, float] = field(default_factory=dict)

    @property
    def stated(self) -> Array:
        """(N, r) of the fitted recordings, of the day of the identification: without what varies from day to day."""
        return self.directions.fit if self.of_day is None else self.of_day

    def shares(self, data: Split[Dataset]) -> Split[Array]:
        """(n,) squared residual per row that the uncertainty of the parameters makes, of either side."""
        fit, held_out = (side.by_joint(np.sum(own**2, axis=1)) / side.rows for own, side in zip(self.directions, data))
        return Split(fit, held_out)


def model_uncertainty(arm: Arm, data: Split[Dataset], ripples: Sequence[Candidate]) -> ModelUncertainty | None:
    """The stated uncertainty of an arm in the residuals of these recordings; None if it states none.

    ripples: all that are searched for at its joints.
    """
    stated, uncertainty = arm.uncertainty, known_on_another_day(arm)
    if stated is None or uncertainty is None or not (stated.parameters or any(stated.left_over)):
        return None

    def felt(side: Dataset) -> Array:
        return stacked([run.whiten(directions_of(run, uncertainty)) for run in side.runs])

    root = stated.directions
    known = stacked([run.whiten(_columns(run, stated.parameters) @ root) for run in data.fit.runs])
    left = _left_over(uncertainty.left_over, data)
    known_to = ModelUncertainty(data.map(felt), left, known, aliased=dict(stated.aliased))
    if not stated.ripple:
        return known_to
    orders = np.array([independent_orders(data.fit, arm, joint, ripples) for joint in range(1, len(arm) + 1)])
    return replace(known_to, rippled=of_strongest(np.array(stated.ripple), orders), orders=orders)


def named(candidate: Candidate) -> str:
    """The name of an effect in ``left_over_shares``: time_skew, joint2.current_offset."""
    return candidate.effect if candidate.joint is None else f"joint{candidate.joint}.{candidate.effect}"


def of_strongest(share: Array, orders: Array) -> Array:
    """(n,) share of squares that a sine or a cosine explains on average, of the ``share`` (n,) of the strongest wave.

    The gains of waves of so many ``orders`` (n,) are exponential, each of two squares; the largest is log(orders) +
    0.577 times their mean on average (Gumbel).
    """
    return np.asarray(share / (2.0 * (np.log(orders) + np.euler_gamma)))


def parameter_std(run: Run) -> Array:
    """(m, n) A: std of the predicted currents due to the uncertainty of the arm's parameters; 0 for an exact model."""
    uncertainty = known_on_another_day(run.arm)
    if uncertainty is None or not uncertainty.parameters:
        return np.zeros_like(run.q)
    return np.asarray(np.linalg.norm(directions_of(run, uncertainty), axis=-1))


def stacked(runs: Sequence[Array]) -> Array:
    """(n m, r), joint by joint as ``Dataset.y``: of all runs (m, n, r)."""
    every = np.concatenate(runs)
    return every.transpose(1, 0, 2).reshape(-1, every.shape[2])


def directions_of(run: Run, uncertainty: Uncertainty) -> Array:
    """(m, n, r) A: change of the expected currents for one standard deviation of each independent error."""
    columns = _columns(run, uncertainty.parameters)
    hump = friction_near_rest(run.arm, uncertainty.parameters, columns, run.brisk_v)
    beyond = friction_beyond(run.arm, uncertainty.parameters, columns, run.brisk_v)
    return np.concatenate([columns @ uncertainty.directions, hump, beyond], axis=-1)


def _left_over(left_over: Sequence[float], data: Split[Dataset]) -> Array:
    runs = [run for side in data for run in side.runs]
    constant = runs[0].arm.joint_array("drive_constant")
    over = np.concatenate([1.0 / run.instruments**2 for run in runs]).mean(axis=0)
    return np.asarray((np.array(left_over or [0.0] * len(constant)) / constant) ** 2 * over)


def _columns(run: Run, names: Sequence[str]) -> Array:
    """(m, n, p) A: change of the expected currents for a unit of each parameter of the model."""
    bent = described(run.arm)
    slow, every = regressor(bent, run.q, run.v, run.a)
    brisk, _ = regressor(bent, run.q, run.brisk_v, run.a)
    place = {name: k for k, name in enumerate(every)}
    columns = np.empty((*run.q.shape, len(names)))
    for k, name in enumerate(names):
        places = [place[entry] for entry in (name, f"{name}_positive", f"{name}_negative") if entry in place]
        if places:
            # friction follows the speed in the band of comparison
            from_motion = slow if name.startswith("link") or name.endswith(".rotor_inertia") else brisk
            columns[..., k] = from_motion[..., places].sum(axis=-1)
        else:
            columns[..., k] = _slope(run, name)
    return columns * run.powered / bent.joint_array("drive_constant")[:, None]


def _slope(run: Run, name: str) -> Array:
    """(m, n) N m: of a parameter that is no column of the regressor, by a finite difference."""
    step = 1e-4
    moved = with_parameters(run.arm, {name: parameter(run.arm, name) + step})
    before, after = (inverse_dynamics(arm, run.q, run.v, run.a) for arm in (run.arm, moved))
    return np.asarray((after - before) / step)


class Significance:
    """Of columns conditional on others, with the model exact or (``known``) as uncertain as it is.

    Rows of a joint count less, the more the model left over there: as those of white noise that has as much along any
    direction as any one effect may explain of it. With more weight, the prior of the parameters would count less than
    how an effect differs from them, which what is left over hides.
    """

    def __init__(self, data: Split[Dataset], others: Sequence[Pair], known: ModelUncertainty | None) -> None:
        self._data, self._others, self._known = data, others, known

    @cached_property
    def _weight(self) -> Array:
        """(N + M,) of every row."""
        left_over = (
            np.zeros(len(self._data.fit.y) // self._data.fit.rows) if self._known is None else self._known.left_over
        )
        variance = self._variance(left_over)
        return np.concatenate([np.repeat(1.0 / np.sqrt(variance), side.rows) for side in self._data])

    def _variance(self, left_over: Array) -> Array:
        """(n,) of the rows of each joint, as of white noise that has as much along any direction as an effect may."""
        return np.asarray(1.0 + left_over * (1.0 + ALIASED_SHARE * sum(side.rows for side in self._data)))

    def _stack(self, pair: Pair) -> Array:
        """(N + M, k) weighted columns in both sets."""
        both = [columns.dense(len(side.y)) for columns, side in zip(pair, self._data)]
        return np.concatenate(both) * self._weight[:, None]

    @cached_property
    def _evidence(self) -> Evidence:
        fit, held_out = self._data
        free = np.hstack([np.zeros((len(self._weight), 0)), *map(self._stack, self._others)])
        # of an identified model, friction near rest is part of what is known
        if self._known is None:
            of_model = self._data.map(lambda side: unseen_by_joint(side.runs))
        else:
            of_model = self._known.directions
        directions = np.concatenate(list(of_model)) * self._weight[:, None]
        y = np.concatenate([side.y for side in self._data]) * self._weight
        block = np.concatenate([fit.block, held_out.block + int(fit.block.max()) + 1])
        alike = float(np.mean([run.alike for side in self._data for run in side.runs]))
        joint = np.concatenate([np.repeat(np.arange(len(side.y) // side.rows), side.rows) for side in self._data])
        return Evidence(y, free, directions, block, alike, joint)

    def beyond_model(self, pair: Pair, candidate: Candidate | None = None) -> bool:
        """Whether columns are significant with the parameters of the model free; always with it exact."""
        return self._known is None or self.chance(pair, candidate) < LIMITS.beyond_model

    @cached_property
    def allowed(self) -> Split[Array]:
        """(n,) how many times the noise residuals of joints are with nothing wrong: 1 where the model is exact."""
        if self._known is None:
            exact = np.ones(len(self._data.fit.y) // self._data.fit.rows)
            return Split(exact, exact)
        left_over = self._known.left_over
        return self._known.shares(self._data).map(lambda share: np.sqrt(1.0 + left_over + share))

    def chance(self, pair: Pair, candidate: Candidate | None = None) -> float:
        """Probability that columns (k of them) look as they do without the effect that they are of.

        candidate: the effect, if it is one: of a ripple, they are those of the strongest of all orders.
        """
        ripple_of = None if candidate is None else joint_of_ripple(candidate)
        chance = self._evidence.chance(self._stack(pair), lambda own: self._of_left_over(own, candidate))
        if ripple_of is None or self._known is None or self._known.orders is None:
            return chance
        return min(chance * float(self._known.orders[ripple_of - 1]), 1.0)

    def _of_left_over(self, own: Array, candidate: Candidate | None) -> Array:
        """(k, k) covariance of the coefficients of columns ``own`` by what the model left over."""
        total = np.zeros((own.shape[1], own.shape[1]))
        if self._known is None:
            return total
        fit, held_out = self._data
        parts, rows = np.split(own, [len(fit.y)]), fit.rows + held_out.rows
        along = rows * self._known.left_over / self._variance(self._known.left_over)
        for joint, left_over in enumerate(along.tolist(), 1):
            at = [part[side.of(joint)] for part, side in zip(parts, self._data)]
            total += self._share(candidate, joint) * left_over * sum(one.T @ one for one in at)
        return total

    def _share(self, candidate: Candidate | None, joint: int) -> float:
        """Of what the model left over at a joint (from 1), what an effect may explain."""
        assert self._known is not None
        if candidate is None or candidate.terms or candidate.body:
            return ALIASED_SHARE
        if self._known.rippled is not None and joint == joint_of_ripple(candidate):
            return min(ALIASED_SHARE, float(self._known.rippled[joint - 1]))
        return self._known.aliased.get(named(candidate), ALIASED_SHARE)
