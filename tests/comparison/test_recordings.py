"""What changed between recordings is found; what did not change, or is known to differ, is not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm_io import InputError
from arm_model.description import Arm
from arm_model.effects.catalogue import CATALOGUE, values_of
from comparison.from_recordings import compare_recordings
from comparison.outcome import Comparison
from tests.comparison.second_day import LEVELS, puma, record

WORN = (LEVELS[0], LEVELS[1], 1.5 * LEVELS[2])
"""Friction +50 % at joint 3."""
LOAD = """
name = "with a known mass"
start = [0.0, 0.0, 0.0]
full_speed = [1.0, 1.0, 1.0]
full_acceleration = [1.0, 1.0, 1.0]
setup = { payload = { mass = 2.0, com = [0.05, 0.0, 0.1] } }
segment = [{ type = "hold", duration = 1.0 }]
"""


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return puma(root)


def names(result: Comparison, kind: str) -> set[str]:
    return {one.quantity.name for one in result.significant if one.quantity.kind == kind}


@pytest.mark.parametrize("again", [{}, {"seed": 1, "speed": 1.3}], ids=["same motion", "another motion"])
def test_friction_of_one_joint_is_found_and_nothing_else(arm: Arm, tmp_path: Path, again: dict[str, float]) -> None:
    before = record(tmp_path / "before.mcap", arm, 1)
    after = record(tmp_path / "after.mcap", arm, 2, levels=WORN, **again)
    result = compare_recordings([before], [after], arm)
    assert names(result, "friction") == {"joint3.coulomb"}
    assert {one.quantity.joint for one in result.significant} == {3}
    by = WORN[2] - LEVELS[2]
    (coulomb,) = (one for one in result.significant if one.quantity.kind == "friction")
    assert coulomb.z is not None and coulomb.z > 20
    assert coulomb.change == pytest.approx(by, abs=3 * coulomb.std)
    points = [one for one in result.changes if one.quantity.kind == "curve" and one.quantity.joint == 3]
    speeds = [abs(one.quantity.speed) for one in points]
    assert len(points) >= 8 and min(speeds) < 0.1 and max(speeds) > 0.8
    # At low and at high speed alike.
    for one in points:
        assert one.significant and one.change == pytest.approx(by, abs=4 * one.std)
    said = {one.kind for one in result.circumstances}
    assert said == ({"motion"} if again else set())


@pytest.mark.parametrize("joints", [2, 3])
def test_a_slow_motion_has_rows_enough(root: Path, tmp_path: Path, joints: int) -> None:
    """Its own band, of a third of a hertz, leaves fewer rows than twice the values of an arm.

    Joint 2 hardly turns back: a spring with a constant torque explains friction of one direction as well, unless its
    stiffness must show.
    """
    arm = puma(root, joints)
    slow: dict[str, Any] = {"speed": 0.3, "seconds": 9.0, "rate": 125.0}
    pair = [record(tmp_path / f"{k}.mcap", arm, k, levels=(20.0, 20.0 if k else 10.0, 6.0), **slow) for k in (0, 1)]
    result = compare_recordings(pair[:1], pair[1:], arm)
    assert {(one.quantity.joint, one.quantity.kind) for one in result.significant} == {(2, "curve")}
    assert [one.change for one in result.significant] == pytest.approx([10.0], abs=0.2)


@pytest.mark.parametrize("noise", [10, 30])
def test_friction_is_no_body_where_little_distinguishes_them(root: Path, tmp_path: Path, noise: int) -> None:
    """Gravity of joint 2 hardly changes in so slow a motion, and a body has ten parameters to explain noise with."""
    arm = puma(root)
    slow: dict[str, Any] = {"speed": 0.3, "seconds": 9.0, "rate": 125.0}
    levels = ((20.0, 10.0, 6.0), (20.0, 20.0, 6.0))
    pair = [record(tmp_path / f"{k}.mcap", arm, noise + k, levels=each, **slow) for k, each in enumerate(levels)]
    (one,) = compare_recordings(pair[:1], pair[1:], arm).significant
    assert (one.quantity.joint, one.quantity.kind) == (2, "curve")
    assert one.std is not None and one.change == pytest.approx(10.0, abs=3 * one.std)


def test_of_a_recording_that_is_too_short_the_seconds_that_lack_are_told(root: Path, tmp_path: Path) -> None:
    arm = puma(root)
    pair = [record(tmp_path / f"{k}.mcap", arm, k, seconds=0.6, rate=125.0) for k in (0, 1)]
    with pytest.raises(InputError, match=r"at least \d+ s more .*it has 0.59 s, which leave \d+ rows for \d+ param"):
        compare_recordings(pair[:1], pair[1:], arm)


def test_where_nothing_changed_nothing_is_named(root: Path, tmp_path: Path) -> None:
    """Twenty pairs, half of them of two motions: one in twenty may be named; more than three would be by 1.6 %."""
    arm, false, z = puma(root, 2), 0, []
    for pair in range(20):
        made = [
            record(
                tmp_path / f"{day}.mcap", arm, 2 * pair + day, seed=pair + day * (pair % 2), seconds=14.0, rate=125.0
            )
            for day in (0, 1)
        ]
        result = compare_recordings(made[:1], made[1:], arm)
        assert result.tested > 12
        false += bool(result.significant)
        z += [one.z for one in result.changes if one.z is not None]
    assert false <= 3
    # The deviations are not so large that nothing could ever be found, either.
    assert 0.5 < np.std(z) < 1.2


def test_known_payload_is_no_change(arm: Arm, tmp_path: Path) -> None:
    payload = CATALOGUE["payload"]
    assert payload.change is not None
    carrying = payload.change(arm, None, values_of(payload, {"mass": 2.0, "x": 0.05, "y": 0.0, "z": 0.1}))
    before = record(tmp_path / "before.mcap", arm, 1)
    told = compare_recordings([before], [record(tmp_path / "told.mcap", carrying, 2, experiment=LOAD)], arm)
    assert told.significant == []
    assert [one.kind for one in told.circumstances] == ["payload"]
    assert "2 kg in told.mcap" in told.circumstances[0].sentence
    untold = compare_recordings([before], [record(tmp_path / "untold.mcap", carrying, 2)], arm)
    assert names(untold, "inertia") and not names(untold, "friction")


def test_scatter_between_the_recordings_of_a_group_counts(root: Path, tmp_path: Path) -> None:
    """Friction of joint 1 varies by 5 % from run to run: of single runs that is a change, of groups it is none."""
    arm = puma(root, 2)
    vary = 1 + 0.05 * np.array([0.3, -1.2, 1.1, -0.2, 0.9, -0.9, 0.4, 1.2])
    runs = [
        record(
            tmp_path / f"{k}.mcap",
            arm,
            k,
            levels=(LEVELS[0] * share, LEVELS[1] * (1.5 if k > 3 else 1.0)),
            seconds=14.0,
            rate=125.0,
        )
        for k, share in enumerate(vary)
    ]
    single = compare_recordings(runs[1:2], runs[4:5], arm)
    assert names(single, "friction") == {"joint1.coulomb", "joint2.coulomb"}
    result = compare_recordings(runs[:4], runs[4:], arm)
    assert names(result, "friction") == {"joint2.coulomb"}
    scattered = next(one for one in result.changes if one.quantity.name == "joint1.coulomb")
    assert scattered.scatter is not None and scattered.scatter > 3


def test_what_a_recording_does_not_show_is_not_compared(arm: Arm, tmp_path: Path) -> None:
    before = record(tmp_path / "before.mcap", arm, 1, temp=24.0)
    after = record(tmp_path / "after.mcap", arm, 2, resting=2, levels=WORN, temp=31.5, rate=200.0)
    result = compare_recordings([before], [after], arm)
    of_three = [one for one in result.changes if one.quantity.joint == 3 and one.quantity.kind == "friction"]
    whys = {one.quantity.name.partition(".")[2]: one.quantity.why for one in of_three}
    rests = "after.mcap never moves joint 3 in positive direction"
    assert whys == {
        **dict.fromkeys(("coulomb", "viscous", "offset"), rests),
        "load_friction.mu": "not excited in after.mcap",
    }
    assert result.significant == []
    sentences = {one.kind: one.sentence for one in result.circumstances}
    assert "motor 3 is 7.5 K warmer (24.0 to 31.5 degC)" in sentences["temperature"]
    assert "250 rows/s before, 200 after" in sentences["rate"]
    assert "motion" in sentences


def test_friction_by_load_is_no_change_of_masses(arm: Arm, tmp_path: Path) -> None:
    before = record(tmp_path / "before.mcap", arm, 1)
    after = record(tmp_path / "after.mcap", arm, 2, by_load=0.1)
    result = compare_recordings([before], [after], arm)
    found = {one.quantity.name: one for one in result.significant if one.quantity.kind != "curve"}
    worn = found["joint2.load_friction.mu"]
    assert worn.change == pytest.approx(0.1, abs=3 * worn.std)
    assert {one.quantity.joint for one in result.significant} == {2}
    assert names(result, "inertia") == set()


def test_an_effect_of_the_model_is_compared_too(arm: Arm, tmp_path: Path) -> None:
    """A spring of the model, whose data has none, is gone on both sides, and no change."""
    sprung = arm.with_effect("gravity_spring", 2, stiffness=10.0, rest_angle=0.3)
    pair = [record(tmp_path / f"{k}.mcap", arm, k, levels=WORN if k else LEVELS) for k in (0, 1)]
    result = compare_recordings(pair[:1], pair[1:], sprung)
    spring = next(one for one in result.changes if one.quantity.kind == "effect")
    assert spring.quantity.words == "stiffness of gravity spring of joint 2"
    assert spring.before is not None and abs(spring.before) < 4 * (spring.std_before or 0.0)
    assert not spring.significant
    assert names(result, "friction") == {"joint3.coulomb"}
