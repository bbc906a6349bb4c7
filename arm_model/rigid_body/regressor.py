"""The torques of an arm as a linear function of its parameters: Y(q, q', q'') p = tau.

Atkeson, An, Hollerbach, "Estimation of inertial parameters of manipulator loads and links", IJRR 5(3), 1986.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Literal

import numpy as np

from arm_io.types import Array
from arm_model.description import Arm
from arm_model.rigid_body import hydrodynamics, newton_euler, scalar
from arm_model.rigid_body.friction_curve import unit_torques
from arm_model.rigid_body.hydrodynamics import COEFFICIENTS
from arm_model.rigid_body.inertia import PARAMETERS, transform_matrix
from arm_model.rigid_body.link_friction import LINK_FRICTION, unit_link_friction
from arm_model.rigid_body.numeric import in_blocks, link_parameters, samples, stacked, turns
from arm_model.rigid_body.vectors import floats
from arm_model.tables.drive import FrictionCurve

Friction = Literal["asymmetric", "symmetric"]


def parameter_names(arm: Arm, *, friction: Friction = "asymmetric") -> list[str]:
    """Names in the order of the regressor's columns.

    Ten a link, then the drive's of each joint, then what water, friction of links and friction curves there are.
    """
    directions = ("_positive", "_negative") if friction == "asymmetric" else ("",)
    rubbing = [f"{kind}{direction}" for kind in ("viscous", "coulomb") for direction in directions]
    drive = ("rotor_inertia", *rubbing, "offset")
    links = [f"link{j}.{name}" for j in range(1, len(arm) + 1) for name in PARAMETERS]
    drives = [f"joint{j}.{name}" for j in range(1, len(arm) + 1) for name in drive]
    curves = [
        f"joint{j}.curve{k}{direction}"
        for j, joint in enumerate(arm.joints, 1)
        for direction in directions
        for k in range(1, 1 + len(joint.friction_curve.speed if joint.friction_curve else ()))
    ]
    return links + drives + [name for name, _ in _described_on_links(arm)] + curves


def _described_on_links(arm: Arm) -> Iterator[tuple[str, float]]:
    """Names and values of the water's parameters and of the links' own friction, where the model describes any."""
    for number, joint in enumerate(arm.joints, 1):
        if joint.cylinder is not None:
            yield from ((f"link{number}.{name}", getattr(joint.cylinder, name)) for name in COEFFICIENTS)
    for number, joint in enumerate(arm.joints, 1):
        if joint.drag is not None:
            yield f"joint{number}.drag", joint.drag
    for name in LINK_FRICTION:
        for number, joint in enumerate(arm.joints, 1):
            if (value := getattr(joint, name)) is not None:
                yield f"joint{number}.{name}", value


def parameter_vector(arm: Arm, *, friction: Friction = "asymmetric") -> Array:
    """(p,) the arm's values in that order: barycentric inertial parameters in the link frame about its origin.

    Rotor inertia, viscous, Coulomb and offset at the JOINT side. ``friction`` "symmetric" gives the means of the two
    directions.
    """
    values = [link_parameters(arm).ravel()]
    for joint in arm.joints:
        n = joint.ratio
        rubbing = np.array([np.multiply(joint.viscous, n**2), np.multiply(joint.coulomb, n)])  # kind, direction
        if friction == "symmetric":
            rubbing = rubbing.mean(axis=1, keepdims=True)
        values.append(np.array([n**2 * joint.rotor_inertia, *rubbing.ravel(), n * joint.offset]))
    on_links = [value for _, value in _described_on_links(arm)]
    return np.concatenate([*values, on_links, *(_curve_values(joint.friction_curve, friction) for joint in arm.joints)])


def _curve_values(curve: FrictionCurve | None, friction: Friction) -> Array:
    if curve is None:
        return np.empty(0)
    both = np.array([curve.positive, curve.negative])
    return both.ravel() if friction == "asymmetric" else both.mean(axis=0)


def regressor(
    arm: Arm, q: Array, qd: Array, qdd: Array, *, friction: Friction = "asymmetric"
) -> tuple[Array, list[str]]:
    """(Y (N, n, p), names): Y @ parameter_vector(arm) = inverse_dynamics(arm, q, qd, qdd), whatever the values.

    Of an arm with coupled joints q, qd, qdd are those that the controller reports.

    With ``friction`` "symmetric" one column joint{j}.viscous, one joint{j}.coulomb and one joint{j}.curve{k} stand for
    both directions.
    """
    q, qd, qdd = samples(arm, q, qd, qdd)
    links = [arm.link_angles(each) for each in (q, qd, qdd)]
    blocks = [
        link_regressor(arm, q, qd, qdd),
        *(_drive_columns(arm, j, qd[:, j], qdd[:, j], friction) for j in range(len(arm))),
        _felt_by_drives(arm, np.concatenate([_water_columns(arm, *links), unit_link_friction(arm, links[1])], axis=2)),
        *(curve_columns(arm, j, qd[:, j], friction) for j in range(len(arm))),
    ]
    return np.concatenate(blocks, axis=2), parameter_names(arm, friction=friction)


def link_regressor(arm: Arm, q: Array, qd: Array, qdd: Array) -> Array:
    """(N, n, 10 n): the columns of ``regressor`` of the inertial parameters of the links alone, which come first."""
    links = [arm.link_angles(each) for each in samples(arm, q, qd, qdd)]
    return _felt_by_drives(arm, in_blocks(partial(_link_columns, arm), *links))


def _felt_by_drives(arm: Arm, columns: Array) -> Array:
    """(N, n, p) torques of drives for torques of joints: C^T columns, C the arm's coupling matrix."""
    return np.asarray(arm.coupling_matrix.T @ columns, float) if arm.coupling else columns


