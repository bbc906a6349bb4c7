"""Rotors of an arm whose model, as every URDF, knows none: behind a gear they are identified."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import armscope
from arm_io import InputError
from arm_model import Arm, read_model
from arm_model.rigid_body.numeric import rigid_torque
from arm_model.urdf import Use, read_urdf, urdf_gaps, write_urdf
from daq.recording import Recording, open_recording
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table
from identification import check_runs, without_rotors
from identification.regression.base_parameters import structural_base
from identification.regression.model_parameters import freed_rotors

GEARS = (32.0, -48.0, 40.0, 36.0, 44.0, 48.0)
ROTORS = (6e-4, 5e-4, 4e-4, 1e-4, 8e-5, 6e-5)
"""kg m2 at the motor."""
RATE = 200.0


@pytest.fixture(scope="module")
def urdf(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A six-axis arm with gears; friction, masses and inertias are those of the true arm, rotors are absent."""
    puma = read_model(root / "config/models/puma560.toml")
    joints = tuple(
        replace(joint, gear=gear, viscous=2.0 / gear**2, coulomb=3.0 / abs(gear), rotor_inertia=0.0, offset=0.0)
        for joint, gear in zip(puma.joints, GEARS)
    )
    path = tmp_path_factory.mktemp("urdf") / "arm.urdf"
    write_urdf(path, replace(puma, joints=joints, controller=None))
    return path


def record(path: Path, arm: Arm, seed: int, seconds: float = 30.0) -> Recording:
    """Four harmonics; torques at the joints by hand: rigid links, rotors over their gears, friction, noise."""
    random, t, count = np.random.default_rng(seed), np.arange(0, seconds, 1 / RATE), len(arm)
    w = 2 * np.pi * 0.12 * np.array([1.0, 2.0, 3.0, 5.0])
    a, phase = random.normal(size=(count, 4)) * 0.5 / np.arange(1, 5), random.uniform(0, 2 * np.pi, (count, 4))
    turn = w * t[:, None, None] + phase
    q, qd, qdd = (np.sum(part, axis=2) for part in (a * np.cos(turn), -a * w * np.sin(turn), -a * w**2 * np.cos(turn)))
    torque = rigid_torque(arm, q, qd, qdd)
    torque += np.square(GEARS[:count]) * ROTORS[:count] * qdd + 2.0 * qd + 3.0 * np.sign(qd)
    torque += 0.02 * random.standard_normal(torque.shape)
    write_table(path, t, {"q": np.round(q / 1e-6) * 1e-6, "i": torque}, Attachments())
    return open_recording(path)


@pytest.mark.slow
def test_rotors_behind_gears_are_found(urdf: Path, tmp_path: Path) -> None:
    arm = read_urdf(urdf)
    assert [joint.gear for joint in arm.joints] == list(GEARS) and freed_rotors(arm) == [1, 2, 3, 4, 5, 6]
    fit, held = (record(tmp_path / f"{seed}.mcap", arm, seed) for seed in (1, 2))
    found = armscope.identify(fit, urdf, held_out=held)
    assert any("no rotor inertia at joints 1, 2, 3, 4, 5, 6: it is identified here" in text for text in found.warnings)
    named = {value.name: value for value in found.parameters}
    for j in (3, 4, 5, 6):  # of joints 1 and 2 in a sum with the link's
        rotor = named[f"joint{j}.rotor_inertia"]
        assert rotor.std is not None and abs(rotor.value - GEARS[j - 1] ** 2 * ROTORS[j - 1]) < 4 * rotor.std
        assert found.arm.joints[j - 1].rotor_inertia == pytest.approx(ROTORS[j - 1], rel=0.1)
    without = replace(arm, joints=tuple(replace(j, gear=1.0, torque_constant=1.0) for j in arm.joints))
    assert found.relative_error(True) < 0.75 * armscope.identify(fit, without, held_out=held).relative_error(True)


