"""The Puma cut down to its first three joints, and a move for it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from arm_model.description import Arm


def three_links(arm: Arm) -> Arm:
    controller = arm.controller
    assert controller is not None and controller.natural_frequency is not None and controller.inertia_pose is not None
    cut = replace(
        controller, natural_frequency=controller.natural_frequency[:3], inertia_pose=controller.inertia_pose[:3]
    )
    return replace(arm, joints=arm.joints[:3], controller=cut)


def swing(joints: int, amplitude: float = 0.6) -> Callable[[np.ndarray], np.ndarray]:
    """A smooth move of all joints in 1 s, then standing."""

    def demand(t: np.ndarray) -> np.ndarray:
        s = np.clip(t, 0.0, 1.0)
        return np.outer(10 * s**3 - 15 * s**4 + 6 * s**5, amplitude * np.array([1, 0.7, -0.8, 0.5, 0.4, -0.6])[:joints])

    return demand
