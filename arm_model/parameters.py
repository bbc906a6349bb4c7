"""Parameters of an arm by name, as identification, diagnosis and batches of simulations speak of them.

link{j}.mass .mx .my .mz .ixx .ixy .ixz .iyy .iyz .izz     barycentric, in the link frame about its origin (kg, kg m, kg
                                                           m2); changing one leaves the other nine as they are
joint{j}.rotor_inertia .offset                             at the JOINT side (kg m2, N m)
joint{j}.viscous_positive .viscous_negative .viscous       at the JOINT side (N m s/rad); the last sets both, and reads
                                                           as the mean
joint{j}.coulomb_positive .coulomb_negative .coulomb       likewise (N m)
joint{j}.curve{k}_positive .curve{k}_negative .curve{k}    likewise: of its friction curve at the k-th speed, from 1
link{j}.drag_coefficient .added_mass_coefficient .buoyancy  of its cylinder in water (1), where the model describes one
joint{j}.drag                                              N m s2/rad2
joint{j}.link_viscous .link_coulomb                        N m s/rad, N m: of the joint's own axis
joint{j}.theta .d .a .alpha .beta .torque_constant .torque_limit .sign_velocity    as the model file has them
base.NAME, thruster{k}.NAME                                of a floating base (``arm_model.tables.base_values``)
joint{j}.EFFECT.PARAMETER, EFFECT.PARAMETER                of an effect term of that joint, of the whole arm
joint{j}.EFFECT2.PARAMETER                                 of its second term of that name, in the order of the file
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import TypeVar

from arm_io import InputError
from arm_model.description import Arm, Joint
from arm_model.effects import CATALOGUE
from arm_model.rigid_body.hydrodynamics import COEFFICIENTS
from arm_model.rigid_body.inertia import PARAMETERS, about_com, barycentric
from arm_model.rigid_body.link_friction import LINK_FRICTION
from arm_model.servo import fixed_gains
from arm_model.tables import base_parameters, with_base_parameters
from arm_model.tables.link_shapes import Cylinder

_DIRECT = (
    "drag",
    *LINK_FRICTION,
    "theta",
    "d",
    "a",
    "alpha",
    "beta",
    "torque_constant",
    "torque_limit",
    "sign_velocity",
)
_DRIVE = {"rotor_inertia": 2, "offset": 1}
"""Powers of the gear ratio from motor to joint."""
_DIRECTED = {"viscous": 2, "coulomb": 1}
"""Likewise; (positive, negative) each."""


def _unknown(name: str) -> InputError:
    return InputError(
        name, "no such parameter of this arm; write link2.mass, joint1.viscous or joint2.backlash.half_gap"
    )


def _split(arm: Arm, name: str) -> tuple[str, int, str]:
    """kind ('link', 'joint' or 'effect'), index from 0 (-1 for the whole arm) and the rest."""
    head, _, quantity = name.partition(".")
    for kind in ("link", "joint"):
        number = head.removeprefix(kind)
        if head.startswith(kind) and number.isdigit():
            if not 1 <= int(number) <= len(arm):
                raise InputError(name, f"this arm has joints 1 to {len(arm)}")
            return ("effect" if "." in quantity else kind), int(number) - 1, quantity
    return "effect", -1, name


def parameter(arm: Arm, name: str) -> float:
    """The value of one parameter, by the names above; InputError for a name the arm has not."""
    if arm.floating is not None and name in (base_values := base_parameters(arm.floating)):
        return base_values[name]
    kind, index, quantity = _split(arm, name)
    if kind == "effect":
        place = _effect_place(arm, name, index, quantity)
        return arm.effects[place].parameters.get(quantity.partition(".")[2], 0.0)
    joint = arm.joints[index]
    if kind == "link" and quantity in PARAMETERS:
        return float(barycentric(joint.mass, joint.com, joint.inertia)[PARAMETERS.index(quantity)])
    if kind == "link" and quantity in COEFFICIENTS and joint.cylinder is not None:
        return float(getattr(joint.cylinder, quantity))
    if kind == "joint":
        friction, direction = friction_and_direction(quantity)
        if friction in _DIRECTED:
            both = getattr(joint, friction)
            at_motor = sum(both) / 2 if direction is None else both[direction]
            return float(at_motor * joint.ratio ** _DIRECTED[friction])
        if (point := curve_place(joint, friction)) is not None:
            sides = [values[point] for values in curve_values(joint)]
            return float(sum(sides) / 2 if direction is None else sides[direction])
        if quantity in _DRIVE:
            return float(getattr(joint, quantity) * joint.ratio ** _DRIVE[quantity])
        if quantity in _DIRECT and getattr(joint, quantity) is not None:
            return float(getattr(joint, quantity))
    raise _unknown(name)


def with_parameters(arm: Arm, values: Mapping[str, float]) -> Arm:
    """The arm with these parameters changed; InputError for a name it has not.

    Nothing is checked for being physical. The controller keeps its gains: better knowledge of the arm does not change
    its servos.
    """
    arm = fixed_gains(arm)
    if arm.floating is not None:
        base_values = base_parameters(arm.floating)
        of_base = {name: float(value) for name, value in values.items() if name in base_values}
        arm = replace(arm, floating=with_base_parameters(arm.floating, of_base)) if of_base else arm
        values = {name: value for name, value in values.items() if name not in base_values}
    joints = list(arm.joints)
    links: dict[int, dict[str, float]] = {}
    for name, value in values.items():
        kind, index, quantity = _split(arm, name)
        if kind == "effect":
            arm = _with_effect(arm, name, index, quantity, float(value))
        elif kind == "link" and quantity in PARAMETERS:
            links.setdefault(index, {})[quantity] = float(value)
        elif kind == "link" and quantity in COEFFICIENTS and (cylinder := joints[index].cylinder) is not None:
            joints[index] = unchecked(joints[index], cylinder=unchecked(cylinder, **{quantity: float(value)}))
        elif kind == "joint":
            joints[index] = _with_joint(joints[index], name, quantity, float(value))
        else:
            raise _unknown(name)
    for index, changed in links.items():
        joints[index] = _with_link(joints[index], changed)
    return replace(arm, joints=tuple(joints))


def _with_link(joint: Joint, changed: Mapping[str, float]) -> Joint:
    parameters = barycentric(joint.mass, joint.com, joint.inertia)
    for name, value in changed.items():
        parameters[PARAMETERS.index(name)] = value
    if parameters[0] == 0.0 and parameters[1:4].any():
        raise InputError("parameters", "a first moment without mass cannot be written as a centre of mass; give a mass")
    mass, com, inertia = about_com(parameters)
    return unchecked(joint, mass=mass, com=com, inertia=inertia)


def _with_joint(joint: Joint, name: str, quantity: str, value: float) -> Joint:
    friction, direction = friction_and_direction(quantity)
    if friction in _DIRECTED:
        at_motor = value / joint.ratio ** _DIRECTED[friction]
        both = [at_motor, at_motor] if direction is None else list(getattr(joint, friction))
        both[direction or 0] = at_motor
        return unchecked(joint, **{friction: tuple(both)})
    if (place := curve_place(joint, friction)) is not None:
        assert joint.friction_curve is not None
        sides = [list(values) for values in curve_values(joint)]
        for side in (0, 1) if direction is None else (direction,):
            sides[side][place] = value
        curve = replace(joint.friction_curve, positive=tuple(sides[0]), negative=tuple(sides[1]))
        return unchecked(joint, friction_curve=curve)
    if quantity in _DRIVE:
        return unchecked(joint, **{quantity: value / joint.ratio ** _DRIVE[quantity]})
    if quantity in _DIRECT:
        return unchecked(joint, **{quantity: value})
    raise _unknown(name)


def friction_and_direction(name: str) -> tuple[str, int | None]:
    """'viscous_negative' -> ('viscous', 1); 'coulomb' -> ('coulomb', None)."""
    for direction, ending in enumerate(("_positive", "_negative")):
        if name.endswith(ending):
            return name.removesuffix(ending), direction
    return name, None


def curve_place(joint: Joint, name: str) -> int | None:
    """'curve3' -> 2 where the joint's friction curve has so many speeds; None for any other name."""
    number = name.removeprefix("curve")
    if joint.friction_curve is None or number == name or not number.isdigit():
        return None
    return int(number) - 1 if 1 <= int(number) <= len(joint.friction_curve.speed) else None


