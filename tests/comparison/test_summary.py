"""Several changes are summed up as the one cause that makes them, and as none where they are of something else."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest

from arm_model.description import Arm
from arm_model.model_file import read_model
from arm_model.rigid_body.inertia import about_com, barycentric
from comparison.from_recordings import compare_recordings
from comparison.outcome import Comparison
from daq.recording import Recording
from tests.comparison.second_day import LEVELS, puma, record

CENTRE = (0.05, 0.0, 0.1)
OWN = (0.02, 0.03, 0.01, 0.0, 0.0, 0.0)
"""kg m2: of a body of 2 kg about its centre."""


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return puma(root)


@pytest.fixture(scope="module")
def before(arm: Arm, tmp_path_factory: pytest.TempPathFactory) -> Recording:
    return record(tmp_path_factory.mktemp("day") / "before.mcap", arm, 1)


def carrying(arm: Arm) -> Arm:
    last = arm.joints[-1]
    body = barycentric(2.0, CENTRE, OWN)
    mass, com, inertia = about_com(barycentric(last.mass, last.com, last.inertia) + body)
    return replace(arm, joints=(*arm.joints[:-1], replace(last, mass=mass, com=com, inertia=inertia)))


def scaled(recording: Recording, joint: int, by: float) -> Recording:
    """The recording with the currents of a joint (from 1) ``by`` times as large."""
    i = recording.i.copy()
    i[:, joint - 1] *= by
    return replace(recording, i=i)


def summed(result: Comparison) -> list[tuple[str, int | None]]:
    return [(one.effect, one.joint) for one in result.summaries]


MOTIONS = {"same motion": {}, "another motion": {"seed": 1, "speed": 1.3}, "another rate": {"rate": 200.0}}


@pytest.mark.parametrize("again", MOTIONS.values(), ids=MOTIONS)
def test_a_payload_sums_up_the_changes_of_links(arm: Arm, before: Recording, tmp_path: Path, again: dict) -> None:
    result = compare_recordings([before], [record(tmp_path / "after.mcap", carrying(arm), 2, **again)], arm)
    (payload,) = result.summaries
    assert (payload.effect, payload.joint) == ("payload", None)
    mass, std, unit = payload.parameters["mass"]
    assert unit == "kg" and abs(mass - 2.0) < 3 * std < 0.7
    for axis, true in zip("xyz", CENTRE):
        if axis in payload.parameters:
            value, doubt, _ = payload.parameters[axis]
            assert abs(value - true) < 3 * doubt
    assert set(payload.explains) == {one.quantity.name for one in result.significant}
    assert payload.sentence in str(result) and result.to_json()["verdict"].startswith(payload.sentence)
    back = compare_recordings([record(tmp_path / "loaded.mcap", carrying(arm), 3)], [before], arm)
    assert back.summaries[0].parameters["mass"][0] == pytest.approx(-2.0, abs=0.3)


def test_a_payload_is_a_constant_force_where_a_joint_lifts_it(root: Path, tmp_path: Path) -> None:
    """Two turning joints and a vertical sliding one with a rotor: friction of the latter shows the weight."""
    scara = read_model(root / "config/models/scara.toml")
    three = replace(scara, joints=tuple(replace(j, rotor_inertia=0.5) for j in scara.joints[:3]), controller=None)
    runs = [record(tmp_path / f"{k}.mcap", arm, k) for k, arm in enumerate((three, carrying(three)))]
    (payload,) = compare_recordings(runs[:1], runs[1:], three).summaries
    mass, std, _ = payload.parameters["mass"]
    assert payload.effect == "payload" and abs(mass - 2.0) < 3 * std < 0.3
    assert "joint3.offset" in payload.explains


@pytest.mark.parametrize("again", [MOTIONS["same motion"], MOTIONS["another motion"]], ids=["same", "another"])
def test_another_torque_constant_sums_up_all_that_a_joint_shows(
    arm: Arm, before: Recording, tmp_path: Path, again: dict
) -> None:
    after = scaled(record(tmp_path / "after.mcap", arm, 2, **again), 2, 1 / 0.85)
    result = compare_recordings([before], [after], arm)
    (constant,) = result.summaries
    assert (constant.effect, constant.joint) == ("torque_constant", 2)
    value, std, _ = constant.parameters["error"]
    assert abs(value + 0.15) < 3 * std < 0.03
    told = re.search(r"torque constant (-[\d.]+) %", constant.sentence)
    assert told is not None and float(told[1]) == pytest.approx(100 * value, abs=0.006)


def test_a_torque_constant_is_as_large_as_it_is_between_several_recordings(arm: Arm, tmp_path: Path) -> None:
    """Of every motion the values make another torque of one joint alone: none of them is that of their mean."""
    days = [
        [record(tmp_path / f"{day}{k}.mcap", arm, 10 * day + k, seed=k, rate=125.0) for k in (1, 2)] for day in (1, 2)
    ]
    result = compare_recordings(days[0], [scaled(each, 2, 1.5) for each in days[1]], arm)
    (constant,) = result.summaries
    value, std, _ = constant.parameters["error"]
    assert (constant.effect, constant.joint) == ("torque_constant", 2)
    assert abs(value + 1 / 3) < 3 * std < 0.01


def test_friction_of_a_joint_is_neither(arm: Arm, before: Recording, tmp_path: Path) -> None:
    worn = (LEVELS[0], 1.5 * LEVELS[1], LEVELS[2])
    result = compare_recordings([before], [record(tmp_path / "after.mcap", arm, 2, levels=worn)], arm)
    assert summed(result) == []
    assert {one.quantity.joint for one in result.significant} == {2}


def test_a_payload_and_friction_are_not_one_cause(arm: Arm, before: Recording, tmp_path: Path) -> None:
    worn = (1.5 * LEVELS[0], LEVELS[1], LEVELS[2])
    result = compare_recordings([before], [record(tmp_path / "after.mcap", carrying(arm), 2, levels=worn)], arm)
    assert summed(result) in ([], [("payload", None)])
    assert ("torque_constant", 1) not in summed(result)
    assert any(one.quantity.name == "joint1.coulomb" for one in result.significant)


@pytest.mark.parametrize("again", MOTIONS.values(), ids=MOTIONS)
def test_nothing_is_summed_up_where_nothing_changed(arm: Arm, before: Recording, tmp_path: Path, again: dict) -> None:
    assert summed(compare_recordings([before], [record(tmp_path / "after.mcap", arm, 2, **again)], arm)) == []


def test_calibrations_are_compared_first(arm: Arm, before: Recording, tmp_path: Path) -> None:
    table = {name: [1.0, 2.0, 3.0] for name in ("amperes_per_volt", "volt_offset", "scale", "offset")}
    other = {**table, "amperes_per_volt": [1.0, 2.2, 3.0]}
    one, two = (
        replace(recording, attachments={**recording.attachments, "calibration.json": text})
        for recording, text in (
            (before, calibration(table, "a")),
            (record(tmp_path / "after.mcap", arm, 2), calibration(other, "b")),
        )
    )
    (said,) = [c for c in compare_recordings([one], [two], arm).circumstances if c.kind == "calibration"]
    assert said.joints == (2,)
    assert "joint 2: 2 A/V of its current transducer before, 2.2 after" in said.sentence
    less = compare_recordings([one], [record(tmp_path / "none.mcap", arm, 3)], arm)
    (said,) = [c for c in less.circumstances if c.kind == "calibration"]
    assert "none.mcap without any" in said.sentence


def calibration(table: dict[str, list[float]], digest: str) -> bytes:
    return json.dumps({**table, "count_column": [0, 1, 2], "volt_column": [0, 1, 2], "hash": digest}).encode()


def test_a_torque_constant_that_the_joint_fit_finds_beside_a_ripple_is_summed_up(
    arm: Arm, before: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where the regressions of single recordings leave too much of the changes for one cause, as they are made to."""
    monkeypatch.setattr("comparison.summaries._current_scale", lambda *_: None)
    rippled = record(tmp_path / "after.mcap", arm, 2, ripple=(1.5, 24.0, 0.7))
    result = compare_recordings([before], [scaled(rippled, 2, 1 / 0.75)], arm)
    (constant,) = result.summaries
    value, std, _ = constant.parameters["error"]
    assert (constant.effect, constant.joint) == ("torque_constant", 2)
    assert abs(value + 0.25) < 3 * std < 0.1
    assert not any(name.startswith("joint1.") for name in constant.explains)
