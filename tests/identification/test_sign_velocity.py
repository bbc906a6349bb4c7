"""Friction that changes its sign more sharply than a model has it: Coulomb and viscous friction are right."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

import armscope
from arm_model import read_model, write_model
from identification.methods.sign_velocity import with_sign_velocities
from identification.methods.solution import fitted_arm, solve
from identification.regression.problem import prepare
from tests.diagnosis.numpy_arm import REST, Friction, NumpyArm, model, straight

DEFAULT = 0.01
"""rad/s: of a model that says nothing of it."""
LEVELS, SLOPES = (9.0, 5.25), (8.0, 5.0)
FRICTION = ((straight(9.0, 8.0),) * 2, (straight(6.0, 5.0), straight(4.5, 5.0)))


def identified(folder: Path, arm: NumpyArm) -> armscope.Identification:
    start = model([(8.0, 8.0), (5.0, 5.0)], [7.0, 4.0])
    joints = tuple(replace(joint, sign_velocity=DEFAULT) for joint in start.joints)
    write_model(folder / "model.toml", replace(start, joints=joints))
    for seed in (1, 2):
        arm.record(folder / f"{seed}.mcap", seed, seconds=16.0)
    return armscope.identify(folder / "1.mcap", folder / "model.toml", held_out=folder / "2.mcap")


def as_the_model_has_it(level: float, slope: float) -> Friction:
    """Friction whose sign is v / sqrt(v^2 + w^2) with the model's w."""

    def rub(v: np.ndarray) -> np.ndarray:
        v = np.maximum(v, 1e-9)
        return np.asarray((slope * v + level * v / np.hypot(v, DEFAULT)) / np.tanh(v / REST))

    return rub


def test_coulomb_and_viscous_friction_do_not_make_up_for_a_blunt_sign(tmp_path: Path) -> None:
    """Friction turns within 4 mrad/s; with the model's 10 both are off by 2 deviations, which are 13 times these."""
    result = identified(tmp_path, NumpyArm(FRICTION))
    value = {one.name: one for one in result.parameters}
    for j, (level, slope) in enumerate(zip(LEVELS, SLOPES, strict=True), 1):
        coulomb, viscous = value[f"joint{j}.coulomb"], value[f"joint{j}.viscous"]
        assert coulomb.std is not None and viscous.std is not None
        assert abs(coulomb.value - level) < 3 * coulomb.std < 0.004 * level
        assert abs(viscous.value - slope) < 3 * viscous.std < 0.004 * slope
    assert [one["stays"] for one in result.extra["sign_velocities"]] == [True, True]
    assert "friction of joint 1 changes its sign over 2 mrad/s, 10 in the model" in str(result)
    assert "sign velocity of joint 2" in result.chosen_on_held_out
    result.write(tmp_path / "out")
    assert [joint.sign_velocity for joint in read_model(tmp_path / "out/model.toml").joints] == [0.002, 0.002]
    # what is written is what was printed
    (again,) = armscope.predict(tmp_path / "2.mcap", tmp_path / "out/model.toml")
    assert again.relative_error == pytest.approx(result.relative_error(True), rel=1e-6)


ALIKE = [{"stays": False, "found": 4e-3, "model": 1e-2, "before": 0.1, "after": 0.1}]


def test_a_sign_that_is_as_the_model_has_it_stays(tmp_path: Path) -> None:
    result = identified(
        tmp_path, NumpyArm(((as_the_model_has_it(9.0, 8.0),) * 2, (as_the_model_has_it(5.0, 5.0),) * 2))
    )
    tried = result.extra["sign_velocities"]
    assert not any(one["stays"] for one in tried)
    two = replace(
        result, extra={**result.extra, "sign_velocities": [one | {"joint": k} for k in (1, 2) for one in ALIKE]}
    )
    assert str(two).count("may change its sign") == 1 and "friction of joints 1, 2 may change its sign more" in str(two)
    assert [joint.sign_velocity for joint in result.arm.joints] == [DEFAULT, DEFAULT]


@pytest.mark.parametrize("friction", ["symmetric", "asymmetric"])
def test_equations_are_those_of_the_sharper_arm(tmp_path: Path, friction: Literal["symmetric", "asymmetric"]) -> None:
    run = NumpyArm(FRICTION).record(tmp_path / "1.mcap", 1, seconds=10.0)
    held = NumpyArm(FRICTION).record(tmp_path / "2.mcap", 2, seconds=10.0)
    arm = model([(8.0, 8.0), (5.0, 5.0)], [7.0, 4.0])
    sharper = replace(arm, joints=(arm.joints[0], replace(arm.joints[1], sign_velocity=0.001)))
    found = with_sign_velocities(prepare([run], arm, held_out=[held], friction=friction), {1: 0.001})
    wanted = prepare([run], sharper, held_out=[held], friction=friction)
    assert found.arm == wanted.arm
    assert found.held is not None and wanted.held is not None
    for ours, theirs in ((found.rows, wanted.rows), (found.judged, wanted.judged), (found.held, wanted.held)):
        np.testing.assert_allclose(ours.columns, theirs.columns, atol=1e-9)


def test_an_error_that_is_allowed_for_is_no_reason_to_predict_the_rows_worse(tmp_path: Path) -> None:
    """A body that the data do not quite allow must not be bought with friction that no recording shows."""
    run = NumpyArm(FRICTION).record(tmp_path / "1.mcap", 1, seconds=10.0)
    arm = model([(8.0, 8.0), (5.0, 5.0)], [7.0, 4.0])
    problem = prepare([run], arm)
    rows = problem.rows
    level = np.where(rows.joint == 1, rows.columns[:, rows.names.index("joint2.coulomb")], 0.0)
    plain, doubted = (solve(one, "ols", lambda _: None) for one in (problem, problem.doubting(50.0 * level)))
    np.testing.assert_allclose(doubted.best.values, plain.best.values)
    assert doubted.uncertainty.std.max() > 10 * plain.uncertainty.std.max()
    assert fitted_arm(doubted) == fitted_arm(plain)
