"""Extended models that cannot be simulated: a spring or a gap between a link and a motor that has no rotor inertia."""

from __future__ import annotations

from collections.abc import Iterator

from arm_model import Arm
from arm_model.effects import CATALOGUE


def not_simulated(extended: Arm) -> Iterator[str]:
    """A sentence per transmission at a joint whose drive has no rotor inertia, as a URDF file leaves it.

    Measured angles show its deflection all the same; a simulation needs a mass on the side of the motor.
    """
    for term in extended.effects:
        if term.joint is None or CATALOGUE[term.name].spring is None:
            continue
        if extended.joints[term.joint - 1].rotor_inertia <= 0.0:
            yield (
                f"the extended model cannot be simulated: {term.name.replace('_', ' ')} of joint {term.joint} needs a "
                "rotor_inertia of that joint; give it one"
            )
