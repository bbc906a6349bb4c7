"""What an arm looks like to a check of collisions: capsules of its links, given or assumed.

A link without capsules in the model gets one from its joint to the next joint (of the last link: to the tool), with a
radius of ``ASSUMED`` of the arm's length: thin where the castings are thick and beside them where links are cranked. A
model of an arm that works close to things should give its capsules.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from arm_clearance import Body, Chain
from arm_io.types import Array
from arm_model.description import Arm
from arm_model.model_file import on_fixed_base, read_model
from arm_model.rigid_body.kinematics import placement

ASSUMED = 0.05
"""Radius of an assumed capsule over the arm's length: 6 cm for an arm that reaches 1.2 m with its links in a row."""
SHORTEST = 0.1
"""M of an arm's length, for arms whose axes all meet."""
TURN, SLIDE = np.pi, 0.2
"""Rad and m either way where a joint states no limits."""


def chain_of(arm: Arm) -> Chain:
    """The arm's nominal kinematics and its capsules."""
    placements = [placement(joint) for joint in arm.joints]
    before, after = (np.array(poses) for poses in zip(*placements))
    tool = np.array(arm.tool)[:3, 3]
    free = [(-TURN, TURN) if joint.revolute else (-SLIDE, SLIDE) for joint in arm.joints]
    return Chain(
        base=np.array(arm.base),
        before=before,
        after=after,
        coupling=arm.coupling_matrix,
        sliding=tuple(not joint.revolute for joint in arm.joints),
        limits=np.array([joint.limits or either for joint, either in zip(arm.joints, free)]),
        tool=tool,
        bodies=_bodies(arm, before, after, tool),
    )


def read_chain(path: str | Path) -> Chain:
    """Of the arm in a model file. InputError where its base floats: nothing then tells where its links are."""
    return chain_of(on_fixed_base(read_model(path), path, "the space around an arm"))


def _bodies(arm: Arm, before: Array, after: Array, tool: Array) -> tuple[Body, ...]:
    """Of links 0 to n, each from its own joint to the next one, in its own frame."""
    starts = [np.zeros(3), *(np.linalg.inv(pose)[:3, 3] for pose in after)]
    ends = [*(pose[:3, 3] for pose in before), tool]
    length = sum(float(np.linalg.norm(end - start)) for start, end in zip(starts, ends))
    radius = ASSUMED * max(length, SHORTEST)
    found: list[Body] = []
    for link, given in enumerate([arm.capsule, *(joint.capsule for joint in arm.joints)]):
        if given is None:
            found.append(Body(link=link, start=starts[link], end=ends[link], radius=radius, assumed=True))
        else:
            found += [
                Body(link=link, start=np.array(one.start), end=np.array(one.end), radius=one.radius) for one in given
            ]
    return tuple(found)
