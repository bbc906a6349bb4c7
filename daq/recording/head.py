"""A recording apart from its rows: its file, its layout, what it was recorded with, and what is missing in it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arm_io import toml_of
from arm_io.dates import utc_date, utc_date_of
from arm_io.types import Array
from daq.acquisition.ledger import LedgerSummary
from daq.recording.messages.row_format import Layout

CALENDAR = 10**17
"""ns since 1970 (March 1973): earlier times of rows count from the beginning of a table, and are no dates."""


@dataclass(frozen=True, eq=False, repr=False)
class RecordingHead:
    """The common part of ``Recording`` (all rows in memory) and ``LongRecording`` (block by block).

    path        the file
    layout      its columns; ``layout.raw`` distinguishes a recording of devices from an imported or simulated one
    attachments every attachment by file name
    ledger      triggers = rows here + rows lost, each loss with its reason
    finished    False: the recording was cut off
    notes       sentences about what is wrong with the file; empty for a whole one
    rig, experiment  tables of the TOML files; model: its TOML text
    calibration, provenance  as recorded
    """

    path: Path
    layout: Layout
    attachments: dict[str, bytes]
    ledger: LedgerSummary
    finished: bool
    notes: tuple[str, ...]

    @property
    def joints(self) -> int:
        """J."""
        return len(self.layout.joints)

    @property
    def rig(self) -> dict[str, Any]:
        """The rig file; empty where the recording carries none."""
        return self._toml("rig.toml") or {}

    @property
    def base_from_tracker(self) -> Array | None:
        """(4, 4) pose of the frame of the tracker's points in the base frame, where the rig says it."""
        pose = self.rig.get("tracker", {}).get("base_from_tracker") if self.layout.points == "tracker" else None
        return None if pose is None else np.array(pose, float)

    @property
    def model(self) -> str | None:
        """Text of the model file."""
        data = self.attachments.get("model.toml")
        return None if data is None else data.decode()

    @property
    def experiment(self) -> dict[str, Any] | None:
        """The experiment file."""
        return self._toml("experiment.toml")

    @property
    def calibration(self) -> dict[str, Any] | None:
        """Scales and offsets by which raw counts and volts became angles and currents."""
        data = self.attachments.get("calibration.json")
        return None if data is None else json.loads(data)

    @property
    def provenance(self) -> dict[str, Any]:
        """What made the recording: when, where, with which versions, from which files."""
        return json.loads(self.attachments.get("provenance.json", b"{}"))

    @property
    def run(self) -> dict[str, Any] | None:
        """How the run ended, its notes and clocks, of a measured recording."""
        data = self.attachments.get("run.json")
        return None if data is None else json.loads(data)

    @property
    def fault(self) -> str | None:
        """What ended the run before it was whole, such as a device that did not answer; None for a whole one."""
        ending = (self.run or {}).get("ending") or {}
        return f"the run was ended by a fault: {ending.get('sentence')}" if ending.get("fault") else None

    def date_at(self, wall_ns: NDArray[np.int64]) -> str | None:
        """'2026-11-22T09:30:00Z' of the first of some rows.

        Where rows have no date: the one that was stated on import, else when the recording was made.
        """
        if len(wall_ns) and wall_ns[0] > CALENDAR:
            return utc_date(int(wall_ns[0]))
        return utc_date_of(self.provenance.get("recorded") or self.provenance.get("made"))

    def position_unit(self, joint: int) -> str:
        """rad, or m of a joint (from 1) that slides, as the rig says, or the model of an import or simulation."""
        types = self.provenance.get("joint_types", [])
        kind = types[joint - 1] if joint <= len(types) else self._joint_table(joint).get("type")
        return "m" if kind == "prismatic" else "rad"

    def current_unit(self, joint: int) -> str:
        """Of ``i`` of a joint (from 1): A, N m or N (torque or force at the joint), % or "drive".

        An imported table may be in the drive's own unit.
        """
        unit: str = self.provenance.get("current_unit", "")
        if not unit and self.provenance.get("kind") == "imported":
            return "drive"
        unit = unit or self._joint_table(joint).get("current", {}).get("unit", "A")
        return "N" if unit == "N m" and self.position_unit(joint) == "m" else unit

    def _joint_table(self, joint: int) -> dict[str, Any]:
        tables = self.rig.get("joint", [])
        table: dict[str, Any] = tables[joint - 1] if joint <= len(tables) else {}
        return table

    def _toml(self, name: str) -> dict[str, Any] | None:
        data = self.attachments.get(name)
        return None if data is None else toml_of(data.decode(), f"{self.path}: {name}")
