"""Rows in which a joint turns or creeps, and what friction may do there.

The search gives a row near standstill the std of all of the joint's Coulomb friction, because what friction does there
depends on more than the velocity. That is right where a joint stands. Where it passes through rest, or creeps, friction
is known but for the law by which it turns, and less of it is unknown: the share ``TURN`` of what it lacks to the
friction of sliding, and all of it where the encoder's noise hides the direction. Friction is evaluated at the full rate
and then filtered as the residual is, because a reversal lasts no longer than the filters; at speeds by angles between
the steps of the encoder, because a joint that creeps passes few of them.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.special import ndtr

from arm_io.types import Array
from arm_model import EffectTerm, Joint
from arm_model.effects import Effect, Signals, Values, Variable
from diagnosis.measurements.currents.model_errors import parameter_std
from diagnosis.measurements.near_rest.between_steps import between_steps
from diagnosis.residual.expected_current import (
    coulomb_at,
    current_delay,
    delayed,
    predicted_current,
    terms_of,
    true_angle,
)
from diagnosis.residual.filters import COMPARE_BAND, MOTION_BAND, kept_rows, low_pass, motion_of, rate_of
from diagnosis.residual.generation import CREEP
from diagnosis.residual.integration import integrated
from diagnosis.residual.noise.channels import angle_noise
from diagnosis.residual.other_effects import residual_under
from diagnosis.residual.run import Run

TURN = 0.3
"""Share of what friction lacks to its value while sliding that may be otherwise: laws of the turn, as tanh(v / w) and
v / hypot(v, w), differ by less once their widths agree."""
SLIDES = 6.0 * CREEP
"""rad/s (m/s): a joint that is faster slides, and the search judges its friction."""
STANDS = CREEP / 2.0
"""rad/s (m/s): a joint that is slower for ``STANDS_FOR`` stands."""
STANDS_FOR = 0.12
"""s for which a joint must be slower than ``STANDS`` to stand."""
SMEARED = 0.03
"""s before and after a slow instant that filters spread it over."""
AFTER_REST = 0.04
"""s about a standstill that are left out."""
SPEED_NOISE = STANDS
"""rad/s (m/s): std of the speed by the encoder above which a joint is not judged near rest."""
COARSE = STANDS / 3.0
"""rad/s (m/s): the same above which closed loops judge it as well."""
BENDS = 9
"""Knots of a function of one variable: straight between them, so that the magnitude of a load is such a function."""
UNMEASURED = 1e4
"""Deviation of a row over the noise of its instruments from which it counts as not measured."""


@dataclass(frozen=True)
class NearRest:
    """One joint of one recording near rest: r rows.

    run, joint  where (joint from 1); v (k,) rad/s: speed of the motor at the rate of the recording; standstill (k,)
    rows (m,)   which of the run's rows these are; block (r,): number of the passage and its second
    residual    (r,) A over std, conditional on all causes; std (r,) A
    nuisance_basis (r, k) orthonormal: effects of another law; projected out of ``residual`` and ``of``
    delay       (k,) s by which currents are recorded after the angles; empty: none
    """

    run: Run
    joint: int
    v: Array
    standstill: NDArray[np.bool_]
    rows: NDArray[np.bool_]
    block: NDArray[np.intp]
    residual: Array
    std: Array
    nuisance_basis: Array = field(default_factory=lambda: np.zeros((0, 0)))
    delay: Array = field(default_factory=lambda: np.zeros(0))

    def of(self, torque: Array) -> Array:
        """(r, ...) over std: what a friction torque (k, ...) N m at the rate of the recording adds to the current."""
        t, rate = self.run.raw[0], rate_of(self.run.raw[0])
        torque = delayed(t, torque, self.delay) if self.delay.any() else torque
        amperes = low_pass(torque, COMPARE_BAND, rate)[kept_rows(rate)][self.rows] / self._drive.drive_constant
        return self.without_nuisance(np.asarray((amperes.T / self.std).T, float))

    def without_nuisance(self, values: Array) -> Array:
        """Values (r, ...) over std, orthogonal to ``nuisance_basis``."""
        return values - self.nuisance_basis @ (self.nuisance_basis.T @ values) if self.nuisance_basis.size else values

    def sign(self, width: Array | float) -> Array:
        """(k, ...) direction of the motion, of the smoothing velocities ``width``."""
        v = self.v[:, None] if np.ndim(width) else self.v
        return np.asarray(v / np.hypot(v, width), float)

    def smoothed(self, width: Array) -> Array:
        """(k, w) N m: the joint's friction with other smoothing velocities (w,), less that of the model."""
        sign_of_model = self.sign(self._drive.sign_velocity)
        turned = [coulomb_at(self._drive, self.v, sign) * sign for sign in self.sign(width).T]
        return np.stack(turned, axis=1) - (coulomb_at(self._drive, self.v, sign_of_model) * sign_of_model)[:, None]

    def of_law(self, effect: Effect, values: Mapping[str, float], width: float | None = None) -> Array:
        """(k,) N m: the law of an effect of friction at a smoothing velocity, by default the model's."""
        assert effect.torque is not None
        sign = self.sign(self._drive.sign_velocity if width is None else width)
        s = Signals(q=np.zeros_like(self.v), v=self.v, sign=sign, coulomb=coulomb_at(self._drive, self.v, sign))
        p = Values(dict(values))
        if effect.rate is not None:
            s = replace(s, state=integrated(effect, p, s, 1.0 / rate_of(self.run.raw[0])))
        return np.asarray(effect.torque(p, s), float)

    @property
    def _drive(self) -> Joint:
        return self.run.arm.joints[self.joint - 1]


