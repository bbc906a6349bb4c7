"""Whether the currents are read later or earlier than the angles, decided on held-out rows.

Controllers average and filter currents, and transmit them in another cycle than angles. A current that is read d later
shows the torque of d before: i_read(t) = i(t - d), or, of a small d, d times the torque's derivative less. Of an
identification this makes viscous friction and inertias wrong, and ``diagnose`` would find both the lag and these.

The lag is estimated joint by joint beside all other parameters. What several joints show alike is a lag of the
instruments; what one joint shows alone is a spring or another friction law of its own, and stays with ``diagnose``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from arm_io.types import Array
from arm_model import Arm, EffectTerm
from arm_model.effects import CATALOGUE
from arm_report.numbers import with_two_std
from identification.methods.added_columns import added_coefficients
from identification.methods.held_out import by_folds, held_out_residual
from identification.methods.solution import Solution
from identification.preprocessing.signals import Motion, equation_rows, equation_weight, parallel_filter
from identification.regression.equations import Equations
from identification.regression.least_squares import joint_noise
from identification.regression.problem import Problem
from identification.ripples.search import BY_CHANCE
from identification.selection import BLOCK_SECONDS, p_value
from identification.signal_words import recorded_signals

EFFECT = next(one.name for one in CATALOGUE.values() if one.delay is not None and len(one.parameters) == 1)
"""The one whose delay is all that it has."""
LEAST = CATALOGUE[EFFECT].parameters[0].typical[0]
"""s: a shorter lag is not looked for."""
MOST = float(CATALOGUE[EFFECT].parameters[0].most)
"""s: a longer one is no lag, it is currents that do not belong to this motion."""
SIGNIFICANT_STDS = 4.0
"""Standard deviations from zero of a lag that stays, and without the joint that shows it most."""
ALIKE = 0.5
"""Share of the lag by which the joint that shows it most may differ from the others together."""
ALIKE_STD = 2.5
"""Std of the difference by which it may differ instead, if that is more."""
REDUCED = 0.01
"""Of the rms error over the noise on held-out rows: what the lag must take away to stay."""


@dataclass(frozen=True, kw_only=True)
class Lag:
    """Of the currents behind the angles, s, with its std.

    before, after: rms error on held-out rows over the noise, without and with it; ``stays`` in the model, or not.
    """

    delay: float
    std: float
    before: float
    after: float
    stays: bool

    def to_json(self, arm: Arm) -> dict[str, Any]:
        """As identification.json has it, of the fitted arm."""
        return asdict(self) | {"says": self.sentence(arm)}

    def sentence(self, arm: Arm) -> str:
        """For a person: of the arm's currents, torques or forces, as it records them."""
        when = "after" if self.delay > 0 else "before"
        place = "in the model as time_skew" if self.stays else "not in the model, the standard deviations allow for it"
        return (
            f"{recorded_signals(arm)} are read {with_two_std(1e3 * abs(self.delay), 1e3 * self.std)} ms {when} the "
            f"angles: {place} (held-out error {self.before:.3g} -> {self.after:.3g} times the noise)"
        )


def delayed(arm: Arm, delay: float) -> Arm:
    """The arm whose currents are read ``delay`` s after its angles."""
    return replace(arm, effects=(*arm.effects, EffectTerm(EFFECT, None, {"delay": delay})))


def in_doubt(problem: Problem, lag: Lag) -> Problem:
    """The problem whose torques may be off by ``lag``: fitted rows show it, and held-out ones do not confirm it.

    Neither is taken as exact: the lag is one standard deviation of what the torques may be off by all along.
    """
    return problem.doubting(lag.delay * _derivatives(problem.motions))


def lag_shown(found: Solution) -> tuple[float, float] | None:
    """Lag of the currents and its std, s, that several joints show alike in the fitted rows, or None.

    It is not searched for in a model that already has a lag, nor for an arm with one joint.
    """
    problem = found.problem
    if any(CATALOGUE[term.name].delay is not None for term in problem.arm.effects) or len(problem.arm) < 2:
        return None
    rows, late = problem.rows, -_derivatives(problem.motions)
    joints = [j for j in range(len(problem.arm)) if np.any(late[rows.joint == j])]
    if len(joints) < 2:
        return None
    return _alike(*added_coefficients(found, np.where(rows.joint[:, None] == np.array(joints), late[:, None], 0.0)))


