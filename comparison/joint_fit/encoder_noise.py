"""Accelerations without the noise of the encoders.

A column of noise makes the inertia that it is fitted with too small (errors in variables), that of a slow recording
more than that of a fast one: two recordings of the same arm would differ. A projection on smooth curves takes noise
away and makes no inertia too large: what it leaves out of a motion is at right angles to what it keeps (Carroll et al.,
Measurement Error in Nonlinear Models, 2006, section 1.5, Berkson's errors). A low-pass does both only where its gain is
0 or 1, and needs the motion beyond the ends.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.interpolate import make_lsq_spline

from arm_io.types import Array
from arm_model import Arm
from arm_model.system import rigid_torque_along
from identification.preprocessing.signals import Motion

WORSE = 10.0
"""Power of noise in an acceleration over that of motion left out of it, at equal harm.

The first makes inertias too small, the second is what the regression leaves over.
"""
DEGREE = 5
"""Of the pieces of a smooth curve, which are then as smooth as the accelerations of positions (splines of order 6)."""


def band_of_motion(motion: Motion) -> Array:
    """(J,) Hz up to which the acceleration of each joint is motion rather than noise of its encoder."""
    band = motion.band
    noise = (2.0 * np.pi * band.frequency[:, None]) ** 4 * band.noise_rms**2 / band.frequency[-1]
    gain = np.cumsum(band.density - (1.0 + WORSE) * noise, axis=0)
    return np.asarray(band.frequency[np.maximum(np.argmax(gain, axis=0), 1)])


def without_noise(motion: Motion, arm: Arm) -> Motion:
    """The motion with accelerations on smooth curves, which bend as quickly as each joint's motion does."""
    qdd = motion.qdd.copy()
    for j, highest in enumerate(band_of_motion(motion)):
        pieces = int(np.ceil(2.0 * highest * (motion.t[-1] - motion.t[0])))
        # as many curves as rows would keep all
        if DEGREE + pieces < len(motion.t) // 2:
            inner = np.linspace(motion.t[0], motion.t[-1], pieces + 1)
            knots = np.concatenate([[inner[0]] * DEGREE, inner, [inner[-1]] * DEGREE])
            qdd[:, j] = make_lsq_spline(motion.t, qdd[:, j], knots, DEGREE)(motion.t)
    return replace(motion, qdd=qdd, torque=motion.torque - _torque(arm, motion, qdd))


def _torque(arm: Arm, motion: Motion, smooth: Array) -> Array:
    """(m, J) N m (N) by the model of what accelerations have beyond ``smooth`` ones (m, J)."""
    rotors = arm.joint_array("ratio") ** 2 * arm.joint_array("rotor_inertia")
    with_, without = (rigid_torque_along(arm, motion.q, motion.qd, qdd) for qdd in (motion.qdd, smooth))
    return np.asarray(with_ - without + rotors * (motion.qdd - smooth))
