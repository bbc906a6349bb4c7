"""Columns of the wrench on a floating base times the parameters are the wrench: identities on random states."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm_model import parameter, with_parameters
from arm_model.moving_base.numeric import forces_with_base
from arm_model.moving_base.regressor import (
    PAYLOAD,
    hull_wrench,
    nominal_wrench_parameters,
    thrust_of,
    wrench_columns,
)
from arm_model.simulation import simulate
from arm_model.tables import base_parameters
from tests.arm_model.floating_arms import floating_arm, random_rows
from tests.arm_model.random_arms import random_states


@pytest.mark.parametrize("seed", range(3))
def test_columns_times_parameters_and_hull_are_the_wrench(seed: int) -> None:
    arm, rows = floating_arm(seed, water=True), random_rows(seed)
    assert arm.floating is not None
    joints = random_states(seed, len(arm))
    thrust = np.random.default_rng(seed).normal(size=(20, 2))
    values = np.array(list(nominal_wrench_parameters(arm).values()))
    found = hull_wrench(arm, rows) - wrench_columns(arm, rows, joints, thrust) @ values
    gains = [one.gain for one in arm.floating.thruster]
    expected = forces_with_base(arm, rows, *joints)[:, :6] - thrust * gains @ arm.floating.allocation.T
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


def test_thrust_is_its_law_in_the_simulation_and_in_numbers() -> None:
    """One sound thruster, and one that is weak forwards, in reverse and near zero."""
    sound = floating_arm(4)
    assert sound.floating is not None
    faults = {"thruster1.forward": 0.7, "thruster1.reverse": 0.4, "thruster1.dead_zone": 1.5, "thruster1.gain": 0.9}
    weak = with_parameters(sound, faults)
    assert weak.floating is not None
    demand = np.array([-6.0, -1.0, 0.0, 1.4, 5.0])
    expected = [-0.4 * 4.5, 0.0, 0.0, 0.0, 0.7 * 3.5]
    np.testing.assert_allclose(thrust_of(demand, weak.floating.thruster[0]), expected)
    pulled = []
    for arm, thrust in ((sound, 0.9 * 0.7 * 3.5), (weak, 5.0)):
        run = simulate(arm, lambda t, u=thrust: np.tile([*np.zeros(4), u, 0.0], (len(t), 1)), duration=0.05, rate=100)
        assert run.base is not None
        pulled.append(run.base.velocity)
    np.testing.assert_allclose(pulled[0], pulled[1], atol=1e-9)


def test_a_payload_at_the_tool_is_its_column() -> None:
    arm, rows = floating_arm(5, water=True), random_rows(5)
    joints = random_states(5, len(arm))
    column = wrench_columns(arm, rows, joints, np.zeros((20, 2)))[
        :, :, list(nominal_wrench_parameters(arm)).index(PAYLOAD)
    ]
    loaded = arm.with_effect("payload", mass=0.7, x=0.0, y=0.0, z=0.0)
    from arm_model.effects import described

    bare = replace(described(loaded), effects=())
    change = forces_with_base(bare, rows, *joints)[:, :6] - forces_with_base(arm, rows, *joints)[:, :6]
    np.testing.assert_allclose(change, -0.7 * column, rtol=1e-9, atol=1e-9)


def test_every_parameter_of_a_base_can_be_set_and_read() -> None:
    arm = floating_arm(3, water=True)
    assert arm.floating is not None
    for number, (name, value) in enumerate(base_parameters(arm.floating).items(), 1):
        changed = with_parameters(arm, {name: value + 0.01 * number})
        assert parameter(changed, name) == pytest.approx(value + 0.01 * number)
        others = [other for other in base_parameters(arm.floating) if other != name]
        for other in others:
            assert parameter(changed, other) == pytest.approx(parameter(arm, other)), (name, other)
