"""Model files (``config/models/*.toml``): an arm as a person writes it, read, checked and written back."""

from __future__ import annotations

import re
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, TypeAdapter, ValidationError

from arm_io import InputError, check_table, counted, read_toml, toml_of, write_toml
from arm_io.entries import other_kind
from arm_io.table import Table
from arm_io.toml import one_line
from arm_model.description import Arm, Coupling, EffectTerm, Joint
from arm_model.effects import check_terms
from arm_model.mjcf import SUFFIXES, mjcf_of, read_mjcf
from arm_model.parameters import parameter
from arm_model.rigid_body.inertia import unphysical
from arm_model.tables.controller import Controller
from arm_model.tables.fields import IDENTITY, Pose, Vector
from arm_model.tables.floating_base import FloatingBase, Thruster
from arm_model.tables.link_shapes import Capsule
from arm_model.tables.uncertainty import Uncertainty, read_uncertainty, write_uncertainty
from arm_model.urdf.reading import read_urdf, urdf_of

LARGEST_ANGLE, LARGEST_LENGTH = 6.5, 100.0
"""rad and m of a D-H table: more is degrees, or mm."""


class _ModelFile(Table):
    """The layout: what an Arm has, with arrays of tables in the singular, as TOML reads best."""

    name: str
    units: Literal["SI"]
    source: str = ""
    unphysical: str = ""
    uncertainty: str = Field(default="", pattern=r"^[^/\\]*$")
    kinematic_uncertainty: str = Field(default="", pattern=r"^[^/\\]*$")
    gravity: Vector = (0.0, 0.0, -9.80665)
    base: Pose = IDENTITY
    tool: Pose = IDENTITY
    capsule: list[Capsule] | None = None
    joint: list[Joint] = Field(min_length=1)
    controller: Controller | None = None
    coupling: list[Coupling] = Field(default=[])
    effect: list[EffectTerm] = Field(default=[])


_MUJOCO = re.compile(r"^\s*(?:<\?.*?\?>\s*|<!--.*?-->\s*|<!DOCTYPE[^>]*>\s*)*<mujoco[\s>]", re.DOTALL)
LINK, MOUNT = ("theta", "d", "a", "alpha", "beta"), ("x", "y", "z", "yaw", "pitch", "roll")
"""Geometric parameters of a joint and, as ``base.x``, of the place of link frame 0, in its own frame."""
_INERTIAL = ("mass", "com", "inertia")
_NEEDED = ("type", *_INERTIAL)


def read_model(path: str | Path) -> Arm:
    """The arm in a model file (.toml), or in a URDF (.urdf) or MuJoCo model (.xml, .mjcf) with one serial chain.

    With its uncertainty, where the file that it names is beside it. InputError (one line: file, entry, what would be
    right) for anything wrong or unphysical.
    """
    suffix = Path(path).suffix
    if suffix in SUFFIXES:
        return read_mjcf(path)
    if suffix == ".urdf":
        return read_urdf(path)
    if suffix == ".xacro":
        raise InputError(path, "is a xacro file; expand it first: xacro FILE > ARM.urdf")
    return _with_kinematic(_with_uncertainty(arm_of(read_toml(path), path), Path(path)), Path(path))


def _with_kinematic(arm: Arm, path: Path) -> Arm:
    """The arm with what the file says that it names of its geometry, if that is beside the model; else InputError."""
    uncertainty = arm.kinematic_uncertainty
    if uncertainty is None or not (file := path.parent / uncertainty.file).exists():
        return arm
    uncertainty = read_uncertainty(file)
    names = {f"joint{j}.{value}" for j in range(1, len(arm) + 1) for value in LINK} | {f"base.{one}" for one in MOUNT}
    for name in uncertainty.parameters:
        if name not in names:
            raise InputError(file, f"{name}: no geometric parameter of this model ({path.name}): calibrate again")
    return replace(arm, kinematic_uncertainty=uncertainty)


def _with_uncertainty(arm: Arm, path: Path) -> Arm:
    """The arm with what the file says that it names, if that is beside the model; InputError where it is of another."""
    if arm.uncertainty is None or not (file := path.parent / arm.uncertainty.file).exists():
        return arm
    uncertainty = read_uncertainty(file)
    for name in uncertainty.parameters:
        try:
            parameter(arm, name)
        except InputError as error:
            raise InputError(file, f"{error}; it must be of this model ({path.name}): identify again") from None
    for key, values in uncertainty.by_joint.items():
        if len(values) not in (0, len(arm)):
            raise InputError(file, f"{key}: has {len(values)} entries, the arm has {counted(len(arm), 'joint')}")
    return replace(arm, uncertainty=uncertainty)


