"""The effects of a model in its identification: their torque in a recording, and the columns of their parameters.

What a recording shows is the inverse dynamics of the arm with all its effects, as its instruments measure it:

    shown = K i_read,   i_read = i + current effects(i),   i = torque(q_read - angle effects, ...) / K_real

K the drive constants that the model names (N m/A), K_real those with a wrong torque constant put right. A column is the
derivative of this by one linear parameter of one effect, at the values of the arm. Where the torque is not linear in
all parameters together (friction that follows a load which follows the masses), the columns are those of a Gauss-Newton
step, and the remainder is ``rest`` in the equations.

Nonlinear parameters (orders, phases, rest angles, Stribeck velocities, delays) stay as the model has them; delays and
errors of angles are taken out of the data before anything is differentiated (``true_readings``). Elastic transmissions
and play count as rigid here, bristles as sliding: their stored state cannot be determined from one row.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm_io.types import Array
from arm_model import Arm, EffectTerm, parameter, with_parameters
from arm_model.effects import CATALOGUE, Effect, Instrument, Parameter, Signals, described, values_of
from arm_model.system import inverse_dynamics

STEP = 1e-3
"""Step of difference quotients, as a share of a parameter's typical size."""


@dataclass(frozen=True)
class Samples:
    """A motion at N instants: q, qd, qdd (N, n) rad, rad/s, rad/s2 (m, m/s, m/s2) at t (N,) s."""

    q: Array
    qd: Array
    qdd: Array
    t: Array


def effect_parameters(arm: Arm) -> list[str]:
    """Names (``arm_model.parameters``) of the linear effect parameters of the model that torques can show."""
    names: list[str] = []
    for term in arm.effects:
        if is_instantaneous(CATALOGUE[term.name]):
            linear = {p.name for p in CATALOGUE[term.name].linear}
            names += [name_of(term, given) for given in term.parameters if given in linear]
    return list(dict.fromkeys(names))


def name_of(term: EffectTerm, entry: str) -> str:
    """'joint2.load_friction.mu', 'payload.mass'."""
    head = "" if term.joint is None else f"joint{term.joint}."
    return f"{head}{term.name}.{entry}"


def is_instantaneous(effect: Effect) -> bool:
    """Whether the recorded current follows the effect row by row.

    Not so springs and bristle friction, which have states, nor effects that only a tracker shows.
    """
    if effect.torque is not None:
        return effect.rate is None
    if effect.deflection is not None:
        return effect.spring is None
    if effect.change is not None:
        return Instrument.CURRENT in effect.observed_by
    return effect.coupling or effect.angle is not None or effect.current is not None


def effects_held_fixed(arm: Arm) -> list[str]:
    """Names of the effects that an identification holds as they are, and counts as rigid or sliding."""
    return [
        f"{term.name} of joint {term.joint}"
        for term in arm.effects
        if CATALOGUE[term.name].spring is not None or CATALOGUE[term.name].rate is not None
    ]


def repeated(arm: Arm) -> list[str]:
    """Names of effects that a joint has more than once.

    All but the first keep their values, because their parameters have the same names.
    """
    found = [f"{term.name} of joint {term.joint}" if term.joint else term.name for term in arm.effects]
    return sorted({name for name in found if found.count(name) > 1})


def is_effect(name: str) -> bool:
    """'joint2.load_friction.mu' and 'payload.mass', not 'joint2.viscous' or 'link6.mass'."""
    head = name.partition(".")[0]
    of_arm = head.startswith(("link", "joint")) and head[-1].isdigit()
    return name.count(".") == (2 if of_arm else 1)


def definition(name: str) -> Parameter:
    """What the catalogue says of an effect's parameter."""
    effect, _, entry = name.split(".", 1)[1].partition(".") if name.count(".") == 2 else name.partition(".")
    return next(p for p in CATALOGUE[effect.rstrip("0123456789")].parameters if p.name == entry)


