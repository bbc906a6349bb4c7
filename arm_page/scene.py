"""The scene that is drawn before any row is received: links of the arm, obstacles around it, limits of its joints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from arm_clearance import Chain
from arm_io import InputError, counted
from arm_model.collision import read_chain
from arm_model.visuals import Visual
from daq.rig import Rig

Table = dict[str, Any]


def chain_of_rig(rig: Rig) -> Chain | None:
    """Kinematic chain of the rig's arm; None if the rig file names no model. InputError if the two do not match."""
    if rig.model_path is None:
        return None
    chain = read_chain(rig.model_path)
    if len(chain) != rig.joints:
        raise InputError(rig.name, f"the rig has {counted(rig.joints, 'joint')}, its model {len(chain)}")
    return chain


def scene_of(rig: Rig, chain: Chain | None, visuals: Sequence[Visual]) -> Table:
    """Rig and arm as plain data: rad, m, A (or N m, N); matrices row by row, in the base frame of the model."""
    limits = rig.limits
    joints = [
        {
            "number": number,
            "name": joint.name or f"joint {number}",
            "unit": joint.unit,
            "current_unit": joint.current_unit,
            "position": None if limits.position is None else list(limits.position[number - 1]),
            "speed": None if limits.speed is None else limits.speed[number - 1],
            "current": None if limits.current is None else limits.current[number - 1],
        }
        for number, joint in enumerate(rig.joint, 1)
    ]
    tracker = rig.tracker
    return {
        "rig": rig.name,
        "description": rig.description,
        "endpoint": rig.zenoh.endpoint,
        "rate": None if rig.trigger is None else rig.trigger.rate,
        "trigger": None if rig.trigger is None else rig.trigger.source,
        "joints": joints,
        "home": _home(rig),
        "devices": [{"name": device.name, "driver": device.driver} for device in rig.device],
        "tracker": None if tracker is None else {"target": list(tracker.target), "placed": _placed(rig)},
        "space": None if rig.space is None else rig.space.model_dump(),
        "arm": None if chain is None else chain.to_json(),
        "meshes": [
            {"link": one.link, "kind": one.file.suffix.lower(), "scale": list(one.scale), "pose": one.pose.tolist()}
            for one in visuals
        ],
    }


def _home(rig: Rig) -> list[float]:
    """rad (m), positions at which the joints are drawn before they are measured: 0, or the limit nearest to it."""
    if rig.limits.position is None:
        return [0.0] * rig.joints
    return [min(max(0.0, low), high) for low, high in rig.limits.position]


def _placed(rig: Rig) -> bool:
    """Whether tracker points can be expressed in the base frame."""
    return rig.tracker is not None and (rig.tracker.device is None or rig.tracker.base_from_tracker is not None)
