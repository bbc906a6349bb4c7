"""A folder as a laboratory leaves it: recordings by the recorder, results as the commands write them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from arm_archive import Filters, open_archive
from daq.acquisition.ledger import Loss, LossReason
from daq.acquisition.rows import Rows
from daq.recording.parts import Attachments
from daq.recording.recorder import Recorder, rows_layout

DAY = 86_400 * 10**9
START = 1_767_225_600 * 10**9
"""ns: 2026-01-01T00:00:00Z."""
FRICTION = {"joint1.coulomb": (5.0, 0.1), "joint2.coulomb": (7.0, 0.2)}
"""Of an identification: value and std, N m."""


def record(
    path: Path, *, day: float = 0.0, rows: int = 400, lost: int = 0, arm: str = "Puma 560", **tables: Any
) -> Path:
    """A measured recording of two joints at 1 kHz; ``lost`` rows in its middle are missing."""
    path.parent.mkdir(parents=True, exist_ok=True)
    attachments = Attachments(
        rig=tables.get("rig", 'name = "cell 4"\n'),
        model=f'name = "{arm}"\n',
        experiment=f'name = "{tables.get("experiment", "fit")}"\n',
        calibration={"hash": tables.get("calibration", "c0ffee"), "count_column": [], "volt_column": []},
        provenance={"kind": "measured", "made": "2020-02-02T02:02:02+00:00"},
    )
    recorder = Recorder(path, rows_layout(["j1", "j2"]), attachments, live=False)
    half = rows // 2
    for number in (np.arange(half), np.arange(half + lost, rows + lost)):
        recorder.append(_rows(number, START + int(day * DAY)))
    losses = [Loss(half, lost, LossReason.QUEUE_FULL, "")] if lost else []
    recorder.finish(losses=losses)
    return path


def _rows(number: np.ndarray, start: int) -> Rows:
    empty = np.empty((len(number), 0))
    ns = start + number * 10**6
    q = np.sin(number * 1e-3)[:, None] * [1.0, 0.5]
    return Rows(
        number=number,
        host_ns=ns,
        wall_ns=ns,
        tick=number,
        counts=empty.astype(np.int64),
        volts=empty,
        quality=empty.astype(np.uint8),
        q=q,
        i=2 * q,
        points=None,
        qref=None,
    )


def identification(folder: Path, values: dict[str, tuple[float, float]], **extra: Any) -> Path:
    """identification.json with these base parameters (value, std), model.toml and report.html."""
    folder.mkdir(parents=True, exist_ok=True)
    entries = [
        {"name": name, "expression": name, "value": v, "std": s, "unit": "N m", "identifiable": True}
        for name, (v, s) in values.items()
    ]
    table = {
        "schema": "armscope.identification/1",
        "method": "wls",
        "fit": ["somewhere/fit.mcap"],
        "held_out": ["held.mcap"],
        "parameters": entries,
        "base_parameters": entries,
        "relative_error": {"fit": 0.01, "held_out": 0.0125},
        "held_directions": 0,
        "blocks": 40,
    } | extra
    (folder / "identification.json").write_text(json.dumps(table))
    (folder / "model.toml").write_text('name = "Puma 560"\n')
    (folder / "report.html").write_text("<p>report</p>")
    return folder / "identification.json"


def diagnosis(folder: Path, size: float | None, **extra: Any) -> Path:
    """diagnosis.json that names a backlash of joint 2 of this half gap, or nothing."""
    folder.mkdir(parents=True, exist_ok=True)
    gap = {"half_gap": {"value": size, "std": 1e-5, "unit": "rad"}}
    cause = {"effect": "backlash", "joint": 2, "parameters": gap, "confidence": 0.98, "group": []}
    table = {
        "schema": "armscope.diagnosis/1",
        "verdict": "consistent" if size is None else "explained",
        "fit": ["fit.mcap"],
        "held_out": [],
        "causes": [] if size is None else [cause],
        "not_visible": [],
    } | extra
    (folder / "diagnosis.json").write_text(json.dumps(table))
    return folder / "diagnosis.json"


def rows_of(folder: Path, **filters: Any) -> list[dict[str, Any]]:
    """What the archive of a folder lists."""
    with open_archive(folder) as archive:
        return archive.rows(Filters(**filters))