def _named_file(name: str) -> Uncertainty | None:
    return Uncertainty(name) if name else None


def carried_arm(text: str, where: str | Path) -> Arm:
    """The arm in the text of a model file, as a recording carries it: TOML, URDF or MJCF; ``where`` names it in errors.

    What an XML file includes, and its meshes, are not in the recording. InputError as ``read_model``.
    """
    start = text.lstrip("\ufeff \t\r\n")
    if not start.startswith("<"):
        return arm_of(toml_of(text, where), where)
    return mjcf_of(start, where) if _MUJOCO.search(start) else urdf_of(start.encode(), where)


def arm_of(table: dict[str, Any], where: str | Path) -> Arm:
    """The arm in a table as a model file has it; InputError, which names it as ``where``, for a table that is none."""
    if "units" not in table:
        right = other_kind(table, ()) or 'write units = "SI" (rad, m, kg, s, N, A) once all values are in them'
        raise InputError(where, f"units: is missing; {right}")
    _all_there(table, where)
    floating, mount = _base_of(table.get("base"), where)
    layout = check_table(where, table if floating is None else {**table, "base": mount}, _ModelFile)
    for number, joint in enumerate(layout.joint, 1):
        if other_unit := _in_other_units(joint):
            raise InputError(where, f"joint[{number}].{other_unit}")
        if not layout.unphysical and (problem := unphysical(joint.mass, joint.inertia)):
            raise InputError(where, f"joint[{number}]: {problem}")
        if joint.name and (first := [one.name for one in layout.joint].index(joint.name) + 1) < number:
            other = f"joint[{number}].name: {joint.name!r} is that of joint[{first}]"
            raise InputError(where, f"{other}; names must differ: recordings tell joints apart by them")
    if floating is not None and not layout.unphysical and (problem := unphysical(floating.mass, floating.inertia)):
        raise InputError(where, f"base: {problem}")
    try:
        arm = Arm(
            name=layout.name,
            joints=tuple(layout.joint),
            gravity=layout.gravity,
            base=layout.base,
            tool=layout.tool,
            controller=layout.controller,
            coupling=tuple(layout.coupling),
            effects=tuple(layout.effect),
            source=layout.source,
            capsule=None if layout.capsule is None else tuple(layout.capsule),
            unphysical=layout.unphysical,
            floating=floating,
            uncertainty=_named_file(layout.uncertainty),
            kinematic_uncertainty=_named_file(layout.kinematic_uncertainty),
        )
    except ValidationError as error:
        raise InputError(where, one_line(error)) from None
    check_terms(arm, where, sizes=True)
    return arm


def _in_other_units(joint: Joint) -> str:
    """An angle or a length of a D-H table that no arm has, with the unit that it seems to be in; "" without one."""
    for name in ("theta", "alpha", "beta"):
        if abs(value := getattr(joint, name)) > LARGEST_ANGLE:
            return f"{name}: {value:g} is more than a turn; must be in rad, not in degrees"
    for name in ("a", "d"):
        if abs(value := getattr(joint, name)) > LARGEST_LENGTH:
            return f"{name}: {value:g} m is longer than any arm; must be in m, not in mm"
    return ""


def on_fixed_base(arm: Arm, where: str | Path, purpose: str) -> Arm:
    """The arm; InputError where its base floats. ``purpose`` is what asks, as '"armscope identify"'."""
    if arm.floating is not None:
        raise InputError(
            where,
            f"has a floating base, and {purpose} takes arms on a fixed one; remove [base] to treat it as held, or see "
            "docs/underwater.md for what floating bases can do",
        )
    return arm


def _all_there(table: dict[str, Any], where: str | Path) -> None:
    """InputError where a joint lacks an entry that others have: a file that forgets one mass is a mistake.

    A file without any mass, com and inertia describes the geometry alone, for calibration.
    """
    entries = table.get("joint")
    joints = [joint for joint in entries if isinstance(joint, dict)] if isinstance(entries, list) else []
    weighed = any(name in joint for joint in joints for name in _INERTIAL)
    for number, joint in enumerate(joints, 1):
        for name in _NEEDED if weighed else ("type",):
            if name not in joint:
                raise InputError(where, f"joint[{number}].{name}: is missing")