def _drive_columns(arm: Arm, j: int, qd: Array, qdd: Array, friction: Friction) -> Array:
    sign = scalar.smooth_sign(qd, arm.joints[j].sign_velocity)
    if friction == "asymmetric":
        rubbing = [np.maximum(qd, 0.0), np.minimum(qd, 0.0), (sign + sign**2) / 2, (sign - sign**2) / 2]
    else:
        rubbing = [qd, sign]
    columns = np.stack([qdd, *rubbing, np.ones_like(qd)], axis=-1)
    block = np.zeros((len(qd), len(arm), columns.shape[-1]))
    block[:, j] = columns
    return block


def curve_columns(arm: Arm, j: int, qd: Array, friction: Friction, *, alone: bool = False) -> Array:
    """(N, n, K or 2 K) torques of unit values of the friction curve of joint j (from 0) at its speeds qd (N,).

    ``alone``: (N, K or 2 K), of joint j itself.
    """
    joint = arm.joints[j]
    if joint.friction_curve is None:
        return np.zeros((len(qd), len(arm), 0))
    sides = unit_torques(joint.friction_curve.speed, qd, scalar.smooth_sign(qd, joint.sign_velocity))
    columns = np.concatenate(sides, axis=1) if friction == "asymmetric" else sides[0] + sides[1]
    if alone:
        return columns
    block = np.zeros((len(qd), len(arm), columns.shape[-1]))
    block[:, j] = columns
    return block


def _water_columns(arm: Arm, q: Array, qd: Array, qdd: Array) -> Array:
    """(N, n, w) torques of unit coefficients of the cylinders, then of unit drag of whole links."""
    chain, columns = newton_euler.chain_of(arm), []
    state = turns(chain, q), list(q.T), list(qd.T), list(qdd.T), arm.gravity
    for j, joint in enumerate(arm.joints):
        if joint.cylinder is not None:
            shape, unit = hydrodynamics.shape_of(chain, j, joint.cylinder), hydrodynamics.unit_water(joint.cylinder)
            for share in np.eye(3) * (unit.resistance, unit.added, unit.displaced):
                water = {j: (shape, hydrodynamics.Water(*map(float, share)))}
                columns.append(stacked(hydrodynamics.torques(chain, water, *state), q.shape[:1]))
    columns += [np.eye(len(arm))[j] * np.abs(qd) * qd for j, joint in enumerate(arm.joints) if joint.drag is not None]
    return np.stack(columns, axis=-1) if columns else np.zeros((*q.shape, 0))


def _link_columns(arm: Arm, q: Array, qd: Array, qdd: Array) -> Array:
    count, n = q.shape
    chain = newton_euler.chain_of(arm)
    # of the parameters in the link frames, as bodies in the joint frames
    units = [[floats(body) for body in transform_matrix(pose).T] for pose in chain.link]
    state = turns(chain, q), list(q.T), list(qd.T), list(qdd.T), arm.gravity
    columns = np.zeros((count, n, 10 * n))
    for j, of_links in enumerate(newton_euler.unit_torques(chain, units, *state)):
        for k, torque in enumerate(one for of_link in of_links for one in of_link):
            columns[:, j, 10 * j + k] = torque
    return columns