def curve_values(joint: Joint) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Values of the joint's friction curve, positive and negative direction; none without a curve."""
    curve = joint.friction_curve
    return ((), ()) if curve is None else (curve.positive, curve.negative)


T = TypeVar("T", Joint, Cylinder)


def unchecked(described: T, **entries: object) -> T:
    """dataclasses.replace without the checks of a model file: a search may pass through a negative mass."""
    changed = object.__new__(type(described))
    for field in fields(described):
        object.__setattr__(changed, field.name, entries.get(field.name, getattr(described, field.name)))
    return changed


def _effect_place(arm: Arm, name: str, index: int, quantity: str) -> int:
    effect, _, entry = quantity.partition(".")
    of_name = effect.rstrip("0123456789")
    number = int(effect.removeprefix(of_name) or 1)
    same = [k for k, term in enumerate(arm.effects) if term.name == of_name and (term.joint or 0) == index + 1]
    # what an effect does not state is 0, and may be changed
    if 1 <= number <= len(same) and entry in {p.name for p in CATALOGUE[of_name].parameters}:
        return same[number - 1]
    raise _unknown(name)


def _with_effect(arm: Arm, name: str, index: int, quantity: str, value: float) -> Arm:
    place = _effect_place(arm, name, index, quantity)
    term = arm.effects[place]
    changed = replace(term, parameters={**term.parameters, quantity.partition(".")[2]: value})
    return replace(arm, effects=(*arm.effects[:place], changed, *arm.effects[place + 1 :]))
