"""``armscope model``: what a model file says, its equations as text or source, URDF and MuJoCo models in and out."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import asdict, replace
from math import isfinite
from pathlib import Path
from typing import Annotated

import typer

from arm_io import InputError, write_text
from arm_io.json_text import json_text
from arm_model import Arm, on_fixed_base, read_model
from arm_model.mjcf import SUFFIXES
from arm_model.rigid_body import regeared
from arm_report import wrapped
from armscope.api.model_files import write_arm, write_into
from armscope.api.reading import note_gaps
from armscope.commands.options import Json
from armscope.model_text.equations import Form, Formulation, equations_text
from armscope.model_text.summary import summary, summary_text
from armscope.progress import shown

MANY = ("--gear", "--torque-constant")
"""Options that take several values."""
WITHOUT_MOTORS = (".urdf", *SUFFIXES)
"""Files of arms that have no place for motors."""
MODELS = (".toml", *WITHOUT_MOTORS)
"""Files of arms that ``--out`` may name; any other holds equations."""


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
        Path | None,
        typer.Option(
            help="file to write (.toml or .urdf); with --into: the copy of that file; with --equations: their text, "
            "for any other ending (rates.m)"
        ),
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
    _refuse_combinations(equations, by, formulations=formulations, effects=effects, as_json=as_json)
    if effects:
        if any(option is not None for option in (model, out, by, into, tip, gear, torque_constant)):
            raise InputError("--effects", "lists the effects of any arm; takes no model and no option but --json")
        _print_catalogue(as_json)
        return
    if model is None:
        raise InputError("model", "needs a model file, as config/models/puma560.toml")
    arm = _with_drives(model, _read(model, tip if into is None else None), gear, torque_constant)
    note_gaps(model, "dynamics", "collisions", tip=tip)
    needs_fixed_base = {
        "--formulations": formulations,
        "--by": by is not None,
        "--into": into is not None,
        "a URDF file": out is not None and out.suffix == ".urdf",
    }
    for what in (name for name, asked in needs_fixed_base.items() if asked):
        on_fixed_base(arm, model, what)
    if into is not None:
        _update(into, arm, out, tip)
    elif out is not None and (equations is None or out.suffix in MODELS):
        write_arm(out, arm, _note)
        if (model.suffix in WITHOUT_MOTORS or gear is not None) and out.suffix == ".toml":
            _note_motors(arm, torque_constant is not None)
    if equations is not None:
        _write_equations(arm, equations, by, out)
    elif formulations:
        _compare(arm, as_json)
    else:
        found = summary(arm)
        print(json_text(found) if as_json else wrapped(summary_text(found)))


def _refuse_combinations(
    equations: Form | None, by: Formulation | None, *, formulations: bool, effects: bool, as_json: bool
) -> None:
    """InputError where options exclude each other, or one lacks another."""
    given = {"--effects": effects, "--equations": equations is not None, "--formulations": formulations}
    if len(several := [name for name, one in given.items() if one]) > 1:
        raise InputError(several[0], f"and {several[1]} exclude each other")
    if equations is not None and as_json:
        raise InputError("--json", "is not for --equations, which are text")
    if by is not None and equations is None:
        raise InputError("--by", "needs --equations text, latex, python, c or matlab")


def _update(file: Path, arm: Arm, out: Path | None, tip: str | None) -> None:
    """Writes a copy of a URDF or MuJoCo file with the parameters of an arm, and says what changed."""
    if out is None or out.suffix != file.suffix:
        raise InputError("--into", f"needs --out NEW{file.suffix}")
    for line in write_into(file, arm, out, tip=tip, say=_note) or ["nothing changed"]:
        print(f"{out}: {line}", file=sys.stderr)


def _note(sentence: str) -> None:
    print(f"note: {sentence}", file=sys.stderr)


def _with_drives(file: Path, arm: Arm, gears: Sequence[float] | None, torque_constants: Sequence[float] | None) -> Arm:
    """The arm with these torque constants behind these gears: limits and friction at its joints stay (``regeared``).

    InputError where its file states other drives.
    """
    if gears is None and torque_constants is None:
        return arm
    if file.suffix == ".toml" and any((joint.gear, joint.torque_constant) != (1.0, 1.0) for joint in arm.joints):
        raise InputError(file, "has drives of its own; --gear and --torque-constant are for files without drives")
    joints = list(arm.joints)
    if gears is not None:
        joints = [regeared(joint, value) for joint, value in zip(joints, _of_joints("--gear", gears, len(arm)))]
    if torque_constants is not None:
        constants = _of_joints("--torque-constant", torque_constants, len(arm))
        joints = [replace(joint, torque_constant=value) for joint, value in zip(joints, constants)]
    return replace(arm, joints=tuple(joints))


def _of_joints(option: str, values: Sequence[float], count: int) -> Sequence[float]:
    """One value per joint; InputError where they are neither one nor as many as joints, or one is 0 or not finite."""
    if not all(value and isfinite(value) for value in values):
        raise InputError(option, "must be finite numbers other than 0")
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


def _print_catalogue(as_json: bool) -> None:
    from armscope.model_text.catalogue import catalogue, catalogue_text

    print(json_text(catalogue()) if as_json else catalogue_text())


def _write_equations(arm: Arm, form: Form, by: Formulation | None, out: Path | None) -> None:
    """Writes the equations to ``out``; prints them where that is none, or the file of an arm."""
    text = equations_text(arm, form, by)
    if out is None or out.suffix in MODELS:
        print(text, end="")
    else:
        write_text(out, text)


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
