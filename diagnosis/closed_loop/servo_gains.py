"""Gains of servos that the recordings show, where they are not those of the model.

Gains are trimmed at the drive and written down once. Where they are others than the model's, its closed loop misses
every joint, and shows nothing of a transmission. Each joint has two unknowns, the position and the velocity gain as
multiples of the model's (the integral goes with the position gain); what the loops miss is linear in small changes of
them, and they are found by Gauss-Newton steps with all joints varied at once: a servo acts on its own joint first.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from arm_io.parallel import in_parallel
from arm_io.types import Array
from arm_model import Arm
from arm_model.servo import fixed_gains, servo_gains
from daq.recording import Recording
from diagnosis.closed_loop.loop_errors import delay_between, loop_errors, loop_of

STEPS = 4
"""Gauss-Newton steps."""
STEP = 0.05
"""Change of the logarithm of a gain for a derivative."""
FARTHEST = 0.4
"""Largest change of the logarithm of a gain in a Gauss-Newton step: ``STEPS`` of them reach ``MOST``."""
MOST = 4.0
"""Times the model's that a gain may be, or its inverse: beyond it is another servo."""


def with_servo_gains(arm: Arm, recordings: Sequence[Recording]) -> Arm:
    """The arm with the position and velocity gains that make the closed-loop errors smallest.

    The arm itself where these gains are none that its servos may have, or leave no stable loop.
    """
    arm = fixed_gains(arm)
    logarithm = np.zeros((2, len(arm)))
    for _ in range(STEPS):
        tried = [scaled(arm, logarithm + by[:, None]) for by in np.vstack([np.zeros(2), STEP * np.eye(2)])]
        errors = iter(in_parallel(_error, list(itertools.product(tried, recordings))))
        at_gains, *moved = (np.concatenate([next(errors) for _ in recordings]) for _ in tried)
        if not all(np.isfinite(one).all() for one in (at_gains, *moved)):
            return arm
        for j in range(len(arm)):
            slopes = np.stack([one[:, j] - at_gains[:, j] for one in moved], axis=1) / STEP
            step = -np.linalg.lstsq(slopes, at_gains[:, j], rcond=None)[0]
            logarithm[:, j] += np.clip(step, -FARTHEST, FARTHEST)
    return scaled(arm, logarithm) if np.all(np.abs(logarithm) < np.log(MOST)) else arm


def _error(loop: tuple[Arm, Recording]) -> Array:
    """(m, n) A: closed-loop error of one recording.

    By the lag of its angles: that of its transients changes with the gains, and would make up for some of them.
    """
    arm, recording = loop
    angle = loop_of(arm, recording)[0][0]
    lag = delay_between(recording.q - angle, np.gradient(angle, recording.dt, axis=0))
    return np.asarray(loop_errors(arm, recording, lag=lag)[0])


def scaled(arm: Arm, logarithm: Array) -> Arm:
    """The arm with gains exp(logarithm (2, n)) times its own: of position with the integral, and of velocity."""
    assert arm.controller is not None
    gains, (position, velocity) = servo_gains(arm), np.exp(logarithm)
    controller = replace(
        arm.controller,
        kind="gains",
        position_gain=tuple(map(float, gains.position * position)),
        velocity_gain=tuple(map(float, gains.velocity * velocity)),
        integral_gain=tuple(map(float, gains.integral * position)),
    )
    return replace(arm, controller=controller)
