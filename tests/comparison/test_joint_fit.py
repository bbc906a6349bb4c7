"""Effects beyond the model between two recordings: ripples, springs and limits that came, or that both have."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm_model.description import Arm
from comparison.change import Change
from comparison.from_recordings import compare_recordings
from comparison.outcome import Comparison
from daq.recording import Recording
from tests.comparison.second_day import puma, record

SHORT: dict[str, Any] = {"seconds": 12.0, "rate": 125.0}
RIPPLE = (1.5, 24.0, 0.7)
"""N m, cycles per turn of the joint, rad."""
ANOTHER: dict[str, Any] = {"seed": 1, "speed": 1.2}


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return puma(root, 2)


@pytest.fixture(scope="module")
def before(arm: Arm, tmp_path_factory: pytest.TempPathFactory) -> Recording:
    return record(tmp_path_factory.mktemp("day") / "before.mcap", arm, 1, **SHORT)


def significant(result: Comparison) -> dict[str, Change]:
    return {one.quantity.name: one for one in result.significant}


@pytest.mark.parametrize("again", [{}, ANOTHER], ids=["same motion", "another motion"])
def test_a_ripple_that_came_is_named_with_amplitude_and_phase(
    arm: Arm, before: Recording, tmp_path: Path, again: dict[str, Any]
) -> None:
    after = record(tmp_path / "after.mcap", arm, 2, **SHORT, **again, ripple=RIPPLE)
    result = compare_recordings([before], [after], arm)
    ((name, one),) = significant(result).items()
    assert name == "joint1.gear_ripple.torque(24).amplitude" and one.quantity.words.startswith("torque ripple of joint")
    assert one.std is not None and one.before is not None and one.before < 0.3
    assert one.change == pytest.approx(RIPPLE[0], abs=max(3 * one.std, 0.1 * RIPPLE[0]))
    phase = next(one for one in result.changes if one.quantity.name == name.replace("amplitude", "phase"))
    assert phase.after is not None and abs(np.angle(np.exp(1j * (phase.after - RIPPLE[2])))) < 0.2


def test_a_ripple_that_both_have_is_no_change(arm: Arm, tmp_path: Path) -> None:
    """Another motion shows it elsewhere, at other speeds."""
    days = [{}, ANOTHER]
    pair = [record(tmp_path / f"{k}.mcap", arm, k, **SHORT, **day, ripple=RIPPLE) for k, day in enumerate(days)]
    assert significant(compare_recordings(pair[:1], pair[1:], arm)) == {}


@pytest.mark.parametrize("again", [{}, ANOTHER], ids=["same motion", "another motion"])
def test_a_spring_that_came_is_named(arm: Arm, before: Recording, tmp_path: Path, again: dict[str, Any]) -> None:
    after = record(tmp_path / "after.mcap", arm, 2, **SHORT, **again, spring=20.0)
    result = compare_recordings([before], [after], arm)
    found = significant(result)
    one = found["joint2.gravity_spring.stiffness"]
    assert one.std is not None and one.change == pytest.approx(20.0, abs=max(4 * one.std, 1.0))
    assert {each.quantity.joint for each in found.values()} == {2}
    # it has a constant torque, which friction has as well: one cause
    summed = {name: each.effect for each in result.summaries for name in each.explains}
    assert summed == (dict.fromkeys(found, "gravity_spring") if len(found) > 1 else {})


TILT = (0.008, -0.012)
"""rad of roll and pitch."""


def tilted(root: Path, folder: Path, reach: float) -> Comparison:
    days = enumerate([(0.0, 0.0), TILT])
    pair = [record(folder / f"{k}.mcap", puma(root), k + 2, **SHORT, reach=reach, tilt=tilt) for k, tilt in days]
    return compare_recordings(pair[:1], pair[1:], puma(root))


@pytest.mark.parametrize(("stiffness", "speed"), [(1500.0, 5.0), (2800.0, 6.0)])
def test_a_gear_that_got_soft_is_named_with_its_compliance(
    root: Path, tmp_path: Path, stiffness: float, speed: float
) -> None:
    """Between two of the stiffnesses that are tried of every gear, beside friction of a motor that it moves."""
    arm = puma(root, 2)
    fast: dict[str, Any] = {"seconds": 12.0, "rate": 250.0, "speed": speed}
    before = record(tmp_path / "before.mcap", arm, 1, **fast)
    after = record(tmp_path / "after.mcap", arm, 2, **fast, soft=1.0 / stiffness)
    found = {one.quantity.name: one for one in compare_recordings([before], [after], arm).significant}
    soft = found.pop("joint1.joint_compliance.compliance")
    assert soft.change == pytest.approx(1.0 / stiffness, rel=0.1)
    assert {one.quantity.joint for one in found.values()} <= {1}


def test_a_base_that_was_tilted_is_named(root: Path, tmp_path: Path) -> None:
    result = tilted(root, tmp_path, 4.0)
    found = significant(result)
    assert set(found) == {"base_tilt.roll", "base_tilt.pitch"} and result.alternatives == []
    for one, hidden in zip((found["base_tilt.roll"], found["base_tilt.pitch"]), TILT):
        assert one.std is not None and one.change == pytest.approx(hidden, abs=3 * one.std)
    (summary,) = result.summaries
    assert summary.effect == "base_tilt" and summary.sentence.startswith("Base tilted by")
    # which single recordings show: told as what the tilt makes, not left beside it without a word
    assert {one.quantity.name: one.overruled for one in result.changes if one.overruled} == {
        "joint1.offset": "follows from base tilt"
    }
    assert "Follows from base tilt: constant torque or friction asymmetry of joint 1 (z = +" in str(result)


def test_what_no_motion_distinguishes_stands_beside_what_is_named(root: Path, tmp_path: Path) -> None:
    """Where joint 1 swings by half a radian, the weight of a tilted arm is nearly a constant torque there."""
    result = tilted(root, tmp_path, 1.0)
    (said,) = result.alternatives
    # one coefficient explains what two do
    assert said == "constant torque or friction asymmetry of joint 1 from base tilt"
    assert str(result).endswith(f"Not distinguished: {said}.") and result.to_json()["verdict"] in str(result)


def test_an_encoder_whose_zero_moved_is_named(root: Path, tmp_path: Path) -> None:
    days = [
        record(tmp_path / f"{k}.mcap", puma(root), k, **SHORT, seed=k % 2, zeros=(0.0, 0.04 * (k > 1), 0.0))
        for k in range(4)
    ]
    ((name, one),) = significant(compare_recordings(days[:2], days[2:], puma(root))).items()
    assert name == "joint2.joint_zero_offset.offset"
    assert one.std is not None and one.change == pytest.approx(0.04, abs=3 * one.std)


def test_a_limit_that_came_is_named(arm: Arm, before: Recording, tmp_path: Path) -> None:
    limit = 0.8 * float(np.quantile(np.abs(before.i[:, 0]), 0.99))
    after = record(tmp_path / "after.mcap", arm, 2, **SHORT, limit=limit)
    one = significant(compare_recordings([before], [after], arm))["joint1.current_limit.limit"]
    assert one.after == pytest.approx(limit, rel=0.01)
    assert one.before is not None and one.before > limit


@pytest.mark.filterwarnings("error")
def test_a_joint_that_stood_before_hides_no_scale_of_another(root: Path, tmp_path: Path) -> None:
    """Values that the side before does not show are the model's there; rounding in their place was 1e140."""
    arm = puma(root)
    weak = replace(arm.joints[0], torque_constant=arm.joints[0].torque_constant / 1.1)
    before = record(tmp_path / "before.mcap", arm, 1, **SHORT, resting=2)
    after = record(tmp_path / "after.mcap", replace(arm, joints=(weak, *arm.joints[1:])), 2, **SHORT)
    (summary,) = compare_recordings([before], [after], arm).summaries
    error, std, _ = summary.parameters["error"]
    assert (summary.effect, summary.joint) == ("torque_constant", 1)
    assert error == pytest.approx(1 / 1.1 - 1, abs=3 * std) and std < 0.01
