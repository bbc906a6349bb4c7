"""Columns of every effect of the catalogue at every joint: its first-order change of the recorded currents.

A candidate is one effect at one joint (or of the whole arm) with its nonlinear parameters fixed; its columns are the
first-order change of the residual currents of all joints for a unit of each linear parameter, from the effect's own
law. Parameters that enter by a phase or a rest position span a plane, and become two columns; ``Candidate.parameters``
turns coefficients back into parameters.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from arm_io.types import Array
from arm_model import Arm, Joint
from arm_model.effects import CATALOGUE, Effect, Instrument, Signals, Values
from arm_model.effects.definition import Law
from arm_model.system import inverse_dynamics
from diagnosis.residual.expected_current import delayed, springs_at, terms_of
from diagnosis.residual.filters import COMPARE_BAND, Motion, kept_rows, low_pass
from diagnosis.residual.gap import AS_FOUND, Teeth, gap_of, through_gap
from diagnosis.residual.integration import in_series, integrated, spring_of, spring_twist
from diagnosis.residual.noise.instruments import residual_gain
from diagnosis.residual.other_effects import swinging_beside
from diagnosis.residual.run import Run
from diagnosis.residual.signals import signals_of
from diagnosis.selection.candidate import Candidate

STEP = 1e-4
"""Step of finite differences of second order, in units of the parameter: an error of 1e-8, and rounding of 1e-11."""
ROUNDING = 1e-10
"""Change of a current over a step, relative to its largest, that is rounding: an effect of 0.1 % of it makes 1e-7."""


def at_own_joint(candidate: Candidate, arm: Arm) -> bool:
    """Whether only the current of the candidate's own joint changes."""
    effect = candidate.definition
    if effect.link_side and arm.coupling:
        return False
    return candidate.is_torque or effect.current is not None or effect.own_joint


def columns(candidate: Candidate, run: Run) -> Array:
    """(m, n, k) A: change of ``run.residual`` for a unit of each of k coefficients."""
    return _columns(candidate, run, slice(0, len(run.arm)))


def own_columns(candidate: Candidate, run: Run) -> Array:
    """(m, k) A: ``columns`` at the joint of a candidate, those of other joints not computed."""
    assert candidate.joint is not None
    return _columns(candidate, run, slice(candidate.joint - 1, candidate.joint))[:, 0]


def _columns(candidate: Candidate, run: Run, at: slice) -> Array:
    """(m, j, k) A: ``columns`` of the j joints ``at``."""
    effect, arm, joint = candidate.definition, run.arm, candidate.joint
    if not run.powered and effect.current is None:
        # drives off, brakes on: only effects of the instruments show
        count = candidate.link_parameters or len(candidate.units())
        return np.zeros((*run.current[:, at].shape, 1 if effect.delay is not None else count))
    if candidate.link_parameters:
        return _link_columns(run, arm, joint or len(arm))[:, at, : candidate.link_parameters]
    if effect.change is not None:
        return np.stack([_changed(run, arm, effect, joint, unit)[:, at] for unit in candidate.units()], axis=-1)
    if effect.coupling:
        return np.stack([_coupled(run, arm, unit)[:, at] for unit in candidate.units()], axis=-1)
    if effect.delay is not None:
        return _by_delay(run, candidate.about)[:, at, None]
    assert joint is not None
    s = signals_of(run, arm, joint, link_side=effect.link_side)
    laws = [_law(run, candidate, unit, s, at) for unit in candidate.units()]
    return np.stack(laws, axis=-1) if len(laws) > 1 else laws[0][..., None]


def _by_delay(run: Run, about: float) -> Array:
    """(m, n) A/s: change of the recorded currents per s of delay, the mean of delays up to ``about`` s."""
    if not about:
        return -run.current_rate
    earlier = [delayed(run.t[part], run.current[part], np.full(part.stop - part.start, -about)) for part in run.parts]
    return (run.current - np.concatenate(earlier)) / about


def _torque(effect: Effect, p: Values, s: Signals, run: Run) -> Array:
    """(m,) N m: torque of a law that gives a torque."""
    assert effect.torque is not None
    if effect.rate is not None:
        s = replace(s, state=_states(effect, p, s, run))
    return np.asarray(effect.torque(p, s))


def _through(effect: Effect, p: Values, drive: Joint, s: Signals) -> Array:
    """(m,) share of the amplitude of a ripple that passes the filters."""
    return residual_gain(effect.cycles(p) * drive.ratio * np.abs(s.v) / (2 * np.pi))


