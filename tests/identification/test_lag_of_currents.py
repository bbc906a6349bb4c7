"""Currents that are read later than the angles, of an arm that is not ours: found, left out, written, diagnosed."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import armscope
from arm_model import read_model, write_model
from identification.methods import lag_of_currents
from identification.methods.solution import solve
from identification.regression.equations import Equations
from identification.regression.problem import prepare
from tests.diagnosis.numpy_arm import RATE, NumpyArm, model, straight

FRICTION = ((straight(9.0, 8.0),) * 2, (straight(6.0, 5.0),) * 2)


def a_row_late(current: np.ndarray) -> np.ndarray:
    return np.concatenate([current[:1], current[:-1]])


def first_joint_late(current: np.ndarray) -> np.ndarray:
    return np.column_stack([a_row_late(current)[:, 0], current[:, 1]])


def identified(folder: Path, arm: NumpyArm, held_out: float = 16.0) -> armscope.Identification:
    for seed, seconds in ((1, 16.0), (2, held_out)):
        arm.record(folder / f"{seed}.mcap", seed, seconds=seconds)
    write_model(folder / "model.toml", model([(8.0, 8.0), (5.0, 5.0)], [7.0, 4.0]))
    return armscope.identify(folder / "1.mcap", folder / "model.toml", held_out=folder / "2.mcap")


def test_a_lag_of_all_currents_is_found_and_written(tmp_path: Path) -> None:
    result = identified(tmp_path, NumpyArm(FRICTION, current=a_row_late))
    lag = result.extra["lag_of_currents"]
    assert abs(lag["delay"] - 1 / RATE) < 3 * lag["std"] < 0.5 / RATE
    assert lag["stays"] and lag["after"] < lag["before"]
    assert "currents are read 2" in str(result) and "in the model as time_skew" in str(result)
    viscous = {value.name: value for value in result.parameters}["joint1.viscous"]
    assert viscous.std is not None and abs(viscous.value - 8.0) < 3 * viscous.std + 0.02
    result.write(tmp_path / "out")
    assert [term.name for term in read_model(tmp_path / "out/model.toml").effects] == ["time_skew"]
    table = json.loads((tmp_path / "out/identification.json").read_text())
    assert table["lag_of_currents"]["delay"] == lag["delay"]
    assert table["chosen_on_held_out"] == ["lag of the currents"]
    said = "were chosen by their error on the held-out recordings: lag of the currents."
    assert said in str(result) and said in (tmp_path / "out/report.html").read_text()
    assert "motions that were not fitted" not in str(result)


def test_few_held_out_seconds_are_confirmed_by_all_others(tmp_path: Path) -> None:
    """Five blocks that all gain are chance once in 32 times."""
    lag = identified(tmp_path, NumpyArm(FRICTION, current=a_row_late), held_out=5.0).extra["lag_of_currents"]
    assert lag["stays"] and abs(lag["delay"] - 1 / RATE) < 3 * lag["std"]


def test_a_lag_that_held_out_rows_do_not_confirm_is_in_the_deviations(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lag_of_currents, "BY_CHANCE", 0.0)
    result = identified(tmp_path, NumpyArm(FRICTION, current=a_row_late))
    assert (
        "after the angles: not in the model, the standard deviations allow for it" in str(result)
        and result.arm.effects == ()
    )
    values = {value.name: value for value in result.parameters}
    for name, truth in (("joint1.viscous", 8.0), ("joint2.viscous", 5.0), ("joint1.coulomb", 9.0)):
        value, std = values[name].value, values[name].std
        assert std is not None and abs(value - truth) < 2 * std


def test_a_doubt_adds_what_the_error_would_change(tmp_path: Path) -> None:
    """The covariance grows by d d^T, d the change of the fit where the torques are off by the error."""
    run = NumpyArm(FRICTION).record(tmp_path / "1.mcap", 1, seconds=10.0)
    problem = prepare([run], model([(8.0, 8.0), (5.0, 5.0)], [7.0, 4.0]))
    error = 0.3 * np.sin(problem.rows.t)
    doubted = solve(problem.doubting(error), "ols", lambda _: None)
    plain = solve(problem, "ols", lambda _: None)
    off = replace(problem, rows=replace(problem.rows, torque=problem.rows.torque + error))
    d = solve(off, "ols", lambda _: None).best.values - plain.best.values
    np.testing.assert_array_equal(doubted.best.values, plain.best.values)
    np.testing.assert_allclose(doubted.uncertainty.covariance - plain.uncertainty.covariance, np.outer(d, d), atol=1e-9)
    inverse = np.linalg.inv(np.linalg.inv(plain.uncertainty.information) + np.outer(d, d))
    np.testing.assert_allclose(doubted.uncertainty.information, inverse, rtol=1e-5, atol=1e-3 * np.abs(inverse).max())


@pytest.mark.parametrize("current", [lambda current: current, first_joint_late])
def test_a_lag_of_no_or_of_one_joint_is_left_out(tmp_path: Path, current: object) -> None:
    result = identified(tmp_path, NumpyArm(FRICTION, current=current))  # type: ignore[arg-type]
    assert "lag_of_currents" not in result.extra and result.arm.effects == ()


def test_currents_that_belong_to_no_motion_have_no_lag() -> None:
    """Angles in degrees taken for radians: the first-order column asks for minutes, and no row would be left."""
    std = np.full(3, 1e-4)
    assert lag_of_currents._alike(np.array([2.0e-3, 2.1e-3, 1.9e-3]), std) is not None
    assert lag_of_currents._alike(np.array([-800.0, -799.0, -801.0]), 1e3 * std) is None


def test_a_joint_with_held_out_rows_in_one_fit_alone_is_not_judged(monkeypatch: pytest.MonkeyPatch) -> None:
    def left(joints: int, size: float) -> tuple[Equations, np.ndarray]:
        """Rows of so many joints over 20 s; joint 3 leaves 1000 N m."""
        joint, t = (one.ravel() for one in np.meshgrid(np.arange(joints), np.arange(0.0, 20.0, 0.1)))
        level = np.where(joint == 2, 1e3, size) * (-1.0) ** np.arange(len(t))
        return Equations(np.empty((len(t), 0)), level, joint, np.zeros(len(t), int), t, ()), level

    monkeypatch.setattr(lag_of_currents, "held_out_residual", lambda one: one)
    for before, after in ((3, 2), (2, 3)):
        lag = lag_of_currents.judged((1e-3, 1e-5), left(before, 1.1), left(after, 1.0))  # type: ignore[arg-type]
        assert (lag.before, lag.after, lag.stays) == (pytest.approx(1.1), pytest.approx(1.0), True)


@pytest.mark.slow
def test_what_changed_later_is_named_alone(tmp_path: Path) -> None:
    result = identified(tmp_path, NumpyArm(FRICTION, current=a_row_late))
    worn = NumpyArm((FRICTION[0], (straight(7.5, 5.0),) * 2), current=a_row_late)
    fit, held_out = (worn.record(tmp_path / f"worn{seed}.mcap", seed, seconds=16.0) for seed in (5, 6))
    found = armscope.diagnose(fit, result.arm, held_out=held_out)
    assert [(cause.effect, cause.joint) for cause in found.causes] == [("coulomb_friction", 2)]
    healthy = NumpyArm(FRICTION, current=a_row_late)
    fit, held_out = (healthy.record(tmp_path / f"well{seed}.mcap", seed, seconds=16.0) for seed in (7, 8))
    assert armscope.diagnose(fit, result.arm, held_out=held_out).verdict == "consistent"
