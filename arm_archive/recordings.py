"""One recording as an entry of the archive."""

from __future__ import annotations

import hashlib
import math
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from arm_archive.entries import RECORDING, Entry
from arm_archive.folder import Found
from arm_io import InputError, toml_of
from daq.recording import LongRecording, open_long
from daq.recording.losses import unreported


def recording_entry(folder: Path, found: Found) -> Entry:
    """Entry of a recording, which is read once with bounded memory; errors in it become its ``state`` and ``note``."""
    try:
        with unreported():
            recording = open_long(folder / found.path, damaged=True)
        return _entry(found.path, recording)
    except InputError as error:
        return Entry(path=found.path, kind=RECORDING, state="unreadable", note=error.what)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        note = f"an attachment has another layout: {type(error).__name__}: {error}"
        return Entry(path=found.path, kind=RECORDING, state="unreadable", note=note)


def _entry(path: str, recording: LongRecording) -> Entry:
    made, rig, experiment = recording.provenance, recording.rig, recording.experiment or {}
    model = recording.attachments.get("model.toml")
    return Entry(
        path=path,
        kind=RECORDING,
        state="unfinished" if not recording.finished else "damaged" if recording.notes else "whole",
        note="; ".join(recording.notes) or None,
        date=recording.date,
        date_of="recording",
        arm=_model_name(recording) or _name(rig),
        rig=_name(rig),
        experiment=_name(experiment),
        source=str(made.get("kind", "measured" if recording.layout.raw else "table")),
        joints=recording.joints,
        rows=len(recording),
        lost=recording.ledger.lost,
        seconds=recording.duration,
        rate=1 / recording.dt if math.isfinite(recording.dt) and recording.dt > 0 else None,
        calibration=str((recording.calibration or {}).get("hash") or "") or None,
        model=None if model is None else hashlib.sha256(model).hexdigest(),
    )


def _model_name(recording: LongRecording) -> str | None:
    """Name of the arm's model, from a TOML table or the root of an XML text (URDF: name, MJCF: model)."""
    text = recording.model
    if text is None:
        return None
    if not text.lstrip("\ufeff \t\r\n").startswith("<"):
        return _name(toml_of(text, f"{recording.path}: model.toml"))
    try:
        root = ElementTree.fromstring(text.lstrip("\ufeff \t\r\n").encode())
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise InputError(f"{recording.path}: model.toml", f"cannot be read as XML: {error}") from None
    return _name({"name": root.get("name") or root.get("model")})


def _name(table: dict[str, Any]) -> str | None:
    name = table.get("name")
    return name if isinstance(name, str) and name else None