def _law(run: Run, candidate: Candidate, p: Values, s: Signals, at: slice) -> Array:
    """(m, j) A: change of the currents of the j joints ``at``, among which is the candidate's, by its law."""
    effect, arm, j = candidate.definition, run.arm, (candidate.joint or 1) - 1
    drive, place = arm.joints[j], j - at.start
    change = np.zeros((len(run.t), at.stop - at.start))
    if candidate.is_torque:
        torque = _torque(effect, p, s, run)
        if effect.link_side and arm.coupling:
            # every drive that moves the link bears a share of the torque
            return np.outer(torque, arm.coupling_matrix[j, at]) / arm.joint_array("drive_constant")[at]
        change[:, place] = torque / drive.drive_constant
    elif effect.current is not None:
        change[:, place] = effect.current(p, s)
    elif effect.deflection is not None:
        # link angle = motor angle - deflection
        elastic = effect.spring is not None
        rates = _twisted(run, j, effect, p) if elastic else _rates(effect.deflection, p, s, drive.ratio, run)
        change = run.moved(j, at, _opposite(rates))
        if (spring := spring_of(effect, p)) is not None:
            in_all = in_series([*springs_at(terms_of(arm), j + 1), spring])
            change += swinging_beside(run, j, in_all, change, at)
        if not elastic:
            # by virtual work: a motor that turns its link by less also bears less of its load
            change[:, place] -= _slope(effect.deflection, p, s) * drive.ratio * s.load / drive.drive_constant
    elif effect.angle is not None:
        # true angle = reading - error, of motor and link
        error, speed, acceleration = _rates(effect.angle, p, s, drive.ratio, run)
        change = run.moved(j, at, (-error, -speed, -acceleration))
        change[:, place] -= drive.ratio**2 * drive.rotor_inertia * acceleration / drive.drive_constant
    if effect.wave:
        change *= _through(effect, p, drive, s)[:, None]
    return change


def _rates(law: Law, p: Values, s: Signals, ratio: float, run: Run) -> Motion:
    """Value, rate and second rate (m,) of an angle that a law gives.

    One that follows the motor angle may turn faster than there are rows: its rates come by the chain rule, d/dt = ratio
    v d/d motor.
    """
    value = np.asarray(law(p, s), float)
    step = 1e-3
    up = np.asarray(law(p, replace(s, motor=s.motor + step)), float)
    down = np.asarray(law(p, replace(s, motor=s.motor - step)), float)
    if np.array_equal(up, value):
        speed = run.rate(value)
        return value, speed, run.rate(speed)
    slope, bend = (up - down) / (2 * step), (up - 2 * value + down) / step**2
    return value, slope * ratio * s.v, bend * (ratio * s.v) ** 2 + slope * ratio * s.a


def _twisted(run: Run, j: int, effect: Effect, p: Values) -> Motion:
    """Twist (m,) of a joint with a spring or with play, and its rates; at rest at the start of every recording.

    Of a spring in series with springs of the model: by how much it twists more than they alone.
    """
    if (spring := spring_of(effect, p)) is None:
        return _lost_motion(run, j, gap_of(effect, p), AS_FOUND)
    known = springs_at(terms_of(run.arm), j + 1)
    twist, speed, acceleration = _wound_up(run, j, [*known, spring])
    if known:
        of_known = _wound_up(run, j, known)
        twist, speed, acceleration = twist - of_known[0], speed - of_known[1], acceleration - of_known[2]
    return twist, speed, acceleration


def _wound_up(run: Run, j: int, springs: Sequence[tuple[float, float]]) -> Motion:
    """Twist (m,) of a joint with springs in series, and its rates."""
    load, inertia, spring = run.brisk_rigid[:, j], run.inertia[:, j], in_series(springs)
    eased = run.eased(j)
    each = [
        spring_twist(load[part], inertia[part], *spring, 1.0 / rate, eased[part])
        for part, rate in zip(run.parts, run.rates)
    ]
    twist, speed, acceleration = (np.concatenate(rates) for rates in zip(*each))
    return twist, speed, acceleration


def _lost_motion(run: Run, j: int, half_gap: float, teeth: Teeth) -> Motion:
    """Twist (m,) of a joint with backlash, and its rates; from raw rows, as a free flight takes few thinned rows."""
    gaps = []
    for flying in run.recordings or (run,):
        loads, inertias, rate = flying.flights
        gap = through_gap(loads[:, j], inertias[:, j], half_gap, 1.0 / rate, teeth)
        gaps.append(low_pass(gap, COMPARE_BAND, rate)[kept_rows(rate)])
    twist = np.concatenate(gaps)
    speed = run.rate(twist)
    return twist, speed, run.rate(speed)


def column_of_gap(run: Run, joint: int, half_gap: float, teeth: Teeth) -> Array:
    """(m, 1) A: change of the current of a joint (from 1) by play of ``half_gap`` rad (m), as its ``teeth`` meet."""
    return run.moved(joint - 1, slice(joint - 1, joint), _opposite(_lost_motion(run, joint - 1, half_gap, teeth)))


def _opposite(motion: Motion) -> Motion:
    angle, speed, acceleration = motion
    return -angle, -speed, -acceleration


def _states(effect: Effect, p: Values, s: Signals, run: Run) -> Array:
    """State (m,) of an effect, from 0 at the start of every recording."""
    states = []
    for part, rate in zip(run.parts, run.rates):
        within = replace(s, v=s.v[part], sign=s.sign[part], coulomb=s.coulomb[part], q=s.q[part])
        states.append(integrated(effect, p, within, 1.0 / rate))
    return np.concatenate(states)


