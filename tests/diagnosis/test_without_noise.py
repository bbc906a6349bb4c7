"""Recordings without noise, as a simulator writes them: what sampled rows do not resolve is no cause."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import armscope
from arm_model import Arm
from daq.recording import Recording


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    """The two joints of the starter project."""
    return armscope.read_model(root / "config/starters/csv/model.toml")


def _recorded(arm: Arm, root: Path, tmp_path: Path) -> list[Recording]:
    motions = {name: armscope.read_experiment(root / f"config/starters/csv/{name}.toml") for name in FILES}
    return [armscope.simulate(arm, motions[n], rate=1000.0).write(tmp_path / f"{n}.mcap") for n in FILES]


FILES = ("fit", "held_out")


def test_nothing_is_wrong_with_an_arm_that_simulates_itself(arm: Arm, root: Path, tmp_path: Path) -> None:
    fit, held_out = _recorded(arm, root, tmp_path)
    result = armscope.diagnose(fit, arm, held_out=held_out)
    assert result.verdict == "consistent" and not result.causes


@pytest.mark.parametrize(
    ("effect", "joint", "name", "value"),
    [("coulomb_friction", 1, "coulomb", 1.5), ("current_gain", 2, "error", -0.05), ("payload", None, "mass", 0.3)],
)
def test_one_effect_is_found_alone_and_of_its_size(
    arm: Arm, root: Path, tmp_path: Path, effect: str, joint: int | None, name: str, value: float
) -> None:
    others = {"x": 0.0, "y": 0.05, "z": 0.0} if effect == "payload" else {}
    fit, held_out = _recorded(arm.with_effect(effect, joint, **{name: value}, **others), root, tmp_path)
    result = armscope.diagnose(fit, arm, held_out=held_out)
    assert result.verdict == "explained"
    (cause,) = result.causes
    assert (cause.effect, cause.joint) == (effect, joint)
    (found,) = (p for p in cause.parameters if p.name == name)
    assert abs(found.value - value) < 2 * found.std < 0.1 * abs(value)


def test_friction_that_is_two_percent_larger_is_found(arm: Arm, root: Path, tmp_path: Path) -> None:
    joint = arm.joints[0]
    changed = replace(arm, joints=(replace(joint, coulomb=(1.02 * joint.coulomb[0],) * 2), arm.joints[1]))
    fit, held_out = _recorded(changed, root, tmp_path)
    result = armscope.diagnose(fit, arm, held_out=held_out)
    assert [cause.key for cause in result.causes] == [("coulomb_friction", 1)]
