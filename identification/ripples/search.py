"""Which ripples a model lacks, decided on held-out rows.

Of what a regression leaves of a joint, the wave that stands out most of those of neighbouring orders is fitted with its
order, and judged where nothing was fitted: it stays where the held-out residual follows it, in its phase, further than
waves of neighbouring orders there by chance, is clearly not zero, and matters beside the joint's friction. Then the
next, while one stands out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, stats

from arm_io.progress import Step
from arm_io.types import Array, Progress
from arm_model import Arm
from identification.preprocessing.signals import Motion, equation_rows
from identification.regression.problem import Problem
from identification.ripples.fit import Fitted, Wave, fit_waves, with_whole_turns
from identification.ripples.result import Ripple
from identification.ripples.rows import WideRows, wide_rows
from identification.ripples.scan import CLOSE, orders_of, wave_sums

STANDS_OUT = 10.0
"""Times the gain that waves of neighbouring orders have on average, which a large wave raises: with noise alone, one
order in 22 000 has it."""
NEIGHBOURS = 41
"""Orders about one whose median gain is that of noise there."""
MOST = 8
"""Waves that are judged at a joint."""
BY_CHANCE = 0.01
"""Probability, over all that was judged, that noise does as much on held-out rows as a law that stays."""
SIGNIFICANT_STDS = 4.0
"""Deviations from zero of the torque of a ripple that stays."""
MATTERS = 0.005
"""Of a joint's Coulomb friction: rms of what a ripple that stays explains, or another friction law, at least."""
FINER = np.linspace(-1.0, 1.0, 17)
"""Orders about the best, in distances of those that are tried."""
APART = 1.5
"""Cycles within the travel that two waves of one joint must be apart."""


def find_ripples(problem: Problem, near: Arm, sizes: Array, progress: Progress) -> list[Ripple]:
    """All that stood out at any joint, with whether they stay.

    near   the arm as it was fitted; sizes (J,) N m (N): Coulomb friction of the joints
    """
    progress("ripples")
    rows = wide_rows(problem, near)
    joints = [j for j in range(len(near)) if all(motion.moves(j) for motion in rows.fit.motions)]
    found: list[Ripple] = []
    for number, j in enumerate(joints):
        progress(Step("ripples", number, len(joints)))
        found += _Joint(rows, near, j, float(sizes[j]), len(joints)).searched()
    return found


