"""Currents that the transducers of a model show for a recorded motion, with every effect of the model exactly.

Columns of candidates are first-order changes; the model that has been accepted so far is evaluated here instead, so
that the second order of a strong effect is not mistaken for another effect.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
from scipy import signal
from scipy.interpolate import CubicSpline
from scipy.linalg import blas

from arm_io.types import Array
from arm_model import Arm, Joint
from arm_model.effects import CATALOGUE, Effect, Signals, Values, described, values_of
from arm_model.rigid_body import curve_level
from arm_model.system import inverse_dynamics, mass_matrix_along, rigid_torque_along
from identification.preprocessing import zero_phase

Term = tuple[Effect, int | None, Values]

MOTION_BAND = 60.0
"""Hz: pass-band of the motion from which the model's currents are computed."""
COLUMN_BAND = 10.0
"""Hz: pass-band of the motion from which the columns of effects, and the wind-up of elastic joints, are computed."""
COMPARE_BAND = 20.0
"""Hz: pass-band in which measured and expected currents are compared."""
ORDER = 4
"""Of the low-pass filter."""
NO_INERTIA = 1e-12
"""kg m2 (kg): rounding errors of a link without inertia about its axis; a gram on a millimetre has a thousand times."""


Motion = tuple[Array, Array, Array]
"""Angle, speed and acceleration (m, n)."""


def low_pass(values: Array, band: float, rate: float) -> Array:
    """Zero-phase fourth-order Butterworth along the first axis; ``rate`` Hz is that of the rows."""
    return zero_phase(_sections(band, rate), values, pad=min(len(values) - 1, int(3 * rate / band)))


def passed(frequency: Array, band: float) -> Array:
    """Share of the amplitude that ``low_pass`` lets through at frequencies (m,) Hz: a Butterworth filter, both ways."""
    return np.asarray(1.0 / (1.0 + (frequency / band) ** (2 * ORDER)))


@cache
def _sections(band: float, rate: float) -> Array:
    sections: Array = signal.butter(ORDER, min(band / (rate / 2), 0.98), output="sos")
    return sections


def rate_of(t: Array) -> float:
    """Hz: rows per second of uniform times t (m,) s."""
    return 1.0 / float(np.median(np.diff(t)))


def rate_along(values: Array, step: float) -> Array:
    """Derivative of values (m, ...) along their rows, ``step`` s apart: that of their cubic spline.

    At a fifth of the rate of the rows, differences of the rows on both sides are a quarter too small, a spline 1 %.
    """
    t = step * np.arange(len(values))
    spline = CubicSpline(t, values)
    # the derivative at the first row of each piece is the coefficient of its linear term
    return np.concatenate([spline.c[2], spline(t[-1:], 1)])


def coulomb_at(joint: Joint, v: Array, sign: Array) -> Array:
    """(m,) N m (N): friction of a joint at speeds v (m,) without its viscous part: Coulomb's and its friction curve.

    It is that of the direction of ``sign`` (m,), smooth between -1 and 1.
    """
    up, down = (joint.ratio * c for c in joint.coulomb)
    curve = 0.0 if joint.friction_curve is None else curve_level(joint.friction_curve, v, sign)
    return np.asarray((up + down) / 2 + (up - down) / 2 * sign + curve)


def motion_of(q: Array, band: float, rate: float) -> Motion:
    """Angle, speed and acceleration (m, n) of recorded angles q (m, n), as far as they lie in the band."""
    angle = low_pass(q, band, rate)
    speed = np.gradient(angle, 1.0 / rate, axis=0)
    return angle, speed, np.gradient(speed, 1.0 / rate, axis=0)


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
    """Rigid links of an arm in the band of comparison, while its motors stand at angles (m, n) rad, ``rate`` Hz apart.

    Springs are wound up by them. Each is computed when it is first asked for.
    """

    arm: Arm
    angle: Array
    rate: float

    @cached_property
    def motion(self) -> Motion:
        """Of the motors: that of the links, if nothing is elastic."""
        return motion_of(self.angle, COMPARE_BAND, self.rate)

    @cached_property
    def load(self) -> Array:
        """(m, n) N m at the drives."""
        return rigid_torque_along(self.arm, *self.motion)

    @cached_property
    def inertia(self) -> Array:
        """(m, n) kg m2 of the links alone at the drives."""
        return mass_matrix_along(self.arm, self.motion[0], rotors=False).diagonal(axis1=1, axis2=2).copy()


