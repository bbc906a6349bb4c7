"""The recorded demand is that of its row's time: its origin is the instant at which the motion began."""

from __future__ import annotations

import re
import time
from pathlib import Path

import numpy as np
import pytest

from arm_io import read_toml
from daq.acquisition.acquisition import Acquisition
from daq.rig import read_rig
from daq.rig.bench import open_bench
from experiment import demand_of, experiment_of
from sim_backend.rig.world import World
from tests.daq.benches import joined


def test_the_demand_of_a_row_is_that_of_its_time(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Within the time that the start signal takes, where that is long the recording says how long."""
    began: list[tuple[World, int]] = []
    write_start = World.write_start

    def watched(world: World, high: bool) -> None:
        write_start(world, high)
        if world.start_ns is not None:
            began.append((world, world.start_ns))

    monkeypatch.setattr(World, "write_start", watched)
    table = read_toml(root / "config/experiments/iso_cube.toml")
    table["segment"] = [{"type": "drive", "joint": 1, "by": 0.3}]
    motion = experiment_of(table, "nudge")
    with open_bench(read_rig(root / "config/puma560_sim.toml")) as bench:
        acquisition = Acquisition(bench, motion)
        rows = joined(list(acquisition.rows()))
    [(_, at)] = began
    assert rows.qref is not None
    true = demand_of(motion)((rows.host_ns - at) * 1e-9)
    speed = np.abs(np.gradient(true[:, 0], rows.host_ns * 1e-9)).max()
    uncertain = [float(took) for note in acquisition.notes for took in re.findall("known to (.*) ms", note)]
    assert np.abs(rows.qref - true).max() < max([1.0, *uncertain]) * 1.1e-3 * speed


def test_a_start_signal_that_takes_long_is_noted(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_start = World.write_start

    def slow(world: World, high: bool) -> None:
        write_start(world, high)
        time.sleep(0.02)

    monkeypatch.setattr(World, "write_start", slow)
    table = read_toml(root / "config/experiments/iso_cube.toml")
    table["segment"] = [{"type": "hold", "duration": 0.1}]
    with open_bench(read_rig(root / "config/puma560_sim.toml")) as bench:
        acquisition = Acquisition(bench, experiment_of(table, "hold"))
        joined(list(acquisition.rows()))
    [note] = [note for note in acquisition.notes if "start signal" in note]
    assert re.match("the start signal took .* ms: the demand's times are known to .* ms", note)
