"""A vertical axis of a gantry whose URDF file knows no rotor: gravity acts on its mass, not on its drive."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import armscope
from daq.recording import Recording, open_recording
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table

GRAVITY = 9.80665
RAIL, LIFT, ROTOR = 12.0, 8.0, 1.5
"""kg: slide and its drive, what the second axis lifts, and the rotor of its drive, at the joint."""
BODY = '<inertial><mass value="{mass}"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial>'
AXIS = (
    '<joint name="{name}" type="prismatic"><parent link="{parent}"/><child link="{child}"/><axis xyz="{axis}"/>'
    '<limit lower="-0.5" upper="0.5" velocity="2" effort="600"/></joint>'
)


def urdf(path: Path, lift: float) -> Path:
    """The gantry as a stranger's file has it; ``lift``: kg of its second link."""
    path.write_text(
        '<robot name="gantry"><link name="base"/>'
        f'<link name="slide">{BODY.format(mass=RAIL)}</link><link name="ram">{BODY.format(mass=lift)}</link>'
        + AXIS.format(name="rail", parent="base", child="slide", axis="1 0 0")
        + AXIS.format(name="lift", parent="slide", child="ram", axis="0 0 1")
        + "</robot>"
    )
    return path


def record(path: Path, seed: int) -> Recording:
    """12 s of three harmonics; forces by hand: masses, the rotor, the weight, friction, noise."""
    random, t = np.random.default_rng(seed), np.arange(0, 12.0, 1 / 200.0)
    w = 2 * np.pi * np.array([0.15, 0.35, 0.8])
    a, phase = random.uniform(0.5, 1.0, (2, 3)) * (0.2, 0.1, 0.03), random.uniform(0, 2 * np.pi, (2, 3))
    turn = w * t[:, None, None] + phase
    q, qd, qdd = (np.sum(part, axis=2) for part in (a * np.cos(turn), -a * w * np.sin(turn), -a * w**2 * np.cos(turn)))
    moved, weight = np.array([RAIL + LIFT, LIFT + ROTOR]), np.array([0.0, LIFT * GRAVITY])
    force = moved * qdd + weight + 30.0 * qd + 10.0 * np.sign(qd) + 0.05 * random.standard_normal(q.shape)
    write_table(path, t, {"q": np.round(q / 1e-7) * 1e-7, "i": force}, Attachments())
    return open_recording(path)


def test_a_rotor_is_no_weight(tmp_path: Path) -> None:
    """The file has the wrong mass, too: that is found, and no offset makes up for it."""
    fit, held = (record(tmp_path / f"{seed}.mcap", seed) for seed in (1, 2))
    found = armscope.identify(fit, urdf(tmp_path / "gantry.urdf", 0.9 * LIFT), held_out=held)
    assert any("no rotor inertia at joint 2: it is identified here" in text for text in found.warnings)
    joint = found.arm.joints[1]
    assert joint.mass == pytest.approx(LIFT, rel=0.01)
    assert joint.rotor_inertia == pytest.approx(ROTOR, rel=0.05)
    assert abs(joint.offset) < 0.01 * LIFT * GRAVITY
    sums = {one.name: one for one in found.base}
    rotor = sums["joint2.rotor_inertia - 0.101972 joint2.offset"]
    assert abs(rotor.value - ROTOR) < 3 * rotor.std
