"""What was taken of a hidden case, as the finder gets it: files, written and read back."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from daq.acquisition.rows import Rows
from daq.recording import Recording, open_recording
from daq.recording.parts import Attachments
from daq.recording.recorder import Recorder, rows_layout
from daq.recording.tables.csv_reader import read_csv
from daq.recording.tables.table import write_table
from tests.blind.instruments import RIG, instruments
from tests.blind.laboratory import Laboratory


def write_recording(path: Path, rows: Rows, laboratory: Laboratory) -> None:
    """One MCAP file, by the recorder or, from a table, as ``armscope import`` does."""
    if laboratory.route == "table":
        table = path.with_suffix(".csv")
        _write_csv(table, rows)
        data = read_csv(table, joints=rows.q.shape[1])
        write_table(path, data.t, data.signals, Attachments(rig=RIG.read_text(encoding="utf-8")))
        table.unlink()
        return
    its = instruments()
    joints = [joint.name or "" for joint in its.rig.joint]
    counters = [f"counter.{k}" for k in range(len(joints))]
    layout = rows_layout(joints, counters=counters, inputs=[f"analog.{k}" for k in range(len(joints))], demand=True)
    attachments = Attachments(rig=RIG.read_text(encoding="utf-8"), calibration=its.calibration.as_table())
    with Recorder(path, layout, attachments, live=False) as recorder:
        recorder.append(rows)


def _write_csv(path: Path, rows: Rows) -> None:
    n = rows.q.shape[1]
    assert rows.qref is not None
    names = ["t", *(f"{signal}{j}" for signal in ("q", "i", "qref") for j in range(1, n + 1))]
    values = np.column_stack([rows.wall_ns * 1e-9, rows.q, rows.i, rows.qref])
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        writer.writerows([[f"{value:.10g}" for value in row] for row in values.tolist()])


def read_recordings(folder: Path) -> tuple[list[Recording], list[Recording]]:
    """(fit, held out) recordings of a folder: files fit_K.mcap and held_out_K.mcap."""
    fit, held_out = ([open_recording(p) for p in sorted(folder.glob(f"{side}_*.mcap"))] for side in ("fit", "held_out"))
    return fit, held_out
