"""Limits that a model lacks and URDF requires: what is written locks no joint, and reads back as no limit."""

from __future__ import annotations

import xml.etree.ElementTree as xml  # noqa: N813
from dataclasses import replace
from pathlib import Path

import pytest

from arm_model import write_model
from arm_model.urdf import read_urdf
from armscope.cli import run
from tests.arm_model.random_arms import random_arm

KINDS = ("prismatic", "revolute")


def test_a_limit_that_is_not_known_locks_no_joint(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Of every joint without one MuJoCo sees room to move, and ours comes back without one."""
    mujoco = pytest.importorskip("mujoco")
    free = {"limits": None, "torque_limit": None, "motor_speed_limit": None}
    arm = random_arm(2)
    kinds = KINDS * len(arm)
    arm = replace(arm, joints=tuple(replace(j, type=kind, **free) for j, kind in zip(arm.joints, kinds)))
    write_model(tmp_path / "arm.toml", arm)
    assert run(["model", str(tmp_path / "arm.toml"), "--out", str(tmp_path / "arm.urdf")]) == 0
    said = capsys.readouterr().err
    slides = [str(number) for number, joint in enumerate(arm.joints, 1) if not joint.revolute]
    for what, joints in (("travel", slides), ("effort", range(1, len(arm) + 1)), ("velocity", range(1, len(arm) + 1))):
        assert f"limit of {what}, and the model has none of joint" in said
        assert all(str(joint) in said.partition(f"limit of {what}")[2].partition(":")[0] for joint in joints)
    for joint in xml.parse(tmp_path / "arm.urdf").getroot().iter("limit"):
        assert float(joint.get("effort", "0")) > 1e6 and float(joint.get("velocity", "0")) > 1e6
    back = read_urdf(tmp_path / "arm.urdf")
    assert [(j.type, j.limits, j.torque_limit, j.motor_speed_limit) for j in back.joints] == [
        (j.type, None, None, None) for j in arm.joints
    ]
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.urdf"))
    data = mujoco.MjData(model)
    data.qpos[:] = 3.0
    mujoco.mj_forward(model, data)
    limits = data.efc_type == mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT
    assert model.nv == len(arm) and not limits.any()
