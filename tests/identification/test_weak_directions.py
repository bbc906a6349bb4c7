"""A spring that is nearly aliased with gravity while its joint hardly moves.

The fit must not be worse elsewhere than the model it came from.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_model.description import Arm, EffectTerm
from arm_model.model_file import read_model
from arm_model.system.dynamics import inverse_dynamics
from daq.recording import Recording, open_recording
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table
from identification.conclusion.conclude import UNCONSTRAINED
from identification.identify import identify_by
from tests.arm_model.pumas import three_links
from tests.identification.test_effects import RATE, motor_motion

STIFFNESS, GUESS, REST = 25.0, 24.0, 0.4  # N m/rad at joint 2, slack at 0.4 rad
MIDDLE = np.array([0.0, -0.5, 0.6])


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return replace(three_links(read_model(root / "config/models/puma560.toml")), controller=None)


def recorded(arm: Arm, path: Path, seed: int, share: float) -> tuple[Recording, float]:
    """Joints 2 and 3 at a share of their travel; and the relative error of a model that has GUESS for the spring."""
    t = np.arange(int(RATE * 20)) / RATE
    scale = np.array([1.0, share, share])
    q, qd, qdd = motor_motion(t, seed)
    q, qd, qdd = MIDDLE + scale * (q - MIDDLE), scale * qd, scale * qdd
    torque = inverse_dynamics(arm, q, qd, qdd)
    torque[:, 1] += STIFFNESS * (q[:, 1] - REST)
    wrong = np.linalg.norm((STIFFNESS - GUESS) * (q[:, 1] - REST)) / np.linalg.norm(torque)
    current = torque / arm.joint_array("drive_constant")
    current += 0.03 * np.random.default_rng(seed).standard_normal(current.shape)
    write_table(path, t, {"q": np.round(q / 1e-5) * 1e-5, "i": current}, Attachments())
    return open_recording(path), float(wrong)


@pytest.mark.parametrize("share", [0.03, 0.2])
def test_weak_excitation_does_not_make_a_model_worse(arm: Arm, tmp_path: Path, share: float) -> None:
    spring = EffectTerm("gravity_spring", 2, {"stiffness": GUESS, "rest_angle": REST})
    start = replace(arm, effects=(spring,))
    fit, _ = recorded(arm, tmp_path / "fit.mcap", 1, share)
    held, wrong = recorded(arm, tmp_path / "held.mcap", 2, 1.0)
    result = identify_by("wls", [fit], start, held_out=[held])
    assert result.relative_error(True) < wrong
    assert all(error < wrong for _, error in result.compared.values())
    assert any("keep the model's values" in note for note in result.notes)
    # Left alone, least squares explains the fitted run and nothing else.
    assert identify_by("ols", [fit], start, held_out=[held]).compared[UNCONSTRAINED][1] > wrong


def test_what_a_lively_run_shows_is_least_squares_own(arm: Arm, tmp_path: Path) -> None:
    fit, _ = recorded(arm, tmp_path / "fit.mcap", 1, 1.0)
    held, wrong = recorded(arm, tmp_path / "held.mcap", 2, 1.0)
    # Far off, and yet found: the data contradicts the model.
    start = replace(arm, effects=(EffectTerm("gravity_spring", 2, {"stiffness": 5.0, "rest_angle": REST}),))
    result = identify_by("wls", [fit], start, held_out=[held])
    assert result.relative_error(True) < 0.5 * wrong
    (stiffness,) = (value for value in result.parameters if value.name == "joint2.gravity_spring.stiffness")
    assert stiffness.identifiable and abs(stiffness.value - STIFFNESS) < 2 * stiffness.std
