"""Effects hidden in a foreign arm or its log, by the names and parameters of the public catalogue.

One function per effect draws its parameters at a joint and a magnitude (1: as in the table of typical values), another
changes the plant or the log's defects. None of armscope's code has a part in either.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from tests.foreign.arms import ForeignArm
from tests.foreign.log import Defects
from tests.foreign.plant import Array, Plant

Values = Mapping[str, float]
Draw = Callable[[np.random.Generator, ForeignArm, int, float], dict[str, float]]


@dataclass(frozen=True)
class Hidden:
    """One effect: its name, its joint (from 1) or None, its parameters at the joint in SI units."""

    effect: str
    joint: int | None
    parameters: Mapping[str, float]


def _between(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _signed(rng: np.random.Generator, low: float, high: float) -> float:
    return float(rng.choice([-1.0, 1.0])) * _between(rng, low, high)


def _phase(rng: np.random.Generator) -> float:
    return float(rng.uniform(-3.0, 3.0))


def _asymmetry(rng: np.random.Generator, arm: ForeignArm, j: int, m: float) -> dict[str, float]:
    part = _signed(rng, 0.1, 0.3) * m * arm.joints[j].coulomb
    return {"positive": part, "negative": -part}


def _less_or_more(rng: np.random.Generator, share: float, m: float) -> float:
    """A relative change; down to a third of what was there."""
    return max(share * m, -0.65)


def _size(arm: ForeignArm) -> float:
    """m: how long the last links are."""
    return 0.1 if sum(joint.mass for joint in arm.joints) < 60 else 0.3


DRAWN: dict[str, Draw] = {
    "viscous_friction": lambda rng, a, j, m: {
        "viscous": _less_or_more(rng, _signed(rng, 0.2, 0.5), m) * a.joints[j].viscous
    },
    "coulomb_friction": lambda rng, a, j, m: {
        "coulomb": _less_or_more(rng, _signed(rng, 0.2, 0.5), m) * a.joints[j].coulomb
    },
    "friction_asymmetry": _asymmetry,
    "stribeck_friction": lambda rng, a, j, m: {
        "breakaway": _between(rng, 0.3, 0.7) * m * a.joints[j].coulomb,
        "stribeck_velocity": _between(rng, 0.05, 0.1) * a.joints[j].speed,
    },
    "load_friction": lambda rng, a, j, m: {"mu": _between(rng, 0.03, 0.15) * m},
    "friction_drift": lambda rng, a, j, m: {
        "fraction": min(_between(rng, 0.15, 0.4) * m, 0.7),
        "time_constant": _between(rng, 3.0, 6.0),
    },
    "gear_ripple": lambda rng, a, j, m: {
        "amplitude": _between(rng, 0.01, 0.03) * m * a.joints[j].rated,
        "order": float(rng.integers(20, 70)) * (2 * np.pi / 0.3 if a.joints[j].prismatic else 1.0),
        "phase": _phase(rng),
    },
    "backlash": lambda rng, a, j, m: {"half_gap": _between(rng, 5e-4, 3e-3) * m},
    "joint_compliance": lambda rng, a, j, m: {"stiffness": _between(rng, 30.0, 120.0) * a.joints[j].rated / m},
    "payload": lambda rng, a, j, m: {
        "mass": _between(rng, 0.04, 0.15) * m * sum(one.mass for one in a.joints[1:]),
        "x": float(rng.uniform(-0.5, 0.5)) * _size(a),
        "y": float(rng.uniform(-0.5, 0.5)) * _size(a),
        "z": float(rng.uniform(0.2, 1.0)) * _size(a),
    },
    "link_inertia": lambda rng, a, j, m: {
        "mass": _between(rng, 0.1, 0.3) * m * a.joints[j].mass,
        "x": float(rng.uniform(-0.5, 1.0)) * _size(a),
        "y": float(rng.uniform(-0.5, 0.5)) * _size(a),
        "z": float(rng.uniform(0.5, 2.0)) * _size(a),
    },
    "rotor_inertia": lambda rng, a, j, m: {"inertia": _between(rng, 0.2, 0.5) * m * a.joints[j].rotor},
    "base_tilt": lambda rng, a, j, m: {"roll": _signed(rng, 0.01, 0.03) * m, "pitch": _signed(rng, 0.01, 0.03) * m},
    "gravity_spring": lambda rng, a, j, m: {
        "stiffness": _between(rng, 0.03, 0.15) * m * a.joints[j].rated / (a.joints[j].reach[1] - a.joints[j].reach[0]),
        "rest_angle": float(np.mean(a.joints[j].reach) + rng.uniform(-0.3, 0.3) * np.ptp(a.joints[j].reach)),
    },
    "torque_constant": lambda rng, a, j, m: {"error": _signed(rng, 0.05, 0.15) * m},
    "current_limit": lambda rng, a, j, m: {"share": float(rng.uniform(0.6, 0.85))},
    "joint_zero_offset": lambda rng, a, j, m: {"offset": _signed(rng, 0.01, 0.05) * m},
    "current_gain": lambda rng, a, j, m: {"error": _signed(rng, 0.05, 0.15) * m},
    "current_offset": lambda rng, a, j, m: {"offset": _signed(rng, 0.01, 0.04) * m * a.joints[j].rated},
    "mains_hum": lambda rng, a, j, m: {
        "amplitude": _between(rng, 0.01, 0.03) * m * a.joints[j].rated,
        "frequency": float(rng.choice([50.0, 60.0]) + rng.uniform(-0.05, 0.05)),
        "phase": _phase(rng),
    },
    "time_skew": lambda rng, a, j, m: {"delay": _between(rng, 2e-3, 8e-3) * m},
    "dropped_trigger": lambda rng, a, j, m: {
        "time": float(rng.uniform(4.0, 9.0)),
        "seconds": _between(rng, 0.01, 0.04),
    },
    "encoder_ripple": lambda rng, a, j, m: {
        "amplitude": _between(rng, 2e-4, 8e-4) * m,
        "order": float(rng.integers(20, 70)),
        "phase": _phase(rng),
    },
    "missed_counts": lambda rng, a, j, m: {
        "jump": _signed(rng, 2e-3, 1e-2) * m * (0.3 if a.joints[j].prismatic else 1.0),
        "time": float(rng.uniform(4.0, 9.0)),
    },
}
WHOLE_ARM = {"payload", "base_tilt", "time_skew", "dropped_trigger"}
LOADED = {"load_friction", "backlash", "joint_zero_offset", "link_inertia"}
"""Hidden at joints with a changing load of gravity only."""
TURNING = {"gear_ripple", "backlash", "joint_compliance", "encoder_ripple", "joint_zero_offset"}
"""Hidden at revolute joints only."""
UNCOUPLED = {"backlash", "joint_compliance", "joint_zero_offset", "gear_ripple", "encoder_ripple", "gravity_spring"}
"""Not hidden at the joints of a coupling."""
SENSED = {"mains_hum", "dropped_trigger", "missed_counts"}
"""Defects of the log that no quantity of ``compare`` speaks of: it is not asked for them."""
COUNTED = {"dropped_trigger", "missed_counts", "current_limit", "encoder_ripple"}
"""Events, which are there or not whatever the noise, and errors of angles, which no torque shows."""


def places(effect: str, arm: ForeignArm) -> list[int | None]:
    """Joints of an arm at which an effect may be hidden; empty where it would be another effect, or nothing."""
    if effect in WHOLE_ARM:
        heavy = any(joint.loaded for joint in arm.joints)
        return [None] if effect != "base_tilt" or (heavy and not arm.joints[0].prismatic) else []
    coupled = {number for joint, by, _ in arm.coupling for number in (joint, by)}
    several: list[int | None] = []
    for number, joint in enumerate(arm.joints, 1):
        if (effect in LOADED and not joint.loaded) or (effect in TURNING and joint.prismatic):
            continue
        if effect in UNCOUPLED and number in coupled:
            continue
        if effect == "link_inertia" and number == len(arm.joints):
            continue  # a payload
        several.append(number)
    return several


def _asymmetric(plant: Plant, joint: int, v: Values) -> Plant:
    share = v["positive"] / plant.friction.level[joint - 1] if plant.friction.level[joint - 1] else 0.0
    return plant.changed("asymmetry", joint, share)


def _stribeck(plant: Plant, joint: int, v: Values) -> Plant:
    """A hump, or where there is one, more of it: as wide as it was."""
    there = plant.friction.hump[joint - 1] > 0
    changed = plant.changed("hump", joint, v["breakaway"])
    width = plant.friction.stribeck[joint - 1]
    return changed if there else changed.changed("stribeck", joint, v["stribeck_velocity"] - width)


def _drifting(plant: Plant, joint: int, v: Values) -> Plant:
    time = v["time_constant"] - plant.friction.fading_time[joint - 1]
    return plant.changed("fading", joint, v["fraction"]).changed("fading_time", joint, time)


def _rippled(plant: Plant, joint: int, v: Values) -> Plant:
    """In place of the ripple that a healthy arm may have: one has one phase."""
    for name, value in (("ripple", v["amplitude"]), ("cycles", v["order"]), ("phase", v["phase"])):
        plant = plant.changed(name, joint, value - getattr(plant, name)[joint - 1])
    return plant


def _sprung(plant: Plant, joint: int, v: Values) -> Plant:
    return plant.changed("spring", joint, v["stiffness"]).changed("rest", joint, v["rest_angle"])


def _loaded(plant: Plant, joint: int, v: Values) -> Plant:
    """A box: a cube of steel's density is small against its distance, a grasped part is not."""
    side = 1.4 * (v["mass"] / 2000.0) ** (1 / 3)
    return replace(
        plant,
        payload=(v["mass"], np.array([v["x"], v["y"], v["z"]]), v["mass"] * side**2 / 6 * np.ones(3)),
    )


