"""Causes at a single axis with an encoder fine enough to judge reversals: parameters and ambiguity groups.

A wave over position that only one run shows is reported as structure, not named as a cause.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from arm_model.effects import described
from arm_model.rigid_body.regressor import link_regressor
from diagnosis.cause import Estimate
from diagnosis.measurements.single_axis.columns import AxisSamples, Rows, columns, encoder_noise, rows_of, waves
from diagnosis.measurements.single_axis.model import LIMITS, Chosen, SingleAxis, of_true_current
from diagnosis.measurements.single_axis.model_errors import Samples, model_errors
from diagnosis.residual.filters import low_pass, rate_of
from diagnosis.residual.run import Run
from diagnosis.selection.beyond_model import in_deviations
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.estimates import estimates
from identification.selection import Score, Split, select
from identification.selection.cluster_covariance import cluster_covariance

SMALL = 1e-4
"""Relative step of a nonlinear parameter by which columns are differentiated."""
LOAD = 1e-6
"""Relative change of a load that is none but rounding."""
TURN = 2e-3
"""Largest Coulomb smoothing velocity, as a share of the speed of the axis."""


@dataclass(frozen=True)
class AxisCause:
    """One cause.

    before, after  A: rms of the held-out residual without and with it
    gains          (blocks,) fall of its square
    without        (m,) A: held-out residual without it
    deviations     standard deviations from nothing were the model exact, and as it is known; None: it states nothing
    """

    effect: str
    parameters: list[Estimate]
    p: float
    before: float
    after: float
    group: tuple[str, ...]
    gains: Array
    without: Array
    deviations: tuple[float, float] | None = None


@dataclass(frozen=True)
class StandingWave:
    """A force with the sine of the position, in one run.

    length, amplitude  m (rad), N (N m)
    share              of the residual energy of either part of the run, predicted from the other
    """

    length: float
    amplitude: float
    share: float


@dataclass(frozen=True)
class AxisSide:
    """Causes in the order of acceptance, and the wave that no second run confirms, if there is one.

    residual: (m,) A of the held-out rows, with all causes. The arm of the rows has the smoothing velocity that they are
    judged with.
    """

    causes: list[AxisCause]
    wave: StandingWave | None
    held_out: Rows
    residual: Array


def with_sharp_friction(arm: Arm, recordings: Split[Samples]) -> Arm:
    """The arm of one axis with a Coulomb smoothing velocity of at most TURN times its speed.

    That velocity is chosen for simulation, seldom measured; if it is as large as the speeds at the start of a stroke,
    it hides what friction does there.
    """
    speed = max(
        float(np.max(np.abs(np.diff(low_pass(one.q, 20.0, rate_of(one.t)), axis=0)))) * rate_of(one.t)
        for side in recordings
        for one in side
    )
    sharp = np.minimum(arm.joint_array("sign_velocity"), max(TURN * speed, 1e-9))
    return arm.with_sign_velocities(sharp)


def axis_side(arm: Arm, recordings: Split[Samples]) -> AxisSide | None:
    """Diagnoses a single axis; None where the arm has several joints, or its encoder is too coarse."""
    if len(arm) != 1:
        return None
    sharp = with_sharp_friction(arm, recordings)
    side = _side(sharp, recordings)
    if side is None or sharp == arm or not side.causes:
        return side
    # compared with sharp friction, the model's smoothed friction is smaller near rest
    own = _side(arm, recordings)
    return own if own is not None and np.sum(own.residual**2) <= np.sum(side.residual**2) else side


def load_changes(run: Run) -> bool:
    """Whether the gravity load of a body on the last link changes while the arm moves."""
    still = np.zeros_like(run.q)
    loads = link_regressor(described(run.arm), run.q, still, still)[..., -10:]
    return bool(np.ptp(loads, axis=0).max() > LOAD * np.abs(loads).max(initial=1e-300))


def _side(arm: Arm, recordings: Split[Samples]) -> AxisSide | None:
    """``axis_side`` with the Coulomb smoothing velocity of ``arm``."""
    fit, held_out = recordings
    rows = recordings.map(lambda side: rows_of(arm, side, LIMITS.block_seconds))
    if not encoder_noise(rows.fit) < LIMITS.encoder_noise:
        return None
    whole = rows_of(arm, [*fit, *held_out], LIMITS.block_seconds) if rows.two_fold else rows.fit
    errors = model_errors(arm, recordings, rows, LIMITS.block_seconds)
    model = SingleAxis(rows, whole, rows.two_fold or _goes_on(fit, held_out), errors)
    chosen = select(model)
    residual = model.residual(chosen, rows.fit, rows.held_out)
    return AxisSide([_cause(c, chosen, model) for c in chosen], _wave(chosen, model), rows.held_out, residual)


def _goes_on(fit: Sequence[AxisSamples], held_out: Sequence[AxisSamples]) -> bool:
    """Whether every held-out recording begins or ends where another recording ends or begins, within two rows.

    They are then pieces of one run.
    """

    def meet(one: AxisSamples, other: AxisSamples) -> bool:
        q, p = one.q, other.q
        step = max(float(np.abs(np.diff(x[:, 0])[[0, -1]]).max()) for x in (q, p)) + np.ptp(q) * 1e-6
        return bool(min(abs(q[-1, 0] - p[0, 0]), abs(p[-1, 0] - q[0, 0])) < 2 * step)

    return all(any(meet(one, other) for other in fit) for one in held_out)


def _wave(chosen: Chosen, model: SingleAxis) -> StandingWave | None:
    """The strongest wave over position in the residual of a single run, where its parts and directions agree on it."""
    if not model.one_run:
        return None
    fit = model.rows.fit
    for candidate in waves(model.residual(chosen, fit, fit), fit, 1):
        score = model.score(candidate, chosen)
        significant = LIMITS.fdr is not None and score.p < LIMITS.fdr
        beyond = model.holds_across_directions(candidate, chosen) and model.beyond_model(candidate, chosen)
        if significant and score.share > LIMITS.min_gain and beyond:
            drive, number = model.whole.arm.joints[0], candidate.shape[0][1]
            sine, cosine = model.fitted([*chosen, candidate], model.whole)[-2:]
            return StandingWave(2 * np.pi / number / drive.ratio, float(np.hypot(sine, cosine)), score.share)
    return None


def _cause(candidate: Candidate, chosen: Chosen, model: SingleAxis) -> AxisCause:
    others, rows = model.without(candidate, chosen), model.rows
    score = model.score(candidate, others)
    without, complete = (model.residual(some, rows.fit, rows.held_out) for some in (others, chosen))
    before, after = (float(np.sqrt(np.mean(values**2))) for values in (without, complete))
    return AxisCause(
        effect=candidate.effect,
        parameters=_parameters(candidate, chosen, model),
        p=score.p,
        before=before,
        after=after,
        group=_group(score, chosen, model),
        gains=score.blocks,
        without=without,
        deviations=_deviations(candidate, others, model),
    )


def _deviations(candidate: Candidate, others: Chosen, model: SingleAxis) -> tuple[float, float] | None:
    """Significance of a cause with an exact model and with its stated uncertainty."""
    if model.errors is None:
        return None
    exact, known = (model.chance(candidate, others, errors) for errors in (model.errors.exact(), model.errors))
    return in_deviations(exact), in_deviations(known)


def _group(score: Score[Candidate], chosen: Chosen, model: SingleAxis) -> tuple[str, ...]:
    """The ambiguity group of a cause: itself, and effects that explain as much with no more coefficients."""
    others = model.without(score.candidate, chosen)
    effects, group = {c.effect for c in chosen}, [score.candidate.effect]
    for rival in model.best(others):
        simpler = rival.effect not in effects and model.columns(rival, model.rows.fit).shape[1] <= len(
            score.coefficients
        )
        enough = LIMITS.ambiguity * score.gain
        if simpler and model.is_physical(rival, others) and model.score(rival, others).gain > enough:
            group.append(rival.effect)
    return tuple(group)


def _parameters(candidate: Candidate, chosen: Chosen, model: SingleAxis) -> list[Estimate]:
    """Values, with standard deviations from clusters of rows at the same place and speed.

    The derivatives by nonlinear parameters are among the columns.
    """
    rows, x = model.whole, model.stacked(chosen, model.whole)
    c = model.fitted(chosen, rows)
    at = sum(model.columns(earlier, rows).shape[1] for earlier in chosen[: chosen.index(candidate)])
    column = model.columns(candidate, rows)
    own = c[at : at + column.shape[1]]
    refined = [name for name, _ in candidate.shape if not candidate.definition[name].fixed]
    values = dict(candidate.shape)
    slopes = [
        (columns(candidate.at(name, (1.0 + SMALL) * values[name]), rows) - column) @ own / (SMALL * values[name])
        for name in refined
    ]
    covariance = cluster_covariance(np.column_stack([x, *slopes]), [rows.residual - x @ c], rows.cells)
    own_rows = [*range(at, at + column.shape[1]), *range(x.shape[1], x.shape[1] + len(refined))]
    true = of_true_current(candidate, own)
    slope = np.ones(len(own_rows))
    slope[: len(own)] = np.where(true == own, 1.0, (1.0 + true) ** 2)
    return estimates(
        candidate,
        true.tolist(),
        covariance[np.ix_(own_rows, own_rows)] * slope[:, None] * slope,
        rows.arm.joints[0],
        LIMITS.systematic,
        refined,
    )
