"""Every effect of the vocabulary, from its model in words: how it is drawn, and how it gets into plant or instruments.

Names and parameters are those of the catalogue; sizes are drawn for a Puma and then scaled by ``m`` until they show as
much as the case asks. Where the catalogue writes a torque, it is what the motor has to add.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from arm_io.types import Array
from tests.blind.second.laboratory import INTERPOLATED
from tests.blind.second.plant import Plant
from tests.blind.second.sensing import Sensing, changed, with_joint

Values = dict[str, float]
World = tuple[Plant, Sensing]
Draw = Callable[[np.random.Generator, Plant, int, float], Values]
Apply = Callable[[Plant, Sensing, int, Mapping[str, float]], World]


@dataclass(frozen=True)
class Kind:
    """How one effect is hidden.

    joints    where it may be (empty: of the whole arm)
    shown_by  "current", "points", or "events": what its size is measured in
    most      of ``m``
    """

    draw: Draw
    apply: Apply
    joints: tuple[int, ...] = (1, 2, 3)
    shown_by: str = "current"
    most: float = 6.0


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _phase(rng: np.random.Generator) -> float:
    return float(rng.uniform(-3.1, 3.1))


def _plus(field: str, key: str) -> Apply:
    """A parameter is added to a (n,) field of the plant at the joint."""

    def apply(p: Plant, s: Sensing, j: int, v: Mapping[str, float]) -> World:
        values = getattr(p, field)
        return p._replace(**{field: with_joint(values, j, values[j - 1] + v[key])}), s

    return apply


def _set(field: str, *keys: str) -> Apply:
    """Parameters become the joint's row of a field of the plant."""

    def apply(p: Plant, s: Sensing, j: int, v: Mapping[str, float]) -> World:
        value = [v[key] for key in keys]
        return p._replace(**{field: with_joint(getattr(p, field), j, value[0] if len(keys) == 1 else value)}), s

    return apply


def _sense(field: str, *keys: str) -> Apply:
    def apply(p: Plant, s: Sensing, j: int, v: Mapping[str, float]) -> World:
        value = [v[key] for key in keys]
        return p, changed(s, **{field: with_joint(getattr(s, field), j, value[0] if len(keys) == 1 else value)})

    return apply


def _dry(p: Plant, j: int) -> float:
    return float(p.coulomb[j - 1].mean())


def _less(value: float, own: Array, growth: float) -> float:
    """Friction of ``own`` (2,) by direction may be less, and never drives: nor where the change grows by ``growth``."""
    return max(value, -0.8 * float(own.min()) / (1.0 + growth))


def _friction_asymmetry(p: Plant, s: Sensing, j: int, v: Mapping[str, float]) -> World:
    return p._replace(coulomb=with_joint(p.coulomb, j, p.coulomb[j - 1] + [v["positive"], v["negative"]])), s


def _stribeck(p: Plant, s: Sensing, j: int, v: Mapping[str, float]) -> World:
    p = p._replace(breakaway=with_joint(p.breakaway, j, v["breakaway"]))
    return p._replace(stribeck=with_joint(p.stribeck, j, v["stribeck_velocity"])), s


def _presliding(p: Plant, s: Sensing, j: int, v: Mapping[str, float]) -> World:
    p = p._replace(bristle=with_joint(p.bristle, j, v["stiffness"]))
    return p._replace(bristle_damping=with_joint(p.bristle_damping, j, v["damping"])), s


def _fading(p: Plant, s: Sensing, j: int, v: Mapping[str, float]) -> World:
    p = p._replace(fading=with_joint(p.fading, j, v["fraction"]))
    return p._replace(fading_time=with_joint(p.fading_time, j, v["time_constant"])), s


def _draw_ripple(rng: np.random.Generator, p: Plant, j: int, m: float) -> Values:
    """Of whole orders per turn of the motor, or of the teeth of the last wheel; an error of position or a torque."""
    teeth = rng.uniform() < 0.5
    order = float(rng.integers(30, 71)) / p.gear[j - 1] if teeth else float(rng.integers(1, 5))
    size = {"amplitude": 2e-4 * m / order**0.5} if rng.uniform() < 0.6 else {"torque": 0.02 * m * p.drive[j - 1]}
    return {**size, "order": order, "phase": _phase(rng)}