def _soft(plant: Plant, joint: int, v: Values) -> Plant:
    stiffness = v.get("stiffness", 0.0)
    rotor = plant.rotor[joint - 1]
    damping = 0.1 * np.sqrt(stiffness * rotor) if stiffness else 0.02 * plant.friction.viscous[joint - 1]
    return replace(plant, springy=joint, stiffness=stiffness, damping=damping, gap=v.get("half_gap", 0.0))


IN_ARM: dict[str, Callable[[Plant, int, Values], Plant]] = {
    "viscous_friction": lambda p, j, v: p.changed("viscous", j, v["viscous"]),
    "coulomb_friction": lambda p, j, v: p.changed("level", j, v["coulomb"]),
    "friction_asymmetry": _asymmetric,
    "stribeck_friction": _stribeck,
    "load_friction": lambda p, j, v: p.changed("by_load", j, v["mu"]),
    "friction_drift": _drifting,
    "gear_ripple": _rippled,
    "backlash": _soft,
    "joint_compliance": _soft,
    "payload": _loaded,
    "link_inertia": lambda p, j, v: replace(p, extra=(j, v["mass"], np.array([v["x"], v["y"], v["z"]]))),
    "rotor_inertia": lambda p, j, v: p.changed("rotor", j, v["inertia"]),
    "base_tilt": lambda p, j, v: replace(p, tilt=np.array([v["roll"], v["pitch"]])),
    "gravity_spring": _sprung,
    "torque_constant": lambda p, j, v: p.changed("strength", j, v["error"]),
    "current_limit": lambda p, j, v: p.changed("limit", j, v["limit"] - p.limit[j - 1]),
    "joint_zero_offset": lambda p, j, v: p.changed("zero", j, v["offset"]),
}
IN_LOG: dict[str, Callable[[Defects, int, Values], Defects]] = {
    "current_gain": lambda d, j, v: d.with_one("gain", j, v["error"]),
    "current_offset": lambda d, j, v: d.with_one("offset", j, v["offset"]),
    "mains_hum": lambda d, j, v: replace(d.with_one("hum", j, v["amplitude"]), hertz=v["frequency"], phase=v["phase"]),
    "time_skew": lambda d, j, v: replace(d, late=v["delay"]),
    "dropped_trigger": lambda d, j, v: replace(d, lost=int(v["rows"]), lost_at=v["time"]),
    "encoder_ripple": lambda d, j, v: replace(
        d.with_one("waves", j, v["amplitude"]).with_one("cycles", j, v["order"]), phase=v["phase"]
    ),
    "missed_counts": lambda d, j, v: replace(d.with_one("jump", j, v["jump"]), jump_at=v["time"]),
}


def hide(plant: Plant, defects: Defects, hidden: Hidden | None) -> tuple[Plant, Defects]:
    """Both with the effect."""
    if hidden is None:
        return plant, defects
    if hidden.effect in IN_ARM:
        return IN_ARM[hidden.effect](plant, hidden.joint or 0, hidden.parameters), defects
    return plant, IN_LOG[hidden.effect](defects, hidden.joint or 0, hidden.parameters)


def noise_ratio(changed: Array, plain: Array, deviation: Array, joint: int | None) -> float:
    """rms change of the logged torque (m, n) over its noise (n,): at the joint, or where it is largest."""
    ratio = np.sqrt(np.mean((changed - plain) ** 2, axis=0)) / deviation
    return float(ratio.max() if joint is None else ratio[joint - 1])
