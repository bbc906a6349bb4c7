"""Compiled systems, kept in memory from an arm that differs from another in numbers only."""

from __future__ import annotations

from collections.abc import Mapping

from arm_io.types import Array
from arm_model.description import Arm
from arm_model.simulation.engine import Program, program_of
from arm_model.symbolic.machine_code import lanes as lanes_of_a_vector
from arm_model.system.closed_loop_system import build
from arm_model.system.warmth import warmth_knots

KEPT = 128
"""Programs that are kept in memory."""
_kept: dict[str, Program] = {}


def program_for(arm: Arm, inputs: Mapping[str, Array], lanes: int, *, single: bool) -> Program:
    """The arm's equations, compiled; kept from an arm that differs from it in numbers only."""
    zero = zeros(inputs)
    joints = [
        (
            j.type,
            j.convention,
            j.theta,
            j.d,
            j.a,
            j.alpha,
            j.beta,
            j.xyz,
            j.rpy,
            j.axis,
            j.ratio,
            j.torque_limit is None,
            None if j.cylinder is None else (j.cylinder.start, j.cylinder.end),
            None if j.friction_curve is None else len(j.friction_curve.speed),
            warmth_knots(arm, number),
        )
        for number, j in enumerate(arm.joints)
    ]
    terms = [(term.name, term.joint) for term in arm.effects]
    width = 1 if lanes == 1 and not single else lanes_of_a_vector(32 if single else 64)
    key = repr((width, single, joints, arm.base, arm.coupling, _servo(arm), terms, _base(arm), sorted(zero)))
    if key not in _kept:
        if len(_kept) >= KEPT:
            _kept.pop(next(iter(_kept)))
        _kept[key] = program_of(build(arm, zero), width, single=single)
    return _kept[key]


def _servo(arm: Arm) -> object:
    """What the equations of the servos depend on: their gains are numbers."""
    servo = arm.controller
    return servo and (servo.servo_period, servo.velocity_bandwidth, servo.velocity_reference)


def _base(arm: Arm) -> object:
    """What the equations of a floating base depend on, its numbers apart."""
    if arm.floating is None:
        return None
    thrusters = [(t.position, t.direction, t.limits, t.time_constant > 0) for t in arm.floating.thruster]
    station = arm.floating.controller
    return thrusters, station is not None, station is not None and station.feedforward > 0


def zeros(inputs: Mapping[str, Array]) -> frozenset[str]:
    """Names of the inputs that are zero in every lane."""
    return frozenset(name for name, value in inputs.items() if not value.any())
