"""Friction of an arm as rows of its parameters: what opposes the motion of every joint, by speed and direction.

Friction that dissipates at every speed is one inequality per row (``physical_consistency``); its torque at a speed, and
the std of that, are the row times the parameters and their covariance (``identification.friction_band``).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from arm_model.effects import CATALOGUE, effect_friction, speeds
from arm_model.friction_split import unit_departure
from identification.regression.effect_columns import is_effect


def friction_rows(arm: Arm, names: Sequence[str], top: Sequence[float] | Array) -> Array:
    """(k, p) N m (N) against the motion, per unit of each parameter: one row per joint, direction and speed.

    Speeds up to ``top`` (n,) rad/s (m/s). Columns of what is no friction are zero.
    """
    found = []
    for j in range(len(arm)):
        v = speeds(arm, j, float(top[j]))
        for direction in (1, -1):
            rows = friction_at(arm, names, j, v, direction)
            found.append(rows[np.any(rows != 0, axis=1)])
    return np.concatenate([np.empty((0, len(names))), *found])


def friction_at(arm: Arm, names: Sequence[str], j: int, v: Array, direction: int) -> Array:
    """(k, p) N m (N) against the motion of joint j (from 0) at speeds v (k,) >= 0, per unit of each parameter.

    v: rad/s (m/s); direction: 1 or -1.
    """
    powers, side = {"viscous": 1, "coulomb": 0}, "positive" if direction > 0 else "negative"
    held = {term.name: term.parameters for term in arm.effects if term.joint == j + 1}
    rows = np.zeros((len(v), len(names)))
    for k, name in enumerate(names):
        head, _, quantity = name.partition(".")
        kind, _, way = quantity.partition("_")
        if head != f"joint{j + 1}":
            continue
        if kind in powers and way in ("", side):
            rows[:, k] = v ** powers[kind]
        elif way in ("", side) and (unit := unit_departure(arm.joints[j], kind, v)) is not None:
            rows[:, k] = unit
        elif is_effect(name) and (effect := CATALOGUE[quantity.split(".")[0]]).friction:
            linear = {p.name: float(p.name == quantity.split(".")[1]) for p in effect.linear}
            rows[:, k] = effect_friction(effect, {**held[effect.name], **linear}, v, direction)
    return rows
