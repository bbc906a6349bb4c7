"""Entry of the index about one file: a recording or a result."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

RECORDING = "recording"
RESULTS = {
    "identification.json": "identification",
    "diagnosis.json": "diagnosis",
    "kinematics.json": "kinematics",
    "compare.json": "comparison",
}
"""File name of a result -> its kind."""
KINDS = (RECORDING, *RESULTS.values())


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One parameter of a result; ``std`` None: the result has no standard deviation."""

    name: str
    value: float
    std: float | None
    unit: str


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One file of the archive; None: not known, or not applicable to its kind.

    path         relative to the folder of the archive, with /
    kind         one of ``KINDS``
    state        whole; unfinished: cut off, readable; damaged: readable in parts; unreadable
    note         what is wrong with the file, in one sentence
    date         UTC, YYYY-MM-DDTHH:MM:SSZ: first row of a recording (of an imported or simulated one, when it was
                 made); of a result that of its first recording
    date_of      "recording", or "file": the result does not state a date, and that of its file is used
    arm, rig, experiment   names
    source       measured, imported or simulated
    joints, rows, lost     numbers; lost: triggers without a row
    seconds, rate          s; Hz (median)
    calibration, model     content hashes
    verdict      of a result, in a few words
    error        held-out error of a result: relative error (identification), rms per coordinate in m (kinematics)
    made_from    names of the recordings that a result used
    report       path of its HTML report, relative to the folder
    """

    path: str
    kind: str
    state: str = "whole"
    note: str | None = None
    date: str | None = None
    date_of: str | None = None
    arm: str | None = None
    rig: str | None = None
    experiment: str | None = None
    source: str | None = None
    joints: int | None = None
    rows: int | None = None
    lost: int | None = None
    seconds: float | None = None
    rate: float | None = None
    calibration: str | None = None
    model: str | None = None
    verdict: str | None = None
    error: float | None = None
    made_from: str | None = None
    report: str | None = None
    parameters: tuple[Parameter, ...] = field(default=(), repr=False)


COLUMNS = tuple(item.name for item in fields(Entry) if item.name != "parameters")
"""Columns of a row of the archive, in their order."""
NUMBERS = {
    "joints": "INTEGER",
    "rows": "INTEGER",
    "lost": "INTEGER",
    "seconds": "REAL",
    "rate": "REAL",
    "error": "REAL",
}
"""Columns with numbers, and their type in SQLite; the others contain text."""
