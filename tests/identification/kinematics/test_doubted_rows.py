"""What the instruments themselves doubt is no measurement for a calibration."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from daq.recording import Recording, open_recording
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table
from drivers.protocols import Quality
from identification.kinematics.data.recordings import tracked

ROWS = 2000


@pytest.fixture
def recording(tmp_path: Path) -> Recording:
    """Two joints and a target, as if counters 0 and 1 and a tracker had seen them."""
    t = np.arange(ROWS) / 1000
    q = np.stack([np.sin(t), 0.3 * np.cos(2 * t)], axis=1)
    xyz = np.stack([np.cos(t), np.sin(t), t], axis=1)
    write_table(tmp_path / "run.mcap", t, {"q": q, "i": np.zeros_like(q), "xyz": xyz}, Attachments())
    found = open_recording(tmp_path / "run.mcap")
    layout = replace(found.layout, raw=True, counters=("a", "b"), points="base")
    table = {"count_column": [0, 1], "volt_column": [-1, -1]}
    attachments = {**found.attachments, "calibration.json": json.dumps(table).encode()}
    return replace(found, layout=layout, attachments=attachments, quality=np.zeros((ROWS, 3), np.uint8))


def test_doubted_angles_and_points_are_left_out(recording: Recording) -> None:
    assert recording.quality is not None and recording.xyz is not None
    clean = tracked(recording).run
    assert clean.usable.all()
    bad = replace(recording, q=recording.q.copy(), xyz=recording.xyz.copy())
    assert bad.q is not None and bad.xyz is not None and bad.quality is not None
    bad.quality[300, 0] = Quality.STALE
    bad.quality[700:900, 1] = Quality.MISSING
    bad.quality[1500, 2] = Quality.LATE
    bad.quality[1600, 2] = Quality.QUADRATURE_ERROR | Quality.SATURATED
    bad.q[300, 0], bad.q[700:900, 1] = 5.0, 0.0  # what a placeholder would do
    bad.xyz[[1500, 1600]] = 9.0
    run = tracked(bad).run
    out = np.zeros(ROWS, bool)
    out[[300, *range(700, 900), 1500, 1600]] = True
    np.testing.assert_array_equal(run.usable, ~out)
    # The neighbours do not feel a placeholder, and are smoothed on.
    np.testing.assert_allclose(run.q[~out], clean.q[~out], atol=1e-5)
    np.testing.assert_array_equal(run.xyz[~out], clean.xyz[~out])
