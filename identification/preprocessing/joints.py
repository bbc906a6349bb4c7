"""Whether the joints of a recording are those of a model, in the model's order."""

from __future__ import annotations

from arm_io import InputError
from arm_model import Arm
from daq.recording import Recording


def check_joints(recording: Recording, arm: Arm) -> None:
    """InputError where a recording has another number of joints than the arm, or the arm's joints in another order.

    The order is known where the recording has all names of the model's joints. ROS 2 drivers publish their joints in
    the order of the alphabet, beside those of a gripper.
    """
    recorded, names = list(recording.layout.joints), [joint.name for joint in arm.joints]
    named = len(set(names)) == len(names) and set(names) <= set(recorded)
    if recorded == names or (len(recorded) == len(names) and not named):
        return
    if not named:
        raise InputError(
            recording.path,
            f"has {len(recorded)} joints, the model '{arm.name}' has {len(names)}; use a recording of that arm",
        )
    remedy = (
        "its rig must have these [[joint]] in this order"
        if recording.layout.raw
        else "import it again with --model, which takes these"
    )
    raise InputError(
        recording.path,
        f"has the joints {', '.join(recorded)}; the model '{arm.name}' has {', '.join(names)}, in this order: {remedy}",
    )
