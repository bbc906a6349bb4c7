"""Faults of the rig file, met by the sampler.

What is lost is accounted for, and no row is joined with its neighbour's.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daq.acquisition.acquisition import Acquisition
from daq.acquisition.ledger import LossReason
from daq.acquisition.rows import Rows
from daq.acquisition.states import End
from drivers.protocols import Quality
from tests.sim_backend.test_chain import _experiment, _fast, _record


def _with(root: Path, *faults: dict[str, Any]) -> tuple[Rows, Acquisition]:
    return _record(_fast(root, fault=list(faults)), _experiment())


@pytest.fixture(scope="module")
def whole(root: Path) -> Rows:
    return _with(root)[0]


@pytest.mark.parametrize("device", ["counter1", "analog"])
def test_a_lost_edge_costs_its_row_and_shifts_none(root: Path, whole: Rows, device: str) -> None:
    rows, acquisition = _with(root, {"kind": "lost_edge", "device": device, "number": 500, "count": 2})
    summary = acquisition.ledger.summary()
    assert summary.lost == 2 and {loss.reason for loss in summary.losses} == {LossReason.LOST_EDGE}
    assert np.setdiff1d(whole.number, rows.number).tolist() == [500, 501]
    there = np.isin(whole.number, rows.number)
    assert np.array_equal(rows.counts, whole.counts[there]) and np.array_equal(rows.volts, whole.volts[there])


@pytest.mark.parametrize("device", ["counter2", "analog"])
def test_an_extra_edge_makes_no_row(root: Path, whole: Rows, device: str) -> None:
    rows, acquisition = _with(root, {"kind": "extra_edge", "device": device, "number": 700})
    assert acquisition.ledger.summary().lost == 0 and any(device in note for note in acquisition.notes)
    assert np.array_equal(rows.counts, whole.counts) and np.array_equal(rows.volts, whole.volts)


def test_rows_that_a_card_had_no_room_for_are_lost_with_a_reason(root: Path, whole: Rows) -> None:
    rows, acquisition = _with(root, {"kind": "lost_row", "device": "counter2", "number": 900, "count": 30})
    summary = acquisition.ledger.summary()
    assert summary.lost == 30 and summary.losses[0].reason is LossReason.NOT_LATCHED
    assert np.setdiff1d(whole.number, rows.number).tolist() == list(range(900, 930))
    assert np.array_equal(rows.counts, whole.counts[np.isin(whole.number, rows.number)])


def test_an_unplugged_card_ends_the_run_with_the_rows_so_far(root: Path, whole: Rows) -> None:
    rows, acquisition = _with(root, {"kind": "unplugged", "device": "counter2", "at": 1.25})
    assert acquisition.ending is not None and acquisition.ending.reason is End.DEVICE_LOST
    assert "counter2" in str(acquisition.ending)
    assert 1000 <= len(rows) <= 1250 and np.array_equal(rows.counts, whole.counts[: len(rows)])
    summary = acquisition.ledger.summary()
    assert summary.triggers == len(rows) + summary.lost and summary.losses[0].reason is LossReason.DEVICE_GONE


def test_a_tracker_that_stops_stops_the_clock(root: Path) -> None:
    rows, acquisition = _with(root, {"kind": "tracker_stops", "device": "tracker", "samples": 800})
    assert acquisition.ending is not None and acquisition.ending.reason is End.TRIGGER_STOPPED and len(rows) == 800


def test_clock_drift_is_in_the_fits(root: Path) -> None:
    drifts = {"counter1": 150.0, "analog": -80.0}
    faults = [{"kind": "clock_drift", "device": name, "ppm": ppm} for name, ppm in drifts.items()]
    _, acquisition = _with(root, *faults)
    rates = {fit.device: fit.tick_rate for fit in acquisition.clocks()}
    for name, ppm in drifts.items():
        assert (rates[name] / rates["counter2"] - 1) * 1e6 == pytest.approx(ppm, abs=10)


def test_marks_of_a_card_come_through(root: Path, whole: Rows) -> None:
    rows, _ = _with(
        root,
        {"kind": "emi_counts", "device": "counter1", "channel": 1, "at": 0.5, "counts": 60, "noticed": True},
        {"kind": "beam_break", "device": "tracker", "at": 0.3, "back": 0.4},
    )
    error = rows.counts - whole.counts
    assert (error[500:, 1] == 60).all() and not error[:499].any()
    assert (rows.quality[:, 1] & Quality.QUADRATURE_ERROR).nonzero()[0].tolist() == [499]
    assert rows.points is not None and np.isnan(rows.points[300:399]).all()