def _alike(lags: Array, std: Array) -> tuple[float, float] | None:
    """Mean (weighted) and std of the joints' lags, s, where they are clearly one lag; else None."""
    seen = std > 0.0
    lags, std = lags[seen], std[seen]
    if len(lags) < 2:
        return None
    worst = int(np.argmax(np.abs(lags) / std))
    (mean, of_mean), (others, of_others) = _mean(lags, std), _mean(np.delete(lags, worst), np.delete(std, worst))
    clear = MOST > abs(mean) > max(SIGNIFICANT_STDS * of_mean, LEAST) and abs(others) > SIGNIFICANT_STDS * of_others
    alike = abs(lags[worst] - others) < max(ALIKE * abs(mean), ALIKE_STD * np.hypot(std[worst], of_others))
    return (mean, of_mean) if clear and alike else None


def _mean(values: Array, std: Array) -> tuple[float, float]:
    weight = 1.0 / std**2
    return float((weight * values).sum() / weight.sum()), float(weight.sum() ** -0.5)


def _derivatives(motions: Sequence[Motion]) -> Array:
    """(rows,) N m/s (N/s): derivative of the measured torque at every row of the fitted equations."""
    parts = []
    for motion in motions:
        rate = np.gradient(motion.torque, motion.dt, axis=0) * equation_weight(motion)
        joint, row = np.nonzero(equation_rows(motion)[1].T)
        parts.append(parallel_filter(motion, rate)[row, joint])
    return np.concatenate(parts)


def judged(shown: tuple[float, float], without: Solution, with_it: Solution) -> Lag:
    """The lag (value, std) with the errors of both fits on held-out rows; it stays where these justify it.

    That the gain is no chance may also be shown by all recordings, in stretches that are predicted from the others:
    short held-out ones, in which an arm pauses, have too few blocks.
    """
    before, after = _errors(held_out_residual(without), held_out_residual(with_it))
    size, remaining = (float(np.sqrt(np.mean(squares))) for squares in (before, after))
    stays = remaining < (1.0 - REDUCED) * size and (
        p_value(before - after) < BY_CHANCE or _in_all_recordings(without, with_it) < BY_CHANCE
    )
    return Lag(delay=shown[0], std=shown[1], before=size, after=remaining, stays=stays)


def _in_all_recordings(without: Solution, with_it: Solution) -> float:
    """Probability of the gain of one fit over the other by chance, with each stretch predicted from the others."""
    if without.problem.held is None:
        return 1.0
    (rows, one, inside), (others, other, others_inside) = by_folds(without), by_folds(with_it)
    before, after = _errors((rows.of(inside), one[inside]), (others.of(others_inside), other[others_inside]))
    return p_value(before - after)


def _errors(without: tuple[Equations, Array], with_it: tuple[Equations, Array]) -> tuple[Array, Array]:
    """(blocks,) mean squares of two residuals (rows,) over the noise of the second one, in the seconds of both."""
    (rows, residual), (others, others_residual) = without, with_it
    # a joint that hardly moves may have rows in one of both alone
    common, others_common = np.isin(rows.joint, others.joint), np.isin(others.joint, rows.joint)
    rows, residual = rows.of(common), residual[common]
    others, others_residual = others.of(others_common), others_residual[others_common]
    noise = joint_noise(others_residual, others.joint)
    before, after = _in_blocks(rows, residual, noise), _in_blocks(others, others_residual, noise)
    both = sorted(before.keys() & after.keys())
    return np.array([before[block] for block in both]), np.array([after[block] for block in both])


def _in_blocks(rows: Equations, residual: Array, noise: Array) -> dict[tuple[int, int], float]:
    """Mean square of the residual over the noise (J,) in every second of every run."""
    keys = zip(rows.run.tolist(), (rows.t // BLOCK_SECONDS).astype(int).tolist())
    of_block: dict[tuple[int, int], list[float]] = {}
    for key, square in zip(keys, ((residual / noise[rows.joint]) ** 2).tolist()):
        of_block.setdefault(key, []).append(square)
    return {key: float(np.mean(squares)) for key, squares in of_block.items()}