def _ripple(p: Plant, s: Sensing, j: int, v: Mapping[str, float]) -> World:
    if "torque" in v:
        return _set("cog", "torque", "order", "phase")(p, s, j, v)
    return _set("tooth", "amplitude", "order", "phase")(p, s, j, v)


def _compliance(p: Plant, s: Sensing, j: int, v: Mapping[str, float]) -> World:
    p = p._replace(stiffness=with_joint(p.stiffness, j, v["stiffness"]))
    return p._replace(damping=with_joint(p.damping, j, v["damping"])), s


def _body(p: Plant, link: int, mass: float, place: Array) -> Plant:
    """A mass point more on a link; place (3,) m in its frame."""
    old, at = p.bodies[link], p.bodies[link, 1:]
    total = old[0] + mass
    middle = (old[0] * at + mass * place) / total
    inertia = p.inertia[link].copy()
    for part, away in ((old[0], at - middle), (mass, place - middle)):
        x, y, z = away
        inertia += part * np.array([y * y + z * z, x * x + z * z, x * x + y * y, -x * y, -y * z, -x * z])
    bodies, inertias = p.bodies.copy(), p.inertia.copy()
    bodies[link], inertias[link] = [total, *middle], inertia
    return p._replace(bodies=bodies, inertia=inertias)


def _payload(p: Plant, s: Sensing, j: int, v: Mapping[str, float]) -> World:
    return _body(p, len(p.gear) - 1, v["mass"], np.array([v["x"], v["y"], v["z"]])), s


def _draw_link(rng: np.random.Generator, p: Plant, j: int, m: float) -> Values:
    """A piece that the model does not have, as moments about the link's frame."""
    mass = m * _log(rng, 0.2, 0.6)
    x, y, z = rng.uniform([-0.3, -0.05, 0.0], [-0.1, 0.1, 0.2])
    moments = {"mass": mass, "mx": mass * x, "my": mass * y, "mz": mass * z}
    squares = {
        "ixx": y * y + z * z,
        "iyy": x * x + z * z,
        "izz": x * x + y * y,
        "ixy": -x * y,
        "iyz": -y * z,
        "ixz": -x * z,
    }
    return moments | {name: mass * float(value) for name, value in squares.items()}


def _link(p: Plant, s: Sensing, j: int, v: Mapping[str, float]) -> World:
    return _body(p, j - 1, v["mass"], np.array([v["mx"], v["my"], v["mz"]]) / v["mass"]), s


def _tilt(p: Plant, s: Sensing, j: int, v: Mapping[str, float]) -> World:
    """The base is turned about its x axis, then about its y axis."""
    cr, sr, cp, sp = np.cos(v["roll"]), np.sin(v["roll"]), np.cos(v["pitch"]), np.sin(v["pitch"])
    roll = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    pitch = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    return p._replace(gravity=(pitch @ roll).T @ p.gravity), s


def _spring(p: Plant, s: Sensing, j: int, v: Mapping[str, float]) -> World:
    return p._replace(spring=with_joint(p.spring, j, [v["stiffness"], v["rest_angle"], 0.0])), s


def _torque_constant(p: Plant, s: Sensing, j: int, v: Mapping[str, float]) -> World:
    return p._replace(drive=with_joint(p.drive, j, p.drive[j - 1] * (1.0 + v["error"]))), s


def _wrist(p: Plant, s: Sensing, j: int, v: Mapping[str, float]) -> World:
    coupling = p.coupling.copy()
    coupling[4, 3], coupling[5, 3], coupling[5, 4] = v["c54"], v["c64"], v["c65"]
    return p._replace(coupling=coupling), s


def _encoder_ripple(p: Plant, s: Sensing, j: int, v: Mapping[str, float]) -> World:
    row = p.wave[j - 1].copy()
    at = 0 if v["order"] == 1 else 2
    row[at : at + 2] = v["amplitude"], v["phase"]
    return p._replace(wave=with_joint(p.wave, j, row)), s


def _missed(p: Plant, s: Sensing, j: int, v: Mapping[str, float]) -> World:
    row = [v["counts"] * INTERPOLATED, v["time"]]
    return p._replace(missed=with_joint(p.missed, j, row)), s


