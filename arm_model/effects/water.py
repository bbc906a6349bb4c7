"""Water that a description lacks or underestimates.

The forces are Morison's along a link (``arm_model.rigid_body.hydrodynamics``).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from arm_model.effects.definition import Effect, Parameter, Place, Values
from arm_model.effects.observation import Excitation, Instrument, Observation, Variable
from arm_model.rigid_body.hydrodynamics import own_drag

if TYPE_CHECKING:
    from arm_model.description import Arm, Joint


def _with_joint(arm: Arm, joint: int, changed: Joint) -> Arm:
    return replace(arm, joints=(*arm.joints[: joint - 1], changed, *arm.joints[joint:]))


def _drag(arm: Arm, joint: int | None, p: Values) -> Arm:
    """Drag along the link's cylinder (Morison), or on the whole joint if the model describes no cylinder."""
    assert joint is not None
    link, unit = arm.joints[joint - 1], own_drag(arm, joint)
    if link.cylinder is None or unit == 0.0:
        return _with_joint(arm, joint, replace(link, drag=(link.drag or 0.0) + p.drag))
    cylinder = replace(link.cylinder, drag_coefficient=link.cylinder.drag_coefficient + p.drag / unit)
    return _with_joint(arm, joint, replace(link, cylinder=cylinder))


def _added_mass(arm: Arm, joint: int | None, p: Values) -> Arm:
    assert joint is not None
    link = arm.joints[joint - 1]
    assert link.cylinder is not None, "check_terms asks for it"
    cylinder = replace(
        link.cylinder,
        added_mass_coefficient=link.cylinder.added_mass_coefficient + p.coefficient,
        buoyancy=link.cylinder.buoyancy + p.buoyancy,
    )
    return _with_joint(arm, joint, replace(link, cylinder=cylinder))


HYDRODYNAMIC_DRAG = Effect(
    name="hydrodynamic_drag",
    place=Place.MECHANICS,
    parameters=(
        Parameter(
            "drag",
            "N m s2/rad2",
            (0.1, 10.0),
            True,
            "torque over square of velocity while the joint moves alone, all strips of the link together",
            noun="drag coefficient",
        ),
    ),
    equation="dF = rho C_d R |v| v dl across the link (Morison); D |q'| q' on a joint that moves alone, or has no "
    "cylinder",
    shows="error with the square of velocity",
    confused_with={"stribeck_friction": "a series of speeds; recordings in air and in water"},
    observed_by={Instrument.CURRENT: Observation(against=Variable.VELOCITY)},
    excited_by=Excitation.SPEED,
    change=_drag,
)

ADDED_MASS = Effect(
    name="added_mass",
    place=Place.MECHANICS,
    parameters=(
        Parameter(
            "coefficient",
            "1",
            (0.5, 2.0),
            True,
            "missing coefficient C_a of the water that moves with the link",
            noun="added mass coefficient",
        ),
        Parameter("buoyancy", "1", (0.1, 1.0), True, "missing share of the displaced water's weight"),
    ),
    equation="dF = (rho C_a pi R^2 a + b rho pi R^2 g) dl across the link's cylinder (Morison; Archimedes)",
    shows="follows acceleration, by pose; a lighter link",
    confused_with={"link_inertia": "recordings in air and in water"},
    observed_by={Instrument.CURRENT: Observation()},
    excited_by=Excitation.ACCELERATION,
    change=_added_mass,
    cylinder=True,
)

EFFECTS = (HYDRODYNAMIC_DRAG, ADDED_MASS)