@dataclass(frozen=True)
class Observation:
    """A recording by angles between the steps of its encoders: v (k, n) rad/s at its rate, residual (m, n) A.

    noise       (k, n) rad/s: std of ``v`` counted in addition to the rest; 0 of an identified model: what it left near
                rest has it
    standstill  (k, n) where joints stand, by the readings themselves: a joint that creeps shows steps
    delay       (k,) s by which its currents are recorded after its angles
    model_std   (m, n) A: std of the predicted current where joints turn or creep, by what an identification knows of
                it; NaN where it says nothing; 0 of an exact model
    """

    run: Run
    v: Array
    noise: Array
    residual: Array
    standstill: NDArray[np.bool_]
    delay: Array
    model_std: Array


def observations(runs: Sequence[Run], terms: Sequence[EffectTerm]) -> list[Observation]:
    """The ``runs`` with drives on, each under its arm with ``terms``."""
    return [observation(run, (*run.arm.effects, *terms)) for run in runs if run.powered]


def observation(run: Run, effects: Sequence[EffectTerm], velocities: Array | None = None) -> Observation:
    """A recording under its arm with these effects instead of the arm's own.

    velocities: (n,) rad/s (m/s), smoothing velocities instead of the arm's own.
    """
    t, q = run.raw
    if velocities is not None:
        run = replace(run, arm=run.arm.with_sign_velocities(velocities))
    arm = replace(run.arm, effects=(*effects, *run.own))
    rate, angle = rate_of(t), between_steps(q)
    shown = motion_of(true_angle(arm, q), MOTION_BAND, rate)
    standstill = np.stack([standstill_rows(v, rate) for v in shown[1].T], axis=1)
    delay = np.sum([current_delay(effect, values, t) for effect, _, values in terms_of(arm)], axis=0) + np.zeros_like(t)
    # an angle interpolated between two steps has no reading noise
    read = ndimage.uniform_filter1d((angle == q).astype(float), max(1, round(SMEARED * rate)), axis=0)
    noise = np.sqrt(np.maximum(read, 0.0)) * [speed_noise(run, joint) for joint in range(1, q.shape[1] + 1)]
    noise = noise * (arm.uncertainty is None)
    if velocities is None and np.array_equal(angle, q):
        return Observation(run, shown[1], noise, residual_under(run, effects), standstill, delay, _model_std(run))
    motion = motion_of(true_angle(arm, angle), MOTION_BAND, rate)
    expected = low_pass(predicted_current(arm, t, angle, motion=motion), COMPARE_BAND, rate)[kept_rows(rate)]
    return Observation(run, motion[1], noise, run.current - expected, standstill, delay, _model_std(run))


def _model_std(run: Run) -> Array:
    """(m, n) A, see ``Observation``: parameters within their covariance, and what the model left near rest."""
    uncertainty = run.arm.uncertainty
    if uncertainty is None:
        return np.zeros_like(run.q)
    near_rest = [np.nan if value is None else value for value in uncertainty.near_rest] or [np.nan] * len(run.arm)
    return np.hypot(parameter_std(run), np.array(near_rest) / run.arm.joint_array("drive_constant"))


def near_rest(recordings: Sequence[Observation], joint: int, nuisance: Collection[Variable] = ()) -> list[NearRest]:
    """A joint near rest in each recording; empty if its speed or its model is not known well enough near rest.

    nuisance: variables of another law; what functions of them explain, one per direction, is projected out.
    """
    judged = (
        recording
        for recording in recordings
        if known_speed(recording, joint) and np.isfinite(recording.model_std[:, joint - 1]).all()
    )
    of_runs = [_of_run(one, joint) for one in judged]
    return [_with_nuisance(one, nuisance) for one in of_runs if one.rows.any()]


