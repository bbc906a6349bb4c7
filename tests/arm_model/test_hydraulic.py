"""Hydraulic drives: their lag is of first order, their force falls with the flow, and the AA300 moves by them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from arm_model.control.computed_torque import Reference
from arm_model.control.hydraulic import HydraulicDrives, Hydraulics
from arm_model.control.proportional_derivative import ProportionalDerivative, tuned
from arm_model.control.torque_control import controlled
from arm_model.description import Arm, Joint
from arm_model.model_file import read_model
from examples.aa300 import driven

ONE = Hydraulics(stall=np.array([400.0]), free=np.array([0.5]), lag=0.05)
SLIDE = Arm(name="slide", gravity=(0.0, 0.0, 0.0), joints=(Joint(type="prismatic", mass=80.0),))


def constant(force: float) -> ProportionalDerivative:
    """That force at a demand of 1 m while the joint is near 0."""
    return ProportionalDerivative(np.array([force]), np.zeros(1))


def test_force_at_rest_follows_a_command_with_the_lag() -> None:
    drives = HydraulicDrives(constant(100.0), ONE, 0.004, np.zeros(1))
    still, one = np.zeros(1), Reference(np.ones(1), np.zeros(1), np.zeros(1))
    found = [drives.torque(still, still, one)[0] for _ in range(50)]
    np.testing.assert_allclose(found, 100.0 * -np.expm1(-0.004 * np.arange(1, 51) / 0.05), rtol=1e-12)


@given(st.floats(-2.0, 2.0), st.floats(1.0, 1e4), st.floats(0.01, 3.0))
def test_power_of_the_drive_is_that_of_pressure_times_flow(speed: float, stall: float, free: float) -> None:
    """Against the load |v| = v_free sqrt(1 - |F| / F_stall); more than F_stall never."""
    low, high = Hydraulics(np.array([stall]), np.array([free]), 0.1).bounds(np.array([speed]))
    assert -stall <= low[0] <= high[0] <= stall
    ahead = high[0] if speed >= 0 else -low[0]
    if ahead > -stall:
        np.testing.assert_allclose(abs(speed), free * np.sqrt(1.0 - ahead / stall), atol=1e-9 * free)


def test_a_mass_reaches_the_speed_of_the_whole_flow_and_no_more() -> None:
    """With the whole force asked for: m v' = F (1 - (v / v0)^2), v = v0 tanh(F t / (m v0))."""
    quick = Hydraulics(ONE.stall, ONE.free, 1e-6)
    run = controlled(
        SLIDE,
        HydraulicDrives(constant(1e6), quick, 0.001, np.zeros(1)),
        lambda t: Reference(np.full(1, 10.0), np.zeros(1), np.zeros(1)),
        duration=0.6,
        period=0.001,
        start=np.zeros(1),
    )
    np.testing.assert_allclose(run.qd[:, 0], 0.5 * np.tanh(400.0 * run.t / (80.0 * 0.5)), atol=3e-3)
    assert run.qd.max() <= 0.5


def test_a_mass_comes_to_its_demand_as_the_gains_say() -> None:
    """Far from the limits and with little lag: critically damped, e = (1 + w t) exp(-w t)."""
    strong = Hydraulics(np.array([1e6]), np.array([100.0]), 1e-4)
    servo = tuned(SLIDE, np.zeros(1), np.array([3.0]))
    run = controlled(
        SLIDE,
        HydraulicDrives(servo, strong, 0.001, np.zeros(1)),
        lambda t: Reference(np.full(1, 0.1), np.zeros(1), np.zeros(1)),
        duration=2.0,
        period=0.001,
        start=np.zeros(1),
    )
    np.testing.assert_allclose(0.1 - run.q[:, 0], 0.1 * (1 + 3 * run.t) * np.exp(-3 * run.t), atol=1e-3)


@pytest.mark.slow
def test_the_aa300_comes_to_its_target_where_its_weight_is_fed_forward(root: Path) -> None:
    arm = read_model(root / "config/models/aa300.toml")
    run = driven(arm, 9.0, weight=True)
    error = np.abs(run.demand - run.q)
    assert (error[-1] < 1e-3).all() and (error.max(axis=0) < 0.04).all()
