"""Friction of identifications in which it is a curve over speed: compared at speeds that all of them know.

The values of two curves are at different speeds, and the level and slope beside them are those of lines over different
ranges. What all say is friction at a speed. Where friction depends on temperature in all of them, it is that at one
temperature: each identification states the one of its own recordings.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from arm_model import Arm
from arm_model.effects import CATALOGUE, Signals, values_of
from comparison.change import Quantity
from comparison.wording import point_quantity

POINTS = 5
"""Speeds per joint and direction that are compared."""
Entry = tuple[float, float | None, str]
"""Value, standard deviation, unit."""


def curved_joints(tables: Sequence[Mapping[str, Any]]) -> set[int]:
    """Joints (from 1) whose friction is a curve, or depends on temperature, in any of some identification.json."""
    bands = [band for table in tables for band in table.get("friction_curves", [])]
    warm = {j for table in tables for j in {band["joint"] for band in bands} if _over_temperature(table, j)}
    return warm | {band["joint"] for band in bands if band["curve"]}


def is_replaced(name: str, joints: set[int]) -> bool:
    """Whether friction at speeds stands for a base parameter of one of the joints (from 1)."""
    head, _, quantity = name.partition(".")
    return head in {f"joint{joint}" for joint in joints} and quantity.startswith(("coulomb", "viscous", "curve"))


def friction_points(
    arm: Arm, tables: Sequence[Mapping[str, Any]], joints: set[int]
) -> tuple[list[Quantity], list[dict[str, Entry]]]:
    """Friction of the joints (from 1) at common speeds, and what each identification says of it, by name."""
    quantities: list[Quantity] = []
    entries: list[dict[str, Entry]] = [{} for _ in tables]
    for joint in sorted(joints):
        bands = [[band for band in table.get("friction_curves", []) if band["joint"] == joint] for table in tables]
        if not all(bands):
            continue
        alike = all(len(curves) == 1 for curves in bands)
        # a curve may begin at standstill, where friction has no direction
        low = max(next((v for v in band["speed"] if v > 0.0), np.inf) for curves in bands for band in curves)
        high = min(band["speed"][-1] for curves in bands for band in curves)
        if low >= high:
            continue
        for direction in ("positive",) if alike else ("positive", "negative"):
            sides = [next(band for band in curves if band["direction"] in (direction, "both")) for curves in bands]
            degc = common_temperature(tables, joint)
            for speed in np.geomspace(low, high, POINTS):
                way = 1.0 if direction == "positive" else -1.0
                quantity = point_quantity(arm, joint - 1, way, float(speed))
                quantities.append(quantity)
                for entry, band, table in zip(entries, sides, tables):
                    torque, std = (float(np.interp(speed, band["speed"], band[key])) for key in ("torque", "std"))
                    more, more_std = (0.0, 0.0) if degc is None else warmed(table, joint, degc, float(speed))
                    entry[quantity.name] = torque + more, float(np.hypot(std, more_std)), quantity.unit
    return quantities, entries


def common_temperature(tables: Sequence[Mapping[str, Any]], joint: int) -> float | None:
    """degC, mean of those at which the friction of a joint (from 1) holds; None where one does not depend on it."""
    temperatures = [one["temperature"] for table in tables for one in _over_temperature(table, joint)]
    return float(np.mean(temperatures)) if temperatures and len(temperatures) == len(tables) else None


def warmed(table: Mapping[str, Any], joint: int, degc: float, speed: float) -> tuple[float, float]:
    """N m (N): by how much friction at a speed is more at a temperature than where it was identified, and its std."""
    total, variance = 0.0, 0.0
    for one in _over_temperature(table, joint):
        seen = Signals(v=speed, sign=1.0, warmer=degc - one["temperature"])
        for name, size in one["parameters"].items():
            effect, _, parameter = name.partition(".")
            held = {key.partition(".")[2]: value for key, value in one["held"].items() if key.startswith(f"{effect}.")}
            law = CATALOGUE[effect].torque
            assert law is not None, "friction over temperature is a torque"
            unit = float(law(values_of(CATALOGUE[effect], {**held, parameter: 1.0}), seen))
            total, variance = total + unit * size["value"], variance + (unit * size["std"]) ** 2
    return total, variance**0.5


def _over_temperature(table: Mapping[str, Any], joint: int) -> list[Mapping[str, Any]]:
    depends = table.get("friction_dependence", [])
    return [one for one in depends if one["joint"] == joint and one["stays"] and one["on"] == "temperature"]
