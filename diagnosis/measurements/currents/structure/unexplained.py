"""Structure that no effect of the catalogue explains: smooth functions of one variable, conditional on the causes.

For every joint and every variable that a torque or a reading could depend on, a spline of the variable (also times the
direction, or times the velocity, of the joint) is fitted together with the causes and scored on the held-out recordings
like a cause. What enters is structure that the catalogue does not contain. A cause that such a function makes
superfluous approximates something else, and is removed: a spring that fits part of a wavy torque over position is no
spring.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from arm_io.parallel import in_parallel
from arm_io.types import Array
from arm_model import Arm
from diagnosis.cause import Signal, Structure
from diagnosis.cause.structure import NO_VARIABLE
from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.measurements.currents.model_errors import Significance
from diagnosis.measurements.currents.structure.basis_functions import Shape, shapes_of
from diagnosis.measurements.currents.structure.likely_variable import Likely, likely_variable
from diagnosis.measurements.currents.structure.noise_ratio import largest_of_noise, noise_ratio
from diagnosis.measurements.currents.structure.shared_bases import Bases
from diagnosis.selection.design import Dataset, Pair
from diagnosis.selection.regression import Fitted, fit_gain, residual_with, with_columns
from diagnosis.selection.unseen_inertia import explained
from diagnosis.selection.waves import wave_of
from identification.selection import Split, p_value

HARDLY = 1 / 3
"""Of the gain that a function needs in held-out recordings, what it needs in the fitted ones to be tried there."""


@dataclass(frozen=True)
class Unexplained:
    """Structures, and the columns that describe them.

    likely: joint -> the variable on which a residual above the noise most likely depends, in held-out or in fitted
    recordings; of the latter alone there is no structure (``diagnosis.remainder.fitted_only``).
    """

    structures: list[Structure]
    pairs: list[Pair]
    likely: dict[int, Likely]


@dataclass(frozen=True)
class StructureSearch:
    """The search for structure in what ``fitted`` columns leave of recordings.

    significance  of columns beside those fitted, with the model as uncertain as it is
    bases         of these recordings
    beside        what a held-out residual (N,) is without what the coefficients of causes may be wrong by
                  (``CoefficientDoubt``)
    """

    data: Split[Dataset]
    fitted: Fitted
    arm: Arm
    significance: Significance
    bases: Bases
    beside: Callable[[Array], Array] = np.asarray

    def of_all_joints(self) -> Unexplained:
        """Structures conditional on what is ``fitted``, joint by joint, the strongest first."""
        joints = range(1, len(self.arm) + 1)
        self.bases.compute(self.arm)
        by_joint = in_parallel(self.at, joints)
        return Unexplained(
            [structure for structures, _, _ in by_joint for structure in structures],
            [pair for _, pairs, _ in by_joint for pair in pairs],
            {joint: likely for joint, (_, _, likely) in zip(joints, by_joint) if likely},
        )

    def at(self, joint: int) -> tuple[list[Structure], list[Pair], Likely | None]:
        """Structures at one joint, their columns, and those of a likely variable."""
        structures: list[Structure] = []
        pairs: list[Pair] = []
        fit, held_out = self.data
        judged = np.ones(held_out.rows, bool)
        shapes = list(shapes_of(self.bases, self.fitted.residual.fit, self.arm, joint))
        for _ in range(LIMITS.structures):
            best = self._strongest(joint, shapes, with_columns(self.fitted, pairs), judged)
            if best is None:
                break
            shape, share = best
            structures.append(Structure(Signal.CURRENT, joint, shape.name, share))
            pairs.append(shape.pair)
            judged &= shape.known
            shapes = [one for one in shapes if one.name != shape.name]
        conditional = with_columns(self.fitted, pairs).residual.held_out
        of_fit, of_held_out = (
            largest_of_noise(side, joint) * times[joint - 1]
            for side, times in zip(self.data, self.significance.allowed)
        )
        if (ratio := noise_ratio(conditional, held_out, joint)) > of_held_out:
            ratio = noise_ratio(self.beside(conditional), held_out, joint)
        quiet = ratio <= of_held_out
        if quiet and (pairs or noise_ratio(self.fitted.residual.fit, fit, joint) <= of_fit):
            return structures, pairs, None
        likely = likely_variable(self.data, self.fitted.residual, self.arm, joint)
        if quiet:
            return [], [], likely
        if likely is not None:
            rows = held_out.of(joint)
            remaining = float(np.sum(conditional[rows] ** 2)) / float(np.sum(self.fitted.residual.held_out[rows] ** 2))
            if not pairs or 1.0 - likely.share < LIMITS.swapped * remaining:
                return [Structure(Signal.CURRENT, joint, likely.variable, likely.share)], [], likely
        if not pairs:
            against = wave_of(self.fitted.residual.held_out, held_out, joint) or NO_VARIABLE
            structures.append(Structure(Signal.CURRENT, joint, against, 0.0, f"{ratio:.1f} times the noise"))
        return structures, pairs, None

    def _strongest(
        self, joint: int, shapes: Sequence[Shape], fitted: Fitted, known: NDArray[np.bool_]
    ) -> tuple[Shape, float] | None:
        """The function that explains most of a joint's held-out residual, and the share of its variance.

        Judged where the variable is in the range that was fitted: beyond it, a function says nothing, and neither do
        coefficients of causes that were fitted beside it. known (rows,): where functions that are fitted already do.
        What a function would explain of ``Bases.unseen`` does not count.
        """
        held_out = self.data.held_out
        rows = held_out.of(joint)
        gains = []
        for shape in shapes:
            # a function that hardly fits the fitted recordings cannot predict others
            in_fit = shape.functions.fit.columns
            gain, c = fit_gain(in_fit, fitted)
            if gain < HARDLY * LIMITS.structure_gain * self.data.fit.rows:
                gains.append(np.zeros(1))
                continue
            pair = Split(in_fit, shape.functions.held_out.columns, self.data.two_fold)
            fall = fitted.residual.held_out**2 - residual_with(pair, c, fitted, held_out) ** 2
            fall[rows] *= shape.known & known
            gains.append(held_out.by_block(fall))
        q = stats.false_discovery_control(np.array([p_value(gain) for gain in gains]))
        before = float(np.sum(fitted.residual.held_out[rows] ** 2 * known))
        of_causes = float(np.sum(held_out.y[rows] ** 2 * known)) - before
        enough = max(LIMITS.structure_gain * held_out.rows, LIMITS.structure_share * of_causes)
        significant = [k for k, gain in enumerate(gains) if q[k] < LIMITS.structure_p and gain.sum() > enough]
        of_unseen = {
            k: sum(float(explained(one, shapes[k].pair.held_out, held_out)[joint - 1]) for one in self.bases.unseen)
            for k in significant
        }
        significant = [k for k in significant if gains[k].sum() - of_unseen[k] > enough]
        significant = [k for k in significant if self.significance.beyond_model(shapes[k].pair)]
        if not significant:
            return None
        best = max(significant, key=lambda k: float(gains[k].sum()))
        return shapes[best], float(gains[best].sum()) / before


def better_than_causes(
    bases: Bases, without: Fitted, with_causes: Fitted, arm: Arm, joint: int, allowed: float
) -> dict[str, float]:
    """Variables of which a single function leaves significantly less residual than the causes of a joint.

    Each with the squared held-out error by which it leaves less; ``without``: the fit without these causes.

    Functions of one variable only approximate a true cause, but may explain more than a wrong one. allowed: squared
    error by which the function may be worse, where there are implausibly many causes; not for the velocity, on which
    several effects depend.
    """
    held_out = bases.held_out
    rows, better = held_out.of(joint), dict[str, float]()
    for shape in shapes_of(bases, without.residual.fit, arm, joint):
        pair = shape.pair
        _, c = fit_gain(pair.fit, without)
        by_function = residual_with(pair, c, without, held_out)
        improvement = (with_causes.residual.held_out**2 - by_function**2)[rows] * shape.known
        blocks = np.bincount(held_out.block[rows], weights=improvement).astype(float)
        gain = float(blocks.sum())
        significant = gain > LIMITS.structure_gain * held_out.rows and p_value(blocks) < LIMITS.structure_p
        if significant or (allowed and shape.name != "velocity" and gain > -allowed):
            better[shape.name] = max(gain, better.get(shape.name, gain))
    return better
