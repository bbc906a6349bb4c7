"""A recording beside what its model predicts: measured and predicted current, and the std that their difference has.

The residual is the measured motor current less the predicted one, in A. Partial derivatives of the predicted current by
angle, speed and acceleration turn an error of an angle into changes of the currents of all joints.
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

from arm_io.types import Array
from arm_model import Arm, EffectTerm
from arm_model.effects import described
from arm_model.rigid_body.regressor import link_regressor
from arm_model.system import inverse_dynamics, mass_matrix_along, rigid_torque_along
from diagnosis.residual.evaluations import Evaluations
from diagnosis.residual.expected_current import Links, true_angle
from diagnosis.residual.filters import COMPARE_BAND, Motion, rate_along, rate_of
from diagnosis.residual.projection import orthogonal_to, orthonormal_basis
from diagnosis.residual.setpoint_ripple import lead_of, unseen_directions
from identification.preprocessing import UNKNOWN, Setpoints
from identification.preprocessing.folding import unbounded

KEPT = 8
"""Residuals of one recording under other effects that are kept."""

Span = tuple[float, float, int | None]
"""First and last time, s from the start of the recording, and the joint (from 1) without a current; None: all are."""


@dataclass(frozen=True)
class Run:
    """The residual of one recording under one model: m rows (``kept_rows``), n joints.

    raw           t (k,) s and q (k, n) rad (m) as recorded, events taken out, smoothed to ``angle_band``
    t             (m,) s from the start of the recording
    q, v, a       (m, n) rad (m) and per second: of the motor over its gear, in the band of columns
    brisk_v, brisk_rigid  v and rigid in the band of comparison, less smooth and noisier
    current, expected  (m, n) A, measured and by the model; current_rate: A/s
    rigid         (m, n) N m (N): torque to the links, at the drives where joints are coupled
    inertia       (m, n) kg m2 (kg): of the links alone, at the drives as well
    deviation     (m, n) A: std of the residual with nothing wrong, of instruments and of friction near standstill
    noise         (n,) A: std of the residual by the instruments alone
    loop_noise    (n,) A: the same with what servos do at setpoints, which a simulated loop does at other instants
    instruments   (m, n) A: as ``noise``, row by row: larger where steps of an encoder beat with rows (``noise.beats``)
    steps         (n,) rad (m): of the encoders, 0 where they have none
    angle_band    Hz; inf: the angles are not smoothed
    may_fold      (m, n) A: one std of what sampling may have put into the currents unseen (``setpoint_ripple``)
    folded        (m, n) A: the same where it matters
    rippled       (m, n, d) A: of lines that are seen beside 0 Hz
    block         (m,) block of one second of each row, from 0
    arm           as set up for this run, with a known payload, say
    setpoints     of the servos
    without_noise  as of ``noise.instruments``
    powered       False: the drives were off, the brakes hold the arm, and currents show what their instruments add
    own           effects that only this recording has, which ``expected`` contains (``with_own``)
    own_directions  (m n, r), orthonormal: what values of this recording alone explain of the whitened residual, which
                  is no evidence of anything else (``with_free``)
    recordings    those of a ``merged`` run
    unmeasured    spans without a sample, which weigh nothing (``deviation``)
    resolved      joints (from 1) that show more along ``folded`` than sampling may put there: it counts in full
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
    steps: Array
    angle_band: float
    may_fold: Array
    folded: Array
    rippled: Array
    block: NDArray[np.intp]
    arm: Arm
    setpoints: Setpoints = UNKNOWN
    without_noise: bool = False
    powered: bool = True
    own: tuple[EffectTerm, ...] = ()
    own_directions: Array | None = None
    recordings: tuple[Run, ...] = ()
    unmeasured: tuple[Span, ...] = ()
    resolved: tuple[int, ...] = ()

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
        links = np.ascontiguousarray(mass_matrix_along(described(self.arm), self.q).transpose(2, 1, 0))
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

    def moved(self, j: int, at: slice, motion: Motion) -> Array:
        """(m, k) A: change of the expected currents of k joints ``at``, where link j (from 0) is further by an angle.

        motion: that angle (m,) rad (m), its rate and its second rate.
        """
        angle, speed, acceleration = motion
        change: Array = self.by_angle[:, at, j] * angle[:, None]
        change += self.by_speed[:, at, j] * speed[:, None]
        change += self.by_acceleration[:, at, j] * acceleration[:, None]
        return change

    def eased(self, j: int) -> Array:
        """(m,) N m/rad (N/m): by how much the load of joint j (from 0) falls per rad that its link is behind."""
        return np.asarray(self.by_angle[:, j, j] * self.arm.joints[j].drive_constant)

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
        return white if self.own_directions is None else orthogonal_to(self.own_directions, white)

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
        """Values (m, n) A less as much of what sampling may have put into them unseen as ``whiten`` does not count.

        Of ``resolved`` joints as well: causes explain the rest of what these show.
        """
        hiding = replace(self, own_directions=None, resolved=())
        return self.deviation * hiding.whiten(values) if hiding._unseen else values

    @property
    def without_ripple(self) -> Run:
        """The run as if sampling could hide nothing that servos do at setpoints."""
        nothing = np.zeros_like(self.folded)
        return replace(self, may_fold=nothing, folded=nothing, rippled=np.zeros_like(self.rippled))

    def hidden_in(self, white: Array) -> Array:
        """(m, n): of a residual over its std (m, n), what sampling most likely put there (posterior mean)."""
        hidden = np.zeros_like(white)
        for part, j, basis, less in self._unseen:
            hidden[part, j] = basis @ ((1.0 - (1.0 - less) ** 2) * (basis.T @ white[part, j]))
        return hidden

    @cached_property
    def _unseen(self) -> list[tuple[slice, int, Array, Array]]:
        """Rows, joint, orthonormal directions (r, k) of what folds there, and the share by which these count less."""
        directions, of_unseen = [], unbounded(self.setpoints, rate_of(self.raw[0]))
        counted = np.isin(np.arange(len(self.arm)) + 1, self.resolved)
        along = np.where(counted, 0.0, self.folded)
        matters = along.any(axis=0) | self.rippled.any(axis=(0, 2))
        for part, j in itertools.product(self.parts, np.flatnonzero(matters).tolist()):
            over, t = 1.0 / self.deviation[part, j], self.t[part] - self.t[part][0]
            folded, rippled = along[part, j] * over, self.rippled[part, j] * over[:, None]
            ahead = lead_of(along[part, j], rate_of(self.t[part])) * over * of_unseen
            directions.append((part, j, *unseen_directions(folded, ahead, rippled, t)))
        return directions


def merged(runs: Sequence[Run]) -> Run:
    """Recordings of one setup with their rows one after the other, as candidates need them for their columns.

    Name, raw data and block are those of the first.
    """
    rows: dict[str, Any] = {
        field.name: np.concatenate([getattr(run, field.name) for run in runs])
        for field in fields(Run)
        if isinstance(getattr(runs[0], field.name), np.ndarray) and field.name not in ("block", "noise", "steps")
    }
    return replace(runs[0], **rows, recordings=tuple(runs))


def with_free(run: Run, columns: Array | None) -> Run:
    """The run with columns (m, n, k) A, of which every coefficient is free in this recording; None: with none.

    Residual and further columns are then judged beside them (Frisch & Waugh, Econometrica 1, 1933).
    """
    bare = replace(run, own_directions=None)
    if columns is None:
        return bare
    return replace(bare, own_directions=orthonormal_basis(bare.whiten(columns).reshape(-1, columns.shape[2])))