def reading(
    arm: Arm, t: Array, q: Array, *, powered: bool = True, motion: Motion | None = None, links: Links | None = None
) -> Array:
    """(m, n) A that the transducers show at times t (m,) s, uniform, while the encoders show q (m, n) rad.

    Not ``powered``: the drives are off, no current flows, and the transducers show what they add themselves.
    motion, links: ``motion_of`` the ``true_angle``, and the ``Links`` at it, where they are known already.
    """
    rate = rate_of(t)
    angle = true_angle(arm, q)
    motion = motion_of(angle, MOTION_BAND, rate) if motion is None else motion
    bent, terms = described(arm), terms_of(arm)
    torque = inverse_dynamics(arm, *motion, time=t)
    if any(effect.spring or effect.rate for effect, _, _ in terms):
        torque = torque + _with_states(arm, terms, motion, links or Links(bent, angle, rate))
    return as_read(arm, t, powered * torque / bent.joint_array("drive_constant"))


def lateness(effect: Effect, values: Values, t: Array) -> Array:
    """(m,) s by which an effect delays currents at times t (m,) s; 0 of one that delays none."""
    late = 0.0 if effect.delay is None else effect.delay(values, Signals(t=t))
    return np.broadcast_to(np.asarray(late, float), t.shape)


def delayed(t: Array, signal: Array, late: Array) -> Array:
    """(m, ...) the ``signal`` (m, ...) at times t (m,) s, uniform, ``late`` (m,) s later; held before it begins."""
    return np.asarray(CubicSpline(t, signal)(np.clip(t - late, t[0], t[-1])), float)


def as_read(arm: Arm, t: Array, current: Array) -> Array:
    """(m, n) A that transducers of ``arm`` show at times t (m,) s of motor currents (m, n) A: late, and not linear."""
    terms = terms_of(arm)
    for effect, _, values in terms:
        if effect.delay is not None:
            current = delayed(t, current, lateness(effect, values, t))
    for effect, joint, values in terms:
        if effect.current is not None and joint is not None:
            own, current = current[:, joint - 1], current.copy()
            current[:, joint - 1] = own + effect.current(values, Signals(current=own, t=t))
    return np.asarray(current, float)


def _with_states(arm: Arm, terms: list[Term], motion: Motion, links: Links) -> Array:
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
    for effect, joint, values in terms:
        if effect.spring is not None and effect.deflection is not None and joint is not None:
            for part, twist in zip(link, _twist(effect, values, links, joint - 1)):
                part[:, joint - 1] -= twist
    return added + rigid_torque_along(links.arm, *link) - links.load


def _twist(effect: Effect, values: Values, links: Links, j: int) -> Motion:
    load, inertia, step = links.load[:, j], links.inertia[:, j], 1.0 / links.rate
    if (spring := spring_of(effect, values)) is not None:
        return wound_up(load, inertia, *spring, step)
    twist = low_pass(through_gap(load, inertia, gap_of(effect, values), step), MOTION_BAND, links.rate)
    speed: Array = np.gradient(twist, step)
    return twist, speed, np.asarray(np.gradient(speed, step), float)


def through_gap(load: Array, inertia: Array, half_gap: float, step: float) -> Array:
    """Twist (m,) of a joint with play, for rows ``step`` s apart.

    +half_gap where the motor pushes the link, -half_gap where it holds it back.

    Where the ``load`` (m,) N m that the link of ``inertia`` (m,) kg m2 needs changes its sign, the teeth part: the link
    flies, inertia d'' = load, until it meets the other flank, and stays there. That takes a tenth of a second where
    gravity turns it over, and ends with a jump of the current. A link without inertia is there at once. Between two
    rows the load is a straight line: a flight that began at a row would be late by half a row, which looks like a time
    skew.
    """
    twist, k, side = np.empty_like(load), 0, 1.0 if load[0] >= 0.0 else -1.0
    to_flight = {one: np.flatnonzero(one * load < 0.0) for one in (1.0, -1.0)}
    torques, masses = load.tolist(), np.maximum(inertia, NO_INERTIA).tolist()
    while True:
        # on a flank up to the row before which the load pulls it off
        ahead = to_flight[side]
        place = int(np.searchsorted(ahead, k))
        start = int(ahead[place]) if half_gap and place < len(ahead) else len(load)
        twist[k:start], k = side * half_gap, start
        if k == len(load):
            return twist
        before = max(side * torques[k - 1], 0.0) if k else 0.0
        fall = -side * torques[k]
        since = step * fall / (fall + before)
        d, v = half_gap - since * since * fall / masses[k] / 6, -since * fall / masses[k] / 2
        while abs(d) < half_gap:
            twist[k], k = side * d, k + 1
            if k == len(load):
                return twist
            torque, after, mass = side * torques[k - 1], side * torques[k], masses[k]
            d += step * (v + step * (2 * torque + after) / mass / 6)
            v += step * (torque + after) / mass / 2
        side = side if d > 0.0 else -side
        twist[k], k = side * half_gap, k + 1