def test_a_rotor_that_is_in_one_sum_with_its_link_is_not_put_into_the_link(urdf: Path, tmp_path: Path) -> None:
    """Two joints, whose rotors no motion distinguishes from the links: these stay as heavy as the model has them."""
    arm = read_urdf(urdf)
    arm = replace(arm, joints=arm.joints[:2])
    fit, held = (record(tmp_path / f"{seed}.mcap", arm, seed, 12.0) for seed in (1, 2))
    found = armscope.identify(fit, arm, held_out=held)
    assert [value.std for value in found.parameters if value.name.endswith("rotor_inertia")] == [None, None]
    for joint, before, rotor in zip(found.arm.joints, arm.joints, ROTORS):
        assert joint.rotor_inertia == pytest.approx(rotor, rel=0.1)
        assert joint.mass == pytest.approx(before.mass, rel=0.1)


def test_the_first_rotor_is_in_one_sum_with_the_first_link(urdf: Path) -> None:
    """About a fixed axis link and rotor turn alike: their sum alone can be known, with the weight 1 of each."""
    base = structural_base(read_urdf(urdf))
    names = list(base.names)
    rotor, link = names.index("joint1.rotor_inertia"), names.index("link1.izz")
    row = int(np.argmax(np.abs(base.grouping[:, rotor])))
    assert base.grouping[row, rotor] == pytest.approx(base.grouping[row, link]) != 0.0
    assert np.count_nonzero(base.grouping[:, rotor]) == 1
    # the last joint's link is felt by the others, its rotor is not
    alone = [base.expression(k) for k in range(len(base)) if base.alone(k)]
    assert "joint6.rotor_inertia" in alone


def test_gears_of_a_urdf_leave_torques_and_friction_at_the_joint(urdf: Path, tmp_path: Path) -> None:
    geared, text = read_urdf(urdf), urdf.read_text()
    (tmp_path / "bare.urdf").write_text(text.replace("mechanicalReduction", "nothing"))
    bare = read_urdf(tmp_path / "bare.urdf")
    assert {joint.gear for joint in bare.joints} == {1.0}
    np.testing.assert_allclose(geared.joint_array("drive_constant"), 1.0)
    assert "With a gear in the model" in without_rotors(bare) and not without_rotors(geared)
    for one, other in zip(geared.joints, bare.joints):
        assert one.ratio * one.coulomb[0] == pytest.approx(other.coulomb[0])
        assert one.ratio**2 * one.viscous[0] == pytest.approx(other.viscous[0])
    (tmp_path / "wrong.urdf").write_text(text.replace(">-48.0<", ">0<"))
    with pytest.raises(InputError, match="mechanicalReduction is 0; expected a finite number other than 0"):
        read_urdf(tmp_path / "wrong.urdf")
    # as a macro leaves a word that it did not replace
    (tmp_path / "word.urdf").write_text(text.replace(">-48.0<", ">reduction<"))
    assert {joint.gear for joint in read_urdf(tmp_path / "word.urdf").joints} == {
        *{one.gear for one in geared.joints},
        1.0,
    } - {-48.0}
    (said,) = urdf_gaps(tmp_path / "word.urdf", {Use.DYNAMICS})
    assert said.startswith("mechanicalReduction of ") and said.endswith(
        "is 'reduction', no number: the gear counts as 1"
    )


def test_a_model_without_gears_and_rotors_is_told_as_such_before_it_misleads(urdf: Path, tmp_path: Path) -> None:
    """Only a refused validation said it: the check called it ready, and comparisons named changes that were none."""
    arm = read_urdf(urdf)
    arm = replace(arm, joints=arm.joints[:2])
    plain = replace(arm, joints=tuple(replace(joint, gear=1.0, torque_constant=1.0) for joint in arm.joints))
    runs = [record(tmp_path / f"{seed}.mcap", arm, seed, seconds=12.0) for seed in (1, 2)]
    for model, said in ((plain, True), (arm, False)):
        assert any("The model has no rotors" in warning for warning in check_runs(runs, model).warnings) is said
        changed = armscope.compare(runs[0], runs[1], model)
        assert any("The model has no rotors" in warning for warning in changed.warnings) is said
