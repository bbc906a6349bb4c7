"""Variation of friction with temperature between the two sides of a comparison, in which nothing need have changed.

Recordings of one side show the scatter among themselves; what varies from day to day, no recordings of a single day
show. It is therefore assumed: a difference of temperature, and its effect on friction by the published law of a
greased robot joint (Bittencourt, Gunnarsson, J. Dyn. Sys. Meas. Control 134(5), 2012).
"""

from __future__ import annotations

import numpy as np

from arm_io.types import Array
from arm_model.tables.friction_of_days import COULOMB, NEAR_REST, UNRECORDED, VISCOUS
from comparison.regression import Structure


def friction_shapes(structure: Structure, joint: int) -> Array:
    """(4, c) level, slope, asymmetry and hump of the friction of a joint (from 0), in the compared values."""
    start, shapes = len(structure.rows), np.zeros((4, structure.size))
    for k, (curve, place) in enumerate(structure.points):
        if curve.joint == joint:
            shapes[:, start + k] = 1.0, curve.speeds[place], curve.direction, float(place == 0)
    return shapes


def friction_drift(structure: Structure, values: Array, warmer: Array) -> Array:
    """(c, 3 J) changes of the compared values by one standard deviation each of independent differences of friction.

    values  (c,) of the arm, NaN where they are not known
    warmer  (J,) K by which the side after was warmer; NaN where it was not recorded. The standard deviation of the
            temperature is that, and ``UNRECORDED`` at least: it is measured at the motor, and friction is in the gear
    """
    kelvin = np.fmax(np.abs(warmer), UNRECORDED)
    points = np.zeros(structure.size, bool)
    points[len(structure.rows) : len(structure.rows) + len(structure.points)] = True
    drift = []
    for joint in range(len(structure.arm)):
        level, slope, asymmetry, hump = shapes = friction_shapes(structure, joint)
        seen = points & (level > 0.0) & np.isfinite(values)
        size = np.zeros(2)
        if seen.any():
            columns = shapes[:, seen].T
            if not np.ptp(asymmetry[seen]):
                # of one direction, nothing distinguishes it from the level
                columns[:, 2] = 0.0
            size = np.abs(np.linalg.lstsq(columns, values[seen], rcond=None)[0][:2])
        shares = COULOMB * size[0], VISCOUS * size[1], NEAR_REST * size[0]
        drift += [kelvin[joint] * share * shape for share, shape in zip(shares, (level, slope, hump))]
    return np.column_stack(drift)


def friction_size(speed: Array, torque: Array) -> Array:
    """(2,) size of the level and of the slope of friction ``torque`` (K,) over ``speed`` (K,), apart from near rest."""
    if len(speed) < 3:
        return np.array([np.abs(np.mean(torque)), 0.0])
    columns = np.column_stack([np.ones_like(speed), speed, np.arange(len(speed)) == 0])
    return np.asarray(np.abs(np.linalg.lstsq(columns, torque, rcond=None)[0][:2]))


def assumed(count: int, what: str = "recordings") -> str:
    """A sentence with the assumption about temperature, for ``count`` recordings (``what``) of both sides together.

    A result does not say at which temperature its recordings were made.
    """
    shares = [f"{100 * UNRECORDED * share:.2g} %" for share in (COULOMB, VISCOUS, NEAR_REST)]
    one = what.removesuffix("es") + "is" if what == "diagnoses" else what.removesuffix("s")
    unknown = (
        f"one {one} per side: how much friction differs from one {one} to the next cannot be estimated"
        if count == 2
        else f"{what} of one day do not show how much friction differs from day to day"
    )
    measured = ", or of the recorded one" if what == "recordings" else ""
    return (
        f"{unknown}; assumed is the effect of a temperature difference of {UNRECORDED:g} K (std){measured}: "
        f"{shares[0]} of Coulomb friction, {shares[1]} of viscous friction, near rest {shares[2]} of Coulomb friction "
        "(Bittencourt, Gunnarsson 2012)"
    )
