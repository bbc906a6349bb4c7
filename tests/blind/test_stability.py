"""The second generator's servos are stable: what the matrix from tick to tick says, against the plant's own motion."""

from __future__ import annotations

import numpy as np
import pytest

from arm_io.types import Array
from tests.blind.second.cases import cases
from tests.blind.second.laboratory import POSE, POSES, arm_of, plant_of, servo_of
from tests.blind.second.plant import Plant, Servo, motion
from tests.blind.second.stability import MARGIN, from_tick_to_tick, growing, scaled

SIX = np.ones(6)


def _healthy(seed: int, number: int) -> tuple[Plant, Servo]:
    where = list(cases("empties", seed, 3))[number].where
    plant = plant_of(where, arm_of(where))
    return plant, servo_of(where, plant)


def _rings(plant: Plant, servo: Servo, seconds: float) -> Array:
    """(ticks, 6) rad: motor angles less links' after a step of demand of a tenth of a milliradian, without friction."""
    none, six = np.zeros((6, 2)), np.ones(6)
    plant = plant._replace(coulomb=none, gravity=np.zeros(3), limit=np.inf * six, count=1e-12 * six)
    ticks = round(seconds / servo.period)
    demand = np.tile(POSE, (ticks, 1))
    demand[10:] += 1e-4
    none = np.zeros((ticks, 6))
    angle, link, _ = motion(plant, servo, 0.0, demand, none, none, np.zeros(6), 8)
    return (angle - link)[::8]


def _growth(wave: Array, period: float) -> float:
    """1/s: slope of the logarithm of a wave's rms over its second half."""
    parts = np.array_split(wave[len(wave) // 2 :], 8)
    level = np.log([np.sqrt(np.mean(part**2)) for part in parts])
    return float(np.polyfit(np.arange(8) * len(parts[0]) * period, level, 1)[0])


@pytest.mark.parametrize("times", [1.0, 1.8 * MARGIN])
def test_waves_grow_and_fade_as_the_matrix_says(times: float) -> None:
    plant, servo = _healthy(20302, 2)
    servo = scaled(servo, times * SIX)
    values = np.log(np.linalg.eigvals(from_tick_to_tick(plant, servo, POSE)).astype(complex)) / servo.period
    # the resonance of joint 1, which has the heaviest link
    mode = values[np.argmax(np.where(np.abs(values.imag) > 2 * np.pi * 150.0, values.real, -np.inf))]
    ring = _rings(plant, servo, 0.35)[:, 0]
    slow = np.convolve(ring, np.ones(15) / 15, "same")
    assert (mode.real > 0) == (times > MARGIN)
    assert _growth((ring - slow)[20:-20], servo.period) == pytest.approx(mode.real, rel=0.15)


@pytest.mark.parametrize("number", range(3))
def test_servos_have_a_gain_margin_in_every_pose(number: int) -> None:
    # number 2 oscillated at 186 Hz with the gains of a rigid joint
    plant, servo = _healthy(20302, number)
    assert all(growing(plant, scaled(servo, 0.99 * MARGIN * SIX), pose) is None for pose in POSES)


def test_a_joint_that_oscillates_is_told() -> None:
    plant, servo = _healthy(20302, 0)
    for joint in (1, 2, 3):
        share = SIX.copy()
        share[joint - 1] = 30.0
        assert growing(plant, scaled(servo, share), POSE) == joint
