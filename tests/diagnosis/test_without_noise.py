"""Recordings without noise, as a simulator writes them: what sampled rows do not resolve is no cause."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import armscope
from arm_model import Arm
from arm_model.servo import fixed_gains
from daq.recording import Recording


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    """The two joints of the starter project."""
    return armscope.read_model(root / "config/starters/csv/model.toml")


def _recorded(arm: Arm, root: Path, tmp_path: Path, rate: float = 1000.0) -> list[Recording]:
    motions = {name: armscope.read_experiment(root / f"config/starters/csv/{name}.toml") for name in FILES}
    return [armscope.simulate(arm, motions[n], rate=rate).write(tmp_path / f"{n}.mcap") for n in FILES]


FILES = ("fit", "held_out")


@pytest.mark.parametrize("rate", [100.0, 125.0, 1000.0])
def test_nothing_is_wrong_with_an_arm_that_simulates_itself(arm: Arm, root: Path, tmp_path: Path, rate: float) -> None:
    fit, held_out = _recorded(arm, root, tmp_path, rate)
    result = armscope.diagnose(fit, arm, held_out=held_out)
    assert result.verdict == "consistent" and not result.causes


def test_ten_rows_per_setpoint_show_nothing_that_is_not_there(root: Path, tmp_path: Path) -> None:
    scara = armscope.read_model(root / "config/models/scara_driven.toml")
    recordings = []
    for name in FILES:
        motion = armscope.read_experiment(root / f"config/experiments/arms/scara_{name}.toml")
        recordings.append(armscope.simulate(scara, motion, rate=500.0).write(tmp_path / f"{name}.mcap"))
    result = armscope.diagnose(recordings[0], scara, held_out=recordings[1])
    assert result.verdict == "consistent" and not result.causes


@pytest.mark.filterwarnings("error")  # a median of no blocks, below 80 rows/s
@pytest.mark.parametrize(("rate", "seed"), [(100.0, 1), (100.0, 2), (62.5, 2)])
def test_few_rows_per_setpoint_show_nothing_beside_noise_either(
    root: Path, tmp_path: Path, rate: float, seed: int
) -> None:
    """Setpoints of the SCARA come at 50 Hz; noise of 0.5 % is less than what sampling folds."""
    scara, random = armscope.read_model(root / "config/models/scara_driven.toml"), np.random.default_rng(seed)
    recordings = []
    for name in FILES:
        motion = armscope.read_experiment(root / f"config/experiments/arms/scara_{name}.toml")
        shown = armscope.simulate(scara, motion, rate=rate)
        noise = 0.005 * np.sqrt(np.mean(shown.i**2, axis=0)) * random.standard_normal(shown.i.shape)
        noisy = replace(shown, readings=replace(shown.readings, current=shown.i + noise))
        recordings.append(noisy.write(tmp_path / f"{name}.mcap"))
    result = armscope.diagnose(recordings[0], scara, held_out=recordings[1])
    assert result.verdict == "consistent" and not result.causes


CHANGED = {
    "viscous_friction": ({"viscous": (1.2e-3, 1.2e-3)}, "viscous", 0.2e-3 * 100.0**2),
    "torque_constant": ({"torque_constant": 0.097}, "error", -0.03),
    "rotor_inertia": ({"rotor_inertia": 3.3e-5}, "inertia", 0.3e-5 * 100.0**2),
}
"""Other drives of the elbow: what differs, and the effect's parameter and value at the joint, by hand."""


@pytest.mark.parametrize("effect", sorted(CHANGED))
def test_a_drive_that_differs_is_found_where_rows_come_as_often_as_setpoints(
    arm: Arm, root: Path, tmp_path: Path, effect: str
) -> None:
    drive, name, value = CHANGED[effect]
    # the servo was tuned for the model
    real = replace(fixed_gains(arm), joints=(arm.joints[0], replace(arm.joints[1], **drive)))
    fit, held_out = _recorded(real, root, tmp_path, 125.0)
    result = armscope.diagnose(fit, arm, held_out=held_out)
    assert result.verdict == "explained"
    (cause,) = result.causes
    assert (effect, 2) in cause.group
    (found,) = (p for p in cause.parameters if p.name == name)
    assert abs(found.value - value) < 2 * found.std < 0.1 * abs(value)


@pytest.mark.parametrize(
    ("effect", "joint", "name", "value"),
    [
        ("coulomb_friction", 1, "coulomb", 1.5),
        ("torque_constant", 2, "error", -0.05),
        ("payload", None, "mass", 0.3),
    ],
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


def test_a_gain_of_a_transducer_is_not_told_from_a_torque_constant(arm: Arm, root: Path, tmp_path: Path) -> None:
    """Both scale the currents that the motion needs, whatever else is wrong."""
    fit, held_out = _recorded(arm.with_effect("current_gain", 2, error=-0.05), root, tmp_path)
    (cause,) = armscope.diagnose(fit, arm, held_out=held_out).causes
    assert set(cause.group) == {("current_gain", 2), ("torque_constant", 2)}
    value = {"current_gain": -0.05, "torque_constant": 1 / 0.95 - 1}[cause.effect]
    assert abs(cause.parameters[0].value - value) < 2 * cause.parameters[0].std < 0.005


def test_friction_that_is_two_percent_larger_is_found(arm: Arm, root: Path, tmp_path: Path) -> None:
    joint = arm.joints[0]
    changed = replace(arm, joints=(replace(joint, coulomb=(1.02 * joint.coulomb[0],) * 2), arm.joints[1]))
    fit, held_out = _recorded(changed, root, tmp_path)
    result = armscope.diagnose(fit, arm, held_out=held_out)
    assert [cause.key for cause in result.causes] == [("coulomb_friction", 1)]


def test_causes_that_small_moves_make_alike_are_told_apart(arm: Arm, root: Path, tmp_path: Path) -> None:
    joint = arm.joints[0]
    stiffer = replace(arm, joints=(replace(joint, coulomb=(1.4 * joint.coulomb[0],) * 2), arm.joints[1]))
    recordings = []
    for name in FILES:
        motion = armscope.read_experiment(root / f"config/starters/csv/{name}.toml")
        segments = [
            one.model_copy(update={side: (0.15 * np.array(getattr(one, side))).tolist() for side in ("sine", "cosine")})
            if hasattr(one, "sine")
            else one
            for one in motion.segment
        ]
        small = motion.model_copy(update={"segment": segments})
        recordings.append(armscope.simulate(stiffer, small, rate=1000.0).write(tmp_path / f"{name}.mcap"))
    result = armscope.diagnose(recordings[0], arm, held_out=recordings[1])
    (cause,) = result.causes
    # the load hardly changes: friction that is in proportion to it has a column of the same shape to 1e-5
    assert cause.group == (("coulomb_friction", 1),)
