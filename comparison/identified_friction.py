"""Friction of identifications in which it is a curve over speed: compared at speeds that all of them know.

The values of two curves are at different speeds, and the level and slope beside them are those of lines over different
ranges. What all say is friction at a speed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from arm_model import Arm
from comparison.change import Quantity
from comparison.wording import point_quantity

POINTS = 5
"""Speeds per joint and direction that are compared."""
Entry = tuple[float, float | None, str]
"""Value, standard deviation, unit."""


def curved_joints(tables: Sequence[Mapping[str, Any]]) -> set[int]:
    """Joints (from 1) whose friction is a curve in any of some identification.json."""
    return {band["joint"] for table in tables for band in table.get("friction_curves", []) if band["curve"]}


def is_replaced(name: str, joints: set[int]) -> bool:
    """Whether friction at speeds stands for a base parameter of one of the joints (from 1)."""
    head, _, rest = name.partition(".")
    return head in {f"joint{joint}" for joint in joints} and rest.startswith(("coulomb", "viscous", "curve"))


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
        alike = all(len(own) == 1 for own in bands)
        low = max(band["speed"][0] for own in bands for band in own)
        high = min(band["speed"][-1] for own in bands for band in own)
        if low >= high:
            continue
        for direction in ("positive",) if alike else ("positive", "negative"):
            sides = [next(band for band in own if band["direction"] in (direction, "both")) for own in bands]
            for speed in np.geomspace(low, high, POINTS):
                way = 1.0 if direction == "positive" else -1.0
                quantity = point_quantity(arm, joint - 1, way, float(speed))
                quantities.append(quantity)
                for entry, band in zip(entries, sides):
                    torque, std = (float(np.interp(speed, band["speed"], band[key])) for key in ("torque", "std"))
                    entry[quantity.name] = torque, std, quantity.unit
    return quantities, entries
