"""What a chain predicts of tracked points, less what was measured: positions, and orientations of 6-D targets."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from arm_io.types import Array
from identification.kinematics.data.points import Points
from identification.kinematics.models.chain import Chain, pose_jacobian, position, position_jacobian


def residual_of(chain: Chain, points: Points, extension: Array | None = None) -> Array:
    """Measured minus predicted (N, 3) m; of an orientation the rotation vector between them, times its lever.

    extension (extensions,): parameters of the points' deflections; None: zero.
    """
    q = points.q if extension is None else points.bent(extension)
    oriented = points.oriented
    if not oriented.any():
        return points.xyz - position(chain, q, points.target)
    residual = np.empty_like(points.xyz)
    placed = points.where(~oriented)
    residual[~oriented] = placed.xyz - position(chain, q[~oriented], placed.target)
    turned = points.where(oriented)
    residual[oriented] = _turned_off(turned, pose_jacobian(chain, q[oriented], turned.target)[0])
    return residual


def linear_in(chain: Chain, points: Points, extension: Array | None = None) -> tuple[Array, Array]:
    """``residual_of``, and the derivative (N, 3, steps) of the prediction with respect to every value of the chain.

    That of an orientation is its first order for small residuals.
    """
    q = points.q if extension is None else points.bent(extension)
    oriented = points.oriented
    if not oriented.any():
        at, derivative = position_jacobian(chain, q, points.target)
        return points.xyz - at, derivative
    residual, derivative = np.empty_like(points.xyz), np.empty((len(points), 3, len(chain.steps)))
    placed, turned = points.where(~oriented), points.where(oriented)
    at, derivative[~oriented] = position_jacobian(chain, q[~oriented], placed.target)
    residual[~oriented] = placed.xyz - at
    rotation, turns = pose_jacobian(chain, q[oriented], turned.target)
    residual[oriented] = _turned_off(turned, rotation)
    derivative[oriented] = turns * _lever(turned)[:, None, None]
    return residual, derivative


def _lever(points: Points) -> Array:
    assert points.lever is not None
    return points.lever


def _turned_off(points: Points, rotation: Array) -> Array:
    """(N, 3) m: rotation vectors in the world from predicted to measured orientations, times their levers."""
    off = Rotation.from_rotvec(points.xyz) * Rotation.from_matrix(rotation).inv()
    return np.asarray(off.as_rotvec() * _lever(points)[:, None], float)
