"""Inertial parameters of one rigid body, about its frame's origin (barycentric), and what makes them physical.

The order everywhere is PARAMETERS: mass, first moment (mx, my, mz) = mass com, and the inertia tensor about the ORIGIN
of the frame, ixx, ixy, ixz, iyy, iyz, izz with ixy = -int x y dm (the tensor's own entries, not products of inertia
with the opposite sign). The torques of an arm are linear in them. Units kg, kg m, kg m2.
"""

from __future__ import annotations

import numpy as np

from arm_io.types import Array

PARAMETERS = ("mass", "mx", "my", "mz", "ixx", "ixy", "ixz", "iyy", "iyz", "izz")
ROUNDING = 64 * np.finfo(float).eps
"""Of an inertia about the com, relative to that about the origin, after some changes of frame."""
_UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
_ABOUT_COM = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))
"""xx yy zz xy yz xz, as model files have it."""


def tensor(entries: Array) -> Array:
    """(..., 6) ixx ixy ixz iyy iyz izz -> (..., 3, 3) symmetric."""
    entries = np.asarray(entries, float)
    full = np.empty((*entries.shape[:-1], 3, 3))
    for k, (i, j) in enumerate(_UPPER):
        full[..., i, j] = full[..., j, i] = entries[..., k]
    return full


def second_moments(inertia: Array) -> Array:
    """(..., 3, 3) kg m2: int x x^T dm of inertia tensors (..., 3, 3) about the same point: tr(I) / 2 1 - I."""
    return np.asarray(np.trace(inertia, axis1=-2, axis2=-1)[..., None, None] / 2 * np.eye(3) - inertia)


def pseudo_inertia(parameters: Array) -> Array:
    """(..., 4, 4) [[second moments, h], [h^T, m]] of parameters (..., 10), h the first moment.

    Positive definite for every body (Wensing, Kim, Slotine, IEEE RA-L 3(1), 2018).
    """
    parameters = np.asarray(parameters, float)
    matrix = np.empty((*parameters.shape[:-1], 4, 4))
    matrix[..., :3, :3] = second_moments(tensor(parameters[..., 4:]))
    matrix[..., :3, 3] = matrix[..., 3, :3] = parameters[..., 1:4]
    matrix[..., 3, 3] = parameters[..., 0]
    return matrix


def _pack(mass: Array, moment: Array, about_origin: Array) -> Array:
    return np.concatenate(
        [mass[..., None], moment, np.stack([about_origin[..., i, j] for i, j in _UPPER], axis=-1)], axis=-1
    )


def _parallel_axis(vector: Array) -> Array:
    """(..., 3) c -> (c.c) 1 - c c^T, so that I_origin = I_com + mass times it."""
    square = np.einsum("...i,...i", vector, vector)
    return square[..., None, None] * np.eye(3) - vector[..., :, None] * vector[..., None, :]


def barycentric(mass: float, com: tuple[float, ...], inertia: tuple[float, ...]) -> Array:
    """(10,) from mass, com (3,) and inertia about the com (xx, yy, zz, xy, yz, xz)."""
    c = np.array(com, float)
    about_com = np.zeros((3, 3))
    for value, (i, j) in zip(inertia, _ABOUT_COM):
        about_com[i, j] = about_com[j, i] = value
    return _pack(np.array(float(mass)), mass * c, about_com + mass * _parallel_axis(c))


def about_com(parameters: Array) -> tuple[float, tuple[float, float, float], tuple[float, ...]]:
    """mass, com, inertia about the com (xx, yy, zz, xy, yz, xz) from (10,).

    The com of a massless body is its origin. Entries that are rounding errors of the terms they come from are 0: a mass
    point far from the origin has no inertia, and no negative one.
    """
    mass, moment = float(parameters[0]), parameters[1:4]
    com = moment / mass if mass != 0.0 else np.zeros(3)
    about_origin, carried = tensor(parameters[4:]), mass * _parallel_axis(com)
    centred = about_origin - carried
    centred[np.abs(centred) < ROUNDING * max(np.abs(about_origin).max(), np.abs(carried).max())] = 0.0
    x, y, z = (float(value) for value in com)
    return mass, (x, y, z), tuple(float(centred[i, j]) for i, j in _ABOUT_COM)


def transform(parameters: Array, pose: Array) -> Array:
    """(..., 10) in frame B -> the same body's in frame A, with ``pose`` (4, 4) of B in A."""
    parameters = np.asarray(parameters, float)
    rotation, shift = pose[:3, :3], pose[:3, 3]
    mass, moment = parameters[..., 0], parameters[..., 1:4] @ rotation.T
    inertia = rotation @ tensor(parameters[..., 4:]) @ rotation.T
    # I' = I + 2 (m.p) 1 - m p^T - p m^T + mass ((p.p) 1 - p p^T): also right for a massless first moment
    cross = np.einsum("...i,i", moment, shift)[..., None, None] * 2 * np.eye(3)
    cross = cross - moment[..., :, None] * shift - shift[:, None] * moment[..., None, :]
    inertia = inertia + cross + mass[..., None, None] * _parallel_axis(shift)
    return _pack(mass, moment + mass[..., None] * shift, inertia)


def transform_matrix(pose: Array) -> Array:
    """(10, 10) T with T @ parameters_B = transform(parameters_B, pose)."""
    return transform(np.eye(10), pose).T


PRINTED = 1e-6
"""Relative error of an inertia as files print it."""
LEAST_TRACE = 1e-9
"""kg m2: of a ball of 1 g and 1 mm radius. Below a millionth of it is what rounding leaves of a point mass."""


def unphysical(mass: float, inertia: tuple[float, ...], rounding: float = 0.0) -> str | None:
    """What is impossible about mass and inertia about the com (xx, yy, zz, xy, yz, xz), or None.

    A body is possible where its second moments int x x^T dm about the com, trace(I) / 2 - I, are positive semidefinite:
    the same as a positive pseudo-inertia and as principal inertias that obey the triangle inequality (Wensing, Kim,
    Slotine, RA-L 2018). ``PRINTED`` is relative to the trace, but to no less than LEAST_TRACE.
    rounding: kg m2, by which each entry may be off for the digits that a file has.
    """
    matrix = np.zeros((3, 3))
    for value, (i, j) in zip(inertia, _ABOUT_COM):
        matrix[i, j] = matrix[j, i] = value
    if mass < 0:
        return f"mass {mass:g} kg is negative"
    principal = np.linalg.eigvalsh(matrix)
    # three principal inertias may be off
    slack = PRINTED * max(abs(np.trace(matrix)), LEAST_TRACE) + 3 * rounding
    shown = ", ".join(f"{value:.4g}" for value in principal)
    if principal[0] < -slack:
        return f"inertia is not positive: principal inertias {shown} kg m2"
    if principal[2] > principal[0] + principal[1] + slack:
        return (
            f"inertia breaks the triangle inequality: of the principal inertias {shown} kg m2 the largest exceeds "
            f"the sum of the others by {principal[2] - principal[0] - principal[1]:.2g}; it must not exceed it"
        )
    if mass == 0.0 and principal[2] > slack:
        return "inertia without mass: give the link a mass"
    return None