def shown_torque(arm: Arm, model: Arm, motion: Samples) -> Array:
    """(N, n) N m (N): current that a recording of ``arm`` shows, times the drive constants of ``model``.

    ``model`` is what the readings were put right with: only where ``arm`` misreads angles otherwise are they moved
    here.
    """
    motion = _where_it_is(arm, model, motion)
    current = inverse_dynamics(arm, motion.q, motion.qd, motion.qdd, time=motion.t)
    current = current / described(arm).joint_array("drive_constant")
    for term in arm.effects:
        effect = CATALOGUE[term.name]
        if effect.current is not None and term.joint is not None:
            j = term.joint - 1
            seen = Signals(q=motion.q[:, j], v=motion.qd[:, j], current=current[:, j], t=motion.t)
            current[:, j] += effect.current(values_of(effect, term.parameters), seen)
    return np.asarray(current * model.joint_array("drive_constant"))


def effect_columns(arm: Arm, model: Arm, motion: Samples, shown: Array) -> Array:
    """(N, n, e) derivative of ``shown`` (N, n), the ``shown_torque``, by each of ``effect_parameters(arm)``.

    In N m (N) per unit of the parameter.
    """
    names = effect_parameters(arm)
    columns = np.zeros((*motion.q.shape, len(names)))
    for k, name in enumerate(names):
        step = STEP * definition(name).typical[1]
        moved = with_parameters(arm, {name: parameter(arm, name) + step})
        columns[:, :, k] = (shown_torque(moved, model, motion) - shown) / step
    return columns


def true_readings(arm: Arm, t: Array, q: Array, current: Array) -> tuple[Array, Array]:
    """Angles (m, n) without the errors of their encoders, currents (m, n) at the instants t (m,) s of the angles."""
    q = q - _misread(arm, q, t)
    for term in arm.effects:
        effect = CATALOGUE[term.name]
        if effect.delay is not None:
            late = effect.delay(values_of(effect, term.parameters), Signals(t=t))
            current = _at(t, current, t + np.broadcast_to(np.asarray(late, float), t.shape))
    return q, current


def _at(t: Array, values: Array, wanted: Array) -> Array:
    """``values`` (m, n) at other times (m,), cubic between samples; NaN next to missing ones and beyond the ends."""
    from scipy.interpolate import CubicSpline

    out = np.full_like(values, np.nan)
    for j, column in enumerate(values.T):
        there = np.isfinite(column)
        if there.sum() < 4:
            continue
        whole = np.interp(wanted, t, np.where(there, 0.0, 1.0), left=1.0, right=1.0) == 0.0
        out[whole, j] = CubicSpline(t[there], column[there])(wanted[whole])
    return out


def _misread(arm: Arm, q: Array, t: Array) -> Array:
    """(m, n) rad by which the encoders show more than the motors' angles over their gears."""
    error = np.zeros_like(q)
    for term in arm.effects:
        effect = CATALOGUE[term.name]
        if effect.angle is not None and term.joint is not None:
            j = term.joint - 1
            seen = Signals(q=q[:, j], motor=q[:, j] * arm.joints[j].ratio, t=t)
            error[:, j] += effect.angle(values_of(effect, term.parameters), seen)
    return error


def _where_it_is(arm: Arm, model: Arm, motion: Samples) -> Samples:
    """The motion after the encoder errors of ``arm``, instead of those of ``model``, are subtracted.

    The errors are e(q), e' q' and e' q'' + e'' q'^2 in position, velocity and acceleration.
    """
    if not any(CATALOGUE[term.name].angle is not None for term in arm.effects):
        return motion
    q, qd, qdd, t = motion.q, motion.qd, motion.qdd, motion.t

    def more(angle: Array) -> Array:
        return _misread(arm, angle, t) - _misread(model, angle, t)

    h = 1e-3 / arm.joint_array("ratio")
    here, up, down = more(q), more(q + h), more(q - h)
    slope, bend = (up - down) / (2 * h), (up - 2 * here + down) / h**2
    return Samples(q - here, qd * (1 - slope), qdd * (1 - slope) - bend * qd**2, t)
