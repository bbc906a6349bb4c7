"""Wrong numbers in the description: masses, inertias, constants, zeros. Their law is another arm."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from arm_model.effects.definition import Effect, Parameter, Place, Values
from arm_model.effects.observation import Excitation, Instrument, Observation, Span, Variable
from arm_model.rigid_body.kinematics import rezeroed

if TYPE_CHECKING:
    from arm_model.description import Arm, Joint


def _with_joint(arm: Arm, joint: int | None, **changes: object) -> Arm:
    assert joint is not None
    joints = list(arm.joints)
    joints[joint - 1] = replace(joints[joint - 1], **changes)  # type: ignore[arg-type]
    return replace(arm, joints=tuple(joints))


def _merged(link: Joint, mass: float, moment: np.ndarray, about_origin: np.ndarray) -> dict[str, object]:
    """Mass, com and inertia of a link.

    What is added: mass kg, first moment (3,) kg m and inertia (3, 3) about the frame's origin.
    """
    xx, yy, zz, xy, yz, xz = link.inertia
    com = np.array(link.com)
    total = link.mass + mass
    first = link.mass * com + moment
    origin = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) + link.mass * _steiner(com) + about_origin
    centre = first / total if total > 0 else com
    inertia = origin - total * _steiner(centre)
    return {
        "mass": float(total),
        "com": tuple(map(float, centre)),
        "inertia": tuple(float(inertia[k]) for k in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))),
    }


def _steiner(r: np.ndarray) -> np.ndarray:
    """Inertia of a unit mass point at r (3,): |r|^2 1 - r r^T."""
    return np.dot(r, r) * np.eye(3) - np.outer(r, r)


def _payload(arm: Arm, joint: int | None, p: Values) -> Arm:
    point = np.array([p.x, p.y, p.z])
    about_com = np.array([[p.ixx, p.ixy, p.ixz], [p.ixy, p.iyy, p.iyz], [p.ixz, p.iyz, p.izz]])
    body = _merged(arm.joints[-1], p.mass, p.mass * point, about_com + p.mass * _steiner(point))
    return _with_joint(arm, len(arm.joints), **body)


def _link_inertia(arm: Arm, joint: int | None, p: Values) -> Arm:
    assert joint is not None
    about = np.array([[p.ixx, p.ixy, p.ixz], [p.ixy, p.iyy, p.iyz], [p.ixz, p.iyz, p.izz]])
    return _with_joint(arm, joint, **_merged(arm.joints[joint - 1], p.mass, np.array([p.mx, p.my, p.mz]), about))


def _rotor_inertia(arm: Arm, joint: int | None, p: Values) -> Arm:
    assert joint is not None
    drive = arm.joints[joint - 1]
    return _with_joint(arm, joint, rotor_inertia=drive.rotor_inertia + p.inertia / drive.gear**2)


_LEVEL = {0: (2, 1), 1: (0, 2), 2: (0, 1)}
"""Axis of the base (x, y, z: 0, 1, 2) nearest to gravity -> the axes of roll and of pitch, the other two."""


def _base_tilt(arm: Arm, joint: int | None, p: Values) -> Arm:
    gravity = np.array(arm.gravity)
    roll, pitch = _LEVEL[int(np.argmax(np.abs(gravity)))]
    x, y, z = (_turn(pitch, p.pitch) @ _turn(roll, p.roll)).T @ gravity
    return replace(arm, gravity=(float(x), float(y), float(z)))


def _turn(axis: int, angle: float) -> np.ndarray:
    """(3, 3) rotation about the base's x, y or z axis (0, 1, 2)."""
    one, other = (axis + 1) % 3, (axis + 2) % 3
    turn = np.eye(3)
    turn[[one, other], [one, other]] = np.cos(angle)
    turn[other, one], turn[one, other] = np.sin(angle), -np.sin(angle)
    return turn


def _torque_constant(arm: Arm, joint: int | None, p: Values) -> Arm:
    assert joint is not None
    return _with_joint(arm, joint, torque_constant=arm.joints[joint - 1].torque_constant * (1 + p.error))


def _zero_offset(arm: Arm, joint: int | None, p: Values) -> Arm:
    # of an arm with coupled joints it displaces every link that the encoder's joint moves
    assert joint is not None
    moved = arm.coupling_matrix[:, joint - 1] * -float(p.offset)
    for link in np.flatnonzero(moved).tolist():
        arm = _with_joint(arm, link + 1, **rezeroed(arm.joints[link], float(moved[link])))
    return arm


FARTHEST = 10.0
"""m from the flange at which the centre of a payload may be: a moment whose mass nothing shows is none of a payload."""

PAYLOAD = Effect(
    name="payload",
    place=Place.MECHANICS,
    parameters=(
        Parameter("mass", "kg", (0.1, 5.0), True, "mass at the flange", noun="payload mass"),
        Parameter(
            "x",
            "m",
            (0.0, 0.3),
            False,
            "centre of the mass in the frame of the last link",
            signed=True,
            span=Span.MOMENT,
            most=FARTHEST,
        ),
        Parameter("y", "m", (0.0, 0.3), False, "", signed=True, span=Span.MOMENT, most=FARTHEST),
        Parameter("z", "m", (0.0, 0.3), False, "", signed=True, span=Span.MOMENT, most=FARTHEST),
        *(
            Parameter(
                f"i{c}",
                "kg m2",
                (0.0, 0.5),
                False,
                f"its own inertia about its centre, {c}; 0 for a mass point",
                signed=True,
                span=Span.INERTIA,
            )
            for c in ("xx", "xy", "xz", "yy", "yz", "zz")
        ),
    ),
    equation="a body of mass m at (x, y, z) of the last link, with an inertia of its own about that centre",
    settable="mounted differently",
    shows="gravity by pose, plus inertia",
    confused_with={"link_inertia": "runs with and without a known mass"},
    per_joint=False,
    observed_by={Instrument.CURRENT: Observation()},
    excited_by=Excitation.LOAD,
    # mass and first moment, which carry gravity; the inertia of a mass point follows from them where it is simulated
    link_parameters=4,
    body="link_inertia",
    change=_payload,
)