def wound_up(load: Array, inertia: Array, stiffness: float, damping: float, step: float) -> tuple[Array, Array, Array]:
    """Twist of an elastic joint, its rate and second rate (m,), for rows ``step`` s apart.

    The motor follows its own motion; the link, of ``inertia`` (m,) kg m2, would need ``load`` (m,) N m to follow it
    stiffly, and oscillates behind the spring instead: inertia d'' + damping d' + stiffness d = load, by exact steps
    with the load as it is in the middle of each; at rest at the start. A link without inertia only follows its load.
    stiffness N m/rad, damping N m s/rad.
    """
    if not (inertia > NO_INERTIA).all():
        follows = load / stiffness
        speed = np.gradient(follows, step)
        return follows, speed, np.gradient(speed, step)
    decay = damping / inertia / 2
    frequency = np.sqrt(np.maximum(stiffness / inertia - decay**2, 1e-9))
    shrink, cos, sin = np.exp(-decay * step), np.cos(frequency * step), np.sin(frequency * step)
    stay, go = shrink * (cos + decay / frequency * sin), shrink * sin / frequency
    back, keep = -stiffness / inertia * shrink * sin / frequency, shrink * (cos - decay / frequency * sin)
    settled = np.append(load[1:] + load[:-1], 2 * load[-1:]) / (2 * stiffness)
    # with x the deviation of (twist, rate) from (settled, 0), each step is x = [[stay, go], [back, keep]] x
    twist, rate = _recurrence(stay, go, back, keep, (1.0 - stay) * settled, -back * settled, load[0] / stiffness)
    return twist, rate, (load - stiffness * twist - damping * rate) / inertia


def _recurrence(
    stay: Array, go: Array, back: Array, keep: Array, forced: Array, forced_rate: Array, start: float
) -> tuple[Array, Array]:
    """d, v (m,): d' = stay d + go v + forced, v' = back d + keep v + forced_rate, row by row; from start and 0.

    The steps are a triangular system of bandwidth four in d0, v0, d1, v1, ..., which BLAS solves forwards, as a loop
    would.
    """
    band = np.zeros((4, 2 * len(stay)), order="F")
    band[2, ::2], band[3, ::2], band[1, 1::2], band[2, 1::2] = -stay, -back, -go, -keep
    right = np.zeros(2 * len(stay))
    right[0], right[2::2], right[3::2] = start, forced[:-1], forced_rate[:-1]
    solved = blas.dtbsv(3, band, right, lower=1, diag=1, overwrite_x=1)
    return solved[::2], solved[1::2]


def spring_of(effect: Effect, values: Values) -> tuple[float, float] | None:
    """Stiffness and damping of a transmission that is a spring; None for one with play, or a stiff one."""
    if effect.spring is None or effect.gap is not None:
        return None
    return float(effect.spring(values, Signals(twist=1.0))), float(effect.spring(values, Signals(twist_rate=1.0)))


def gap_of(effect: Effect, values: Values) -> float:
    """rad (m): half of the play of a transmission that has some."""
    assert effect.gap is not None
    return float(values[effect.gap.name])


def integrated(effect: Effect, p: Values, s: Signals, step: float) -> Array:
    """State (m,) of an effect along rows ``step`` s apart, by exponential steps: its rate is affine in the state.

    Between two rows the rate is the mean of both: with that of the first alone the state is half a row late, which
    looks like damping.
    """
    assert effect.rate is not None
    at0 = np.broadcast_to(np.asarray(effect.rate(p, replace(s, state=0.0)), float), s.v.shape)
    slope = np.broadcast_to(np.asarray(effect.rate(p, replace(s, state=1.0)), float), s.v.shape) - at0
    at0, slope = (np.append((rate[:-1] + rate[1:]) / 2.0, rate[-1]) for rate in (at0, slope))
    grow = np.exp(np.minimum(slope * step, 0.0))
    stiff = np.abs(slope) > 1e-9
    forced = np.where(stiff, at0 * (grow - 1.0) / np.where(stiff, slope, 1.0), at0 * step)
    # state' = grow state + forced, row by row from 0: a triangular system of bandwidth two
    band = np.zeros((2, len(grow)), order="F")
    band[1] = -grow
    solved: Array = blas.dtbsv(1, band, np.append(0.0, forced[:-1]), lower=1, diag=1)
    return solved
