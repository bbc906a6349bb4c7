"""What is in a recording, as one table that becomes JSON or a page of text."""

from __future__ import annotations

import hashlib
import math
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from daq.recording.mcap_file.checksums import SENTENCES, verify
from daq.recording.mcap_file.pages import mapped
from daq.recording.messages.row_format import JOINT_TOPICS, format_of
from daq.recording.parts import ledger_table
from daq.recording.reader import Recording
from drivers.protocols import Quality

_UNITS = {"v": "V", "temp": "degC"}


def summary(recording: Recording) -> dict[str, Any]:
    """The table; numbers that do not exist are None. ``intervals`` and ``duration`` in s, ``rate`` in Hz (median)."""
    layout, t = recording.layout, recording.t
    steps = np.diff(t) if len(t) > 1 else np.full(1, np.nan)
    return {
        "schema": "armscope.info/1",
        "file": str(recording.path),
        "bytes": recording.path.stat().st_size,
        "kind": recording.provenance.get("kind", "measured" if layout.raw else "table"),
        "finished": recording.finished,
        "notes": list(recording.notes),
        "rig": recording.rig.get("name"),
        "experiment": (recording.experiment or {}).get("name"),
        "run": recording.run,
        "rows": len(recording),
        "start": _wall(recording) if layout.raw else None,
        "duration": float(t[-1]) if len(t) else 0.0,
        "rate": _number(1 / np.median(steps)),
        "intervals": {
            name: _number(get(steps)) for name, get in (("min", np.min), ("median", np.median), ("max", np.max))
        },
        "joints": list(layout.joints),
        "signals": _signals(recording),
        "counters": list(layout.counters),
        "inputs": list(layout.inputs),
        "extra": list(layout.extra),
        "doubts": _doubts(recording),
        "topics": [{"topic": topic.name, "type": topic.type} for topic in format_of(layout.to_json()).topics],
        "ledger": ledger_table(recording.ledger),
        "gaps": [{"row": gap.row, "triggers": gap.triggers, "seconds": gap.seconds} for gap in recording.gaps],
        "calibration": recording.calibration,
        "provenance": recording.provenance,
        "attachments": [
            {"name": name, "bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}
            for name, data in recording.attachments.items()
        ],
    }


def verification_table(path: Path) -> dict[str, Any]:
    """What the checksums of a file say."""
    found = verify(mapped(path))
    return {
        "integrity": str(found.integrity),
        "sentence": SENTENCES[found.integrity],
        "records": found.records,
        "damages": [damage.sentence for damage in found.damages],
    }


def current_unit(recording: Recording) -> str:
    """Of ``i``: A, but an imported table may have it in the drive's own command unit, and does not say."""
    return "drive" if recording.provenance.get("kind") == "imported" else "A"


def _signals(recording: Recording) -> list[dict[str, Any]]:
    """Each measured column: which samples are missing, and what the others are like."""
    kinds = [joint.get("type", "revolute") for joint in recording.rig.get("joint", [])]
    table = []
    for signal in JOINT_TOPICS:
        for joint in recording.layout.signals.get(signal, ()):
            if signal == "i":
                unit = current_unit(recording)
            else:
                unit = _UNITS.get(signal, "m" if kinds[joint - 1 : joint] == ["prismatic"] else "rad")
            values = getattr(recording, signal)[:, joint - 1]
            table.append({"signal": signal, "joint": joint, "unit": unit} | _statistics(values))
    points = recording.points if recording.points is not None else recording.xyz
    if points is not None:
        frame = {"frame": recording.layout.points, "unit": "m"}
        table += [{"signal": axis, "joint": None} | frame | _statistics(points[:, k]) for k, axis in enumerate("xyz")]
    return table


def _statistics(values: np.ndarray) -> dict[str, Any]:
    there = values[~np.isnan(values)]
    numbers = (there.min(), there.max(), np.sqrt(np.mean(there**2))) if len(there) else (math.nan,) * 3
    return {"missing": len(values) - len(there)} | {
        name: _number(number) for name, number in zip(("min", "max", "rms"), numbers)
    }


def _doubts(recording: Recording) -> dict[str, int] | None:
    """How many values carry which quality bit; None where nobody judged them."""
    if recording.quality is None:
        return None
    return {bit.name.lower(): int(np.count_nonzero(recording.quality & bit)) for bit in Quality if bit and bit.name}


def _wall(recording: Recording) -> str | None:
    if not len(recording):
        return None
    return datetime.fromtimestamp(recording.wall_ns[0] * 1e-9, UTC).isoformat(timespec="milliseconds")


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
