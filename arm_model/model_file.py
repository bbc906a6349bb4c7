"""Model files (``config/models/*.toml``): an arm as a person writes it, read, checked and written back."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, ValidationError

from arm_io import InputError, check_table, read_toml, write_toml
from arm_io.table import Table
from arm_io.toml import one_line
from arm_model.description import IDENTITY, Arm, Capsule, Controller, Coupling, EffectTerm, Joint, Pose, Vector
from arm_model.effects import check_terms, dissipation
from arm_model.mjcf import SUFFIXES, read_mjcf
from arm_model.rigid_body.inertia import unphysical
from arm_model.urdf import read_urdf


class _ModelFile(Table):
    """The layout: what an Arm has, with arrays of tables in the singular, as TOML reads best."""

    name: str
    units: Literal["SI"]
    source: str = ""
    unphysical: str = ""
    gravity: Vector = (0.0, 0.0, -9.80665)
    base: Pose = IDENTITY
    tool: Pose = IDENTITY
    capsule: list[Capsule] | None = None
    joint: list[Joint] = Field(min_length=1)
    controller: Controller | None = None
    coupling: list[Coupling] = Field(default=[])
    effect: list[EffectTerm] = Field(default=[])


_NEEDED = ("type", "mass", "com", "inertia")


def read_model(path: str | Path) -> Arm:
    """The arm in a model file (.toml), or in a URDF (.urdf) or MuJoCo model (.xml, .mjcf) with one serial chain.

    InputError (one line: file, entry, what would be right) for anything wrong or unphysical.
    """
    suffix = Path(path).suffix
    if suffix in SUFFIXES:
        return read_mjcf(path)
    return read_urdf(path) if suffix == ".urdf" else arm_of(read_toml(path), path)


def arm_of(table: dict[str, Any], where: str | Path) -> Arm:
    """The arm in a table as a model file has it; ``where`` names it in errors."""
    if "units" not in table:
        raise InputError(
            where, 'units: is missing; write units = "SI" (rad, m, kg, s, N, A) once all values are in them'
        )
    _all_there(table, where)
    layout = check_table(where, table, _ModelFile)
    for number, joint in enumerate(layout.joint, 1):
        if not layout.unphysical and (problem := unphysical(joint.mass, joint.inertia)):
            raise InputError(where, f"joint[{number}]: {problem}")
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
        )
    except ValidationError as error:
        raise InputError(where, one_line(error)) from None
    check_terms(arm, where)
    if not arm.unphysical and (driven := dissipation.problem(arm)):
        raise InputError(where, driven)
    return arm


def _all_there(table: dict[str, Any], where: str | Path) -> None:
    """Joint has defaults for people who build arms in code; a file that forgets a mass is a mistake."""
    joints = table.get("joint")
    for number, joint in enumerate(joints if isinstance(joints, list) else [], 1):
        for name in _NEEDED:
            if isinstance(joint, dict) and name not in joint:
                raise InputError(where, f"joint[{number}].{name}: is missing")


def model_table(arm: Arm) -> dict[str, Any]:
    """The table that ``arm_of`` reads back as an equal arm; entries at their defaults are left out."""
    table: dict[str, Any] = {"name": arm.name, "units": "SI"}
    for text in ("source", "unphysical"):
        if getattr(arm, text):
            table[text] = getattr(arm, text)
    table["gravity"] = list(arm.gravity)
    for name in ("base", "tool"):
        if getattr(arm, name) != IDENTITY:
            table[name] = [list(row) for row in getattr(arm, name)]
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
    """Writes a model file that ``read_model`` reads back as an equal arm; whole or not at all."""
    write_toml(path, model_table(arm), heading=heading)
