"""Residual generation: the current that a model predicts for the measured motion, and measured less predicted current.

Every signal is smoothed by the same zero-phase filters on both sides of the equation, then thinned to
``ROWS_PER_SECOND``. The residual is the measured motor current less the predicted one, in A. Partial derivatives of the
predicted current by angle, speed and acceleration turn an error of an angle into changes of the currents of all joints.
"""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from arm_io.types import Array
from arm_model import Arm, EffectTerm
from arm_model.effects import Signals, described
from arm_model.rigid_body import drive_mass_matrix
from arm_model.rigid_body.regressor import link_regressor
from arm_model.system import inverse_dynamics, mass_matrix_along, rigid_torque_along
from diagnosis.residual.evaluations import Evaluations
from diagnosis.residual.expected_current import (
    COLUMN_BAND,
    COMPARE_BAND,
    MOTION_BAND,
    Links,
    coulomb_at,
    low_pass,
    may_be,
    motion_of,
    rate_along,
    rate_of,
    reading,
    true_angle,
)
from diagnosis.residual.instrument_noise import channel_noise, row_by_row
from diagnosis.residual.noise import NOTHING_KNOWN, KnownNoise, encoder_steps
from diagnosis.residual.perpendicular import beside
from diagnosis.residual.setpoint_ripple import DIRECTIONS, folded_onto, ripple_beside, unseen_directions
from identification.preprocessing import UNKNOWN, Setpoints, setpoints_of, unbounded

ROWS_PER_SECOND = 100
KEPT = 8
"""Residuals of one recording under other effects that are kept."""
CREEP = 0.02
"""rad/s (m/s): below it friction depends on more than the velocity."""


