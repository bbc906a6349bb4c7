"""Ripples and encoder errors per turn of the joint and of the shafts of a gear have their names and orders."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_model import Arm, GearStage
from arm_model.rigid_body.numeric import rigid_torque
from daq.recording import Attachments, Recording, open_recording, write_table
from diagnosis.diagnose import diagnose
from diagnosis.selection.ripple_orders import _waves, in_words, of_shafts, order_of, shaft_in_words, side_band
from tests.comparison.second_day import motion, puma

TEETH, TORQUE, MISREAD = 45, 0.8, 4e-4
"""Cycles per turn of joint 1; N m and rad."""


def _recorded(
    path: Path,
    arm: Arm,
    seed: int,
    torque: float,
    misread: float,
    uneven: float = 0.0,
    others: Sequence[tuple[float, float]] = (),
) -> Recording:
    """others: N m and cycles per turn of joint 1 of further waves of torque."""
    rng, t = np.random.default_rng(seed), np.arange(3000) / 250.0
    # side bands show over half a turn or more
    q, qd, qdd = (one * [2.5 if uneven else 1.0, 1.0] for one in motion(t, 2, seed, 0.8))
    needed = rigid_torque(arm, q, qd, qdd)
    for j, joint in enumerate(arm.joints):
        v = qd[:, j]
        dry = joint.ratio * np.where(v > 0, joint.coulomb[0], joint.coulomb[1])
        needed[:, j] += dry * v / np.hypot(v, joint.sign_velocity) + joint.ratio**2 * joint.viscous[0] * v
        needed[:, j] += joint.ratio**2 * joint.rotor_inertia * qdd[:, j]
    wave = np.sin(TEETH * q[:, 0] + 0.4) * (1.0 + uneven * np.cos(q[:, 0] - 0.8))
    needed[:, 0] += torque * wave + sum(size * np.sin(cycles * q[:, 0] + cycles) for size, cycles in others)
    i = needed / arm.joint_array("drive_constant") + 0.02 * rng.standard_normal(q.shape)
    read = q + misread * wave[:, None] * (np.arange(2) == 0)
    write_table(path, t, {"q": np.round(read / 1e-5) * 1e-5, "i": i}, Attachments())
    return open_recording(path)


@pytest.mark.parametrize(
    ("effect", "amplitude", "torque", "misread"),
    [("gear_ripple", "torque", TORQUE, 0.0), ("encoder_ripple", "amplitude", 0.0, MISREAD)],
)
def test_a_wave_per_turn_of_the_joint_is_named_with_its_order(
    effect: str, amplitude: str, torque: float, misread: float, tmp_path: Path, root: Path
) -> None:
    arm = puma(root, 2)
    runs = [_recorded(tmp_path / f"{seed}.mcap", arm, seed, torque, misread) for seed in (1, 2, 3)]
    found = diagnose(arm, runs[:2], runs[2:])
    (cause,) = found.causes
    assert cause.key == (effect, 1) and found.verdict == "explained"
    values = {p.name: p for p in cause.parameters}
    assert values["order"].value * arm.joints[0].ratio == pytest.approx(TEETH)
    assert abs(values[amplitude].value - (torque or misread)) < 3 * values[amplitude].std
    assert f"{TEETH} cycles per turn of the joint" in cause.evidence
    (term,) = found.extended.effects
    assert set(term.parameters) == {amplitude, "order", "phase"}


def test_side_bands_of_uneven_teeth_belong_to_the_ripple(tmp_path: Path, root: Path) -> None:
    """Torque that waves with the teeth, more on one side of the wheel: three orders, and one cause.

    Without side bands the ripple was withdrawn, as a function of the motor's angle left less.
    """
    arm = puma(root, 2)
    runs = [_recorded(tmp_path / f"{seed}.mcap", arm, seed, 2.0, 0.0, 0.5) for seed in (1, 2, 3)]
    found = diagnose(arm, runs[1:], runs[:1])
    (cause,) = found.causes
    assert cause.key == ("gear_ripple", 1) and found.verdict == "explained"
    values = {p.name: p.value for p in cause.parameters}
    ratio = arm.joints[0].ratio
    assert values["order"] * ratio == pytest.approx(TEETH) and values["torque"] == pytest.approx(2.0, rel=0.05)
    bands = {round(term.parameters["order"] * ratio): term.parameters["torque"] for term in cause.harmonics}
    assert bands == pytest.approx({TEETH - 1: 0.5, TEETH + 1: 0.5}, rel=0.2)
    assert "side band -1 per turn of the joint" in cause.evidence


@pytest.mark.parametrize("torque", [0.0, TORQUE])
def test_ripples_of_two_wheels_and_of_two_orders_of_a_motor_are_named(
    torque: float, tmp_path: Path, root: Path
) -> None:
    """Each order is a term of one cause: a second one was unexplained, or was named a position error of the gear."""
    arm = puma(root, 2)
    ratio = arm.joints[0].ratio
    (own, of_motor) = ([(0.6, 61.0)], []) if torque else ([], [(TORQUE, 3 * ratio), (0.6, 5 * ratio)])
    runs = [_recorded(tmp_path / f"{seed}.mcap", arm, seed, torque, 0.0, others=own + of_motor) for seed in (1, 2, 3)]
    found = diagnose(arm, runs[:2], runs[2:])
    (cause,) = found.causes
    assert cause.key == ("gear_ripple" if torque else "cogging", 1) and found.verdict == "explained"
    name, order = ("torque", "order") if torque else ("amplitude", "pole_pairs")
    (further,) = cause.harmonics
    values = {p.name: p.value for p in cause.parameters}
    assert values[name] == pytest.approx(TORQUE, rel=0.02) and further.parameters[name] == pytest.approx(0.6, rel=0.03)
    both = [values[order] * ratio, further.parameters[order] * ratio]
    assert both == pytest.approx([TEETH, 61.0] if torque else [3 * ratio, 5 * ratio])
    where = "61 cycles per turn of the joint" if torque else "5 cycles per turn of the motor"
    assert f"further order, {where}" in cause.evidence


def test_side_bands_are_turns_of_a_slower_shaft_away(root: Path) -> None:
    joint = replace(puma(root, 2).joints[0], gear=-30.0, gear_stage=(GearStage(6.0, 72), GearStage(5.0, 95)))
    turn = 1 / 30.0
    assert side_band(96 * turn, 95 * turn, joint) == (1, pytest.approx(turn))
    assert side_band(93 * turn, 95 * turn, joint) == (-2, pytest.approx(turn))
    # by the shaft between, five turns of the joint each
    whole, own = side_band(90 * turn, 95 * turn, joint) or (0, 0.0)
    assert (whole, shaft_in_words(own, joint)) == (-1, "the shaft behind stage 1 of the gear")
    assert shaft_in_words(turn, joint) == "the joint"
    # neither the same order, nor one far away, nor few cycles per turn
    for order, carrier in ((95.0, 95.0), (98.0, 95.0), (2.0, 1.0)):
        assert side_band(order * turn, carrier * turn, joint) is None


def test_stages_have_the_orders_of_their_teeth_side_bands_and_shafts(root: Path) -> None:
    """Two spur stages, 6 and 5, with 72 and 95 teeth on the driven wheels."""
    arm = puma(root, 2)
    joint = replace(arm.joints[0], gear=-30.0, gear_stage=(GearStage(6.0, 72), GearStage(5.0, 95)))
    arm = replace(arm, joints=(joint, *arm.joints[1:]))
    orders = {order_of(c): c for c in of_shafts(arm) if c.joint == 1 and c.effect == "gear_ripple"}
    per_joint_turn = np.array([order for order in orders if order is not None]) * 30.0

    def there(*values: float) -> bool:
        return all(np.abs(per_joint_turn - value).min() < 1e-6 for value in values)

    # the first mesh is 72 x 5 = 360 per turn of the joint, the 12th order of the motor, which is searched already
    assert not there(360.0) and there(355.0, 365.0, 350.0, 370.0)
    assert there(95.0, 190.0, 285.0, 94.0, 96.0, 100.0, 105.0)
    # run-out of the shaft between, and what the joint has without stages
    assert there(5.0, 10.0, 45.0)
    words = in_words(orders[min(orders, key=lambda order: abs((order or 0.0) * 30.0 - 5.0))], joint)
    assert words == "5 cycles per turn of the joint, 1 of the shaft behind stage 1 of the gear, 0.1667 of the motor"


def test_stages_must_multiply_to_the_gear(root: Path) -> None:
    joint = puma(root, 2).joints[0]
    with pytest.raises(ValueError, match="must be that of the gear, 30"):
        replace(joint, gear=30.0, gear_stage=(GearStage(6.0), GearStage(4.0)))


def test_waves_that_follow_one_another_are_sines_of_their_orders() -> None:
    motor = np.random.default_rng(5).uniform(-300.0, 300.0, 2000)
    for orders in (np.arange(1.0, 61.0), np.array([n / 62.61 for n in range(10, 101)]), np.array([1 / 7, 0.4, 3.0])):
        for order, wave in zip(orders, _waves(orders, motor)):
            assert np.max(np.abs(wave - (np.cos(order * motor) + 1j * np.sin(order * motor)))) < 1e-9
