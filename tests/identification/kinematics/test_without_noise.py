"""Points without noise: nothing is found in errors below those of any tracker, and the selection ends."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import armscope
from arm_model.description import Arm
from arm_model.rigid_body.kinematics import link_frames
from identification.kinematics.estimation import cross_validation
from identification.kinematics.estimation.cross_validation import Trial, choose
from identification.kinematics.estimation.extensions import Extension

URDF = """\
<robot name="turned">
  <link name="base"/>
  {joints}
</robot>
"""
JOINT = """\
  <joint name="j{k}" type="revolute">
    <parent link="{parent}"/><child link="l{k}"/>
    <origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>
    <limit lower="-2" upper="2" effort="100" velocity="3"/>
  </joint>
  <link name="l{k}">
    <inertial><origin xyz="0 0 0.1"/><mass value="2"/>
      <inertia ixx="0.02" iyy="0.02" izz="0.01" ixy="0" iyz="0" ixz="0"/></inertial>
  </link>
"""
PLACES = [("0 0 0.3", "0 0 0", "0 0 1"), ("0 0 0.1", "0 0 0", "0 1 0"), ("0 0 0.5", "0 0 0", "0 1 0")]
PLACES += [("0 0 0.2", "0 0 0", "0 0 1"), ("0 0 0.2", "3.14159265 0 0", "0 1 0"), ("0 0 -0.1", "0 0 0", "0 0 -1")]
TARGET = (0.05, 0.02, 0.1)


@pytest.fixture
def arm(tmp_path: Path) -> Arm:
    joints = [
        JOINT.format(k=k, parent=f"l{k - 1}" if k > 1 else "base", xyz=xyz, rpy=rpy, axis=axis)
        for k, (xyz, rpy, axis) in enumerate(PLACES, 1)
    ]
    path = tmp_path / "arm.urdf"
    path.write_text(URDF.format(joints="".join(joints)))
    return armscope.read_model(path)


def poses(folder: Path, arm: Arm, target: tuple[float, float, float]) -> Path:
    """A table of 80 poses with the points of a target (m, frame of the last link), to the last digit."""
    q = np.random.default_rng(4).uniform(-1.8, 1.8, (80, len(arm)))
    points = (link_frames(arm, q)[:, -1] @ [*target, 1.0])[:, :3]
    heading = ",".join([*(f"q{j + 1}" for j in range(len(arm))), "x", "y", "z"])
    path = folder / "poses.csv"
    np.savetxt(path, np.concatenate([q, points], axis=1), delimiter=",", header=heading, comments="", fmt="%.17g")
    return path


def test_nothing_is_found_in_errors_below_those_of_any_tracker(arm: Arm, tmp_path: Path) -> None:
    found = armscope.calibrate(poses(tmp_path, arm, TARGET), arm, tracker=armscope.Tracker(target=TARGET))
    assert found.to_json()["effects"] == []
    assert str(found).count("(both below 0.001 mm)") == 2


def test_a_wrong_target_is_told_in_the_frame_that_it_was_given_in(arm: Arm, tmp_path: Path) -> None:
    """That of the model's last link, whose axis is turned in the Denavit-Hartenberg frame of the calibration."""
    given = (TARGET[0] + 0.3, *TARGET[1:])
    found = armscope.calibrate(poses(tmp_path, arm, TARGET), arm, tracker=armscope.Tracker(target=given))
    (told,) = [said for said in found.to_json()["warnings"] if "was given as" in said]
    assert "was given as (0.3500, 0.0200, 0.1000) m" in told
    place = told.partition("place it at (")[2].partition(")")[0]
    # the last link may take up to a millimetre of it
    assert [float(x) for x in place.split(", ")] == pytest.approx(TARGET, abs=1e-3)
    (written,) = found.to_json()["targets"]
    assert written["place"] == pytest.approx(TARGET, abs=1e-3)
    assert [row[3] for row in written["pose"]][:3] != pytest.approx(TARGET, abs=1e-2)


def test_a_selection_that_comes_back_to_where_it_was_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without its one extension less is left, from where it enters again."""
    extension = Extension("encoder_scale", 2)
    rounds: list[Any] = []

    def selected(model: cross_validation.LeftOutPoints) -> SimpleNamespace:
        rounds.append(model)
        assert len(rounds) < 20
        free = extension in model.candidates
        trial = Trial(extension, 2e-3, 1e-3, 9.0, accepted=True)
        return SimpleNamespace(
            chosen=(extension,) if free else (), trials=[trial] if free else [], cost=1.0 if free else 0.9
        )

    monkeypatch.setattr(cross_validation, "_selection", selected)
    points = SimpleNamespace(where=lambda rows: None)
    start = SimpleNamespace(inlier=np.ones(50, bool), values=np.zeros(1))
    of: Callable[..., Any] = choose
    chosen, trials = of(None, points, np.arange(50) // 5, [extension], lambda every: np.zeros((50, 1, 1)), start)
    assert chosen == [extension] and len(trials) == 1
