"""The quantities reported: base parameters, points of friction curves, and level and slope of each joint's friction.

All are linear maps of the values that the regression estimates.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from comparison.change import Quantity
from comparison.friction_curves import level_and_slope
from comparison.load_friction import loaded_joints
from comparison.regression import Structure
from comparison.wording import friction_quantity, load_quantity, parameter_quantity, point_quantity
from identification.result import unit_of


def values_quantities(structure: Structure) -> list[Quantity]:
    """(c) the values themselves."""
    arm, base = structure.arm, structure.base
    quantities = [
        parameter_quantity(base.expression(int(row)), unit_of(base.names[column], arm))
        for row, column in zip(structure.rows, structure.kept)
    ]
    points = [
        point_quantity(arm, curve.joint, curve.direction, float(curve.speeds[k])) for curve, k in structure.points
    ]
    return [*quantities, *points, *(load_quantity(int(j)) for j in loaded_joints(structure.loads))]


def friction_maps(structure: Structure, variance: Array) -> tuple[list[Quantity], Array]:
    """Level, slope and offset of each joint's friction, and (r, c) how they follow from the values.

    variance  (c,) of the changes of the values, which weight the points; NaN where they are not comparable
    """
    quantities: list[Quantity] = []
    maps: list[Array] = []
    start = len(structure.rows)
    places = {}
    for curve in structure.curves:
        places[curve.joint, curve.direction] = np.arange(start, start + len(curve.speeds))
        start += len(curve.speeds)
    for joint in range(len(structure.arm)):
        both = [next(c for c in structure.curves if c.joint == joint and c.direction == sign) for sign in (1.0, -1.0)]
        names = ("coulomb", "viscous", "offset")
        entries = [friction_quantity(structure.arm, joint, name) for name in names]
        rows = np.full((3, len(variance)), np.nan)
        why = next((curve.why for curve in both if curve.why), "")
        if not why:
            rows[:] = 0.0
            why = _level_rows(rows, [curve.speeds for curve in both], [places[joint, s] for s in (1.0, -1.0)], variance)
        if why.startswith("slope: "):
            entries[1], why = entries[1].not_comparable(why.removeprefix("slope: ")), ""
        quantities += [entry.not_comparable(why) if why else entry for entry in entries]
        maps += list(rows)
    return quantities, np.array(maps).reshape(len(quantities), len(variance))


def _level_rows(rows: Array, speeds: Sequence[Array], places: Sequence[NDArray[np.intp]], variance: Array) -> str:
    """Fills level, slope and offset (3, c) of one joint; the reason where one cannot be had."""
    if any(np.isnan(variance[place]).any() for place in places):
        return "these motions do not separate friction from the rest of the model"
    sloped = True
    for speed, place, sign in zip(speeds, places, (1.0, -1.0)):
        shape = level_and_slope(speed, 1 / np.maximum(variance[place], 1e-300))
        rows[0, place] = shape[0] / 2
        rows[2, place] = sign * shape[0] / 2
        if len(shape) > 1:
            rows[1, place] = shape[1] / 2
        else:
            sloped = False
    if not sloped:
        rows[1] = np.nan
        return "slope: the recordings share too narrow a range of speeds"
    return ""
