"""What a calibration found, written into the URDF file from which its model came."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import armscope
from arm_io import InputError
from arm_model import read_model, write_model
from arm_model.rigid_body import forward
from armscope.cli import run
from identification.kinematics.models import in_denavit_hartenberg, placed_as

URDF = "config/models/ur5e.urdf"


def moved(arm, scale: float, last: bool = True):
    """The arm with all its D-H parameters changed; those of the last link only if ``last``."""
    draw = np.random.default_rng(5)
    joints = []
    for number, joint in enumerate(arm.joints, 1):
        change = {name: getattr(joint, name) + scale * draw.normal() for name in ("theta", "alpha", "a", "d")}
        joints.append(replace(joint, **change) if last or number < len(arm) else joint)
    return replace(arm, joints=tuple(joints))


def test_a_calibrated_arm_is_placed_as_before(root: Path) -> None:
    """Exactly the same motion; frames moved by as little as the parameters were; masses where they were in the link."""
    original = read_model(root / URDF)
    given, _ = in_denavit_hartenberg(original)
    arm = moved(given, 1e-3)
    placed = placed_as(arm, original)
    q = np.random.default_rng(6).uniform(-3, 3, (40, 6))
    np.testing.assert_allclose(forward(placed, q), forward(arm, q), atol=1e-13)
    for was, now in zip(original.joints, placed.joints):
        assert now.convention == "placed" and now.axis == was.axis
        np.testing.assert_allclose(now.xyz, was.xyz, atol=6e-3)
        np.testing.assert_allclose(now.com, was.com, atol=1e-12)
        np.testing.assert_allclose(now.inertia, was.inertia, atol=1e-12)
    assert np.abs(np.array(placed.tool) - np.array(original.tool)).max() < 6e-3
    back = placed_as(given, original)
    for was, now in zip(original.joints, back.joints):
        np.testing.assert_allclose(now.xyz, was.xyz, atol=1e-12)


def test_the_command_writes_the_origins_into_the_file(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It was refused: 'has another axis or convention', although the document promised it."""
    original = read_model(root / URDF)
    arm = moved(in_denavit_hartenberg(original)[0], 1e-3, last=False)
    write_model(tmp_path / "model.toml", arm)
    out = tmp_path / "calibrated.urdf"
    assert run(["model", str(tmp_path / "model.toml"), "--into", str(root / URDF), "--out", str(out)]) == 0
    said = capsys.readouterr().err
    assert "joint elbow: origin" in said and "mass" not in said and "friction" not in said
    q = np.random.default_rng(6).uniform(-3, 3, (40, 6))
    reached = forward(read_model(out), q)
    assert np.abs(forward(original, q) - forward(arm, q)).max() > 1e-3
    np.testing.assert_allclose(reached, forward(placed_as(arm, original), q) @ _without_tool(arm, original), atol=1e-9)


def test_a_model_is_written_in_the_format_of_its_name(root: Path, tmp_path: Path) -> None:
    """From Python a .urdf file, and any other, was written as TOML."""
    original = read_model(root / URDF)
    arm = moved(in_denavit_hartenberg(original)[0], 1e-3)
    with pytest.warns(UserWarning, match="the tool frame is not written: in the model it lies"):
        armscope.write_model(tmp_path / "into.urdf", arm, into=root / URDF)
    assert (tmp_path / "into.urdf").read_text().count("\n") == (root / URDF).read_text().count("\n")
    with pytest.warns(UserWarning, match="load_friction"):
        armscope.write_model(tmp_path / "new.urdf", original.with_effect("load_friction", joint=1, mu=0.1))
    assert read_model(tmp_path / "new.urdf").joints[0].mass == original.joints[0].mass
    for name, into in (("arm.json", None), ("arm.toml", root / URDF)):
        with pytest.raises(InputError, match="must end in"):
            armscope.write_model(tmp_path / name, arm, into=into)
        assert not (tmp_path / name).exists()


def _without_tool(arm, original) -> np.ndarray:
    """What the file cannot hold: the tool frame in the last link."""
    return np.linalg.inv(np.array(placed_as(arm, original).tool)) @ np.array(original.tool)


def test_the_model_of_another_arm_is_refused(root: Path) -> None:
    original = read_model(root / URDF)
    given, _ = in_denavit_hartenberg(original)
    other = replace(given, joints=(replace(given.joints[0], alpha=1.0), *given.joints[1:]))
    with pytest.raises(InputError, match="the model is of another arm"):
        placed_as(other, original)
