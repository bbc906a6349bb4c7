"""The arm with its effects of geometry applied to its links.

These change the equations themselves, not only the numbers in them.
"""

from __future__ import annotations

from dataclasses import replace

from arm_io import InputError
from arm_model.description import Arm
from arm_model.effects import CATALOGUE, values_of
from arm_model.servo import fixed_gains


def relinked(arm: Arm, *, zeros: bool = False) -> Arm:
    """The arm with its ``link_geometry`` carried into its joints (``zeros``: its ``joint_zero_offset`` too).

    The equations of an arm with placed joints (URDF) have no number to add a zero offset to: there, too, it is carried
    into them. Servos stay those of the arm as it was described.

    InputError where a link is placed (URDF) and so has no D-H parameters to be wrong.
    """
    zeros = zeros or any(joint.convention == "placed" for joint in arm.joints)
    terms = [t for t in arm.effects if t.name == "link_geometry" or (zeros and t.name == "joint_zero_offset")]
    if not terms:
        return arm
    bent = replace(fixed_gains(replace(arm, effects=())), effects=tuple(t for t in arm.effects if t not in terms))
    for term in terms:
        effect = CATALOGUE[term.name]
        assert effect.change is not None
        try:
            bent = effect.change(bent, term.joint, values_of(effect, term.parameters))
        except ValueError as error:
            raise InputError(arm.name, str(error)) from None
    return bent
