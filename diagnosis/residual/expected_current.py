"""Currents that the transducers of a model show for a recorded motion, with every effect of the model exactly.

Columns of candidates are first-order changes; the model that has been accepted so far is evaluated here instead, so
that the second order of a strong effect is not mistaken for another effect.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline

from arm_io.types import Array
from arm_model import Arm, Joint
from arm_model.effects import CATALOGUE, Effect, Signals, Values, described, values_of
from arm_model.rigid_body import curve_level
from arm_model.system import inverse_dynamics, mass_matrix_along, rigid_torque_along
from diagnosis.residual.filters import COMPARE_BAND, MOTION_BAND, Motion, low_pass, motion_of, rate_of
from diagnosis.residual.gap import AS_FOUND, POSSIBLE, Teeth, gap_of, through_gap
from diagnosis.residual.integration import in_series, integrated, spring_of, spring_twist

Term = tuple[Effect, int | None, Values]
STEP = 1e-5
"""rad (m): of finite differences of a load."""


def coulomb_at(joint: Joint, v: Array, sign: Array) -> Array:
    """(m,) N m (N): friction of a joint at speeds v (m,) without its viscous part: Coulomb and friction curve.

    The direction is that of ``sign`` (m,), a smooth sign between -1 and 1.
    """
    up, down = (joint.ratio * c for c in joint.coulomb)
    curve = 0.0 if joint.friction_curve is None else curve_level(joint.friction_curve, v, sign)
    return np.asarray((up + down) / 2 + (up - down) / 2 * sign + curve)


def terms_of(arm: Arm) -> list[Term]:
    """The effects of a model with their parameters, without those that screening removes from the data."""
    return [
        (CATALOGUE[term.name], term.joint, values_of(CATALOGUE[term.name], term.parameters))
        for term in arm.effects
        if not CATALOGUE[term.name].screened
    ]


def true_angle(arm: Arm, q: Array) -> Array:
    """(m, n) rad: true motor angles, at joint side, while their encoders read q."""
    angle = q.copy()
    errors = [(effect.angle, joint - 1, values) for effect, joint, values in terms_of(arm) if effect.angle and joint]
    # a fixed-point iteration for the errors at the true angle: it contracts, as errors are far below their period
    for _ in range(2 if errors else 0):
        at, angle = angle, q.copy()
        for law, j, values in errors:
            angle[:, j] -= law(values, Signals(motor=at[:, j] * arm.joints[j].ratio))
    return angle


@dataclass(frozen=True)
class Links:
    """Rigid links of an arm in the band of comparison, with its motors at angles (m, n) rad, ``rate`` rows per second.

    They wind up the springs of the transmissions. Each quantity is computed when it is first asked for.
    """

    arm: Arm
    angle: Array
    rate: float

    @cached_property
    def motion(self) -> Motion:
        """The motion of the motors, which is that of the links if nothing is elastic."""
        return motion_of(self.angle, COMPARE_BAND, self.rate)

    @cached_property
    def load(self) -> Array:
        """(m, n) N m at the drives."""
        return rigid_torque_along(self.arm, *self.motion)

    @cached_property
    def inertia(self) -> Array:
        """(m, n) kg m2 of the links alone at the drives."""
        return mass_matrix_along(self.arm, self.motion[0]).diagonal(axis1=1, axis2=2).copy()

    def eased(self, j: int) -> Array:
        """(m,) N m/rad: by how much the load of joint j (from 0) falls per rad that its link is behind the motor."""
        if j not in self._eased:
            q, v, a = self.motion
            small = STEP * np.eye(q.shape[1])[j]
            ahead, behind = (rigid_torque_along(self.arm, q + by, v, a)[:, j] for by in (small, -small))
            self._eased[j] = (ahead - behind) / (2 * STEP)
        return self._eased[j]

    @cached_property
    def _eased(self) -> dict[int, Array]:
        return {}

    @cached_property
    def flights(self) -> tuple[Array, Array]:
        """Load and inertia (m, n) in the whole ``MOTION_BAND``, for a link that crosses a gap freely.

        A load smoothed over the instant of contact would separate the flanks too early and too late.
        """
        motion = motion_of(self.angle, MOTION_BAND, self.rate)
        inertia = mass_matrix_along(self.arm, motion[0]).diagonal(axis1=1, axis2=2)
        return rigid_torque_along(self.arm, *motion), inertia.copy()


def predicted_current(
    arm: Arm,
    t: Array,
    q: Array,
    *,
    powered: bool = True,
    motion: Motion | None = None,
    links: Links | None = None,
    teeth: Teeth = AS_FOUND,
) -> Array:
    """(m, n) A that the transducers show at times t (m,) s, uniform, while the encoders show q (m, n) rad.

    Not ``powered``: the drives are off, no current flows, and the transducers show what they add themselves.
    motion, links: ``motion_of`` the ``true_angle``, and the ``Links`` at it, where they are known already. teeth: of
    joints with play.
    """
    rate = rate_of(t)
    angle = true_angle(arm, q)
    motion = motion_of(angle, MOTION_BAND, rate) if motion is None else motion
    bent, terms = described(arm), terms_of(arm)
    torque = inverse_dynamics(arm, *motion, time=t)
    if any(effect.spring or effect.rate for effect, _, _ in terms):
        torque = torque + _with_states(arm, terms, motion, links or Links(bent, angle, rate), teeth)
    return transduced(arm, t, powered * torque / bent.joint_array("drive_constant"))


def current_delay(effect: Effect, values: Values, t: Array) -> Array:
    """(m,) s by which an effect delays currents at times t (m,) s; 0 of one that delays none."""
    late = 0.0 if effect.delay is None else effect.delay(values, Signals(t=t))
    return np.broadcast_to(np.asarray(late, float), t.shape)


def delayed(t: Array, signal: Array, late: Array) -> Array:
    """(m, ...) the ``signal`` (m, ...) at times t (m,) s, uniform, ``late`` (m,) s later; held before it begins."""
    return np.asarray(CubicSpline(t, signal)(np.clip(t - late, t[0], t[-1])), float)


def transduced(arm: Arm, t: Array, current: Array) -> Array:
    """(m, n) A that transducers of ``arm`` show at times t (m,) s of motor currents (m, n) A: late, and not linear."""
    terms = terms_of(arm)
    for effect, _, values in terms:
        if effect.delay is not None:
            current = delayed(t, current, current_delay(effect, values, t))
    for effect, joint, values in terms:
        if effect.current is not None and joint is not None:
            of_joint, current = current[:, joint - 1], current.copy()
            current[:, joint - 1] = of_joint + effect.current(values, Signals(current=of_joint, t=t))
    return np.asarray(current, float)


def _with_states(arm: Arm, terms: list[Term], motion: Motion, links: Links, teeth: Teeth) -> Array:
    """(m, n) N m that elastic transmissions, wound up as their load demands at every instant, and bristles add."""
    added = np.zeros_like(links.angle)
    for effect, joint, values in terms:
        if effect.rate is not None and effect.torque is not None and joint is not None:
            j, drive = joint - 1, arm.joints[joint - 1]
            speed = motion[1][:, j]
            sign = speed / np.hypot(speed, drive.sign_velocity)
            s = Signals(q=motion[0][:, j], v=speed, sign=sign, coulomb=coulomb_at(drive, speed, sign))
            added[:, j] += effect.torque(values, replace(s, state=integrated(effect, values, s, 1.0 / links.rate)))
    link = tuple(part.copy() for part in links.motion)
    for j in sorted({joint - 1 for _, joint, _ in terms if joint is not None}):
        for of_joint in _twists(terms, j, links, teeth):
            for part, twist in zip(link, of_joint):
                part[:, j] -= twist
    return added + rigid_torque_along(links.arm, *link) - links.load


def springs_at(terms: Sequence[Term], joint: int) -> list[tuple[float, float]]:
    """Stiffness and damping of every spring at a joint (from 1)."""
    several = (spring_of(effect, values) for effect, at, values in terms if at == joint)
    return [one for one in several if one is not None]


def _twists(terms: Sequence[Term], j: int, links: Links, teeth: Teeth) -> Iterator[Motion]:
    """Twist (m,) of all springs of joint j (from 0) together and of every play, each with its rates."""
    if springs := springs_at(terms, j + 1):
        load, inertia, spring = links.load[:, j], links.inertia[:, j], in_series(springs)
        yield spring_twist(load, inertia, *spring, 1.0 / links.rate, links.eased(j))
    for effect, joint, values in terms:
        if joint == j + 1 and effect.gap is not None and effect.deflection is not None:
            load, inertia = links.flights
            gap = through_gap(load[:, j], inertia[:, j], gap_of(effect, values), 1.0 / links.rate, teeth)
            twist = low_pass(gap, MOTION_BAND, links.rate)
            speed: Array = np.gradient(twist, 1.0 / links.rate)
            yield twist, speed, np.asarray(np.gradient(speed, 1.0 / links.rate), float)


def possible_teeth(arm: Arm) -> tuple[Teeth, ...]:
    """Other ways in which the teeth of an arm may meet than the law's; empty if no joint has backlash."""
    return POSSIBLE if any(effect.gap is not None for effect, _, _ in terms_of(arm)) else ()


def has_dynamics(arm: Arm) -> bool:
    """Whether the model expects any torque at all."""
    return any(
        joint.mass or joint.rotor_inertia or any(joint.coulomb) or any(joint.viscous) or joint.friction_curve
        for joint in arm.joints
    )
