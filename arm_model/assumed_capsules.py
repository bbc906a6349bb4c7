"""Capsules that stand in for links of which a model states no shape.

A link without capsules gets one from its joint to the next joint (of the last link: to the tool), with a radius of
``ASSUMED`` of the arm's length: thin where the castings are thick and beside them where links are cranked. A model of
an arm that works close to things should give its capsules.
"""

from __future__ import annotations

import numpy as np

from arm_model.capsules import vector
from arm_model.description import Arm
from arm_model.rigid_body.kinematics import placement
from arm_model.tables.link_shapes import Capsule

ASSUMED = 0.05
"""Radius of an assumed capsule over the arm's length: 6 cm for an arm that reaches 1.2 m with its links in a row."""
SHORTEST = 0.1
"""M of an arm's length, for arms whose axes all meet."""


def assumed_capsules(arm: Arm) -> list[Capsule]:
    """Of links 0 to n, each from its own joint to the next one, in its own frame."""
    placements = [placement(joint) for joint in arm.joints]
    starts = [np.zeros(3), *(np.linalg.inv(after)[:3, 3] for _, after in placements)]
    ends = [*(before[:3, 3] for before, _ in placements), np.array(arm.tool)[:3, 3]]
    length = sum(float(np.linalg.norm(end - start)) for start, end in zip(starts, ends))
    radius = ASSUMED * max(length, SHORTEST)
    return [Capsule(vector(start), vector(end), radius) for start, end in zip(starts, ends)]
