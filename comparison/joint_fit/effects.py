"""Effects beyond the model whose change is looked for: springs, elastic gears, gaps, ripples, the arm out of place.

Ripples are those that stand out. Out of place is an arm whose base is tilted, or whose encoders have other zeros.
Each is columns of the joint fit: the torque of all joints for a unit of each coefficient, by the law of the catalogue.
All sides share its value, and its change is a hypothesis like any other.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import ndimage

from arm_io.types import Array
from arm_model import Arm
from arm_model.effects import CATALOGUE, Effect, Signals, Values, units
from arm_model.system import mass_matrix_along, rigid_torque_along
from comparison.regression import Rows
from diagnosis.residual.gap import through_gap
from diagnosis.residual.integration import spring_twist
from identification.preprocessing import butterworth, zero_phase
from identification.preprocessing.signals import Motion, equation_rows, equation_weight, parallel_filter
from identification.selection import scaled_lstsq

STIFFNESSES = (1e3, 4e3, 2e4, 2e5)
"""N m/rad (N/m) at which an elastic gear is tried: one that is stiffer is the last of them, in proportion."""
DAMPING_RATIO = 0.1
"""Of an elastic gear with its link: more, and its twist would be as late as currents that are read at another time."""
CONTACT = {"contact_stiffness": 1e5, "contact_damping": 80.0}
"""N m/rad (N/m) and N m s/rad (N s/m) where a gap is closed: stiff, so that it is the gap alone that shows."""
HALF_GAPS = (5e-4, 2e-3)
"""rad (m) at which a gap is tried: what it does is in proportion, but for the time in which the link crosses it."""
NEAR = 0.1
"""Relative difference of the orders of two ripples of which one looks like the other."""
ABOVE = 10.0
"""Power of an acceleration over that of its noise up to which it is a motion."""
LINES = 9
"""Lines of the spectrum whose median is that power: rates of it are in proportion at every frequency."""
STEP = 1e-3
"""Of an angle (rad) and its rates: of the central differences by which an error of an angle moves the torques."""
NOTHING = 1e-9
"""Of the largest torque, per rad (m): less is rounding, as of the zero of an axis along gravity."""


@dataclass(frozen=True)
class Added:
    """One effect at one joint (from 1), or of the whole arm (None), with its nonlinear parameters ``held``.

    amplitude  of a ripple: the linear parameter that it has; "": the effect's first
    tries      number of alternatives from which it was chosen by the data
    """

    effect: str
    joint: int | None
    held: Mapping[str, float] = field(default_factory=dict)
    amplitude: str = ""
    tries: int = 1

    def same(self, other: Added) -> bool:
        """Whether both have the same columns."""
        key = self.effect, self.joint, dict(self.held), self.amplitude
        return key == (other.effect, other.joint, dict(other.held), other.amplitude)

    @property
    def wave(self) -> bool:
        """Whether it is a ripple."""
        return self.definition.wave

    @property
    def placed(self) -> bool:
        """Whether it is an error of placement: of the base, or of the zero of an encoder."""
        return self.definition.change is not None

    @property
    def timed(self) -> bool:
        """Whether it is a delay of the currents."""
        return self.definition.delay is not None

    @property
    def elastic(self) -> bool:
        """Whether it is an elastic gear, at a stiffness."""
        return self.effect == "joint_compliance"

    def stiffer(self, by: float) -> Added:
        """The elastic gear at ``by`` times the stiffness, of the same damping ratio."""
        held = {"stiffness": self.held["stiffness"] * by, "damping": self.held["damping"] * math.sqrt(by)}
        return replace(self, held=held)

    def near(self, other: Added) -> bool:
        """Whether both are ripples of one joint that a travel of one turn hardly distinguishes."""
        if not (self.wave and other.wave) or self.joint != other.joint:
            return False
        return abs(self.held["order"] / other.held["order"] - 1.0) < NEAR

    @property
    def definition(self) -> Effect:
        """The effect as the catalogue defines it."""
        return CATALOGUE[self.effect]

    @property
    def units(self) -> list[Values]:
        """Parameter values, one set per column."""
        if self.definition.wave:
            return units(self.definition, self.held, self.amplitude)
        names = [p.name for p in self.definition.parameters]
        if self.placed:
            return [Values(dict.fromkeys(names, 0.0) | {name: 1.0}) for name in names]
        # a spring relaxed at one angle: relaxed at another, it adds a constant torque, which friction has as well
        return [Values(dict.fromkeys(names, 0.0) | {names[0]: 1.0} | dict(self.held))]


SKEW = Added("time_skew", None)
"""Currents that are read later or earlier than the angles."""


def always(arm: Arm, motions: Sequence[Motion]) -> list[Added]:
    """The tilt of the base; zeros, springs, elastic gears and gaps of every joint, but those that the model has."""
    centre = np.mean([arm.link_angles(motion.q).mean(axis=0) for motion in motions], axis=0)
    modelled = {(term.name, term.joint) for term in arm.effects}
    inertia = np.mean([np.mean(_own_inertia(arm, motion), axis=0) for motion in motions], axis=0)
    effects = [Added("base_tilt", None), SKEW]
    for joint in range(1, len(arm) + 1):
        effects.append(Added("joint_zero_offset", joint))
        effects.append(Added("gravity_spring", joint, {"rest_angle": float(centre[joint - 1])}))
        critical = 2.0 * np.sqrt(np.array(STIFFNESSES) * max(float(inertia[joint - 1]), 0.0))
        damping = (DAMPING_RATIO * critical).tolist()
        elastic = [{"stiffness": k, "damping": c} for k, c in zip(STIFFNESSES, damping)]
        effects += [Added("joint_compliance", joint, held, tries=len(elastic)) for held in elastic]
        gaps = [{"half_gap": gap, **CONTACT} for gap in HALF_GAPS]
        effects += [Added("backlash", joint, held, tries=len(gaps)) for held in gaps]
    # delays of the model are corrected in the readings
    return [one for one in effects if one == SKEW or (one.effect, one.joint) not in modelled]


def added_rows(every: Sequence[Added], arm: Arm, motion: Motion) -> Array:
    """(k, e) columns of all of them in the rows of one recording."""
    joint, row = np.nonzero(equation_rows(motion)[1].T)
    weight = equation_weight(motion)[..., None]
    smooth = _above_noise(motion)
    load = _smooth(rigid_torque_along(arm, *smooth), motion)
    inertia = _own_inertia(arm, motion)
    torques = [
        _of_delay(motion, load, *smooth[1:]) if one.timed else torque_of(one, arm, motion, load, inertia)
        for one in every
    ]
    parts = [parallel_filter(motion, torque * weight)[row, joint] for torque in torques]
    return np.concatenate([np.empty((len(row), 0)), *parts], axis=1)


def _own_inertia(arm: Arm, motion: Motion) -> Array:
    """(m, J) kg m2 (kg) of the links about each joint, the others at rest."""
    return np.asarray(mass_matrix_along(arm, motion.q).diagonal(axis1=1, axis2=2))


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


def _of_delay(motion: Motion, load: Array, speed: Array, acceleration: Array) -> Array:
    """(m, J, 1) N m (N) per s of delay: minus the rate of what load, rotor and friction explain of the torques.

    The rate of the measured torques would be that of their noise: in it, any delay is found by which they are put back.
    """
    explained = np.zeros_like(motion.torque)
    for j in range(motion.torque.shape[1]):
        v, used = speed[:, j], motion.certain[:, j]
        columns = np.column_stack([load[:, j], acceleration[:, j], v, np.sign(v), np.ones_like(v)])
        explained[:, j] = columns @ scaled_lstsq(columns[used], motion.torque[used, j])
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
