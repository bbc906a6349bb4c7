"""Many recordings through the whole chain."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from mcap.reader import make_reader

from daq.recording import open_recording
from tests.sim_backend.recordings import record
from tests.sim_backend.slow_disk import slow_disk
from tests.sim_backend.test_chain import _experiment


def test_recordings_of_one_bench_are_whole_and_each_its_own(root: Path, tmp_path: Path) -> None:
    experiments = [_experiment(name=f"run {k}", start=[0.1 * k, -1.5, 1.5, 0.0, 0.5, 0.0]) for k in range(3)]
    paths = record(root / "config/puma560_sim.toml", experiments, tmp_path)
    for k, path in enumerate(paths):
        recording = open_recording(path)
        assert recording.ledger.balanced and recording.ledger.lost == 0 and recording.gaps == []
        assert np.abs(recording.q[0] - experiments[k].start).max() < 2e-4
        assert recording.qref is not None and np.abs(recording.q - recording.qref).max() < 0.05
        assert recording.xyz is not None and np.isfinite(recording.xyz[::3]).all()


def test_a_slow_disk_loses_nothing_as_long_as_there_is_memory(root: Path, tmp_path: Path) -> None:
    with slow_disk(0.3) as waits:
        (path,) = record(root / "config/puma560_sim.toml", [_experiment()], tmp_path)
    # One a batch of rows, which is no larger than a chunk here: 0.3 s are 300 rows.
    with open(path, "rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None and waits.count >= len(summary.chunk_indexes) > 0
    assert open_recording(path).ledger.lost == 0
