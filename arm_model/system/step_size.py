"""How fast the fastest part of an arm moves, and hence how short the steps of a simulation must be."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from arm_io import InputError
from arm_io.types import Array
from arm_model.description import Arm
from arm_model.effects import CATALOGUE, Signals, Values
from arm_model.rigid_body.numeric import drive_mass_matrix

SWING, DECAY, BRISTLE = 0.4, 1.0, 1.0
"""Largest products of step and pulsation, step and damping rate, step and relaxation rate of a state of friction."""


CONTACT_FREQUENCY, CONTACT_DAMPING = 100.0, 0.3
"""Hz and damping ratio of teeth in contact where a model file does not say.

Stiff against the servo, slow against the step.
"""


def without_rotor(arm: Arm, j: int) -> InputError:
    """Says that joint j has no mass on the side of its motor."""
    return InputError(arm.name, f"joint {j + 1} has a two-mass transmission but no rotor_inertia; give it one")


def _mobility(arm: Arm, j: int) -> float:
    """1/(kg m2): 1/rotor + 1/link of joint j with the other joints standing at zero."""
    link = float(drive_mass_matrix(arm, np.zeros(len(arm)), rotors=False)[0, j, j])
    joint = arm.joints[j]
    rotor = joint.ratio**2 * joint.rotor_inertia
    if rotor <= 0:
        raise without_rotor(arm, j)
    if link <= 0:
        raise InputError(
            arm.name, f"joint {j + 1} has a two-mass transmission, but nothing behind it has inertia about its axis"
        )
    return 1.0 / rotor + 1.0 / link


def joint_without_inertia(arm: Arm, q: Array) -> int | None:
    """The joint (from 1) that accelerates without any torque at q (n,), alone or with others; None if there is none.

    Such a joint has a massless last link and a drive without a rotor, as some URDF files describe it.
    """
    matrix = drive_mass_matrix(arm, np.nan_to_num(q))[0]
    size = np.sqrt(np.abs(matrix.diagonal()))
    if size.min() <= 1e-9 * size.max():
        return int(np.argmin(size)) + 1
    values, vectors = np.linalg.eigh(matrix / np.outer(size, size))
    return int(np.argmax(np.abs(vectors[:, 0]))) + 1 if values[0] < 1e-12 else None


def contact(arm: Arm, j: int, values: Mapping[str, float]) -> dict[str, float]:
    """contact_stiffness (N m/rad) and contact_damping of joint j's teeth, where ``values`` leave them at 0."""
    if values.get("contact_stiffness") != 0.0:
        return {}
    inertia, pulsation = 1.0 / _mobility(arm, j), 2 * np.pi * CONTACT_FREQUENCY
    found = {"contact_stiffness": inertia * pulsation**2}
    if values["contact_damping"] == 0.0:
        found["contact_damping"] = 2 * CONTACT_DAMPING * inertia * pulsation
    return found


def fastest(arm: Arm, inputs: Mapping[str, Array]) -> Array:
    """(lanes,) 1/s: one over the step that springs and states of friction allow; 0 where there are none."""
    rates = [np.zeros_like(inputs["gravity0"])]
    for number, term in enumerate(arm.effects):
        effect, j = CATALOGUE[term.name], (term.joint or 0) - 1
        prefix = "contact_" if effect.name == "backlash" else ""
        if effect.spring is not None:
            mobility = _mobility(arm, j)
            stiffness = inputs[f"effect{number}.{prefix}stiffness"]
            damping = inputs[f"effect{number}.{prefix}damping"]
            rates.append(np.sqrt(stiffness * mobility) / SWING)
            rates.append(damping * mobility / DECAY)
        if effect.rate is not None:
            joint = arm.joints[j]
            speed = 2.0 if joint.motor_speed_limit is None else joint.motor_speed_limit / joint.ratio
            level = np.maximum(inputs[f"coulomb_mean{j}"] - abs(inputs[f"coulomb_difference{j}"]), 1e-3)
            values = Values({p.name: inputs[f"effect{number}.{p.name}"] for p in effect.parameters})
            at = (effect.rate(values, Signals(v=speed, sign=1.0, coulomb=level, state=state)) for state in (0.0, 1.0))
            rates.append(np.asarray(next(at) - next(at)) / BRISTLE)
    return np.max(np.stack(np.broadcast_arrays(*rates)), axis=0)