@dataclass
class _Joint:
    """The search at one joint (from 0); tried: joints at which ripples are looked for."""

    rows: WideRows
    arm: Arm
    j: int
    friction: float
    tried: int

    def searched(self) -> list[Ripple]:
        """Those that stay, with the values of their joint fit, then those that do not."""
        orders = orders_of(self.rows.fit.motions, self.j)
        if len(orders) <= NEIGHBOURS // 2:
            return []
        apart, refused = float(orders[1] - orders[0]) / CLOSE, list[tuple[float, Ripple]]()
        kept = fit_waves(self.rows, self.j, [])
        whys: list[str] = []
        for _ in range(MOST):
            best = self._strongest(orders, kept, [order for order, _ in refused], apart)
            if best is None:
                break
            order, of_angle = best
            more = self._with(kept, order)
            why, stays = self._judged(kept, more, of_angle, (1 + len(whys) + len(refused)) * self.tried)
            if stays:
                kept, whys = more, [*whys, why]
            else:
                refused.append((order, self._ripple(more, -1, why, False)))
        stay = [self._ripple(kept, k, why, True) for k, why in enumerate(whys)]
        return stay + [one for _, one in refused]

    def _with(self, kept: Fitted, order: float) -> Fitted:
        """The fit with one more wave, of whole turns of a shaft where its order is one within its deviation."""
        joint = self.arm.joints[self.j]
        more = fit_waves(self.rows, self.j, [*kept.waves, Wave(order)])
        whole = with_whole_turns(more, len(more.waves) - 1, joint.ratio, joint.revolute)
        return fit_waves(self.rows, self.j, [*more.waves[:-1], whole]) if whole.whole else more

    def _strongest(
        self, orders: Array, kept: Fitted, refused: Sequence[float], apart: float
    ) -> tuple[float, bool] | None:
        """The order that stands out most, and whether it does more as an error of an angle; None where none does."""
        side = self.rows.fit
        residual = _by_motion(kept.residual[0], side.kept, side.motions)
        gains = _gains(side.motions, residual, self.j, orders)
        floor = ndimage.median_filter(gains[0], NEIGHBOURS, mode="nearest") / np.log(2.0)
        above = gains[0] / np.maximum(floor, 1.0)
        for order in [*refused, *(wave.order for wave in kept.waves)]:
            above[np.abs(orders - order) < APART * apart] = 0.0
        best = int(np.argmax(above))
        if above[best] < STANDS_OUT:
            return None
        finer = orders[best] + (orders[1] - orders[0]) * FINER
        around = _gains(side.motions, residual, self.j, finer)
        return float(finer[int(np.argmax(around[0]))]), bool(around[1].max() > around[0].max())

    def _judged(self, before: Fitted, after: Fitted, of_angle: bool, tests: int) -> tuple[str, bool]:
        """Why the last wave of a fit stays or not, and whether it does; ``tests``: so many are made."""
        joint, held = self.arm.joints[self.j], self.rows.held_out
        unit = "N m" if joint.revolute else "N"
        of_joint = held.equations.joint == self.j
        one, other = (fit.residual[1][of_joint] for fit in (before, after))
        p = self._by_chance(one, other, after)
        errors = [float(np.sqrt(np.mean(each**2))) * held.noise[self.j] if len(each) else 0.0 for each in (one, other)]
        errors_said = f"held-out error {errors[0]:.3g} -> {errors[1]:.3g} {unit}"
        (torque, _, _), covariance = after.parameters(-1 % len(after.waves), joint.ratio)
        if of_angle:
            return f"it grows with the square of the speed, as an error of an angle does; {errors_said}", False
        if p * tests > BY_CHANCE:
            if errors[1] >= errors[0]:
                return errors_said, False
            return f"{errors_said}, as noise alone would gain in {100 * min(1.0, p * tests):.2g} % of cases", False
        if torque < SIGNIFICANT_STDS * np.sqrt(covariance[0, 0]):
            return f"its torque is not clearly above zero; {errors_said}", False
        if torque / np.sqrt(2.0) < MATTERS * self.friction:
            return f"less than {MATTERS:.1%} of the joint's friction; {errors_said}", False
        return errors_said, True

    def _by_chance(self, before: Array, after: Array, fit: Fitted) -> float:
        """Probability that noise follows the last wave of a fit as far, in its phase, as the held-out rows do.

        before, after: (k,) held-out residual of the joint without and with that wave.

        Of noise, the component along a wave is as large as along those of neighbouring orders, which have its colour
        and act in the same seconds (Student's t, two degrees of freedom per cycle within the travel). Few seconds show
        this of a wave of many cycles; blocks of time of them are too few to count.
        """
        held, wave = self.rows.held_out, before - after
        own = orders_of(held.motions, self.j)
        if len(own) <= NEIGHBOURS // 2 or not wave.any():
            return 1.0
        step = float(own[1] - own[0])
        distance = np.abs(own - fit.waves[-1].order) / step
        near = own[(distance >= APART / CLOSE) & (distance <= max(NEIGHBOURS / 2, np.sort(distance)[NEIGHBOURS // 2]))]
        residual = _by_motion(fit.residual[1], held.kept, held.motions)
        both_phases = float(np.mean(_gains(held.motions, residual, self.j, near)[0]))
        along = float(wave @ before) / float(np.linalg.norm(wave))
        return float(stats.t.sf(along / np.sqrt(max(both_phases / 2.0, 1e-300)), 2.0 * CLOSE * len(near)))

    def _ripple(self, fit: Fitted, k: int, why: str, stays: bool) -> Ripple:
        k %= len(fit.waves)
        values, covariance = fit.parameters(k, self.arm.joints[self.j].ratio)
        torque, order, phase = values
        return Ripple(
            joint=self.j + 1,
            torque=torque,
            order=order,
            phase=phase,
            covariance=covariance,
            turn=fit.waves[k].turn,
            stays=stays,
            why=why,
        )


def _by_motion(residual: Array, kept: NDArray[np.bool_], motions: Sequence[Motion]) -> list[Array]:
    """Residuals (k,) of the ``kept`` rows (r,) as all rows of each motion; 0 where a row is not kept."""
    whole = np.zeros(len(kept))
    whole[kept] = residual
    counts = [int(equation_rows(motion)[1].sum()) for motion in motions]
    return np.split(whole, np.cumsum(counts)[:-1])


def _gains(motions: Sequence[Motion], residual: Sequence[Array], joint: int, orders: Array) -> Array:
    """(2, o) by how much a wave in all motions reduces the squares: as a torque, and as an error of an angle."""
    sums, power = wave_sums(motions, residual, joint, orders, np.zeros(len(motions), bool))
    return np.asarray(np.abs(sums[0]) ** 2 / power[0] / 2.0)
