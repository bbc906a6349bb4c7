"""Hides effects in a plant and in its instruments' signals. One function per effect; magnitudes are the caller's.

A mechanical effect changes the ``Plant``; a sensing or timing effect changes the ``Signals`` that the instruments see.
Names and parameters are those of the public catalogue; the code is not. Defects outside the catalogue are in
``unmodelled``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from arm_io.types import Array
from tests.blind import unmodelled
from tests.blind.plant import Plant

Values = Mapping[str, float]


@dataclass(frozen=True)
class Hidden:
    """One hidden effect: its name, its joint (1-based) or None, and its parameters in SI units at the joint."""

    effect: str
    joint: int | None
    parameters: Mapping[str, float]


@dataclass(frozen=True)
class Signals:
    """What there is to be measured, at times t (m,) s.

    Motor angle over gear (m, n) rad and current (m, n) A, signed as the joint.

    gear (n,) motor turns a turn of the joint; counts (n,) of the encoder a motor turn.
    """

    t: Array
    angle: Array
    current: Array
    gear: Array
    counts: Array


def _set(values: Array, joint: int, value: float) -> Array:
    values = values.copy()
    values[joint - 1] = value
    return values


def _with_body(p: Plant, joint: int, mass: float, first: Array, about_origin: Array) -> Plant:
    """A body on a link: mass kg, first moment (3,) kg m and inertia (3, 3) kg m2.

    About the origin of the link's frame.
    """
    j = joint - 1
    xx, yy, zz, xy, yz, xz = p.inertia[j]
    whole = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) + p.mass[j] * _steiner(p.com[j]) + about_origin
    total = p.mass[j] + mass
    centre = (p.mass[j] * p.com[j] + first) / total
    whole -= total * _steiner(centre)
    com, inertia = p.com.copy(), p.inertia.copy()
    com[j] = centre
    inertia[j] = [whole[0, 0], whole[1, 1], whole[2, 2], whole[0, 1], whole[1, 2], whole[0, 2]]
    return p._replace(mass=_set(p.mass, joint, total), com=com, inertia=inertia)


def _steiner(r: Array) -> Array:
    about: Array = r @ r * np.eye(3) - np.outer(r, r)
    return about


def _payload(p: Plant, joint: int, v: Values) -> Plant:
    """A mass point of v['mass'] at (x, y, z) of the last link."""
    point = np.array([v["x"], v["y"], v["z"]])
    return _with_body(p, len(p.mass), v["mass"], v["mass"] * point, v["mass"] * _steiner(point))


def _asymmetry(p: Plant, joint: int, v: Values) -> Plant:
    """Coulomb friction, and where it is said viscous friction, more or less of it by the direction of motion."""
    j, up, down = joint - 1, v.get("viscous_positive", 0.0), v.get("viscous_negative", 0.0)
    return p._replace(
        coulomb_up=_set(p.coulomb_up, joint, p.coulomb_up[j] + v["positive"]),
        coulomb_down=_set(p.coulomb_down, joint, p.coulomb_down[j] + v["negative"]),
        viscous=_set(p.viscous, joint, p.viscous[j] + (up + down) / 2),
        one_way_viscous=_set(p.one_way_viscous, joint, (up - down) / 2),
    )


def _tilt(p: Plant, joint: int, v: Values) -> Plant:
    cr, sr, cp, sp = np.cos(v["roll"]), np.sin(v["roll"]), np.cos(v["pitch"]), np.sin(v["pitch"])
    turned = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]]) @ np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    return p._replace(gravity=turned.T @ p.gravity)


def _link(p: Plant, joint: int, v: Values) -> Plant:
    """The ten parameters of one link about its frame's origin.

    Each is wrong by what ``v`` says (0 where it says nothing).
    """
    xx, yy, zz, xy, yz, xz = (v.get(name, 0.0) for name in ("ixx", "iyy", "izz", "ixy", "iyz", "ixz"))
    first = np.array([v.get(name, 0.0) for name in ("mx", "my", "mz")])
    return _with_body(p, joint, v.get("mass", 0.0), first, np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))


def _wrist(p: Plant, joint: int, v: Values) -> Plant:
    coupling = p.coupling.copy()
    for name, value in v.items():  # c54: motor 4 turns link 5
        coupling[int(name[1]) - 1, int(name[2]) - 1] = value
    return p._replace(coupling=coupling)


def _elastic(p: Plant, joint: int, v: Values) -> Plant:
    j = joint - 1
    stiffness = v.get("stiffness", 2e5 if joint <= 3 else 2e4)  # teeth in contact, where only a gap is hidden
    damping = v.get("damping", 2 * 0.1 * np.sqrt(stiffness * p.rotor[j]))
    return p._replace(
        stiffness=_set(p.stiffness, joint, stiffness),
        damping=_set(p.damping, joint, damping),
        half_gap=_set(p.half_gap, joint, v.get("half_gap", 0.0)),
    )


MECHANICAL: dict[str, Callable[[Plant, int, Values], Plant]] = {
    "viscous_friction": lambda p, j, v: p._replace(viscous=_set(p.viscous, j, p.viscous[j - 1] + v["viscous"])),
    "coulomb_friction": lambda p, j, v: p._replace(
        coulomb_up=_set(p.coulomb_up, j, p.coulomb_up[j - 1] + v["coulomb"]),
        coulomb_down=_set(p.coulomb_down, j, p.coulomb_down[j - 1] + v["coulomb"]),
    ),
    "friction_asymmetry": _asymmetry,
    "stribeck_friction": lambda p, j, v: p._replace(
        breakaway=_set(p.breakaway, j, v["breakaway"]),
        stribeck_velocity=_set(p.stribeck_velocity, j, v["stribeck_velocity"]),
    ),
    "presliding_friction": lambda p, j, v: p._replace(
        bristle=_set(p.bristle, j, v["stiffness"]), bristle_damping=_set(p.bristle_damping, j, v["damping"])
    ),
    "load_friction": lambda p, j, v: p._replace(load_share=_set(p.load_share, j, v["mu"])),
    "friction_drift": lambda p, j, v: p._replace(
        drift_share=_set(p.drift_share, j, v["fraction"]), drift_time=_set(p.drift_time, j, v["time_constant"])
    ),
    "gear_ripple": lambda p, j, v: p._replace(
        lead_error=_set(p.lead_error, j, v["amplitude"]),
        lead_order=_set(p.lead_order, j, v["order"]),
        lead_phase=_set(p.lead_phase, j, v["phase"]),
    ),
    "cogging": lambda p, j, v: p._replace(
        ripple_torque=_set(p.ripple_torque, j, v["amplitude"]),
        ripple_order=_set(p.ripple_order, j, v["pole_pairs"]),
        ripple_phase=_set(p.ripple_phase, j, v["phase"]),
    ),
    "backlash": _elastic,
    "joint_compliance": _elastic,
    "payload": _payload,
    "link_inertia": _link,
    "rotor_inertia": lambda p, j, v: p._replace(rotor=_set(p.rotor, j, p.rotor[j - 1] + v["inertia"])),
    "base_tilt": _tilt,
    "gravity_spring": lambda p, j, v: p._replace(
        spring=_set(p.spring, j, v["stiffness"]), spring_rest=_set(p.spring_rest, j, v["rest_angle"])
    ),
    "torque_constant": lambda p, j, v: p._replace(
        torque_per_ampere=_set(p.torque_per_ampere, j, p.torque_per_ampere[j - 1] * (1 + v["error"]))
    ),
    "current_limit": lambda p, j, v: p._replace(current_limit=_set(p.current_limit, j, v["limit"])),
    "wrist_coupling": _wrist,
    "encoder_ripple": lambda p, j, v: p._replace(
        read_error=_set(p.read_error, j, v["amplitude"]),
        read_order=_set(p.read_order, j, v["order"]),
        read_phase=_set(p.read_phase, j, v["phase"]),
    ),
    "hydrodynamic_drag": lambda p, j, v: p._replace(quadratic=_set(p.quadratic, j, v["drag"])),
}


def _late(t: Array, values: Array, delay: float) -> Array:
    late: Array = CubicSpline(t, values)(np.clip(t - delay, t[0], t[-1]))
    return late


def _columns(s: Signals, which: str, joint: int, change: Callable[[Array], Array]) -> Signals:
    changed = getattr(s, which).copy()
    changed[:, joint - 1] = change(changed[:, joint - 1])
    return replace(s, **{which: changed})


def _missed(s: Signals, joint: int, v: Values) -> Signals:
    per_count = 2 * np.pi / (s.counts[joint - 1] * s.gear[joint - 1])
    return _columns(s, "angle", joint, lambda q: q + v["counts"] * per_count * (s.t >= v["time"]))


def _dropped(s: Signals, joint: int, v: Values) -> Signals:
    row, count = int(v["row"]), int(v["count"])
    later = np.minimum(np.arange(len(s.t)) + np.where(np.arange(len(s.t)) >= row, count, 0), len(s.t) - 1)
    return replace(s, current=s.current[later])


SENSING: dict[str, Callable[[Signals, int, Values], Signals]] = {
    "missed_counts": _missed,
    "current_offset": lambda s, j, v: _columns(s, "current", j, lambda i: i + v["offset"]),
    "current_gain": lambda s, j, v: _columns(s, "current", j, lambda i: i * (1 + v["error"])),
    "current_nonlinearity": lambda s, j, v: _columns(s, "current", j, lambda i: i - v["cubic"] * i**3),
    "mains_hum": lambda s, j, v: _columns(
        s, "current", j, lambda i: i + v["amplitude"] * np.sin(2 * np.pi * v["frequency"] * s.t + v["phase"])
    ),
    "time_skew": lambda s, j, v: replace(s, current=_late(s.t, s.current, v["delay"])),
    "dropped_trigger": _dropped,
}


def _offset_zero(p: Plant, joint: int, v: Values) -> Plant:
    """The encoder reads q where the link stands at q - offset: the same arm with another zero."""
    dh = p.dh.copy()
    dh[joint - 1, 0] -= v["offset"]
    return p._replace(dh=dh)


MECHANICAL["joint_zero_offset"] = _offset_zero


def hide_in_plant(plant: Plant, hidden: tuple[Hidden, ...]) -> Plant:
    """The plant with the mechanical ones among the hidden effects."""
    for h in hidden:
        change = MECHANICAL.get(h.effect) or unmodelled.MECHANICAL.get(h.effect)
        if change is not None:
            plant = change(plant, h.joint or 0, h.parameters)
        elif h.effect not in SENSING and h.effect not in unmodelled.SENSING:
            raise KeyError(h.effect)
    return plant


def hide_in_signals(signals: Signals, hidden: tuple[Hidden, ...]) -> Signals:
    """The signals with the sensing and timing ones among the hidden effects."""
    for h in hidden:
        if h.effect in SENSING:
            signals = SENSING[h.effect](signals, h.joint or 0, h.parameters)
        elif h.effect in unmodelled.SENSING:
            change = unmodelled.SENSING[h.effect]
            signals = replace(signals, current=change(signals.t, signals.current, h.joint or 0, h.parameters))
    return signals
