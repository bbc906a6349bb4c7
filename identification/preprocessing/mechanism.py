"""Whether a recording is of the joints, the mechanism and the drives that a model describes.

A recording may carry the model with which it was made; and it may say whether its signals of the drives are currents or
torques.
"""

from __future__ import annotations

from arm_io import InputError, counted
from arm_model import Arm, Joint, carried_arm
from daq.recording import Recording

LENGTH = 0.02
"""m by which the axes of one mechanism may stand otherwise in two models of it, beside 5 % of the length."""
OTHER = 1.5
"""Ratio of drive constants, or its inverse, above which it is another drive."""
ROUNDED = 1.01
"""... below which they are the same, rounded."""
ALIKE = 0.8
"""Correlation of a measured current or torque with the model's above which the two are one but for their size."""
OTHER_UNIT = 5.0
"""Ratio of their sizes, or its inverse, above which the unit is wrong: no file's masses are as far off."""


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
            f"has {counted(len(recorded), 'joint')}, the model '{arm.name}' has {len(names)}; "
            "use a recording of that arm",
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


def check_mechanism(recording: Recording, arm: Arm) -> None:
    """InputError if a recording was made with the model of another mechanism, or with other drives, than ``arm``.

    Lengths may differ by as much as a calibration finds.
    """
    _check_units(recording, arm)
    carried = _carried(recording)
    if isinstance(carried, str):
        return
    where, recorded = recording.path, f"was recorded with '{carried.name}'"
    if carried.floating is not None:
        raise InputError(where, f"{recorded}, whose base floats; '{arm.name}' has a fixed one")
    for number, (joint, before) in enumerate(zip(arm.joints, carried.joints), 1):
        if joint.type != before.type:
            raise InputError(
                where, f"{recorded}, whose joint {number} is {before.type}; '{arm.name}' has a {joint.type} one"
            )
        for length in ("a", "d") if joint.convention == before.convention else ():
            now, then = getattr(joint, length), getattr(before, length)
            if abs(now - then) > LENGTH + 0.05 * abs(now):
                raise InputError(
                    where,
                    f"{recorded}, whose joint {number} has {length} = {then:.4g} m; '{arm.name}' has {now:.4g} m",
                )
        if _has_motor(before) and _differ(joint, before) > OTHER:
            raise InputError(
                where,
                f"{recorded}: {before.drive_constant:.4g} {_per_ampere(before)} at joint {number}, '{arm.name}' has "
                f"{joint.drive_constant:.4g}; if that model was wrong, export the recording as a table and import it "
                "again without",
            )


def other_drives(recording: Recording, arm: Arm) -> list[str]:
    """A sentence per joint whose drive constant differs from that of the model which the recording carries."""
    carried = _carried(recording)
    if isinstance(carried, str):
        return [carried] if carried else []
    return [
        f"was recorded with a model of {before.drive_constant:.4g} {_per_ampere(before)} at joint "
        f"{number}, '{arm.name}' has {joint.drive_constant:.4g}, which counts here"
        for number, (joint, before) in enumerate(zip(arm.joints, carried.joints), 1)
        if _has_motor(before) and _differ(joint, before) > ROUNDED
    ]


def _check_units(recording: Recording, arm: Arm) -> None:
    """InputError where a recording has torques and the model takes currents."""
    for number, joint in enumerate(arm.joints, 1):
        unit = recording.current_unit(number)
        if unit in ("N m", "N") and _has_motor(joint):
            raise InputError(
                recording.path,
                f"has the {'torque' if unit == 'N m' else 'force'} of joint {number} ({unit}); '{arm.name}' takes "
                f"currents, {joint.drive_constant:.4g} {_per_ampere(joint)}: in a model that takes this "
                f"{'torque' if unit == 'N m' else 'force'}, torque_constant is 1 over the gear, "
                f"{1 / joint.ratio:.4g}; or import the table with the --rig of this model",
            )


def _carried(recording: Recording) -> Arm | str:
    """The model that a recording carries; a sentence where it cannot be read, as one that includes files; "": none."""
    if recording.model is None:
        return ""
    try:
        return carried_arm(recording.model, "model.toml")
    except InputError as error:
        return f"is not compared with the model that it carries: {error}"


def _has_motor(joint: Joint) -> bool:
    """Whether the model says what a current does; of a URDF file none does, and any drive may be behind it."""
    return abs(joint.drive_constant - 1) > 1e-9


def _differ(one: Joint, other: Joint) -> float:
    """Ratio of the larger drive constant to the smaller."""
    pair = one.drive_constant, other.drive_constant
    return max(pair) / min(pair)


def _per_ampere(joint: Joint) -> str:
    return f"{'N m' if joint.revolute else 'N'}/{joint.current_unit}"
