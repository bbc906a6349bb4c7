"""Parameters of a floating base by name.

base.added_mass_{DEGREE} .linear_drag_{DEGREE} .quadratic_drag_{DEGREE}
                               of surge, sway, heave (kg, N s/m, N s2/m2), roll, pitch, yaw (kg m2, N m s/rad,
                               N m s2/rad2); added mass: the diagonal
base.displaced_mass            kg
base.lift_x .lift_y .lift_z    kg m: first moment of the displaced water, displaced mass times buoyancy centre
thruster{k}.gain               thrust over demanded thrust, of thruster k from 1
thruster{k}.forward .reverse   share of that for positive and negative demands
thruster{k}.dead_zone          N: demand that gives nothing
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from arm_model.tables.floating_base import DEGREES, FloatingBase, Thruster

PER_DEGREE = {
    "added_mass": ("kg", "kg m2"),
    "linear_drag": ("N s/m", "N m s/rad"),
    "quadratic_drag": ("N s2/m2", "N m s2/rad2"),
}
"""Kinds of parameters that each degree of freedom has, and their units for shifts and turns."""
AXES = ("x", "y", "z")
OF_THRUSTER = {"gain": "1", "forward": "1", "reverse": "1", "dead_zone": "N"}
"""Parameters of each thruster, and their units."""


def base_parameters(base: FloatingBase) -> dict[str, float]:
    """All parameters by name."""
    diagonal, moment = np.diag(base.added), base.displaced_mass * np.array(base.buoyancy_centre)
    values: dict[str, Sequence[float]] = {
        "added_mass": diagonal.tolist(),
        "linear_drag": base.linear_drag,
        "quadratic_drag": base.quadratic_drag,
    }
    named = {f"base.{kind}_{DEGREES[k]}": float(values[kind][k]) for kind in PER_DEGREE for k in range(6)}
    named["base.displaced_mass"] = base.displaced_mass
    named |= {f"base.lift_{axis}": float(value) for axis, value in zip(AXES, moment)}
    thrusters = enumerate(base.thruster, 1)
    return named | {f"thruster{k}.{name}": float(getattr(one, name)) for k, one in thrusters for name in OF_THRUSTER}


def unit_of(name: str) -> str:
    """Unit of a parameter."""
    head, _, quantity = name.partition(".")
    if head != "base":
        return OF_THRUSTER[quantity]
    if quantity == "displaced_mass":
        return "kg"
    kind, _, degree = quantity.rpartition("_")
    return "kg m" if kind == "lift" else PER_DEGREE[kind][DEGREES.index(degree) >= 3]


def with_base_parameters(base: FloatingBase, values: Mapping[str, float]) -> FloatingBase:
    """The base with these parameters changed. KeyError for a name that it has not.

    Drag, displaced mass and dead zones that are negative become 0: an estimate may be below it by its uncertainty.
    """
    nominal = base_parameters(base)
    for name in values:
        nominal[name]
    now = {**nominal, **values}

    def six(kind: str) -> tuple[float, float, float, float, float, float]:
        a, b, c, d, e, f = (max(float(now[f"base.{kind}_{degree}"]), 0.0) for degree in DEGREES)
        return a, b, c, d, e, f

    added = base.added
    for k, value in enumerate(six("added_mass")):
        added[k, k] = value
    displaced = max(float(now["base.displaced_mass"]), 0.0)
    x, y, z = (float(now[f"base.lift_{axis}"]) / displaced if displaced else 0.0 for axis in AXES)
    thrusters = tuple(_thruster(thruster, k, now) for k, thruster in enumerate(base.thruster, 1))
    return replace(
        base,
        added_mass=added.tolist(),
        linear_drag=six("linear_drag"),
        quadratic_drag=six("quadratic_drag"),
        displaced_mass=displaced,
        buoyancy_centre=(x, y, z),
        thruster=thrusters,
    )


def _thruster(thruster: Thruster, k: int, values: Mapping[str, float]) -> Thruster:
    gain, forward, reverse, dead_zone = (float(values[f"thruster{k}.{name}"]) for name in OF_THRUSTER)
    return replace(thruster, gain=gain, forward=forward, reverse=reverse, dead_zone=max(dead_zone, 0.0))
