"""Chains, their derivatives, and Hayati's parameters from a product of exponentials.

Identities on random arms, against scipy's rotations and exponentials written independently.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from identification.kinematics.models.chain import (
    Chain,
    Step,
    forward,
    placement,
    position,
    position_jacobian,
    xyz_ypr,
)
from identification.kinematics.models.hayati import Table, to_hayati
from identification.kinematics.models.product_of_exponentials import Exponentials, exponential, exponentials_of

RANDOM = np.random.default_rng(6)


def pose(generator: np.random.Generator) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3] = Rotation.random(random_state=int(generator.integers(1 << 30))).as_matrix()
    out[:3, 3] = generator.normal(size=3)
    return out


def hayati(table: np.ndarray, base: np.ndarray, tool: np.ndarray, prismatic: tuple[bool, ...]) -> Chain:
    """Chain of links Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta); table (joints, 5)."""
    steps = []
    for j, (theta, d, a, alpha, beta) in enumerate(table.tolist()):
        turning, sliding = (None, j) if prismatic[j] else (j, None)
        steps += [
            Step("rz", theta, f"joint{j + 1}.theta", turning),
            Step("tz", d, f"joint{j + 1}.d", sliding),
            Step("tx", a, f"joint{j + 1}.a"),
            Step("rx", alpha, f"joint{j + 1}.alpha"),
            Step("ry", beta, f"joint{j + 1}.beta"),
        ]
    return Chain((*placement("base", base), *steps, *placement("tool", tool)))


def random_hayati(generator: np.random.Generator, joints: int) -> Chain:
    """Random arm with a parallel pair, an intersecting pair and, at times, a prismatic joint."""
    table = generator.normal(size=(joints, 5))
    table[:, 4] = 0.0
    table[1, 3] = generator.normal() * 1e-3
    table[1, 4] = generator.normal() * 1e-3
    table[2, 2] = 0.0
    prismatic = tuple(bool(generator.random() < 0.2) and j not in (0, 1, 2) for j in range(joints))
    return hayati(table, pose(generator), pose(generator), prismatic)


def homogeneous(sequence: str, angle: float, shift: tuple[float, float, float] = (0, 0, 0)) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3] = Rotation.from_euler(sequence, angle).as_matrix()
    out[:3, 3] = shift
    return out


def test_denavit_hartenberg_is_the_textbook_product() -> None:
    table, base, tool = RANDOM.normal(size=(4, 4)), pose(RANDOM), pose(RANDOM)
    q = RANDOM.normal(size=4)
    expected = base
    for j, (theta, d, a, alpha) in enumerate(table):
        turn, slide = (theta, d + q[j]) if j == 2 else (theta + q[j], d)
        expected = expected @ homogeneous("z", turn, (0, 0, slide)) @ homogeneous("x", alpha, (a, 0, 0))
    chain = hayati(np.column_stack((table, np.zeros(4))), base, tool, (False, False, True, False))
    np.testing.assert_allclose(forward(chain, q)[0], expected @ tool, atol=1e-12)


@pytest.mark.parametrize("joints", [3, 6, 7])
def test_position_jacobian_is_the_derivative(joints: int) -> None:
    chain = random_hayati(RANDOM, joints)
    q = RANDOM.normal(size=(5, joints))
    values = chain.values
    at, jacobian = position_jacobian(chain, q)
    np.testing.assert_allclose(at, forward(chain, q)[:, :3, 3], atol=1e-12)
    for k in range(len(values)):
        step = np.zeros(len(values))
        step[k] = 1e-6
        slope = (position(chain.at(values + step), q) - position(chain.at(values - step), q)) / 2e-6
        np.testing.assert_allclose(jacobian[:, :, k], slope, atol=1e-7)


def test_pose_as_six_numbers_and_back() -> None:
    for _ in range(20):
        wanted = pose(RANDOM)
        x, y, z, yaw, pitch, roll = xyz_ypr(wanted)
        np.testing.assert_allclose(
            Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_matrix(), wanted[:3, :3], atol=1e-12
        )
        np.testing.assert_allclose([x, y, z], wanted[:3, 3])


def test_exponential_is_the_matrix_exponential() -> None:
    direction = RANDOM.normal(size=3)
    direction /= np.linalg.norm(direction)
    for w, v in ((direction, -np.cross(direction, RANDOM.normal(size=3))), (np.zeros(3), direction)):
        matrix = np.zeros((4, 4))
        matrix[:3, :3] = np.cross(np.eye(3), w)
        matrix[:3, 3] = v
        np.testing.assert_allclose(exponential(np.r_[w, v], 0.7), expm(0.7 * matrix), atol=1e-12)


@pytest.mark.parametrize("seed", range(25))
def test_exponentials_and_hayatis_parameters_give_the_same_poses(seed: int) -> None:
    generator = np.random.default_rng(seed)
    joints = int(generator.integers(3, 8))
    chain = random_hayati(generator, joints)
    q = generator.uniform(-np.pi, np.pi, (6, joints))
    hub = exponentials_of(chain)
    poses = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    for screw, angle in zip(hub.screws, q.T):
        poses = poses @ exponential(screw, angle)
    np.testing.assert_allclose(poses @ hub.home, forward(chain, q), atol=1e-10)
    table = to_hayati(hub)
    again = hayati(table.rows, table.base, table.tool, table.prismatic)
    np.testing.assert_allclose(forward(again, q), forward(chain, q), atol=1e-10)


@pytest.mark.parametrize("seed", range(10))
def test_hayati_near_the_nominal_comes_back_as_it_was(seed: int) -> None:
    """Parameters, not only poses, survive the way through the exponentials when the nominal chooses the branches."""
    generator = np.random.default_rng(seed)
    nominal = np.array(
        [
            [0, 0.67, 0, np.pi / 2, 0],
            [0, 0, 0.43, 0, 0],
            [0, 0.15, 0.02, -np.pi / 2, 0],
            [0, 0.43, 0, np.pi / 2, 0],
            [0, 0, 0, -np.pi / 2, 0],
            [0, 0, 0, 0, 0],
        ]
    )
    true = nominal + generator.normal(size=(6, 5)) * 5e-3
    true[:, 4] = [0, 4e-3, 0, 0, 0, 0]
    true[1, 1] = 0.0  # Hayati: d stays where the next axis is parallel
    true[0, :2] = nominal[0, :2]  # turning and sliding the base along axis 1 is no freedom of its own here
    true[5] = nominal[5]
    tool = pose(generator)
    chain = hayati(true, np.eye(4), tool, (False,) * 6)
    near = Table(nominal, np.eye(4), np.eye(4), (False,) * 6)
    table = to_hayati(exponentials_of(chain), near)
    np.testing.assert_allclose(table.rows[1:], true[1:], atol=1e-9)
    np.testing.assert_allclose(table.rows[0, 2:], true[0, 2:], atol=1e-9)
    np.testing.assert_allclose(table.tool, tool, atol=1e-9)


def test_wrong_shapes_are_refused() -> None:
    chain = hayati(np.zeros((3, 5)), np.eye(4), np.eye(4), (False,) * 3)
    with pytest.raises(ValueError, match="q needs shape"):
        forward(chain, np.zeros((4, 2)))
    assert isinstance(exponentials_of(chain), Exponentials)
