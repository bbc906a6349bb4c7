"""What a recording of imported rows carries beside them: rig, model, the chain for viewers, where they come from."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from arm_io import read_text
from daq.recording import Attachments, Table
from daq.recording.provenance import file_identity, provenance
from daq.recording.tables import Mapping as Columns

if TYPE_CHECKING:
    from arm_clearance import Chain
    from daq.rig import Rig


def attachments_of(
    table: Path,
    rig: Path | None,
    checked: Rig | None,
    first: Table,
    chosen: Columns | None,
    per_current: list[float] | None,
) -> Attachments:
    """Rig, model, and where the rows of a table come from.

    rig, checked  the rig file if one was given, and its joints, or those of a model; chosen: how columns were read
    per_current   N m/A (N/A) of each joint by which torques were divided; None: they stay what they are
    """
    model = None if checked is None else checked.model_path
    details: dict[str, Any] = {} if first.epoch is None else {"epoch": str(first.epoch)}
    if rig is None and checked is not None:
        details["joint_types"] = [joint.type for joint in checked.joint]
    elif rig is None and chosen is not None and (types := chosen.joint_types(first.joints)):
        details["joint_types"] = types
    if chosen is not None:
        details |= {
            "mapping": chosen.model_dump(exclude_none=True, exclude_defaults=True),
            "current_unit": _unit(chosen, per_current),
        }
    return Attachments(
        rig=None if rig is None else read_text(rig),
        model=None if model is None else read_text(model),
        provenance=provenance("imported", source=_identity(table), **details),
        chain=_chain(model, first),
    )


def _identity(table: Path) -> dict[str, Any]:
    """Of a file, or of the files of a bag's folder."""
    if not table.is_dir():
        return file_identity(table)
    return {"name": table.name, "files": [file_identity(path) for path in sorted(table.iterdir()) if path.is_file()]}


def _unit(mapping: Columns, per_current: list[float] | None) -> str:
    """Of ``i`` in the recording."""
    if mapping.torques:
        return "A" if per_current else "N m"
    unit = (mapping.units_of("i", 1) or ["drive"])[0]
    return "A" if unit == "mA" else unit


def _chain(model: Path | None, first: Table) -> Chain | None:
    """The arm for viewers; None without a model, for another number of joints, or where it floats without a pose."""
    from arm_model import read_model
    from arm_model.collision import chain_of

    if model is None or ((arm := read_model(model)).floating is not None and not first.has_pose):
        return None
    chain = chain_of(arm)
    return chain if len(chain) == first.joints else None
