"""The numbers that a generated system takes, from one arm or from many variations of it.

System: ``arm_model.system.closed_loop_system``.

Joints and effects are counted from 0 here. All drive quantities are at the joint side:

    body{j}.{k}  regrouped inertial parameters in the joint frame     gravity{k}   m/s2, base frame
    resistance{j} added{j} displaced{j}   the water's, of link j (``arm_model.rigid_body.hydrodynamics``); drag{j} of
                                          the whole link, N m s2/rad2
    link_viscous{j} link_coulomb{j}       of the joint's own axis (``arm_model.rigid_body.link_friction``)
    rotor{j} offset{j} viscous_mean{j} viscous_difference{j} coulomb_mean{j} coulomb_difference{j} sign_velocity{j}
                 of the directions: mean, and half of positive less negative (coulomb with the friction curve at rest)
    curve{j}.speed{k} curve{j}.positive{k} curve{j}.negative{k}    rad/s (m/s), and by how much the slope of joint j's
                 friction curve changes there (``arm_model.rigid_body.friction_curve``)
    zero{j}      rad (m): what a zero offset adds to q before the links see it
    warm{j}.start warm{j}.time{k} warm{j}.bend{k}   K, s, K/s: of the motor's temperature (``arm_model.system.warmth``)
    drive{j}     N m/A                                               kp{j} ki{j} kd{j} limit{j}   the servo's, A
    effect{e}.{parameter}
    base_..., thruster_..., feedforward   of a floating base (``arm_model.system.base_inputs``)
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from arm_io import InputError
from arm_io.types import Array
from arm_model.description import Arm
from arm_model.effects import CATALOGUE, described, values_of
from arm_model.parameters import with_parameters
from arm_model.rigid_body import newton_euler
from arm_model.rigid_body.friction_curve import bends
from arm_model.rigid_body.hydrodynamics import unit_water
from arm_model.rigid_body.inertia import transform
from arm_model.rigid_body.link_friction import LINK_FRICTION
from arm_model.rigid_body.regressor import parameter_names, parameter_vector
from arm_model.rigid_body.regroup import regrouped
from arm_model.servo import servo_gains
from arm_model.system.base_inputs import base_numbers
from arm_model.system.step_size import contact
from arm_model.system.warmth import warmth_numbers


def numbers(arm: Arm, variations: Mapping[str, Array] | None = None) -> dict[str, Array]:
    """Name -> (lanes,) values.

    ``variations``: parameter name (``arm_model.parameters``) -> (lanes,); without any, one lane.

    InputError for an unknown name, for lanes of different number, and for geometry, which is built into the equations.
    """
    variations = {name: np.atleast_1d(np.asarray(value, float)) for name, value in (variations or {}).items()}
    counts = {len(value) for value in variations.values()} or {1}
    if len(counts) != 1:
        raise InputError("parameters", f"have {sorted(counts)} values; expected as many for each")
    lanes = counts.pop()
    for name in variations:
        if name.split(".")[-1] in ("theta", "d", "a", "alpha", "beta"):
            raise InputError(name, "geometry is built into the equations; simulate one arm at a time to vary it")
    linear = parameter_names(arm)
    if all(each in linear for name in variations for each in _directions(name)):
        return _linear(arm, variations, lanes)
    each = [
        with_parameters(arm, {name: float(value[lane]) for name, value in variations.items()}) for lane in range(lanes)
    ]
    found = [_linear(each[0], {}, 1)]
    for one in each[1:]:
        alike = _without_effects(one) == _without_effects(each[0])
        # most vary numbers of effects alone, which change no number of bodies and drives
        found.append(found[0] | _constant(one, 1) if alike else _linear(one, {}, 1))
    return {name: np.concatenate([one[name] for one in found]) for name in found[0]}


def _without_effects(arm: Arm) -> tuple[Arm, Arm]:
    """An arm, and what its effects make of its description, without the effects themselves."""
    return replace(arm, effects=()), replace(described(arm), effects=())


def _linear(arm: Arm, variations: Mapping[str, Array], lanes: int) -> dict[str, Array]:
    """All lanes at once: the variations are of parameters that the torque is linear in."""
    bent = described(arm)
    n, names = len(arm), parameter_names(bent)
    p = np.tile(parameter_vector(bent), (lanes, 1))
    nominal = dict(zip(parameter_names(arm), parameter_vector(arm)))
    for name, values in variations.items():
        for each in _directions(name):
            p[:, names.index(each)] += values - nominal[each]
    chain = newton_euler.chain_of(arm)  # what a zero offset turns, zero{j} turns: the bodies with everything else
    links = p[:, : 10 * n].reshape(lanes, n, 10)
    bodies = np.stack([transform(links[:, j], chain.link[j]) for j in range(n)], axis=1)
    if arm.floating is None:  # a base that moves feels all of the first link
        bodies = regrouped(chain, bodies)
    found = {f"body{j}.{k}": bodies[:, j, k] for j in range(n) for k in range(10)}
    drive = p[:, 10 * n : 16 * n].reshape(lanes, n, 6)
    for j in range(n):
        found |= {f"rotor{j}": drive[:, j, 0], f"offset{j}": drive[:, j, 5]}
        for kind, forwards, backwards in (("viscous", *drive[:, j, 1:3].T), ("coulomb", *drive[:, j, 3:5].T)):
            found[f"{kind}_mean{j}"] = (forwards + backwards) / 2
            found[f"{kind}_difference{j}"] = (forwards - backwards) / 2
    rest = dict(zip(names[16 * n :], p[:, 16 * n :].T))
    found |= _water(bent, rest, lanes)
    found |= {
        f"{kind}{j}": rest.get(f"joint{j + 1}.{kind}", np.zeros(lanes)) for kind in LINK_FRICTION for j in range(n)
    }
    for j in range(n):
        _add_curve(found, bent, j, rest)
    return found | _constant(arm, lanes)


def _constant(arm: Arm, lanes: int) -> dict[str, Array]:
    """The numbers that the torque is not linear in, alike in all lanes."""
    return {name: np.full(lanes, float(value)) for name, value in _constants(arm, described(arm)).items()}


def _directions(name: str) -> tuple[str, ...]:
    """The linear parameters that a name sets: friction without a direction sets both."""
    if name.endswith((".viscous", ".coulomb")) or re.fullmatch(r"joint\d+\.curve\d+", name):
        return f"{name}_positive", f"{name}_negative"
    return (name,)


def _add_curve(found: dict[str, Array], arm: Arm, j: int, values: Mapping[str, Array]) -> None:
    """Adds the friction curve of joint j with its ``values``, (lanes,) each by their names."""
    curve = arm.joints[j].friction_curve
    if curve is None:
        return
    sides = [
        np.stack([values[f"joint{j + 1}.curve{k}_{way}"] for k in range(1, len(curve.speed) + 1)], axis=-1)
        for way in ("positive", "negative")
    ]
    found[f"coulomb_mean{j}"] = found[f"coulomb_mean{j}"] + (sides[0][:, 0] + sides[1][:, 0]) / 2
    found[f"coulomb_difference{j}"] = found[f"coulomb_difference{j}"] + (sides[0][:, 0] - sides[1][:, 0]) / 2
    for way, side in zip(("positive", "negative"), sides):
        found |= {f"curve{j}.{way}{k}": bend for k, bend in enumerate(bends(curve.speed, side).T)}
    found |= {f"curve{j}.speed{k}": np.full(len(sides[0]), speed) for k, speed in enumerate(curve.speed)}


def _water(arm: Arm, coefficients: Mapping[str, Array], lanes: int) -> dict[str, Array]:
    """What the water's coefficients, (lanes,) each by their names, make of the cylinders."""
    numbers = {}
    for j, joint in enumerate(arm.joints):
        numbers[f"drag{j}"] = coefficients.get(f"joint{j + 1}.drag", np.zeros(lanes))
        if joint.cylinder is not None:
            unit = unit_water(joint.cylinder)
            numbers[f"resistance{j}"] = unit.resistance * coefficients[f"link{j + 1}.drag_coefficient"]
            numbers[f"added{j}"] = unit.added * coefficients[f"link{j + 1}.added_mass_coefficient"]
            numbers[f"displaced{j}"] = unit.displaced * coefficients[f"link{j + 1}.buoyancy"]
    return numbers


