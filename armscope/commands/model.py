"""``armscope model``: what a model file says, its equations as text or source, URDF and MuJoCo models in and out."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated

import typer

from arm_io import InputError
from arm_io.json_text import json_text
from arm_io.toml import check_kind
from arm_model import Arm, on_fixed_base, read_model, write_model
from arm_model.mjcf import SUFFIXES
from arm_model.rigid_body import regeared
from arm_report import wrapped
from armscope.api.reading import note_gaps
from armscope.commands.options import Json
from armscope.model_text.equations import Form, Formulation, equations_text
from armscope.model_text.summary import summary, summary_text
from armscope.progress import shown

MANY = ("--gear", "--torque-constant")
SEEN = 1e-7
"""m and rad by which a tool frame has moved."""


def command(
    model: Annotated[
        Path | None,
        typer.Argument(
            metavar="MODEL",
            help="the arm: a model file (.toml), a URDF file (.urdf) or a MuJoCo model (.xml)",
            show_default=False,
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="file to write (.toml or .urdf); with --into: the copy of that file")
    ] = None,
    equations: Annotated[
        Form | None, typer.Option(help="print the accelerations: text, latex, python, c or matlab")
    ] = None,
    by: Annotated[
        Formulation | None, typer.Option(help="with --equations: the torques of the rigid links, by this formulation")
    ] = None,
    formulations: Annotated[
        bool, typer.Option(help="compare Newton-Euler, Lagrange and Kane: operation count, generation time, difference")
    ] = False,
    effects: Annotated[
        bool, typer.Option(help="list the effects that a model may have, with their parameters; needs no model")
    ] = False,
    into: Annotated[
        Path | None,
        typer.Option(
            metavar="ARM.urdf|ARM.xml",
            help="with --out: write a copy of this URDF or MuJoCo file with the parameters of the model",
        ),
    ] = None,
    tip: Annotated[
        str | None, typer.Option(metavar="LINK", help="last link or body, of a URDF or MuJoCo file that branches")
    ] = None,
    gear: Annotated[
        list[float] | None,
        typer.Option(metavar="G ...", help="turns of the motor per turn of the joint, one for all or one each"),
    ] = None,
    torque_constant: Annotated[
        list[float] | None,
        typer.Option(metavar="K ...", help="N m/A of the motor, one for all joints or one each"),
    ] = None,
    as_json: Json = False,
) -> None:
    if effects:
        _catalogue(as_json)
        return
    if model is None:
        raise InputError("model", "needs a model file, as config/models/puma560.toml")
    arm = _read(model, tip if into is None else None)
    if gear is not None or torque_constant is not None:
        if model.suffix == ".toml" and any((joint.gear, joint.torque_constant) != (1.0, 1.0) for joint in arm.joints):
            raise InputError(model, "has drives of its own; --gear and --torque-constant are for files without drives")
        arm = _with_drives(arm, gear, torque_constant)
    note_gaps(model, "dynamics", "collisions", tip=tip)
    for what, asked in (
        ("--formulations", formulations),
        ("--by", by is not None),
        ("--into", into is not None),
        ("a URDF file", out is not None and out.suffix == ".urdf"),
    ):
        if asked:
            on_fixed_base(arm, model, what)
    if into is not None:
        _update(into, arm, out, tip)
    elif out is not None:
        _write(out, arm)
        if (model.suffix in (".urdf", *SUFFIXES) or gear is not None) and out.suffix == ".toml":
            _note_motors(arm, torque_constant is not None)
    if by is not None and equations is None:
        raise InputError("--by", "needs --equations text, latex, python, c or matlab")
    if equations is not None:
        print(equations_text(arm, equations, by), end="")
        return
    if formulations:
        _compare(arm, as_json)
        return
    found = summary(arm)
    print(json_text(found) if as_json else wrapped(summary_text(found)))


def _with_drives(arm: Arm, gears: Sequence[float] | None, torque_constants: Sequence[float] | None) -> Arm:
    """The arm with these torque constants behind these gears: limits and friction at its joints stay (``regeared``)."""
    joints = list(arm.joints)
    if gears is not None:
        joints = [regeared(joint, value) for joint, value in zip(joints, _of_joints("--gear", gears, len(arm)))]
    if torque_constants is not None:
        constants = _of_joints("--torque-constant", torque_constants, len(arm))
        joints = [replace(joint, torque_constant=value) for joint, value in zip(joints, constants)]
    return replace(arm, joints=tuple(joints))


def _of_joints(option: str, values: Sequence[float], count: int) -> Sequence[float]:
    """One value per joint; InputError where they are neither one nor as many as joints, or one is zero."""
    if 0.0 in values:
        raise InputError(option, "must not be 0")
    if len(values) not in (1, count):
        raise InputError(option, f"has {len(values)} values; must be one for all, or {count}, one per joint")
    return values if len(values) == count else list(values) * count


def _note_motors(arm: Arm, stated: bool) -> None:
    """Says what is to be added to a model that comes from URDF or MJCF, which have no place for motors."""
    if stated:
        return
    lacks = "torque constants" if any(joint.gear != 1.0 for joint in arm.joints) else "motors"
    gears = "" if lacks != "motors" else "--gear G ... (turns of the motor per turn of the joint) and "
    print(
        f"note: the file has no {lacks}: give {gears}--torque-constant K ... (N m/A of the motor), one number for all "
        "joints or one per joint; until then a current i counts as the torque of the joint, N m",
        file=sys.stderr,
    )


def _read(path: Path, tip: str | None) -> Arm:
    if tip is None:
        return read_model(path)
    if path.suffix in SUFFIXES:
        from arm_model.mjcf import read_mjcf

        return read_mjcf(path, tip=tip)
    if path.suffix != ".urdf":
        raise InputError("--tip", f"names a link of a URDF file or a body of a MuJoCo model; {path} is neither")
    from arm_model.urdf import read_urdf

    return read_urdf(path, tip=tip)


def _update(original: Path, arm: Arm, out: Path | None, tip: str | None) -> None:
    """Writes a URDF file or MuJoCo model with the numbers of the arm; says on standard error what changed."""
    from arm_model.urdf import not_in_urdf

    if out is None or out.suffix != original.suffix:
        raise InputError("--into", f"needs --out NEW{original.suffix}")
    if original.suffix in SUFFIXES:
        from arm_model.mjcf import update_mjcf

        changed = update_mjcf(original, arm, out, tip=tip)
    else:
        from arm_model.urdf import read_urdf, update_urdf

        given = read_urdf(original, tip=tip)
        arm = _placed(arm, given)
        changed = update_urdf(original, arm, out, tip=tip)
        _say_tool(arm, given, original)
    for line in changed or ["nothing changed"]:
        print(f"{out}: {line}", file=sys.stderr)
    for sentence in not_in_urdf(arm, "MJCF" if original.suffix in SUFFIXES else "URDF"):
        print(f"note: {sentence}", file=sys.stderr)


def _placed(arm: Arm, original: Arm) -> Arm:
    """A model in D-H, as ``calibrate`` writes it, with its joints placed as those of the URDF file it comes from."""
    same = [joint.name for joint in arm.joints] == [joint.name for joint in original.joints]
    if not same or all(joint.convention == "placed" for joint in arm.joints):
        return arm
    from identification.kinematics.models import placed_as

    return placed_as(arm, original)


def _say_tool(arm: Arm, original: Arm, file: Path) -> None:
    """A note where the tool frame, which a joint's origin cannot hold, has moved in the frame of the last link."""
    import numpy as np
    from scipy.spatial.transform import Rotation

    off = np.linalg.inv(np.array(original.tool)) @ np.array(arm.tool)
    turned = float(Rotation.from_matrix(off[:3, :3]).magnitude())
    if np.linalg.norm(off[:3, 3]) > SEEN or turned > SEEN:
        x, y, z = 1e3 * off[:3, 3]
        print(
            f"note: the tool frame is not written: in the model it lies {x:.4f}, {y:.4f}, {z:.4f} mm and "
            f"{1e3 * turned:.4f} mrad from that of {file.name}, in its axes",
            file=sys.stderr,
        )


def _write(path: Path, arm: Arm) -> None:
    if path.suffix == ".urdf":
        from arm_model.urdf import not_in_urdf, unknown_in_urdf, write_urdf

        write_urdf(path, arm)
        for sentence in not_in_urdf(arm) + unknown_in_urdf(arm):
            print(f"note: {sentence}", file=sys.stderr)
    elif path.suffix == ".toml":
        check_kind(path, "units")
        write_model(path, arm)
    else:
        raise InputError(path, "must end in .toml or .urdf")


def _catalogue(as_json: bool) -> None:
    from armscope.model_text.catalogue import catalogue, catalogue_text

    print(json_text(catalogue()) if as_json else catalogue_text())


def _compare(arm: Arm, as_json: bool) -> None:
    from arm_model.formulations import compare
    from armscope.model_text.formulations import formulations_text

    with shown(as_json) as progress:
        progress("generating the equations, several ways")
        rows = compare(arm)
    if as_json:
        print(json_text({"name": arm.name, "formulations": [asdict(row) for row in rows]}))
    else:
        print(formulations_text(arm, rows))