LINK_INERTIA = Effect(
    name="link_inertia",
    place=Place.MECHANICS,
    parameters=(
        Parameter("mass", "kg", (0.1, 5.0), True, "error of the mass", signed=True, noun="mass error"),
        *(
            Parameter(f"m{c}", "kg m", (0.01, 1.0), True, f"error of mass times centre, {c}", signed=True)
            for c in "xyz"
        ),
        *(
            Parameter(
                f"i{c}", "kg m2", (0.001, 0.5), True, f"error of the inertia about the frame's origin, {c}", signed=True
            )
            for c in ("xx", "xy", "xz", "yy", "yz", "zz")
        ),
    ),
    equation="mass, centre or inertia of the link differ",
    shows="inertial and gravity columns of the link",
    confused_with={"payload": "runs with and without a known mass", "torque_constant": "a known payload"},
    observed_by={Instrument.CURRENT: Observation()},
    near_cases=("rotor_inertia",),
    link_parameters=10,
    change=_link_inertia,
)

ROTOR_INERTIA = Effect(
    name="rotor_inertia",
    place=Place.MECHANICS,
    parameters=(
        Parameter(
            "inertia",
            "kg m2",
            (0.05, 3.0),
            True,
            "missing rotor inertia, at the joint: G^2 Jm",
            signed=True,
            noun="rotor inertia",
        ),
    ),
    equation="tau = G^2 Jm q''",
    shows="follows acceleration in every pose",
    confused_with={"link_inertia": "other poses"},
    observed_by={
        Instrument.CURRENT: Observation(against=Variable.ACCELERATION),
        Instrument.SINGLE_AXIS: Observation(against=Variable.VELOCITY),
    },
    excited_by=Excitation.ACCELERATION,
    own_joint=True,
    change=_rotor_inertia,
)

BASE_TILT = Effect(
    name="base_tilt",
    place=Place.GEOMETRY,
    parameters=(
        # a tilt of half a turn is the largest; rotation about gravity has no effect
        Parameter(
            "roll",
            "rad",
            (0.002, 0.05),
            True,
            "rotation of the base about its x axis (z: gravity along x)",
            signed=True,
            most=3.2,
        ),
        Parameter(
            "pitch",
            "rad",
            (0.002, 0.05),
            True,
            "rotation of the base about its y axis (z: gravity along y)",
            signed=True,
            most=3.2,
        ),
    ),
    equation="g is not as the model has it",
    shows="torque of joint 1 as sin(q1 + phi)",
    confused_with={"link_inertia": "recordings with the base turned", "joint_zero_offset": "a level on the base"},
    per_joint=False,
    observed_by={Instrument.CURRENT: Observation()},
    change=_base_tilt,
)

TORQUE_CONSTANT = Effect(
    name="torque_constant",
    place=Place.MECHANICS,
    parameters=(
        Parameter(
            "error",
            "1",
            (0.02, 0.2),
            True,
            "relative error of the torque constant",
            signed=True,
            noun="torque constant error",
        ),
    ),
    equation="tau = (1 + e) k i",
    shows="all torques of one joint scaled",
    confused_with={"current_gain": "a reference shunt", "link_inertia": "a known payload"},
    observed_by={Instrument.CURRENT: Observation(against=Variable.CURRENT)},
    excited_by=Excitation.CURRENT,
    aliases=("current_gain",),
    own_joint=True,
    change=_torque_constant,
)

JOINT_ZERO_OFFSET = Effect(
    name="joint_zero_offset",
    place=Place.GEOMETRY,
    parameters=(
        Parameter(
            "offset",
            "rad",
            (0.002, 0.1),
            True,
            "encoder reading with the link at 0",
            signed=True,
            # a whole turn of a revolute joint; few slides are longer
            most=6.3,
            chain="theta",
            noun="zero offset",
        ),
    ),
    equation="q_read = q + delta",
    shows="gravity out of phase",
    confused_with={"link_inertia": "a tracker or a level", "base_tilt": "a level on the base"},
    observed_by={
        Instrument.CURRENT: Observation(),
        # which of the two encoders is off they cannot say
        Instrument.LINK_ENCODER: Observation(of_arm=False),
        Instrument.TRACKER: Observation(
            shows="the tracked point is rotated by a constant angle about the axis",
            # d_theta is the zero's error with its sign turned
            aliases=("link_geometry",),
        ),
    },
    excited_by=Excitation.GRAVITY,
    change=_zero_offset,
)

CURRENT_LIMIT = Effect(
    name="current_limit",
    place=Place.MECHANICS,
    parameters=(Parameter("limit", "A", (0.5, 20.0), False, "largest current of the drive", noun="current limit"),),
    equation="|i| <= limit",
    shows="current flat while the error grows",
    confused_with={"current_nonlinearity": "whether the motion is clipped too"},
    observed_by={Instrument.RAW: Observation()},
    excited_by=Excitation.CURRENT,
    limit=lambda p, s: p.limit,
)

EFFECTS = (PAYLOAD, LINK_INERTIA, ROTOR_INERTIA, BASE_TILT, TORQUE_CONSTANT, JOINT_ZERO_OFFSET, CURRENT_LIMIT)