def _slope(law: Law, p: Values, s: Signals) -> Array:
    """(m,) derivative of an angle by the motor's own angle."""
    step = 1e-3
    up, down = (np.asarray(law(p, replace(s, motor=s.motor + sign * step)), float) for sign in (1.0, -1.0))
    slope: Array = (up - down) / (2 * step)
    return slope


def _changed(run: Run, arm: Arm, effect: Effect, joint: int | None, unit: Values) -> Array:
    """(m, n) A: first-order change by finite differences of the description; 0 where it is what rounding leaves.

    By three points, as sizes that may not be negative allow none on the other side. By two, half of a step times the
    second order is in it: a roll of the base of an arm that moves in one vertical plane would have a column, and be
    estimated at hundreds of rad.
    """

    def expected(step: float) -> Array:
        assert effect.change is not None
        small = Values({k: (v * step if any(p.name == k for p in effect.linear) else v) for k, v in unit.items()})
        changed = effect.change(arm, joint, small)
        return inverse_dynamics(changed, run.q, run.v, run.a) / changed.joint_array("drive_constant")

    change = 4 * expected(STEP) - expected(2 * STEP) - 3 * run.along
    change[:, np.abs(change).max(axis=0) < ROUNDING * np.abs(run.along).max(axis=0)] = 0.0
    return change / (2 * STEP)


def _link_columns(run: Run, arm: Arm, joint: int) -> Array:
    """(m, n, 10) A: barycentric parameters of one link, exactly; 0 of those that no motion shows."""
    of_link = run.by_link[..., 10 * (joint - 1) : 10 * joint]
    size = np.abs(of_link).max(axis=(0, 1), initial=0.0)
    # columns are scaled to unit length later, which would turn mere rounding into a column
    return of_link * (size > ROUNDING * size.max(initial=0.0)) / arm.joint_array("drive_constant")[:, None]


def _coupled(run: Run, arm: Arm, unit: Values) -> Array:
    """(m, n) A: change by entries of C, with link = (K + C) motor; K the couplings of the model.

    Links are displaced by C q, torques returned by C^T. unit: rad per rad, by the name of an entry (``c23``).
    """
    change, all_joints = np.zeros_like(run.current), slice(0, len(arm))
    constant, back = arm.joint_array("drive_constant"), np.linalg.inv(arm.coupling_matrix)
    at_links = run.rigid @ back
    for name, value in unit.items():
        if value == 0.0:
            continue
        i, j = int(name[1]) - 1, int(name[2]) - 1
        if i >= len(arm) or j >= len(arm):
            continue
        # rotation of the motors that rotates link i alone
        for k in np.flatnonzero(back[:, i]):
            by = value * back[k, i]
            change += run.moved(int(k), all_joints, (by * run.q[:, j], by * run.v[:, j], by * run.a[:, j]))
        change[:, j] += value * at_links[:, i] / constant[j]
    return change


def candidates(arm: Arm, inertia: Array | None = None) -> Iterator[Candidate]:
    """Every candidate for this arm, with every combination of the first values of its searched parameters.

    inertia: (n,) kg m2 (kg) that swings on a spring of each drive; None: not known.
    """
    for effect in CATALOGUE.values():
        if Instrument.CURRENT not in effect.observed_by or (effect.coupling and len(arm) < 6):
            continue
        searched = [p for p in effect.parameters if p.search and not p.derived]
        shapes = [
            dict(zip((p.name for p in searched), values)) for values in itertools.product(*(p.search for p in searched))
        ]
        entry = next((p.name for p in effect.parameters if p.own), None)
        for joint in range(1, len(arm) + 1) if effect.per_joint else (None,):
            if effect.cylinder and joint is not None and arm.joints[joint - 1].cylinder is None:
                continue
            swinging = 0.0 if inertia is None or joint is None else float(inertia[joint - 1])
            for shape in shapes:
                yield Candidate(effect.name, joint, tuple(effect.damped(shape, swinging).items()))
            if entry is not None and joint is not None:
                yield from (
                    Candidate(effect.name, joint, ((entry, skew),)) for skew in own_skews(arm.joints[joint - 1])
                )


LEAST_SKEW = 0.005
"""Directions that differ by less count as equal."""


def own_skews(joint: Joint) -> list[float]:
    """How the directions of a joint's own Coulomb friction differ: (F+ - F-) / (F+ + F-); [] where they are equal.

    The second is with the constant torque as part of both: while a joint moves, the two are one, and friction that is
    identified as equal in both directions has the difference there. A larger constant torque is no friction.
    """
    positive, negative = joint.coulomb
    total = positive + negative
    if total <= 0.0:
        return []
    skews = [(positive - negative) / total, (positive - negative + 2.0 * joint.offset) / total]
    possible = [skew for skew in skews if LEAST_SKEW < abs(skew) < 1.0]
    return possible[:1] if len(possible) == 2 and abs(possible[0] - possible[1]) < LEAST_SKEW else possible