@dataclass(frozen=True)
class Run:
    """The residual of one recording under one model; m rows at some ROWS_PER_SECOND, n joints.

    raw: t (k,) s and q (k, n) rad as recorded, events taken out; t (m,) s from the start of the recording; q, v, a (m,
    n) rad and per second of the motor over gear; current, expected, residual (m, n) A; current_rate A/s;
    rigid (m, n) N m: torque to the links; inertia (m, n) kg m2 of the links alone; both at the drives, where joints are
    coupled;
    folded (m, n) A: one std of what sampling may have put into the currents unseen (``setpoint_ripple``); rippled (m,
    n, d) A: the same of lines that are seen beside 0 Hz; setpoints: of the servos;
    brisk_v, brisk_rigid: v and rigid from the motion in the band of comparison, less smooth and noisier;
    noise (n,) A: std of the residual from the instruments alone; loop_noise (n,) A: the same with what servos do at
    setpoints, which a simulated closed loop does at other instants; instruments (m, n) A: the same row by row, larger
    where steps of an encoder beat with the rows (``beats``); deviation (m, n) A: std that the residual has with nothing
    wrong: of the instruments, and of friction near standstill; block (m,): block of one second, from 0;
    recordings: those of a ``merged`` run;
    arm: as it was set up for this run (with a known payload, say); powered: False where the drives were off: the brakes
    hold the arm, and the currents show what their own instruments add; own: effects that only this recording has, which
    ``expected`` contains (``with_own``); own_directions (m n, r), orthonormal: what values of this recording alone
    explain of the whitened residual, which is no evidence of anything else (``free_values``).
    """

    name: str
    raw: tuple[Array, Array]
    t: Array
    q: Array
    v: Array
    a: Array
    current: Array
    current_rate: Array
    expected: Array
    rigid: Array
    brisk_v: Array
    brisk_rigid: Array
    inertia: Array
    deviation: Array
    noise: Array
    loop_noise: Array
    instruments: Array
    folded: Array
    rippled: Array
    block: NDArray[np.intp]
    arm: Arm
    setpoints: Setpoints = UNKNOWN
    powered: bool = True
    own: tuple[EffectTerm, ...] = ()
    own_directions: Array | None = None
    recordings: tuple[Run, ...] = ()

    @cached_property
    def parts(self) -> tuple[slice, ...]:
        """Rows that follow one another in time: one part, or one for each recording of a ``merged`` run."""
        ends = np.flatnonzero(np.diff(self.t) <= 0.0) + 1
        edges = [0, *ends.tolist(), len(self.t)]
        return tuple(slice(a, b) for a, b in itertools.pairwise(edges))

    @cached_property
    def rates(self) -> tuple[float, ...]:
        """Rows per second of each of the ``parts``."""
        # every spring of a search grid asks for them
        return tuple(rate_of(self.t[part]) for part in self.parts)

    @property
    def per_second(self) -> float:
        """Rows per second: of 250 rows/s every second one is kept, which makes 125, not ROWS_PER_SECOND."""
        return rate_of(self.t)

    @property
    def alike(self) -> float:
        """Rows that count as one: the filters leave 2 x COMPARE_BAND independent values per second."""
        return self.per_second / (2.0 * COMPARE_BAND)

    def rate(self, values: Array) -> Array:
        """Derivative of values (m,) by time, within each recording."""
        return np.concatenate([rate_along(values[part], 1.0 / rate) for part, rate in zip(self.parts, self.rates)])

    @cached_property
    def along(self) -> Array:
        """(m, n) A: current by first-order laws, for the motion from which columns are computed."""
        return inverse_dynamics(self.arm, self.q, self.v, self.a) / self.arm.joint_array("drive_constant")

    @cached_property
    def by_acceleration(self) -> Array:
        """(m, n, n) A s2/rad: derivative of the expected current of joint j by the acceleration of link k."""
        links = np.ascontiguousarray(mass_matrix_along(described(self.arm), self.q, rotors=False).transpose(2, 1, 0))
        links /= self.arm.joint_array("drive_constant")[:, None]
        return links.transpose(2, 1, 0)

    @cached_property
    def by_angle(self) -> Array:
        """(m, n, n) A/rad: as ``by_acceleration``, by the angle."""
        return self._slopes(1e-5, 0.0)

    @cached_property
    def by_speed(self) -> Array:
        """(m, n, n) A s/rad: as ``by_acceleration``, by the speed."""
        return self._slopes(0.0, 0.5)

    @cached_property
    def by_link(self) -> Array:
        """(m, n, 10 n) N m per inertial parameter of each link."""
        return link_regressor(described(self.arm), self.q, self.v, self.a)

    @cached_property
    def flights(self) -> tuple[Array, Array, float]:
        """Loads (k, n) N m and inertias (k, n) kg m2 of the links in the raw rows, and their rate, Hz."""
        t, q = self.raw
        rate = rate_of(t)
        return *Links(described(self.arm), true_angle(self.arm, q), rate).flights, rate

    @cached_property
    def residuals(self) -> deque[tuple[tuple[EffectTerm, ...], Array]]:
        """The last residuals (m, n) A under other effects than those of ``arm``: several steps ask for the same."""
        return deque(maxlen=KEPT)

    @cached_property
    def evaluations(self) -> Evaluations:
        """Of the raw rows, under the arm with other effects."""
        return Evaluations(*self.raw, self.powered)

    def _slopes(self, angle: float, speed: float) -> Array:
        """(m, n, n) A: slopes of the rigid torque by each angle or speed, by central differences of these steps."""
        bent, joints = described(self.arm), np.eye(len(self.arm))
        # rows follow one another in memory: columns take them by moved link and joint
        slopes = np.empty((len(joints), len(joints), len(self.t))).transpose(2, 1, 0)
        for k, joint in enumerate(joints):
            moved = ((self.q + side * angle * joint, self.v + side * speed * joint) for side in (1.0, -1.0))
            up, down = (rigid_torque_along(bent, q, v, self.a) for q, v in moved)
            slopes[..., k] = (up - down) / (2 * (angle + speed))
        return slopes / self.arm.joint_array("drive_constant")[:, None]

    @property
    def residual(self) -> Array:
        """(m, n) A."""
        return self.current - self.expected

    @property
    def whitened(self) -> Array:
        """(m, n) residual over its std."""
        return self.whiten(self.residual)

    def whiten(self, values: Array) -> Array:
        """Values (m, n) or (m, n, k) A over the std that they would have with nothing wrong.

        Along ``folded`` and ``rippled``, their drift as two clocks diverge, and where no line shows how much it is, its
        shift against the motion that a servo makes of setpoints, a residual counts less (``unseen_directions``), in the
        recording and joint that these belong to.
        """
        over = self.deviation.reshape(*self.deviation.shape, *[1] * (values.ndim - 2))
        white: Array = values / over
        for joint in {j + 1 for _, j, _, _ in self._unseen}:
            white[:, joint - 1] = self._without_unseen(white[:, joint - 1], joint)
        return white if self.own_directions is None else beside(self.own_directions, white)

    def whiten_at(self, values: Array, joint: int) -> Array:
        """``whiten`` of values (m, k) A at one joint (1-based)."""
        return self._without_unseen(values / self.deviation[:, [joint - 1]], joint)

    def _without_unseen(self, white: Array, joint: int) -> Array:
        """Values (m, ...) at one joint over their std, those along what sampling hides counting less; in place."""
        for part, j, basis, less in self._unseen:
            if j == joint - 1:
                white[part] -= basis @ (less * (basis.T @ white[part]).T).T
        return white

    def less_folded(self, values: Array) -> Array:
        """Values (m, n) A less as much of what sampling may have put into them unseen as ``whiten`` does not count."""
        return self.deviation * replace(self, own_directions=None).whiten(values) if self._unseen else values

    @property
    def without_ripple(self) -> Run:
        """The run as if sampling could hide nothing that servos do at setpoints."""
        return replace(self, folded=np.zeros_like(self.folded), rippled=np.zeros_like(self.rippled))

    def hidden_in(self, white: Array) -> Array:
        """(m, n): of a residual over its std (m, n), what sampling most likely put there (posterior mean)."""
        hidden = np.zeros_like(white)
        for part, j, basis, less in self._unseen:
            hidden[part, j] = basis @ ((1.0 - (1.0 - less) ** 2) * (basis.T @ white[part, j]))
        return hidden

    @cached_property
    def _unseen(self) -> list[tuple[slice, int, Array, Array]]:
        """Rows, joint, orthonormal directions (r, k) of what folds there, and the share by which these count less."""
        found, of_unseen = [], unbounded(self.setpoints, rate_of(self.raw[0]))
        matters = self.folded.any(axis=0) | self.rippled.any(axis=(0, 2))
        for part, j in itertools.product(self.parts, np.flatnonzero(matters).tolist()):
            over, t = 1.0 / self.deviation[part, j], self.t[part] - self.t[part][0]
            folded, rippled = self.folded[part, j] * over, self.rippled[part, j] * over[:, None]
            directions = unseen_directions(folded, rippled, t, of_unseen=of_unseen, per_second=rate_of(self.t[part]))
            found.append((part, j, *directions))
        return found