def _constants(arm: Arm, bent: Arm) -> dict[str, float]:
    """What does not enter the torque linearly; the servo belongs to the arm as described, without its effects."""
    found = {f"gravity{k}": value for k, value in enumerate(bent.gravity)} | base_numbers(arm, bent)
    found |= warmth_numbers(arm)
    for j, (joint, real) in enumerate(zip(arm.joints, bent.joints)):
        found[f"zero{j}"] = real.theta - joint.theta if joint.revolute else real.d - joint.d
    for j, (joint, real) in enumerate(zip(arm.joints, bent.joints)):
        found |= {f"drive{j}": real.drive_constant, f"sign_velocity{j}": real.sign_velocity}
        if real.torque_limit is not None:
            # the servo clips what it takes for this torque
            found[f"limit{j}"] = real.torque_limit / joint.drive_constant
    if arm.controller is not None:
        gains = servo_gains(arm)
        for j in range(len(arm)):
            found |= {f"kp{j}": gains.position[j], f"ki{j}": gains.integral[j], f"kd{j}": gains.velocity[j]}
    for number, term in enumerate(arm.effects):
        effect = CATALOGUE[term.name]
        values = values_of(effect, term.parameters)
        if effect.spring is not None:
            values |= contact(arm, (term.joint or 0) - 1, values)
        found |= {f"effect{number}.{name}": value for name, value in values.items()}
    return found
