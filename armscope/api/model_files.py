"""An arm into a file: a model file, a URDF file, or a copy of a user's own URDF file or MuJoCo model."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from warnings import warn

import numpy as np

from arm_io import InputError
from arm_io.progress import silent
from arm_io.toml import check_kind
from arm_model import Arm
from armscope.api.reading import File, read_model
from armscope.shipped import found

SEEN = 1e-7
"""m and rad by which a tool frame has moved."""


def write_model(path: File, model: File | Arm, *, into: File | None = None) -> None:
    """Writes a model file (.toml), a URDF file (.urdf), or a copy of a file with the parameters of the model.

    path   the file to write, whole or not at all
    into   a URDF file or MuJoCo model with the same joints: of its copy only what differs is changed
    What the format cannot hold is a Python warning each. InputError where the file cannot be written, has another
    ending, or the model is one that ``read_model`` refuses.
    """
    arm, out, notes = read_model(model), Path(path), list[str]()
    if into is None:
        write_arm(out, arm, notes.append)
    else:
        write_into(found(Path(into)), arm, out, say=notes.append)
    for note in notes:
        warn(note, stacklevel=2)


def write_arm(path: Path, arm: Arm, say: Callable[[str], None]) -> None:
    """Writes a .toml or .urdf file; ``say`` is called with what URDF cannot hold. InputError for another ending."""
    from arm_model import write_model
    from arm_model.urdf import not_in_urdf, unknown_in_urdf, write_urdf

    if path.suffix == ".urdf":
        write_urdf(path, arm)
        for sentence in not_in_urdf(arm) + unknown_in_urdf(arm):
            say(sentence)
    elif path.suffix == ".toml":
        check_kind(path, "units")
        write_model(path, arm)
    else:
        raise InputError(path, "must end in .toml or .urdf")


def write_into(
    original: Path, arm: Arm, out: Path, *, tip: str | None = None, say: Callable[[str], None] = silent
) -> list[str]:
    """Writes a copy of a URDF file or MuJoCo model with the numbers of the arm; returns what changed, a line each.

    tip  last link or body, of a file that branches; say: called with what the format cannot hold
    InputError where the arm has other joints than the file, or ``out`` another ending.
    """
    from arm_model.mjcf import SUFFIXES, update_mjcf
    from arm_model.urdf import not_in_urdf, read_urdf, update_urdf

    if out.suffix != original.suffix:
        raise InputError(out, f"must end in {original.suffix}, as {original.name} does")
    if original.suffix in SUFFIXES:
        changed = update_mjcf(original, arm, out, tip=tip)
    else:
        given = read_urdf(original, tip=tip)
        arm = _placed(arm, given)
        changed = update_urdf(original, arm, out, tip=tip)
        _say_tool(arm, given, original, say)
    for sentence in not_in_urdf(arm, "MJCF" if original.suffix in SUFFIXES else "URDF"):
        say(sentence)
    return changed


def _placed(arm: Arm, original: Arm) -> Arm:
    """A model in D-H, as ``calibrate`` writes it, with its joints placed as those of the URDF file it comes from."""
    same = [joint.name for joint in arm.joints] == [joint.name for joint in original.joints]
    if not same or all(joint.convention == "placed" for joint in arm.joints):
        return arm
    from identification.kinematics.models import placed_as

    return placed_as(arm, original)


def _say_tool(arm: Arm, original: Arm, file: Path, say: Callable[[str], None]) -> None:
    """Where the tool frame, which a joint's origin cannot hold, has moved in the frame of the last link."""
    from scipy.spatial.transform import Rotation

    off = np.linalg.inv(np.array(original.tool)) @ np.array(arm.tool)
    turned = float(Rotation.from_matrix(off[:3, :3]).magnitude())
    if np.linalg.norm(off[:3, 3]) > SEEN or turned > SEEN:
        x, y, z = 1e3 * off[:3, 3]
        say(
            f"the tool frame is not written: in the model it lies {x:.4f}, {y:.4f}, {z:.4f} mm and "
            f"{1e3 * turned:.4f} mrad from that of {file.name}, in its axes"
        )
