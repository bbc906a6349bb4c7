"""The friction of each joint over its speed, as an identification writes it, with its confidence band."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from arm_model.effects import total_friction
from identification.regression.friction_rows import friction_at
from identification.regression.problem import Problem
from identification.regression.uncertainty import FitUncertainty

SMEARED = 1.5
"""Times the lowest speed: below, a joint has just reversed, and filters smear what friction did there."""
LOWEST = 1e-3
"""Share of the highest speed, below which no band of a straight line begins."""
STRAIGHT = 10
"""Speeds at which a straight line is given, each the same factor apart: the lowest differ most in their std."""


@dataclass(frozen=True, kw_only=True)
class FrictionBand:
    """Friction of a joint (from 1) in one direction (1 or -1; 0: the same in both), N m (N) against the motion.

    speed (k,) rad/s (m/s); torque (k,): that of model.toml; std (k,) of it: from the fit, from the straight lines
    between the speeds of a curve, and from reversals, which friction at the lowest speeds is not free of. curve:
    whether it is a curve in model.toml, at these speeds, or a straight line.
    """

    joint: int
    direction: int
    speed: Array
    torque: Array
    std: Array
    curve: bool

    def to_json(self) -> dict[str, Any]:
        """As identification.json has it."""
        return {
            "joint": self.joint,
            "direction": {1: "positive", -1: "negative", 0: "both"}[self.direction],
            "curve": self.curve,
            "speed": self.speed.tolist(),
            "torque": self.torque.tolist(),
            "std": self.std.tolist(),
        }


def _between(speed: Array, torque: Array) -> Array:
    """(k,) N m (N) by which straight lines between the speeds may be off a smooth curve: h^2 |f''| / 8, as two std."""
    step, slope = np.diff(speed), np.diff(torque) / np.diff(speed)
    off = np.zeros_like(speed)
    off[1:-1] = (step[1:] + step[:-1]) / 2 * np.abs(np.diff(slope)) / 16
    return off


def bands_of(problem: Problem, arm: Arm, uncertainty: FitUncertainty) -> list[FrictionBand]:
    """Of every joint that slides in the fitted runs; ``arm``: the one that is written."""
    names = [problem.base.names[k] for k in problem.columns]
    bands = []
    for j, joint in enumerate(arm.joints):
        v = np.concatenate([np.abs(motion.qd[motion.certain[:, j], j]) for motion in problem.motions])
        if not v.any():
            continue
        curve = joint.friction_curve
        high = float(v.max())
        low = max(float(np.quantile(v, 0.01)), LOWEST * high)
        speed = np.geomspace(low, high, STRAIGHT) if curve is None else np.array(curve.speed)
        same = problem.friction == "symmetric" and joint.coulomb[0] == joint.coulomb[1]
        for direction in (1,) if same else (1, -1):
            rows = friction_at(problem.arm, names, j, speed, direction)
            torque = total_friction(arm, j, speed, direction)
            std = np.sqrt(np.maximum(np.einsum("ka,ab,kb->k", rows, uncertainty.covariance, rows), 0.0))
            # a curve of the model may begin at standstill
            reversing = torque * np.exp(-((speed / (SMEARED * (speed[0] or low))) ** 2))
            std = np.sqrt(std**2 + _between(speed, torque) ** 2 + reversing**2)
            bands.append(
                FrictionBand(
                    joint=j + 1,
                    direction=0 if same else direction,
                    speed=speed,
                    torque=torque,
                    std=std,
                    curve=curve is not None,
                )
            )
    return bands