def _water(p: Plant, s: Sensing, j: int, v: Mapping[str, float]) -> World:
    row = p.cylinders[j - 1].copy()
    row[8] += v["coefficient"]
    row[9] += v["buoyancy"]
    return p._replace(cylinders=with_joint(p.cylinders, j, row)), s


def _geometry(p: Plant, s: Sensing, j: int, v: Mapping[str, float]) -> World:
    # of the arm: its currents hold up the links where they are
    row = p.dh[j - 1] + [v.get(name, 0.0) for name in ("d_theta", "d_d", "d_a", "d_alpha")]
    return p._replace(dh=with_joint(p.dh, j, row)), s


def _draw_geometry(rng: np.random.Generator, p: Plant, j: int, m: float) -> Values:
    size = {"d_theta": 1e-3, "d_alpha": 1e-3, "d_a": 3e-4, "d_d": 3e-4}
    # of parallel axes 2 and 3 only the sum of the offsets d is there to be seen
    names = [str(name) for name in rng.choice(["d_theta", "d_alpha", "d_a"], 2, replace=False)]
    return {name: m * _sign(rng) * size[name] for name in names}


KINDS: dict[str, Kind] = {
    "viscous_friction": Kind(
        lambda r, p, j, m: {
            "viscous": _less(m * _sign(r) * r.uniform(0.2, 0.4) * p.viscous[j - 1].mean(), p.viscous[j - 1], p.growth)
        },
        _plus("more_viscous", "viscous"),
        most=3.0,
    ),
    "coulomb_friction": Kind(
        lambda r, p, j, m: {
            "coulomb": _less(m * _sign(r) * r.uniform(0.1, 0.3) * _dry(p, j), p.coulomb[j - 1], p.growth)
        },
        _plus("more_coulomb", "coulomb"),
    ),
    "friction_asymmetry": Kind(
        lambda r, p, j, m: {
            "positive": 0.1 * m * _dry(p, j) * (a := _sign(r)),
            "negative": -0.1 * a * m * _dry(p, j) * r.uniform(0.5, 1.0),
        },
        _friction_asymmetry,
    ),
    "stribeck_friction": Kind(
        lambda r, p, j, m: {"breakaway": m * r.uniform(0.2, 0.6) * _dry(p, j), "stribeck_velocity": _log(r, 0.02, 0.1)},
        _stribeck,
        most=3.0,
    ),
    "presliding_friction": Kind(
        lambda r, p, j, m: {
            "stiffness": (k := _dry(p, j) / (m * _log(r, 0.002, 0.01))),
            "damping": 0.2 * np.sqrt(k * p.rotor[j - 1]),
        },
        _presliding,
    ),
    "load_friction": Kind(lambda r, p, j, m: {"mu": 0.05 * m}, _plus("load_share", "mu"), (2, 3), most=4.0),
    "friction_drift": Kind(
        lambda r, p, j, m: {"fraction": min(0.1 * m, 0.6), "time_constant": _log(r, 3.0, 15.0)}, _fading
    ),
    "gear_ripple": Kind(_draw_ripple, _ripple),
    "cogging": Kind(
        lambda r, p, j, m: {
            "amplitude": 0.02 * m * p.drive[j - 1],
            "pole_pairs": float(r.integers(3, 13)),
            "phase": _phase(r),
        },
        _set("cog", "amplitude", "pole_pairs", "phase"),
    ),
    "backlash": Kind(lambda r, p, j, m: {"half_gap": 5e-4 * m}, _set("half_gap", "half_gap"), (2, 3), most=10.0),
    "joint_compliance": Kind(
        lambda r, p, j, m: {"stiffness": (k := _log(r, 2e4, 1e5) / m), "damping": r.uniform(0.05, 0.15) * np.sqrt(k)},
        _compliance,
        (2, 3),
        most=12.0,
    ),
    "payload": Kind(
        lambda r, p, j, m: {"mass": 0.4 * m, "x": r.uniform(-0.05, 0.05), "y": 0.0, "z": r.uniform(0.03, 0.12)},
        _payload,
        (),
    ),
    "link_inertia": Kind(_draw_link, _link, (2, 3)),
    "rotor_inertia": Kind(
        lambda r, p, j, m: {"inertia": max(m * _sign(r) * 0.1, -0.5) * p.rotor[j - 1]},
        _plus("rotor", "inertia"),
        most=10.0,
    ),
    "base_tilt": Kind(
        lambda r, p, j, m: {"roll": 5e-3 * m * _sign(r), "pitch": 5e-3 * m * _sign(r) * r.uniform(0.3, 1.0)}, _tilt, ()
    ),
    "gravity_spring": Kind(
        lambda r, p, j, m: {"stiffness": m * _log(r, 1.0, 3.0), "rest_angle": r.uniform(-0.8, 0.8)}, _spring
    ),
    "torque_constant": Kind(lambda r, p, j, m: {"error": max(0.05 * m * _sign(r), -0.4)}, _torque_constant),
    "current_limit": Kind(
        lambda r, p, j, m: {"limit": float(p.limit[j - 1]) / (1.0 + 0.5 * m)}, _set("limit", "limit"), most=40.0
    ),
    "wrist_coupling": Kind(
        lambda r, p, j, m: {name: _sign(r) * _log(r, 0.01, 0.1) for name in ("c54", "c64", "c65")}, _wrist, (), "events"
    ),
    "encoder_ripple": Kind(
        lambda r, p, j, m: {"amplitude": 2e-4 * m, "order": float(r.integers(1, 3)), "phase": _phase(r)},
        _encoder_ripple,
    ),
    "missed_counts": Kind(
        lambda r, p, j, m: {"counts": float(r.integers(3, 40)) * _sign(r), "time": r.uniform(4.0, 10.0)},
        _missed,
        (1, 2, 3),
        "events",
    ),
    "joint_zero_offset": Kind(
        lambda r, p, j, m: {"offset": 5e-3 * m * _sign(r)}, _plus("zero", "offset"), (2, 3), most=10.0
    ),
    "current_offset": Kind(lambda r, p, j, m: {"offset": 0.03 * m * _sign(r)}, _sense("offset", "offset")),
    "current_gain": Kind(lambda r, p, j, m: {"error": 0.04 * m * _sign(r)}, _sense("gain", "error")),
    "current_nonlinearity": Kind(lambda r, p, j, m: {"cubic": 2e-3 * m}, _sense("cubic", "cubic"), most=5.0),
    "mains_hum": Kind(
        lambda r, p, j, m: {
            "amplitude": 0.01 * m,
            "frequency": float(r.choice([50.0, 60.0])) + r.uniform(-0.05, 0.05),
            "phase": _phase(r),
        },
        _sense("hum", "amplitude", "frequency", "phase"),
        (1, 2, 3, 4, 5),
    ),
    "time_skew": Kind(
        lambda r, p, j, m: {"delay": 5e-4 * m * _sign(r)},
        lambda p, s, j, v: (p, changed(s, delay=v["delay"])),
        (),
        most=10.0,
    ),
    "dropped_trigger": Kind(
        lambda r, p, j, m: {"place": r.uniform(0.3, 0.6), "count": float(r.integers(1, 9))},
        lambda p, s, j, v: (p, s),
        (),
        "events",
    ),
    "tracker_latency": Kind(
        lambda r, p, j, m: {"delay": 5e-4 * m},
        lambda p, s, j, v: (p, changed(s, tracker_delay=v["delay"])),
        (),
        "points",
    ),
    "tracker_outliers": Kind(
        lambda r, p, j, m: {"share": _log(r, 0.002, 0.02), "size": _log(r, 0.003, 0.03)},
        lambda p, s, j, v: (p, changed(s, wrong=(v["share"], v["size"]))),
        (),
        "events",
    ),
    "link_geometry": Kind(_draw_geometry, _geometry, (2, 3), "points"),
    "link_sag": Kind(lambda r, p, j, m: {"compliance": 1e-5 * m}, _sense("sag", "compliance"), (2, 3), "points"),
    "hydrodynamic_drag": Kind(lambda r, p, j, m: {"drag": m * _log(r, 0.3, 1.5)}, _plus("drag", "drag")),
    "added_mass": Kind(lambda r, p, j, m: {"coefficient": 0.3 * m, "buoyancy": 0.0}, _water, (2, 3), most=10.0),
}
"""Every name of the vocabulary."""

NEEDS_TRACKER = {"tracker_latency", "tracker_outliers", "link_geometry", "link_sag"}
GROWS = {"viscous_friction", "coulomb_friction", "load_friction"}
"""Effects that in some cases change within a recording, from 0.6 to 1.4 of their size."""
