"""Columns of effects beyond the model in the rows of one recording, each computed once."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from arm_io.types import Array
from arm_model import Arm
from arm_model.effects import Signals, Values
from arm_model.system import rigid_torque_along
from comparison.joint_fit.effects import Added, own_inertia
from comparison.regression import Rows
from diagnosis.residual.gap import through_gap
from diagnosis.residual.integration import spring_twist
from identification.preprocessing import butterworth, zero_phase
from identification.preprocessing.signals import Motion, equation_rows, equation_weight, parallel_filter
from identification.selection import scaled_lstsq

ABOVE = 10.0
"""Power of an acceleration over that of its noise up to which it is a motion."""
LINES = 9
"""Lines of the spectrum whose median is that power: rates of it are in proportion at every frequency."""
STEP = 1e-3
"""Of an angle (rad) and its rates: of the central differences by which an error of an angle moves the torques."""
NOTHING = 1e-9
"""Of the largest torque, per rad (m): less is rounding, as of the zero of an axis along gravity."""


class EffectColumns:
    """Columns of the effects of an arm along a motion, in the rows of its regression.

    They are of the positions alone, but for a delay, which is of the torques: columns are kept where torques are put
    back by a delay.
    """

    def __init__(self, arm: Arm, motion: Motion) -> None:
        self._arm, self._motion = arm, motion
        self._known: dict[tuple[object, ...], Array] = {}

    def of(self, every: Sequence[Added], torque: Array) -> Array:
        """(k, e) columns of all of them; torque (m, J) N m (N): measured ones, for delays."""
        found = [np.empty((len(self._place[0]), 0))]
        for one in every:
            if one.timed:
                found.append(self._in_rows(_of_delay(self._motion, torque, self._load, *self._smooth[1:])))
                continue
            if one.key not in self._known:
                of_arm = torque_of(one, self._arm, self._motion, self._load, self._inertia)
                self._known[one.key] = self._in_rows(of_arm)
            found.append(self._known[one.key])
        return np.concatenate(found, axis=1)

    def _in_rows(self, torque: Array) -> Array:
        weighted = torque * equation_weight(self._motion)[..., None]
        return np.asarray(parallel_filter(self._motion, weighted)[self._place])

    @cached_property
    def _place(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """(k,) row of the filtered motion, and joint, of each row."""
        joint, row = np.nonzero(equation_rows(self._motion)[1].T)
        return row, joint

    @cached_property
    def _smooth(self) -> tuple[Array, Array, Array]:
        return _above_noise(self._motion)

    @cached_property
    def _load(self) -> Array:
        """(m, J) N m (N) of the links at the drives."""
        return _smooth(rigid_torque_along(self._arm, *self._smooth), self._motion)

    @cached_property
    def _inertia(self) -> Array:
        return own_inertia(self._arm, self._motion)


def with_columns(rows: Rows, more: Array) -> Rows:
    """The rows of a recording with further columns (k, e), after those of the compared values."""
    return Rows(rows.equations, np.concatenate([rows.columns, more], axis=1), rows.own, rows.y)


def torque_of(one: Added, arm: Arm, motion: Motion, load: Array, inertia: Array) -> Array:
    """(m, J, k) N m (N) at the drives per unit of each coefficient.

    load, inertia  (m, J) N m and kg m2 (N and kg) of the links at the drives
    """
    if one.placed:
        return _misplaced(one, arm, motion)
    assert one.joint is not None
    j, effect = one.joint - 1, one.definition
    motor = Signals(q=arm.link_angles(motion.q)[:, j], motor=arm.joints[j].ratio * motion.q[:, j])
    found = []
    for p in one.units:
        if effect.spring is not None:
            found.append(_moved(arm, motion, j, *_twist(one, p, load[:, j], inertia[:, j], motion)))
        elif effect.angle is not None:
            error = np.asarray(effect.angle(p, motor))
            rates = np.gradient(error, motion.dt), np.gradient(np.gradient(error, motion.dt), motion.dt)
            torque = _moved(arm, motion, j, error, *rates)
            # the motor's true angle differs from its encoder's
            torque[:, j] -= arm.joints[j].ratio ** 2 * arm.joints[j].rotor_inertia * rates[1]
            found.append(torque)
        else:
            assert effect.torque is not None
            found.append(np.outer(np.asarray(effect.torque(p, motor)), arm.coupling_matrix[j]))
    return np.stack(found, axis=-1)


def _of_delay(motion: Motion, torque: Array, load: Array, speed: Array, acceleration: Array) -> Array:
    """(m, J, 1) N m (N) per s of delay: minus the rate of what load, rotor and friction explain of torques (m, J).

    The rate of the measured torques would be that of their noise: in it, any delay is found by which they are put back.
    """
    explained = np.zeros_like(torque)
    for j in range(torque.shape[1]):
        v, used = speed[:, j], motion.certain[:, j]
        columns = np.column_stack([load[:, j], acceleration[:, j], v, np.sign(v), np.ones_like(v)])
        explained[:, j] = columns @ scaled_lstsq(columns[used], torque[used, j])
    return -np.gradient(explained, motion.dt, axis=0)[..., None]


def _misplaced(one: Added, arm: Arm, motion: Motion) -> Array:
    """(m, J, k) of an error of where the arm is: central differences of the torque of its links."""
    change = one.definition.change
    assert change is not None
    found = []
    for p in one.units:
        ends = [change(arm, one.joint, Values({name: sign * STEP * of for name, of in p.items()})) for sign in (1, -1)]
        ahead, behind = (rigid_torque_along(each, motion.q, motion.qd, motion.qdd) for each in ends)
        torque = (ahead - behind) / (2 * STEP)
        found.append(torque if np.abs(torque).max() > NOTHING * np.abs(ahead).max() else np.zeros_like(torque))
    return np.stack(found, axis=-1)


def _twist(one: Added, p: Values, load: Array, inertia: Array, motion: Motion) -> tuple[Array, Array, Array]:
    """Motor angle less link angle (m,) and its rates."""
    if one.elastic:
        return spring_twist(load, inertia, p["stiffness"], p["damping"], motion.dt)
    gap = through_gap(load, inertia, p["half_gap"], motion.dt)
    # a gap that the load never crosses acts like another zero of the encoder
    gap = _smooth((gap if np.ptp(gap) > p["half_gap"] else np.zeros_like(gap))[:, None], motion)[:, 0]
    speed = np.gradient(gap, motion.dt)
    return gap, speed, np.gradient(speed, motion.dt)


def _above_noise(motion: Motion) -> tuple[Array, Array, Array]:
    """Angles (m, J), speeds and accelerations of each joint up to where its motion is lost in the noise of its encoder.

    Beyond, a load is what the encoder's noise makes of accelerations. The torque that these ask for is wrong by the
    same noise, and the twist of a soft gear, whose link would not follow it, explains that error.
    """
    band = motion.band
    noise = (2.0 * np.pi * band.frequency[:, None]) ** 4 * band.noise_rms**2 / band.frequency[-1]
    filtered = [motion.q.copy(), motion.qd.copy(), motion.qdd.copy()]
    for j in range(motion.q.shape[1]):
        smooth = ndimage.median_filter(band.density[:, j], LINES)
        lost = np.flatnonzero((smooth < ABOVE * noise[:, j]) & (band.frequency > 0.0))
        cut = float(band.frequency[lost[0]]) if len(lost) else np.inf
        if 2.0 * cut * motion.dt < 0.98:
            low_pass = butterworth(2, 2.0 * cut * motion.dt)
            for values in filtered:
                values[:, j] = zero_phase(low_pass, values[:, j])
    return filtered[0], filtered[1], filtered[2]


def _smooth(values: Array, motion: Motion) -> Array:
    """Values (m, ...) in the band of the regression, beyond which their rates would be noise."""
    low_pass = butterworth(4, 2 * motion.band.parallel * motion.dt)
    return zero_phase(low_pass, values)


def _moved(arm: Arm, motion: Motion, j: int, angle: Array, speed: Array, acceleration: Array) -> Array:
    """(m, J) N m: what torques change by where link j (from 0) is behind its drive by ``angle`` (m,), with rates."""
    size = STEP / max(float(np.abs(angle).max()), 1e-300)
    shift = [np.zeros_like(motion.q) for _ in range(3)]
    for one, by in zip(shift, (angle, speed, acceleration)):
        one[:, j] = size * by
    behind, ahead = (
        rigid_torque_along(arm, motion.q - sign * shift[0], motion.qd - sign * shift[1], motion.qdd - sign * shift[2])
        for sign in (1.0, -1.0)
    )
    return np.asarray((behind - ahead) / (2 * size))
