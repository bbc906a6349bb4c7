"""A joint behind another gear: what is at the motor is converted, so that what happens at the joint stays the same."""

from __future__ import annotations

from dataclasses import replace

from arm_model.description import Joint


def regeared(joint: Joint, gear: float) -> Joint:
    """The joint with this gear (motor angle over joint angle, signed; not 0), and the same motion at the joint.

    Rotor inertia, friction, torque per current and speed limit at the joint stay: N m, kg m2 and rad/s of the motor
    (``arm_model.description``) become those of a motor behind the other gear. Gear stages are of the old gear, and go.
    """
    if gear == joint.gear:
        return joint
    slower = joint.ratio / abs(gear)
    forwards, backwards = joint.viscous
    positive, negative = joint.coulomb
    limit = joint.motor_speed_limit
    return replace(
        joint,
        gear=gear,
        gear_stage=(),
        rotor_inertia=joint.rotor_inertia * slower**2,
        viscous=(forwards * slower**2, backwards * slower**2),
        coulomb=(positive * slower, negative * slower),
        offset=joint.offset * slower,
        torque_constant=joint.torque_constant * slower,
        motor_speed_limit=None if limit is None else limit / slower,
    )