def _with_nuisance(one: NearRest, variables: Collection[Variable]) -> NearRest:
    """The rows, orthogonal to any function of each of the variables in either direction of motion."""
    if not variables:
        return one
    sign = one.of(one.sign(one.run.arm.joints[one.joint - 1].sign_velocity))
    columns = []
    for variable in variables:
        x = {Variable.POSITION: one.run.q, Variable.LOAD: one.run.rigid}[variable][one.rows, one.joint - 1]
        knots = np.linspace(x.min(), x.max(), BENDS)
        hats = np.stack([np.interp(x, knots, hat) for hat in np.eye(BENDS)], axis=1)
        columns += [hats / one.std[:, None], hats * sign[:, None]]
    basis, size, _ = np.linalg.svd(np.hstack(columns), full_matrices=False)
    one = replace(one, nuisance_basis=basis[:, size > 1e-6 * size[0]])
    return replace(one, residual=one.without_nuisance(one.residual))


def known_speed(recording: Observation, joint: int) -> bool:
    """Whether the encoder shows a motion as one; if its noise is not counted, it must not be ``coarse``."""
    counted = recording.noise[:, joint - 1].any()
    return speed_noise(recording.run, joint) < (SPEED_NOISE if counted else COARSE)


def coarse(run: Run, joint: int) -> bool:
    """Whether the encoder cannot resolve a fraction of the speed below which a joint counts as at rest."""
    return speed_noise(run, joint) >= COARSE


def speed_noise(run: Run, joint: int) -> float:
    """rad/s (m/s): std of the speed of a joint (from 1) by its encoder."""
    rate = rate_of(run.raw[0])
    band = min(MOTION_BAND, rate / 2)
    return float(position_noise(run, joint) * 2 * np.pi * np.sqrt(band**3 / 3 / (rate / 2)))


def position_noise(run: Run, joint: int) -> float:
    """rad (m): std of the angle of a joint (from 1) by its encoder."""
    return float(angle_noise(run.raw[1][:, [joint - 1]], run.steps[[joint - 1]])[0])


def _of_run(recording: Observation, joint: int) -> NearRest:
    run, v, j = recording.run, recording.v[:, joint - 1], joint - 1
    rate = rate_of(run.raw[0])
    instruments = run.instruments[:, j]
    standstill = recording.standstill[:, j]
    slow = _spread(np.abs(v) < SLIDES, SMEARED * rate)
    rows = (slow & ~_spread(standstill, AFTER_REST * rate))[kept_rows(rate)] & (
        run.deviation[:, j] < UNMEASURED * instruments
    )
    passage, _ = ndimage.label(rows)
    one = NearRest(
        run=run,
        joint=joint,
        v=v,
        standstill=standstill,
        rows=rows,
        block=(passage.astype(np.intp) * len(rows) + (np.arange(len(rows)) // run.per_second).astype(np.intp))[rows],
        residual=np.zeros(0),
        std=np.ones(int(rows.sum())),
        delay=recording.delay,
    )
    drive = run.arm.joints[j]
    lacking = 1.0 - np.abs(one.sign(drive.sign_velocity))
    unknown = max(drive.rest_friction) * np.hypot(TURN * lacking, direction_noise(v, recording.noise[:, j]))
    std = np.sqrt(instruments[rows] ** 2 + one.of(unknown) ** 2 + recording.model_std[rows, j] ** 2)
    return replace(one, residual=recording.residual[rows, j] / std, std=std)


def direction_noise(v: Array, noise: Array) -> Array:
    """(k,) std of the direction of motion, +-1, where a speed v (k,) rad/s has that noise (k,)."""
    # without noise the direction is certain
    stds = np.divide(np.abs(v), noise, out=np.full(np.shape(v), np.inf), where=noise > 0.0)
    other_way = ndtr(-stds)
    return np.asarray(2.0 * np.sqrt(other_way * (1.0 - other_way)))


def standstill_rows(v: Array, rate: float) -> NDArray[np.bool_]:
    """(k,) True where a joint with speeds v (k,) rad/s at ``rate`` Hz is at rest."""
    return _longer(np.abs(v) < STANDS, STANDS_FOR * rate)


def _longer(flags: NDArray[np.bool_], rows: float) -> NDArray[np.bool_]:
    """(k,) the runs of True in ``flags`` (k,) that are longer than ``rows``."""
    label, count = ndimage.label(flags)
    length = np.bincount(label, minlength=count + 1)
    return np.asarray(flags & (length[label] > rows))


def _spread(flags: NDArray[np.bool_], rows: float) -> NDArray[np.bool_]:
    """(k,) each True in ``flags`` (k,) extended by ``rows`` on either side."""
    return np.asarray(ndimage.maximum_filter1d(flags.astype(np.uint8), 2 * int(rows) + 1) > 0)