def residual_run(
    name: str, arm: Arm, t: Array, q: Array, i: Array, *, powered: bool = True, known: KnownNoise = NOTHING_KNOWN
) -> Run:
    """The residual of a recording t (m,) s, q (m, n) rad, i (m, n) A, under ``arm``.

    The recording is uniformly sampled and without gaps. ``known``: of the noise of its instruments.
    """
    rate = rate_of(t)
    angle = true_angle(arm, q)
    position, v, a = motion_of(angle, MOTION_BAND, rate)
    bent = described(arm)
    constant = bent.joint_array("drive_constant")
    keep = kept(rate)
    if known.steps is None:
        known = replace(known, steps=encoder_steps(q))

    def thin(values: Array, band: float = COMPARE_BAND) -> Array:
        # joint by joint in memory, as columns take them, and without all the rows between
        return np.asfortranarray(low_pass(values, band, rate)[keep])

    # Columns are made from a motion smoothed further: what they have in common with the noise of the residual would
    # look like a cause.
    low, slow_v, slow_a = (thin(values, COLUMN_BAND) for values in (position, v, a))
    links = mass_matrix_along(bent, low, rotors=False)
    # friction near standstill is indeterminate, as far as the filters smear it
    coulomb = np.array([max(joint.rest_friction) for joint in arm.joints]) / constant
    slowest = ndimage.minimum_filter1d(np.abs(v), int(0.06 * rate), axis=0)[keep]
    width = arm.joint_array("sign_velocity")
    uncertain = np.maximum(np.exp(-((slowest / CREEP) ** 2)), 1.0 - slowest / np.hypot(slowest, width))
    friction_std = coulomb * uncertain * powered
    rows, current, expected = t[keep], thin(i), thin(reading(arm, t, q, powered=powered, motion=(position, v, a)))
    # of a gap, what teeth do as they meet is uncertain
    other = (reading(arm, t, q, powered=powered, motion=(position, v, a), teeth=teeth) for teeth in may_be(arm))
    of_teeth = sum(((thin(one) - expected) ** 2 for one in other), np.zeros_like(expected))
    block = ((rows - rows[0]) // 1.0).astype(np.intp)
    brisk = [thin(values) for values in (position, v, a)]
    setpoints, period = UNKNOWN, 0.0
    folded, rippled = np.zeros_like(slow_v), np.zeros((*slow_v.shape, DIRECTIONS))
    if known.residual is not None:
        noise = loop_noise = known.residual
        instruments = np.broadcast_to(noise, slow_v.shape)
    else:
        moved = drive_mass_matrix(bent, q[:: max(1, len(q) // 50)]) / constant[:, None]
        setpoints = known.setpoints
        if not setpoints.period:
            setpoints = setpoints_of(arm, 1.0 / rate, currents=(lambda: _ripple_of(i, a, rate)) if powered else None)
        # of setpoints that the currents alone show, what servos do above the lines that are seen stays noise
        period = 0.0 if setpoints.source == "currents" else setpoints.period
        noise = channel_noise(q, i, moved, rate, known, period)
        loop_noise = channel_noise(q, i, moved, rate, known, 0.0) if period else noise
        instruments = row_by_row(noise, q, slow_v, moved, rate, known)
    if powered and setpoints.period:
        folded = folded_onto(arm, (t, angle, i), brisk[2], noise, keep, setpoints)
        rippled = ripple_beside(arm, (t, angle, i), noise, keep, setpoints)
    return Run(
        name=name,
        raw=(t, q),
        t=rows - t[0],
        q=low,
        v=slow_v,
        a=slow_a,
        current=current,
        current_rate=thin(np.gradient(i, 1.0 / rate, axis=0)),
        expected=expected,
        rigid=np.asfortranarray(rigid_torque_along(bent, low, slow_v, slow_a)),
        brisk_v=brisk[1],
        brisk_rigid=np.asfortranarray(rigid_torque_along(bent, *brisk)),
        inertia=np.asfortranarray(links.diagonal(axis1=1, axis2=2)),
        deviation=np.asfortranarray(np.sqrt(instruments**2 + friction_std**2 + of_teeth)),
        noise=noise,
        loop_noise=loop_noise,
        instruments=instruments,
        folded=folded,
        rippled=rippled,
        block=block,
        arm=arm,
        setpoints=setpoints,
        powered=powered,
    )


def _ripple_of(i: Array, a: Array, rate: float) -> tuple[Array, Array]:
    """(k, n) A what servos do in currents, and (k, n) rad/s2 the acceleration that causes it."""
    return i - low_pass(i, COMPARE_BAND, rate), low_pass(a, COLUMN_BAND, rate)


def merged(runs: Sequence[Run]) -> Run:
    """Recordings of one setup, rows one after the other, as candidates compute their columns from.

    Name, raw and block are the first's.
    """
    rows: dict[str, Any] = {
        field.name: np.concatenate([getattr(run, field.name) for run in runs])
        for field in fields(Run)
        if isinstance(getattr(runs[0], field.name), np.ndarray) and field.name not in ("block", "noise")
    }
    return replace(runs[0], **rows, recordings=tuple(runs))


def kept(rate: float) -> slice:
    """Rows of a recording at ``rate`` Hz that are kept: about ROWS_PER_SECOND of them, without filter transients."""
    return slice(int(0.2 * rate), -int(0.2 * rate), max(1, round(rate / ROWS_PER_SECOND)))


def rate_kept(rate: float) -> float:
    """Rows per second of those that are ``kept`` of a recording at ``rate`` Hz: 125 of 250, 111 of 333."""
    return rate / (kept(rate).step or 1)


def residual_with(run: Run, terms: Sequence[EffectTerm]) -> Array:
    """(m, n) A: ``Run.residual`` of a recording under its arm with more effects."""
    return residual_under(run, (*run.arm.effects, *terms))


def residual_under(run: Run, effects: Sequence[EffectTerm]) -> Array:
    """(m, n) A: the residual of a recording under its arm with these effects instead of its own."""
    if tuple(effects) == run.arm.effects:
        return run.residual
    for known, residual in run.residuals:
        if known == tuple(effects):
            return residual
    residual = run.current - _expected(run, (*effects, *run.own))
    residual.flags.writeable = False
    run.residuals.append((tuple(effects), residual))
    return residual


def with_own(run: Run, terms: Sequence[EffectTerm]) -> Run:
    """The run with these effects of its recording alone, in the place of those that it had."""
    if tuple(terms) == run.own:
        return run
    return replace(run, own=tuple(terms), expected=_expected(run, (*run.arm.effects, *terms)))


def _expected(run: Run, effects: Sequence[EffectTerm]) -> Array:
    """(m, n) A: the current that the arm of a run predicts with these effects instead of its own."""
    return run.evaluations.expected(replace(run.arm, effects=tuple(effects)), kept(rate_of(run.raw[0])))


def signals_of(run: Run, arm: Arm, joint: int, *, link_side: bool = False) -> Signals:
    """Arguments (m,) of the laws of effects at one joint (1-based) of a run.

    ``link_side``: the speed is that of the link; it differs from that of the motor where joints are coupled.
    """
    j = joint - 1
    drive = arm.joints[j]
    v = (arm.link_angles(run.brisk_v) if link_side else run.brisk_v)[:, j]
    sign, warmer = v / np.sqrt(v**2 + drive.sign_velocity**2), warmth(run, joint)
    return Signals(
        q=arm.link_angles(run.q)[:, j],
        v=v,
        a=run.a[:, j],
        motor=drive.ratio * run.q[:, j],
        sign=sign,
        load=run.rigid[:, j],
        coulomb=coulomb_at(drive, v, sign),
        current=run.current[:, j],
        torque=run.current[:, j] * drive.drive_constant,
        t=run.t,
        warmer=0.0 if warmer is None else warmer,
    )


def warmth(run: Run, joint: int) -> Array | None:
    """(m,) K of the motor of a joint (from 1) above where its friction holds; None where that is not known."""
    reference, temperatures = run.arm.joints[joint - 1].temperature, run.arm.temperatures
    degc = None if temperatures is None else temperatures.at(joint - 1, run.t)
    return None if degc is None or reference is None else degc - reference
