"""Currents that are read later than the angles, of an arm that is not ours: found, left out, written, diagnosed."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import armscope
from arm_model import read_model, write_model
from identification.methods import lag_of_currents
from identification.regression.equations import Equations
from tests.diagnosis.numpy_arm import RATE, NumpyArm, model, straight

FRICTION = ((straight(9.0, 8.0),) * 2, (straight(6.0, 5.0),) * 2)


def a_row_late(current: np.ndarray) -> np.ndarray:
    return np.concatenate([current[:1], current[:-1]])


def first_joint_late(current: np.ndarray) -> np.ndarray:
    return np.column_stack([a_row_late(current)[:, 0], current[:, 1]])


def identified(folder: Path, arm: NumpyArm) -> armscope.Identification:
    for seed in (1, 2):
        arm.record(folder / f"{seed}.mcap", seed, seconds=16.0)
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


@pytest.mark.parametrize("current", [lambda current: current, first_joint_late])
def test_a_lag_of_no_or_of_one_joint_is_left_out(tmp_path: Path, current: object) -> None:
    result = identified(tmp_path, NumpyArm(FRICTION, current=current))  # type: ignore[arg-type]
    assert "lag_of_currents" not in result.extra and result.arm.effects == ()


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
