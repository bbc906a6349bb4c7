"""How fast friction brings a joint to rest: what limits the steps of a simulation where joints stand or turn.

With sign v = v / sqrt(v^2 + w^2), Coulomb friction F is a damper F / w about rest: a joint of inertia J relaxes at
F / (w J), which has nothing to do with how it moves otherwise. The classical Runge-Kutta method is unstable beyond a
product of step and rate of 2.785 (Hairer & Wanner, Solving Ordinary Differential Equations II, IV.2) and chatters at
standstill there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache

import numpy as np

from arm_io.types import Array
from arm_model.description import Arm
from arm_model.effects import CATALOGUE, Signals, Values
from arm_model.rigid_body.numeric import drive_mass_matrix, drive_rigid_torque

PRODUCT = 2.0
"""Largest product of step and relaxation rate: of 2.785, at which steps chatter."""
MOST, SOFTER = 64, 10.0
"""Most steps per servo tick because of friction, and factor by which a smoothing velocity may be larger instead."""
POSES = 8
"""Poses at which the inertia of each joint is looked at, the least of which counts."""


def friction_rates(arm: Arm, inputs: Mapping[str, Array]) -> Array:
    """(lanes, n) 1/s: relaxation rates at rest of the joints' friction, by the slope of all its laws over velocity.

    inputs: as ``arm_model.system.kernel_inputs`` gives them. Friction that depends on load has that of the weight at
    zero angles.
    """
    mobility, weight = _at_rest(replace(arm, effects=()) if arm.effects else arm)
    for term in arm.effects:
        joint = arm.joints[(term.joint or 1) - 1]
        if CATALOGUE[term.name].spring is not None and joint.rotor_inertia > 0.0:
            alone = 1.0 / (joint.ratio**2 * joint.rotor_inertia)
            mobility = np.where(np.arange(len(arm)) == (term.joint or 0) - 1, np.maximum(mobility, alone), mobility)
    slopes = [_slope(arm, inputs, j, float(weight[j])) for j in range(len(arm))]
    return np.stack(slopes, axis=-1) * mobility


def softened(arm: Arm, inputs: Mapping[str, Array], period: float) -> dict[str, Array]:
    """The inputs with friction smoothed over a larger velocity, where ``MOST`` steps per tick (s) do not suffice.

    Not where that would be more than ``SOFTER`` times as large: friction would no longer be what it is, and such a
    joint, of a URDF file without rotors, diverges.
    """
    factors = np.maximum(friction_rates(arm, inputs) * period / (PRODUCT * MOST), 1.0)
    factors = np.where(factors > SOFTER, 1.0, factors)
    return dict(inputs) | {f"sign_velocity{j}": inputs[f"sign_velocity{j}"] * factors[:, j] for j in range(len(arm))}


def _slope(arm: Arm, inputs: Mapping[str, Array], j: int, load: float) -> Array:
    """(lanes,) N m s/rad: how friction of joint j (from 0), under a load (N m), rises with its velocity at rest."""
    step = 1e-3 * inputs[f"sign_velocity{j}"]
    forwards, backwards = (_friction(arm, inputs, j, way * step, load) for way in (1.0, -1.0))
    return np.maximum((forwards - backwards) / (2.0 * step), 0.0)


def _friction(arm: Arm, inputs: Mapping[str, Array], j: int, v: Array, load: float) -> Array:
    """(lanes,) N m at a velocity v (lanes,) rad/s."""
    sign = v / np.hypot(v, inputs[f"sign_velocity{j}"])
    coulomb = inputs[f"coulomb_mean{j}"] + inputs[f"coulomb_difference{j}"] * sign
    torque = inputs[f"viscous_mean{j}"] * v + inputs[f"viscous_difference{j}"] * np.abs(v) + coulomb * sign
    torque = torque + inputs[f"link_viscous{j}"] * v + inputs[f"link_coulomb{j}"] * sign
    for number, term in enumerate(arm.effects):
        effect = CATALOGUE[term.name]
        if term.joint == j + 1 and effect.torque is not None and effect.rate is None:
            values = Values({p.name: inputs[f"effect{number}.{p.name}"] for p in effect.parameters})
            torque = torque + effect.torque(values, Signals(v=v, sign=sign, coulomb=coulomb, load=load))
    return np.asarray(torque, float)


@lru_cache(maxsize=32)  # of an arm without effects: what is tried of those is simulated again and again
def _at_rest(arm: Arm) -> tuple[Array, Array]:
    """(n,) 1/(kg m2): largest acceleration of each joint by a torque of 1 at it; (n,) N m of weight at zero angles.

    Zeros of an arm that some torque accelerates without bound: it is refused elsewhere.
    """
    random = np.random.default_rng(1)
    poses = np.concatenate([np.zeros((1, len(arm))), random.uniform(-1.5, 1.5, (POSES - 1, len(arm)))])
    weight = np.abs(drive_rigid_torque(arm, *np.zeros((3, 1, len(arm))))[0])
    try:
        found = np.linalg.inv(drive_mass_matrix(arm, poses)).diagonal(axis1=1, axis2=2).max(axis=0)
    except np.linalg.LinAlgError:
        return np.zeros(len(arm)), weight
    return np.maximum(np.where(np.isfinite(found), found, 0.0), 0.0), weight
