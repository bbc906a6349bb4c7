"""Models and conversions.

Identities on random arms, against scipy's rotations and exponentials written independently.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from identification.kinematics.models import conversion, parameterisations
from identification.kinematics.models.chain import Chain, forward, position, position_jacobian, xyz_ypr
from identification.kinematics.models.product_of_exponentials import (
    Exponentials,
    exponential,
    exponentials_of,
    forward_exponentials,
    from_lines,
)

RANDOM = np.random.default_rng(6)


def pose(generator: np.random.Generator) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3] = Rotation.random(random_state=int(generator.integers(1 << 30))).as_matrix()
    out[:3, 3] = generator.normal(size=3)
    return out


def random_hayati(generator: np.random.Generator, joints: int) -> Chain:
    """Random arm with a parallel pair, an intersecting pair and, at times, a prismatic joint."""
    table = generator.normal(size=(joints, 5))
    table[:, 4] = 0.0
    table[1, 3] = generator.normal() * 1e-3
    table[1, 4] = generator.normal() * 1e-3
    table[2, 2] = 0.0
    prismatic = [bool(generator.random() < 0.2) and j not in (0, 1, 2) for j in range(joints)]
    return parameterisations.hayati(table, base=pose(generator), tool=pose(generator), prismatic=prismatic)


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
    chain = parameterisations.denavit_hartenberg(table, base=base, tool=tool, prismatic=[False, False, True, False])
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
def test_every_model_gives_the_same_poses(seed: int) -> None:
    generator = np.random.default_rng(seed)
    joints = int(generator.integers(3, 8))
    chain = random_hayati(generator, joints)
    q = generator.uniform(-np.pi, np.pi, (6, joints))
    expected = forward(chain, q)
    hub = exponentials_of(chain)
    np.testing.assert_allclose(forward_exponentials(hub, q), expected, atol=1e-10)
    for convert, build in (
        (conversion.to_denavit_hartenberg, parameterisations.denavit_hartenberg),
        (conversion.to_hayati, parameterisations.hayati),
        (conversion.to_whitney_lozinski, parameterisations.whitney_lozinski),
        (conversion.to_s_model, parameterisations.s_model),
    ):
        table = convert(hub)
        again = build(table.rows, base=table.base, tool=table.tool, prismatic=table.prismatic)
        # plain D-H on axes 1 mrad from parallel has d of hundreds of metres: digits are lost there, and only there
        atol = 1e-7 if build is parameterisations.denavit_hartenberg else 1e-10
        np.testing.assert_allclose(forward(again, q), expected, atol=atol, err_msg=build.__name__)


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
    chain = parameterisations.hayati(true, base=np.eye(4), tool=tool, prismatic=[False] * 6)
    near = conversion.Table(nominal, np.eye(4), np.eye(4), (False,) * 6)
    table = conversion.to_hayati(exponentials_of(chain), near)
    np.testing.assert_allclose(table.rows[1:], true[1:], atol=1e-9)
    np.testing.assert_allclose(table.rows[0, 2:], true[0, 2:], atol=1e-9)
    np.testing.assert_allclose(table.tool, tool, atol=1e-9)


def test_lines_seen_in_any_configuration_give_the_same_arm() -> None:
    chain = parameterisations.hayati(
        RANDOM.normal(size=(5, 5)), base=pose(RANDOM), tool=pose(RANDOM), prismatic=[False] * 5
    )
    hub = exponentials_of(chain)
    at = RANDOM.normal(size=5)
    from identification.kinematics.models.chain import joint_axes

    direction, point = joint_axes(chain, at)
    again = from_lines(direction, point + 0.3 * direction, forward(chain, at)[0], at)
    np.testing.assert_allclose(again.screws, hub.screws, atol=1e-12)
    np.testing.assert_allclose(again.home, hub.home, atol=1e-12)


def test_wrong_shapes_are_refused() -> None:
    with pytest.raises(ValueError, match=r"\(3, 4\)"):
        parameterisations.denavit_hartenberg(np.zeros((3, 5)), base=np.eye(4), tool=np.eye(4), prismatic=[False] * 3)
    chain = parameterisations.hayati(np.zeros((3, 5)), base=np.eye(4), tool=np.eye(4), prismatic=[False] * 3)
    with pytest.raises(ValueError, match="q needs shape"):
        forward(chain, np.zeros((4, 2)))
    assert isinstance(exponentials_of(chain), Exponentials)
