"""What identify says of its parameters is said in parameters of the model file, and of every direction."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from arm_io.plain_data import check_plain
from arm_model import Arm, FrictionCurve, Joint
from arm_model.friction_split import split_arm
from arm_model.rigid_body.regressor import regressor
from identification.friction_band import bands_of
from identification.regression.model_parameters import Friction, column_names, described_columns
from identification.regression.parameter_covariance import _in_model, _shrunk, writable
from identification.regression.uncertainty import FitUncertainty
from tests.arm_model.random_arms import random_arm


def _rubbing(seed: int) -> Arm:
    """Friction that differs by direction at joint 1, a curve at joint 2."""
    arm = random_arm(seed, joints=3)
    curve = FrictionCurve((0.05, 0.2, 0.6, 1.5), (2.0, 1.5, 1.8, 2.5), (2.1, 1.4, 1.9, 2.4))
    first, second, third = arm.joints
    uneven = replace(first, coulomb=(0.3, 0.2))
    return split_arm(replace(arm, effects=(), joints=(uneven, replace(second, friction_curve=curve), third)))


@pytest.mark.parametrize("friction", ["symmetric", "asymmetric"])
@pytest.mark.parametrize("seed", range(4))
def test_a_change_of_a_column_is_the_same_change_of_parameters(seed: int, friction: Friction) -> None:
    arm, rng = _rubbing(seed), np.random.default_rng(seed)
    q, qd, qdd = rng.normal(size=(3, 40, 3))
    # away from reversals, where the sign of a velocity is its own square
    qd = np.sign(qd) * (0.02 + np.abs(qd)) * 1e3 * max(joint.sign_velocity for joint in arm.joints)
    every, names = regressor(arm, q, qd, qdd)
    columns = described_columns(arm, q, qd, qdd, friction)
    size = np.abs(columns).max() + 1.0
    for k, name in enumerate(column_names(arm, friction)):
        found = np.zeros_like(columns[..., 0])
        for parameter, share in _in_model(arm, name).items():
            both = (parameter, f"{parameter}_positive", f"{parameter}_negative")
            found += share * sum(every[..., names.index(one)] for one in both if one in names)
        assert np.abs(found - columns[..., k]).max() < 1e-3 * size, name


def test_few_blocks_still_speak_of_every_direction() -> None:
    """Deviations as stated, full rank, and the blocks' correlations where there are many blocks."""
    rng = np.random.default_rng(0)
    root = rng.normal(size=(12, 3))
    few, information = root @ root.T, np.linalg.inv(np.diag(rng.uniform(0.5, 2.0, 12)))
    std = np.sqrt(np.diag(few))
    one = np.zeros(12)
    for blocks, least in ((4, 0.1), (10_000, 0.0)):
        uncertainty = FitUncertainty(few, std, one, information, 1.0, blocks, (one, one))
        covariance = _shrunk(uncertainty)
        assert np.allclose(np.sqrt(np.diag(covariance)), std)
        over = covariance / np.outer(std, std)
        assert np.linalg.eigvalsh(over)[0] > least
    assert np.allclose(over, few / np.outer(std, std), atol=2e-3)


def test_deviations_beyond_physics_are_written_as_large_as_a_file_may_have_them() -> None:
    std = np.array([1e-3, 2e7, 1e12])
    correlation = np.array([[1.0, 0.5, -0.3], [0.5, 1.0, 0.9], [-0.3, 0.9, 1.0]])
    written = writable(correlation * np.outer(std, std))
    check_plain("model_uncertainty.json", {"covariance": written.tolist()})
    left = np.sqrt(np.diag(written))
    assert left[:2] == pytest.approx(std[:2]) and left[2] > 3e7
    assert written / np.outer(left, left) == pytest.approx(correlation)


@pytest.mark.filterwarnings("error")
def test_information_that_is_indefinite_by_rounding_has_a_covariance() -> None:
    """The random arm 30402: inertias of a micro arm, so different that one eigenvalue was negative by rounding."""
    rng = np.random.default_rng(1)
    columns = rng.normal(size=(200, 5)) @ np.diag(10.0 ** np.array([9, 6, 3, 0, -1]))
    columns[:, 4] = columns[:, 3] * 0.1
    information = columns.T @ columns
    information[4, 4] *= 1.0 - 1e-14
    std, one = 10.0 ** np.array([-9.0, -6.0, -3.0, 0.0, 1.0]), np.zeros(5)
    covariance = _shrunk(FitUncertainty(np.diag(std**2), std, one, information, 1.0, 2, (one, one)))
    assert np.allclose(np.sqrt(np.diag(covariance)), std)
    assert np.linalg.eigvalsh(covariance / np.outer(std, std))[0] > -1e-9


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("first", [0.0, 0.1])
def test_a_friction_curve_from_standstill_has_a_band(first: float) -> None:
    """At its first speed the band is as wide as the friction: a joint has just reversed there."""
    curve = FrictionCurve((first, 0.5, 1.0), (2.0, 2.0, 2.0), (2.0, 2.0, 2.0))
    arm = Arm(name="a", joints=(Joint(friction_curve=curve),))
    qd = np.linspace(0.05, 1.0, 200)[:, None]
    motion = SimpleNamespace(qd=qd, certain=np.ones_like(qd, bool))
    base = SimpleNamespace(names=["joint1.viscous"])
    problem = SimpleNamespace(arm=arm, base=base, columns=[0], motions=[motion], friction="symmetric")
    band, *_ = bands_of(problem, arm, SimpleNamespace(covariance=np.array([[1e-6]])))  # type: ignore[arg-type]
    assert np.isfinite(band.std).all() and 1.0 < band.std[0] < 2.1 and band.std[-1] < 0.1


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("slowest", [0.0, 0.03])
def test_the_band_of_a_straight_line_is_as_wide_as_friction_near_its_lowest_speed_only(slowest: float) -> None:
    """Speeds at equal distances, 0.2 rad/s here: on a logarithmic axis that was a triangle."""
    arm = Arm(name="a", joints=(Joint(coulomb=(2.0, 2.0)),))
    qd = np.r_[np.full(100, slowest), np.linspace(0.05, 2.0, 200)][:, None]
    motion = SimpleNamespace(qd=qd, certain=np.ones_like(qd, bool))
    base = SimpleNamespace(names=["joint1.viscous"])
    problem = SimpleNamespace(arm=arm, base=base, columns=[0], motions=[motion], friction="symmetric")
    (band,) = bands_of(problem, arm, SimpleNamespace(covariance=np.array([[1e-6]])))  # type: ignore[arg-type]
    assert band.std[0] > 1.0
    assert np.interp(np.log(5 * band.speed[0]), np.log(band.speed), band.std) < 0.1
    still = SimpleNamespace(qd=0.0 * qd, certain=motion.certain)
    assert bands_of(SimpleNamespace(**{**vars(problem), "motions": [still]}), arm, SimpleNamespace()) == []  # type: ignore[arg-type]
