"""Arguments of the laws of effects, along the rows of a residual."""

from __future__ import annotations

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from arm_model.effects import Signals
from diagnosis.residual.expected_current import coulomb_at
from diagnosis.residual.run import Run
from diagnosis.residual.warmth import warmth

SHARPNESS = 0.01
"""Share of its highest speed at which a joint counts as moving fully in one direction, where nothing else says so."""


def direction_of(v: Array) -> Array:
    """(m,) direction of motion, from -1 to 1, at speeds v (m,) per second, without a Coulomb smoothing velocity."""
    return np.asarray(v / np.hypot(v, SHARPNESS * max(float(np.max(np.abs(v))), 1e-12)))


def signals_of(run: Run, arm: Arm, joint: int, *, link_side: bool = False) -> Signals:
    """Arguments (m,) of the laws of effects at one joint (1-based) of a run.

    ``link_side``: the speed is that of the link; it differs from that of the motor where joints are coupled.

    The current is the one that the model expects: the measured one has the residual in it, which any law of it would
    follow, whatever made it.
    """
    j = joint - 1
    drive, current = arm.joints[j], run.powered * run.along[:, j]
    v = (arm.link_angles(run.brisk_v) if link_side else run.brisk_v)[:, j]
    sign, warmer = v / np.sqrt(v**2 + drive.sign_velocity**2), warmth(run, joint)
    return Signals(
        q=arm.link_angles(run.q)[:, j],
        v=v,
        a=run.a[:, j],
        motor=drive.ratio * run.q[:, j],
        sign=sign,
        load=run.rigid[:, j],
        coulomb=coulomb_at(drive, v, sign),
        current=current,
        torque=current * drive.drive_constant,
        t=run.t,
        warmer=0.0 if warmer is None else warmer,
    )
