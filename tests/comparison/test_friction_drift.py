"""Friction that differs by no more than a degree or two of temperature is no change; what differs by more is one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm_model.description import Arm
from arm_model.tables.friction_of_days import UNRECORDED, VISCOUS
from comparison import friction_drift
from comparison.friction_curves import Curve
from comparison.from_recordings import compare_recordings
from comparison.joint_fit import tested
from comparison.joint_fit.hypotheses import Hypothesis
from comparison.joint_fit.joint_regression import JointRegression
from comparison.regression import Structure
from identification.regression.base_parameters import structural_base
from tests.comparison.second_day import LEVELS, puma, record

SHORT: dict[str, Any] = {"seconds": 14.0, "rate": 125.0}


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return puma(root, 2)


def published(speed: np.ndarray, temperature: float) -> np.ndarray:
    """Friction over rad/s of the motor, of a joint that bears no load (Bittencourt, Gunnarsson 2012), normalised."""
    hump = (-2.44e-2 + 1.69e-3 * temperature) * np.exp(-((speed / (-25.0 + temperature)) ** 1.3))
    return 3.04e-2 + hump + (1.29e-4 + 1.31e-3 * np.exp(-temperature / 20.71)) * speed


@pytest.mark.parametrize("temperature", [34.0, 40.0, 46.0])
def test_the_assumed_difference_is_that_of_the_published_law(arm: Arm, temperature: float) -> None:
    """In its size over all speeds; that the hump grows wider, too, is not in it."""
    speeds = np.array([4.0, 40.0, 90.0, 150.0, 220.0])
    curves = [Curve(joint, sign, speeds) for joint in (0, 1) for sign in (1.0, -1.0)]
    structure = Structure(arm, structural_base(arm, "asymmetric"), np.empty(0, np.intp), curves, np.full(2, np.nan))
    values = np.tile(published(speeds, temperature), 4)
    drift = friction_drift.friction_drift(structure, values, np.full(2, np.nan))
    std = np.sqrt(np.sum(drift**2, axis=1))[: len(speeds)]
    true = np.abs(published(speeds, temperature + UNRECORDED) - published(speeds, temperature))
    assert (true < 2.5 * std).all()
    assert np.sqrt(np.mean(true**2)) > 0.3 * np.sqrt(np.mean(std**2))
    # the other joint's friction is its own
    assert not drift[: 2 * len(speeds), 3:].any() and not drift[2 * len(speeds) :, :3].any()


def test_a_recorded_difference_counts_where_it_is_larger(arm: Arm) -> None:
    curves = [Curve(joint, sign, np.array([0.1, 1.0])) for joint in (0, 1) for sign in (1.0, -1.0)]
    structure = Structure(arm, structural_base(arm, "asymmetric"), np.empty(0, np.intp), curves, np.full(2, np.nan))
    values = np.tile([10.0, 12.0], 4)
    some, more = (friction_drift.friction_drift(structure, values, np.array(k)) for k in ([0.2, np.nan], [-6.0, 0.0]))
    np.testing.assert_allclose(more[:, :3], some[:, :3] * 6.0 / UNRECORDED)
    np.testing.assert_allclose(more[:, 3:], some[:, 3:])


@pytest.mark.parametrize("directions", [(1.0, -1.0), (1.0,), (-1.0,)])
def test_a_weight_that_a_joint_bears_is_no_friction(arm: Arm, directions: tuple[float, ...]) -> None:
    """In one direction it adds to the friction, whose speeds are others than those of the other direction."""
    speeds = {1.0: np.array([0.03, 0.06, 0.09, 0.12]), -1.0: np.array([0.02, 0.04, 0.06, 0.08])}
    curves = [Curve(0, sign, speeds[sign]) for sign in directions]
    structure = Structure(arm, structural_base(arm, "asymmetric"), np.empty(0, np.intp), curves, np.full(2, np.nan))
    free, bears = (
        np.concatenate([20.0 + 30.0 * speeds[sign] + sign * weight for sign in directions])
        for weight in (0.0, 18.0 * (len(directions) > 1))
    )
    drift = [friction_drift.friction_drift(structure, values, np.full(2, np.nan)) for values in (free, bears)]
    np.testing.assert_allclose(drift[1], drift[0], atol=1e-12)
    assert np.abs(drift[0][:, 1]).max() == pytest.approx(30.0 * VISCOUS * UNRECORDED * speeds[directions[0]].max())


@pytest.mark.parametrize("per_side", [1, 2])
@pytest.mark.parametrize("share, named", [(1.01, False), (1.15, True)])
def test_between_two_days_only_what_temperature_does_not_explain_is_named(
    arm: Arm, tmp_path: Path, share: float, named: bool, per_side: int
) -> None:
    """The deviations of the recordings alone are a tenth of a per cent."""
    levels = LEVELS[0] * share, LEVELS[1]
    sides = [
        [record(tmp_path / f"{day}{k}.mcap", arm, 10 * day + k, levels=of, **SHORT) for k in range(per_side)]
        for day, of in enumerate((LEVELS, levels))
    ]
    result = compare_recordings(sides[0], sides[1], arm)
    assert {one.quantity.name for one in result.significant if one.quantity.kind == "friction"} == (
        {"joint1.coulomb"} if named else set()
    )
    assert bool(result.significant) == named
    (sentence,) = result.assumptions
    assert sentence.startswith("one recording per side" if per_side == 1 else "recordings of one day")
    assert sentence in str(result) and "Bittencourt" in sentence


def test_deviations_hold_what_differs_between_the_sides() -> None:
    """Rows made by hand, 300 times: a value that differs between the sides by chance, and a column that overlaps it."""
    rng, by, z = np.random.default_rng(5), 0.5, []
    blocks, rows = 40, 6
    block = np.repeat(np.arange(2 * blocks), rows)
    recording = np.repeat([0, 1], blocks)
    for _ in range(300):
        x = rng.normal(size=(len(block), 3))
        x[:, 1] += 0.7 * x[:, 0]
        after = recording[block] == 1
        y = rng.normal(size=len(block)) + after * (x[:, 0] * by * rng.normal())
        drift = by * np.eye(3)[:, :1]
        fit = JointRegression(x, y, block, recording, recording == 1, np.ones(3), drift)
        every = [Hypothesis("friction", 1, one[:, None], str(k)) for k, one in enumerate(np.eye(3))]
        z.append([one.coefficients[0] / np.sqrt(one.covariance[0, 0]) for one in tested.tested(fit, every, [])])
    assert np.std(z, axis=0) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("seed", range(3))
def test_a_cause_is_judged_by_what_the_drift_leaves_of_it(seed: int) -> None:
    """Another scale changes friction, which drifts, by ten times as much as a mass, which does not."""
    rng = np.random.default_rng(seed)
    block, recording = np.repeat(np.arange(80), 30), np.repeat([0, 1], 40)
    x, after = rng.normal(size=(len(block), 2)), recording[block] == 1
    made = np.array([10.0, 1.0])
    y = rng.normal(size=len(block)) + after * (x @ (0.5 * made) + x[:, 0] * 10.0 * rng.normal())
    drift = 10.0 * np.eye(2)[:, :1]
    fit = JointRegression(x, y, block, recording, recording == 1, np.ones(2), drift)
    (one,) = tested.tested(fit, [Hypothesis("scale", 1, made[:, None], "scale")], [])
    std = float(np.sqrt(one.covariance[0, 0]))
    assert one.coefficients[0] == pytest.approx(0.5, abs=3 * std) and std < 0.06
