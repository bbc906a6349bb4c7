"""What a designed motion must stay within: positions, speeds, accelerations, torques, and distances to the space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arm_clearance import Pairs
from arm_io import InputError
from arm_io.types import Array
from arm_model import Arm

SPEED = 1.0
"""rad/s (m/s) where a model states no limit: a careful laboratory arm."""
ACCELERATION = 3.0
"""rad/s2 (m/s2) where a model states no limit."""


@dataclass(frozen=True)
class Limits:
    """position (n, 2) rad, speed (n,) rad/s, acceleration (n,) rad/s2, torque (n,) N m.

    m and N for prismatic joints. pairs: the distances that must be kept; None: nothing is said of the arm's space.
    """

    position: Array
    speed: Array
    acceleration: Array
    torque: Array
    pairs: Pairs | None = None

    @staticmethod
    def of(arm: Arm, *, share: float = 0.8) -> Limits:
        """The model's limits less a margin; a torque limit that is not stated is large enough for any motion."""
        position, speed, torque = [], [], []
        for joint in arm.joints:
            low, high = joint.limits or ((-1.5, 1.5) if joint.revolute else (-0.2, 0.2))
            middle, half = (low + high) / 2, (high - low) / 2 * share
            # A joint without position limits: half a turn each way excites all of its gravity terms.
            half = min(half, np.pi / 2) if joint.revolute else half
            position.append([middle - half, middle + half])
            speed.append(share * min(joint.motor_speed_limit / joint.ratio, 3.0) if joint.motor_speed_limit else SPEED)
            torque.append(share * joint.torque_limit if joint.torque_limit else np.inf)
        return Limits(np.array(position), np.array(speed), 4.0 * np.array(speed), np.array(torque))

    def within(
        self,
        arm: Arm,
        *,
        position: Sequence[tuple[float, float]] | None = None,
        speed: Sequence[float] | None = None,
        acceleration: Sequence[float] | None = None,
        current: Sequence[float] | None = None,
        share: float = 0.8,
    ) -> Limits:
        """The narrower of these and of a rig's limits (rad, rad/s, rad/s2, A per joint), less a margin.

        None: the rig states none.
        """
        low, high = self.position.T
        if position is not None:
            lower, upper = np.array(position, float).T
            middle, half = (lower + upper) / 2, (upper - lower) / 2 * share
            low, high = np.maximum(low, middle - half), np.minimum(high, middle + half)
            if (low >= high).any():
                joint = int(np.argmax(low >= high)) + 1
                raise InputError(
                    f"limits.position[{joint}]", f"leave no room within what '{arm.name}' states for the joint"
                )
        slower = self.speed if speed is None else np.minimum(self.speed, share * np.array(speed, float))
        gentler = self.acceleration if acceleration is None else share * np.array(acceleration, float)
        weaker = self.torque
        if current is not None:
            weaker = np.minimum(weaker, share * np.array(current, float) * arm.joint_array("drive_constant"))
        return Limits(np.stack([low, high], axis=1), slower, np.minimum(self.acceleration, gentler), weaker, self.pairs)
