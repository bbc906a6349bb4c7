"""The sampler on the simulated Puma's rig files, as fast as it computes.

Faults of the simulation, found and accounted for.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daq.acquisition.ledger import LossReason
from daq.acquisition.states import End
from daq.rig.rig_file import Rig, read_rig
from experiment import Experiment, read_experiment
from tests.daq.benches import run


def _fast(path: Path, faults: list[dict[str, Any]] | None = None) -> Rig:
    rig = read_rig(path)
    rig.simulation.update(pace="fast", fault=faults or [])
    return rig


@pytest.fixture
def motion(root: Path) -> Experiment:
    return read_experiment(root / "config/experiments/thesis_11_joint3_100_forward.toml")


def test_a_test_of_the_thesis_ends_where_it_should(root: Path, motion: Experiment) -> None:
    acquisition, rows = run(_fast(root / "config/puma560_sim.toml"), experiment=motion)
    assert rows is not None and rows.qref is not None and rows.points is not None
    assert acquisition.ending is not None and acquisition.ending.reason is End.MOTION_DONE
    assert acquisition.ledger.summary().lost == 0 and acquisition.notes == []
    count = 2 * np.pi / 1000 / 53.7
    assert np.abs(rows.q[0] - motion.start).max() < 5 * count
    assert np.abs(rows.q[-1] - rows.qref[-1]).max() < 0.01
    # A negative gear: the count goes the other way, position and current do not.
    fast = rows.qref[:, 2] > 0
    assert rows.counts[-1, 2] < rows.counts[0, 2] and rows.q[-1, 2] > rows.q[0, 2]
    assert fast.any()
    seen = ~np.isnan(rows.points[:, 0])
    assert np.flatnonzero(seen)[:4].tolist() == [0, 3, 6, 9]  # 350 points/s of 1000


def test_edges_that_one_card_missed_shift_no_joint_against_another(root: Path, motion: Experiment) -> None:
    faults = [
        {"kind": "lost_edge", "device": "counter1", "number": 700},
        {"kind": "extra_edge", "device": "counter2", "number": 900},
        {"kind": "lost_row", "device": "analog", "number": 1200, "count": 3},
    ]
    _, clean = run(_fast(root / "config/puma560_sim.toml"), experiment=motion)
    acquisition, rows = run(_fast(root / "config/puma560_sim.toml", faults), experiment=motion)
    assert clean is not None and rows is not None
    assert np.array_equal(np.setdiff1d(clean.number, rows.number), [700, 1200, 1201, 1202])
    same = np.isin(clean.number, rows.number)
    assert np.array_equal(rows.counts, clean.counts[same])
    assert np.array_equal(rows.volts, clean.volts[same])
    losses = {(loss.first, loss.rows, loss.reason) for loss in acquisition.ledger.summary().losses}
    assert losses == {(700, 1, LossReason.LOST_EDGE), (1200, 3, LossReason.NOT_LATCHED)}
    assert acquisition.ledger.imbalance() is None
    assert any("counter2: 1 edges" in note for note in acquisition.notes)


def test_a_tracker_on_its_own_time_gives_each_point_to_the_nearest_row(root: Path) -> None:
    _, rows = run(_fast(root / "config/puma560_sim_20khz.toml"), seconds=0.3)
    assert rows is not None and rows.points is not None
    assert len(rows) == 6000
    seen = np.flatnonzero(~np.isnan(rows.points[:, 0]))
    assert len(seen) == pytest.approx(300, abs=2)
    assert np.abs(np.diff(seen) - 20).max() <= 1
