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
from arm_model.rigid_body.regressor import regressor
from arm_model.system import inverse_dynamics, mass_matrix_along, rigid_torque_along
from diagnosis.residual.beats import beat_variance, steps_of
from diagnosis.residual.expected_current import (
    COLUMN_BAND,
    COMPARE_BAND,
    MOTION_BAND,
    coulomb_at,
    low_pass,
    motion_of,
    rate_of,
    reading,
    true_angle,
)
from diagnosis.residual.folded import folded_currents, rows_per_setpoint
from diagnosis.residual.noise import NOTHING_KNOWN, KnownNoise, angle_noise, encoder_steps, scatter
from diagnosis.residual.perpendicular import beside
from identification.preprocessing import UNSEEN, drifting

ROWS_PER_SECOND = 100
ROWS_FOR_ONE = ROWS_PER_SECOND / (2.0 * COMPARE_BAND)
"""Rows that count as one: the filters leave 2 x COMPARE_BAND independent values per second."""
KEPT = 8
"""Residuals of one recording under other effects that are kept."""
AHEAD = 0.02
"""s by which setpoints are ahead of the motion: the delay of a servo with a bandwidth of 8 Hz."""
CREEP = 0.02
"""rad/s (m/s): below it friction depends on more than the velocity."""


@dataclass(frozen=True)
class Run:
    """The residual of one recording under one model; m rows at ROWS_PER_SECOND, n joints.

    raw: t (k,) s and q (k, n) rad as recorded, events taken out; t (m,) s from the start of the recording; q, v, a (m,
    n) rad and per second of the motor over gear; current, expected, residual (m, n) A; current_rate A/s;
    rigid (m, n) N m: torque to the links; inertia (m, n) kg m2 of the links alone; both at the drives, where joints are
    coupled;
    folded (m, n) A: one std of what sampling may have put into the currents unseen (``identification.preprocessing``),
    where rows come at this many ``setpoint_rows`` per setpoint of the controller, stated or seen (0: not so);
    brisk_v, brisk_rigid: v and rigid from the motion in the band of comparison, less smooth and noisier;
    noise (n,) A: std of the residual from the instruments alone; instruments (m, n) A: the same row by row, larger
    where steps of an encoder beat with the rows (``beats``); deviation (m, n) A: std that the residual has with nothing
    wrong: of the instruments, and of friction near standstill; block (m,): block of one second, from 0;
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
    instruments: Array
    folded: Array
    setpoint_rows: int
    block: NDArray[np.intp]
    arm: Arm
    powered: bool = True
    own: tuple[EffectTerm, ...] = ()
    own_directions: Array | None = None

    @property
    def parts(self) -> tuple[slice, ...]:
        """Rows that follow one another in time: one part, or one for each recording of a ``merged`` run."""
        ends = np.flatnonzero(np.diff(self.t) <= 0.0) + 1
        edges = [0, *ends.tolist(), len(self.t)]
        return tuple(slice(a, b) for a, b in itertools.pairwise(edges))

    def rate(self, values: Array) -> Array:
        """Derivative of values (m,) by time, within each recording."""
        return np.concatenate([np.gradient(values[part], 1.0 / ROWS_PER_SECOND) for part in self.parts])

    @cached_property
    def along(self) -> Array:
        """(m, n) A: current by first-order laws, for the motion from which columns are computed."""
        return inverse_dynamics(self.arm, self.q, self.v, self.a) / self.arm.joint_array("drive_constant")

    @cached_property
    def by_acceleration(self) -> Array:
        """(m, n, n) A s2/rad: derivative of the expected current of joint j by the acceleration of link k."""
        links = mass_matrix_along(described(self.arm), self.q, rotors=False).transpose(2, 0, 1)
        return (links / self.arm.joint_array("drive_constant")).transpose(1, 2, 0)

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
        return regressor(described(self.arm), self.q, self.v, self.a)[0][..., : 10 * len(self.arm)]

    @cached_property
    def residuals(self) -> deque[tuple[tuple[EffectTerm, ...], Array]]:
        """The last residuals (m, n) A under other effects than those of ``arm``: several steps ask for the same."""
        return deque(maxlen=KEPT)

    @cached_property
    def twists(self) -> dict[tuple[int, float, float], tuple[Array, Array, Array]]:
        """Twist (m,) rad, rate and second rate behind springs (joint from 0, stiffness, damping) computed so far."""
        return {}

    def _slopes(self, angle: float, speed: float) -> Array:
        """(m, n, n) A: slopes of the rigid torque by each angle or speed, by central differences of these steps."""
        bent, joints = described(self.arm), np.eye(len(self.arm))
        # the rows of one moved link follow one another in memory: columns take them link by link
        slopes = np.empty((len(joints), len(self.t), len(joints))).transpose(1, 2, 0)
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

        Along ``folded``, its drift as two clocks diverge, and where no line shows how much it is, its shift against the
        motion that a servo makes of setpoints, a residual of one std more is no evidence: the inverse root of the
        covariance 1 + f f^T, in the recording and joint that f belongs to.
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
        return self.deviation * replace(self, own_directions=None).whiten(values) if self.folded.any() else values

    @cached_property
    def _unseen(self) -> list[tuple[slice, int, Array, Array]]:
        """Rows, joint, orthonormal directions (r, k) of what folds there, and the share by which these count less."""
        found, of_unseen = [], self.setpoint_rows == UNSEEN and self.arm.controller is not None
        for part, j in itertools.product(self.parts, np.flatnonzero(self.folded.any(axis=0)).tolist()):
            over, folded = 1.0 / self.deviation[part, j], self.folded[part, j]
            own = drifting(folded * over, self.t[part] - self.t[part][0])
            if of_unseen:
                # the setpoints make the ripple, and the motion follows them later
                own = np.column_stack([own, AHEAD * ROWS_PER_SECOND * np.gradient(folded) * over])
            basis, size, _ = np.linalg.svd(own, full_matrices=False)
            found.append((part, j, basis, 1.0 - 1.0 / np.sqrt(1.0 + size**2)))
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

    def thin(values: Array) -> Array:
        return low_pass(values, COMPARE_BAND, rate)[keep]

    moved = drive_mass_matrix(bent, q[:: max(1, len(q) // 50)]) / constant[:, None]
    noise = channel_noise(q, i, moved, rate, known)
    # Columns are made from a motion smoothed further: what they have in common with the noise of the residual would
    # look like a cause.
    low, slow_v, slow_a = (low_pass(values, COLUMN_BAND, rate)[keep] for values in (position, v, a))
    links = mass_matrix_along(bent, low, rotors=False)
    # friction near standstill is indeterminate, as far as the filters smear it
    coulomb = np.array([max(joint.rest_friction) for joint in arm.joints]) / constant
    slowest = ndimage.minimum_filter1d(np.abs(v), int(0.06 * rate), axis=0)[keep]
    width = arm.joint_array("sign_velocity")
    uncertain = np.maximum(np.exp(-((slowest / CREEP) ** 2)), 1.0 - slowest / np.hypot(slowest, width))
    friction_std = coulomb * uncertain * powered
    rows, current, expected = t[keep], thin(i), thin(reading(arm, t, q, powered=powered, motion=(position, v, a)))
    block = ((rows - rows[0]) // 1.0).astype(np.intp)
    instruments = _row_by_row(noise, q, slow_v, moved, rate, known)
    setpoint_rows = rows_per_setpoint(arm, i, a, rate) if powered else 0
    brisk = [thin(values) for values in (position, v, a)]
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
        rigid=rigid_torque_along(bent, low, slow_v, slow_a),
        brisk_v=brisk[1],
        brisk_rigid=rigid_torque_along(bent, *brisk),
        inertia=links.diagonal(axis1=1, axis2=2),
        deviation=np.hypot(instruments, friction_std),
        noise=noise,
        instruments=instruments,
        folded=folded_currents(arm, (t, angle, i), setpoint_rows, keep, brisk[2], noise),
        setpoint_rows=setpoint_rows,
        block=block,
        arm=arm,
        powered=powered,
    )


def merged(runs: Sequence[Run]) -> Run:
    """Recordings of one setup, rows one after the other, as candidates compute their columns from.

    Name, raw and block are the first's.
    """
    rows: dict[str, Any] = {
        field.name: np.concatenate([getattr(run, field.name) for run in runs])
        for field in fields(Run)
        if isinstance(getattr(runs[0], field.name), np.ndarray) and field.name not in ("block", "noise")
    }
    return replace(runs[0], **rows)


def kept(rate: float) -> slice:
    """Rows of a recording at ``rate`` Hz that are kept: ROWS_PER_SECOND of them, without filter transients."""
    return slice(int(0.2 * rate), -int(0.2 * rate), max(1, round(rate / ROWS_PER_SECOND)))


def passed(frequency: Array) -> Array:
    """Share of an oscillation at ``frequency`` Hz that passes the filters of motion and comparison."""
    # the eighth power by squaring: numpy's takes ten times as long
    compare, motion = (np.square(np.square(np.square(frequency / band))) for band in (COMPARE_BAND, MOTION_BAND))
    share: Array = 1.0 / (1.0 + compare) / (1.0 + motion)
    return share


def channel_noise(q: Array, i: Array, inertia: Array, rate: float, known: KnownNoise) -> Array:
    """(n,) A: standard deviation of the residual from the instruments alone, in the band of comparison.

    inertia (k, n, n) A s2/rad: currents per acceleration, at some rows.
    Current: its scatter, taken for white, or its std at standstill, if that is known and larger.
    Angle: its step or scatter, through two differentiations and the joint's own inertia. See ``noise``.
    """
    white = scatter(i)
    frequency = np.linspace(0.0, rate / 2, 2000)
    through = passed(frequency)
    share = np.trapezoid(1.0 / (1.0 + (frequency / COMPARE_BAND) ** 8) ** 2, frequency) / (rate / 2)
    wobble = np.trapezoid(((2 * np.pi * frequency) ** 2 * through) ** 2, frequency) / (rate / 2)
    own = inertia.diagonal(axis1=1, axis2=2).mean(axis=0)
    from_angle = own * angle_noise(q, known.steps) * np.sqrt(wobble)
    from_current = np.maximum(white * np.sqrt(share), known.still)
    return np.hypot(from_current, from_angle) + 1e-9


def _row_by_row(noise: Array, q: Array, v: Array, inertia: Array, rate: float, known: KnownNoise) -> Array:
    """(m, n) A: ``noise`` (n,) or, at speeds v (m, n) at which encoder steps beat with the rows, what the beats leave.

    inertia: as of ``channel_noise``.
    An acceleration that is wrong at one joint is wrong in the currents of all that its inertia couples.
    """
    beats = beat_variance(v, steps_of(q, known.steps), rate, lambda f: (2 * np.pi * f) ** 2 * passed(f))
    return np.sqrt(np.maximum(noise**2, beats @ np.mean(inertia**2, axis=0).T))


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
    t, q = run.raw
    rate = rate_of(t)
    arm = replace(run.arm, effects=(*effects, *run.own))
    residual = run.current - low_pass(reading(arm, t, q, powered=run.powered), COMPARE_BAND, rate)[kept(rate)]
    residual.flags.writeable = False
    run.residuals.append((tuple(effects), residual))
    return residual


def with_own(run: Run, terms: Sequence[EffectTerm]) -> Run:
    """The run with these effects of its recording alone, in the place of those that it had."""
    if tuple(terms) == run.own:
        return run
    t, q = run.raw
    rate = rate_of(t)
    arm = replace(run.arm, effects=(*run.arm.effects, *terms))
    expected = low_pass(reading(arm, t, q, powered=run.powered), COMPARE_BAND, rate)[kept(rate)]
    return replace(run, own=tuple(terms), expected=expected)


def signals_of(run: Run, arm: Arm, joint: int, *, link_side: bool = False) -> Signals:
    """Arguments (m,) of the laws of effects at one joint (1-based) of a run.

    ``link_side``: the speed is that of the link; it differs from that of the motor where joints are coupled.
    """
    j = joint - 1
    drive = arm.joints[j]
    v = (arm.link_angles(run.brisk_v) if link_side else run.brisk_v)[:, j]
    sign = v / np.sqrt(v**2 + drive.sign_velocity**2)
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
    )
