"""What an arm looks like to a check of collisions: capsules of its links, given or assumed (``assumed_capsules``)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from arm_clearance import Body, Chain
from arm_model.assumed_capsules import assumed_capsules
from arm_model.description import Arm
from arm_model.model_file import on_fixed_base, read_model
from arm_model.rigid_body.kinematics import placement

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
        bodies=_bodies(arm),
    )


def read_chain(path: str | Path) -> Chain:
    """Of the arm in a model file. InputError where its base floats: nothing then tells where its links are."""
    return chain_of(on_fixed_base(read_model(path), path, "the space around an arm"))


def _bodies(arm: Arm) -> tuple[Body, ...]:
    """Of links 0 to n, each in its own frame."""
    bodies: list[Body] = []
    stated = [arm.capsule, *(joint.capsule for joint in arm.joints)]
    for link, (given, assumed) in enumerate(zip(stated, assumed_capsules(arm), strict=True)):
        bodies += [
            Body(
                link=link,
                start=np.array(one.start),
                end=np.array(one.end),
                radius=one.radius,
                assumed=given is None,
            )
            for one in ((assumed,) if given is None else given)
        ]
    return tuple(bodies)