def _base_of(base: Any, where: str | Path) -> tuple[FloatingBase | None, Any]:
    """The floating base of a table ``[base]`` and the pose of link frame 0 on it; (None, base) where it is a pose."""
    if not isinstance(base, dict):
        return None, base
    if base.get("kind") != "floating":
        raise InputError(
            where, 'base.kind: must be "floating"; of a fixed base, write base = [[..], [..], [..], [..]], its pose'
        )
    entries = {name: value for name, value in base.items() if name != "mount"}
    try:
        return TypeAdapter(FloatingBase).validate_python(entries), base.get("mount", IDENTITY)
    except ValidationError as error:
        raise InputError(where, f"base.{one_line(error)}") from None


def _base_table(floating: FloatingBase, mount: Pose) -> dict[str, Any]:
    """The table that ``_base_of`` reads back; entries at their defaults are left out."""
    default = {field.name: field.default for field in fields(FloatingBase)}
    table: dict[str, Any] = {
        name: value
        for name, value in asdict(floating).items()
        if name in ("kind", "mass", "inertia") or (value != default[name] and name not in ("thruster", "controller"))
    }
    if mount != IDENTITY:
        table["mount"] = [list(row) for row in mount]
    if floating.thruster:
        sound = {field.name: field.default for field in fields(Thruster)}
        table["thruster"] = [
            {name: value for name, value in asdict(thruster).items() if name == "gain" or value != sound[name]}
            for thruster in floating.thruster
        ]
    if floating.controller is not None:
        entries = asdict(floating.controller)
        table["controller"] = {name: value for name, value in entries.items() if value is not None}
    return table


def model_table(arm: Arm) -> dict[str, Any]:
    """The table that ``arm_of`` reads back as an equal arm; entries at their defaults are left out."""
    table: dict[str, Any] = {"name": arm.name, "units": "SI"}
    for text in ("source", "unphysical"):
        if getattr(arm, text):
            table[text] = getattr(arm, text)
    table["gravity"] = list(arm.gravity)
    for name in ("base", "tool"):
        if getattr(arm, name) != IDENTITY and (name != "base" or arm.floating is None):
            table[name] = [list(row) for row in getattr(arm, name)]
    if arm.floating is not None:
        table["base"] = _base_table(arm.floating, arm.base)
    if arm.capsule is not None:
        table["capsule"] = [asdict(capsule) for capsule in arm.capsule]
    default = asdict(Joint())
    table["joint"] = [
        {
            name: _short(name, value)
            for name, value in asdict(joint).items()
            if name in _NEEDED or value != default[name]
        }
        for joint in arm.joints
    ]
    if arm.controller is not None:
        table["controller"] = {name: value for name, value in asdict(arm.controller).items() if value is not None}
    if arm.coupling:
        table["coupling"] = [asdict(entry) for entry in arm.coupling]
    if arm.effects:
        table["effect"] = [
            {name: value for name, value in asdict(effect).items() if value is not None} for effect in arm.effects
        ]
    return table


def _short(name: str, value: Any) -> Any:
    """Viscous friction that is alike in both directions as one number."""
    return value[0] if name == "viscous" and value[0] == value[1] else value


def write_model(path: str | Path, arm: Arm, *, heading: str = "") -> None:
    """Writes a model file that ``read_model`` reads back as an equal arm; whole or not at all.

    What is known of its parameters goes into files beside it, for model.toml ``model_uncertainty.json``, and
    ``model_kinematic_uncertainty.json`` for its geometry.
    """
    table, files = model_table(arm), {}
    for key, uncertainty in (("uncertainty", arm.uncertainty), ("kinematic_uncertainty", arm.kinematic_uncertainty)):
        if uncertainty is not None and uncertainty.parameters:
            file = Path(path).with_name(f"{Path(path).stem}_{key}.json")
            write_uncertainty(file, uncertainty)
            files[key] = file.name
    if files:
        table = {"name": table.pop("name"), "units": table.pop("units"), **files, **table}
    write_toml(path, table, heading=heading)
