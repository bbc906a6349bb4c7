"""Identifications whose friction is a curve are compared at speeds that all of them know."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from arm_model import Arm, Joint
from comparison.stored.identified_friction import POINTS, curved_joints, friction_points, is_replaced

ARM = Arm("arm", (Joint(mass=1.0), Joint(mass=1.0)))


def identification(
    low: float, high: float, level: float, directions: tuple[str, ...] = ("both",), curve: bool = True
) -> dict[str, Any]:
    speed = np.geomspace(low, high, 12)
    torque = (level + 2.0 * speed).tolist()
    bands = [
        {"joint": 2, "direction": d, "curve": curve, "speed": speed.tolist(), "torque": torque, "std": [0.1] * 12}
        for d in directions
    ]
    return {"friction_curves": bands}


def test_friction_is_compared_within_the_range_that_both_know() -> None:
    tables = [identification(0.01, 1.0, 5.0), identification(0.02, 0.7, 6.0)]
    assert curved_joints(tables) == {2}
    quantities, entries = friction_points(ARM, tables, {2})
    assert len(quantities) == POINTS
    assert all(0.02 <= abs(quantity.speed or 0.0) <= 0.7 + 1e-9 for quantity in quantities)
    for quantity in quantities:
        (before, std, unit), (after, _, _) = (entry[quantity.name] for entry in entries)
        assert (std, unit) == (0.1, "N m")
        np.testing.assert_allclose(after - before, 1.0, atol=1e-9)


def test_curves_that_begin_at_standstill_are_compared_from_their_first_speed_on() -> None:
    tables = [identification(0.01, 1.0, level) for level in (5.0, 6.0)]
    for table in tables:
        table["friction_curves"][0]["speed"][0] = 0.0
    quantities, entries = friction_points(ARM, tables, {2})
    assert len(quantities) == POINTS
    slowest = min(abs(quantity.speed or 0.0) for quantity in quantities)
    assert slowest == tables[0]["friction_curves"][0]["speed"][1] > 0.0
    for quantity in quantities:
        assert entries[1][quantity.name][0] - entries[0][quantity.name][0] == pytest.approx(1.0)


def test_friction_that_depends_on_temperature_is_compared_at_one_temperature() -> None:
    """The same joint identified at 30 and at 50 degC, with a level that falls by 0.05 N m/K."""
    tables = [identification(0.01, 1.0, level) for level in (5.0, 4.0)]
    for table, degc in zip(tables, (30.0, 50.0)):
        entry = {"joint": 2, "on": "temperature", "stays": True, "temperature": degc}
        entry["parameters"] = {"temperature_friction.coulomb": {"value": -0.05, "std": 0.001}}
        entry["held"] = {f"temperature_friction.{name}": 0.1 for name in ("stribeck_velocity", "thinning")}
        table["friction_dependence"] = [entry]
    quantities, entries = friction_points(ARM, tables, {2})
    for quantity in quantities:
        (before, std, _), (after, _, _) = (entry[quantity.name] for entry in entries)
        assert after == pytest.approx(before, abs=1e-9)
        assert std == pytest.approx(np.hypot(0.1, 0.01), abs=1e-9)
    del tables[1]["friction_dependence"]
    _, entries = friction_points(ARM, tables, {2})
    assert entries[1][quantities[0].name][0] - entries[0][quantities[0].name][0] == pytest.approx(-1.0)


def test_a_curve_for_both_directions_is_compared_with_one_for_each() -> None:
    tables = [identification(0.01, 1.0, 5.0), identification(0.01, 1.0, 5.0, ("positive", "negative"))]
    quantities, entries = friction_points(ARM, tables, {2})
    assert len(quantities) == 2 * POINTS
    assert all(quantity.name in entry for quantity in quantities for entry in entries)


def test_only_friction_of_those_joints_is_replaced() -> None:
    assert is_replaced("joint2.coulomb", {2})
    assert is_replaced("joint2.viscous_positive", {2})
    assert is_replaced("joint2.curve3", {2})
    assert not is_replaced("joint1.coulomb", {2})
    assert not is_replaced("joint2.offset", {2})
    assert curved_joints([identification(0.01, 1.0, 5.0, curve=False), {}]) == set()


def test_a_result_without_friction_over_speed_shares_none() -> None:
    quantities, entries = friction_points(ARM, [identification(0.01, 1.0, 5.0), {}], {2})
    assert quantities == []
    assert entries == [{}, {}]
