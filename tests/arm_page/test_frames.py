"""Frames against the rows they are made of: nothing is left out, however the rows are cut into blocks."""

from __future__ import annotations

import json

import numpy as np
import pytest

from arm_page.frames import FRAME_NS, KEPT, Frame, FrameMaker, Ring
from arm_page.telemetry import Telemetry
from drivers.protocols import Quality

POSE = [[0.0, -1.0, 0.0, 1.0], [1.0, 0.0, 0.0, 2.0], [0.0, 0.0, 1.0, 3.0], [0.0, 0.0, 0.0, 1.0]]


def rows(count: int, period_ns: int, seed: int = 0) -> dict[str, np.ndarray]:
    """Random rows of two joints with missing values, a tracker point every seventh row."""
    random = np.random.default_rng(seed)
    q, i = random.normal(size=(2, count, 2))
    q[random.random((count, 2)) < 0.3] = np.nan
    i[random.random((count, 2)) < 0.3] = np.nan
    points = np.full((count, 3), np.nan)
    points[::7] = random.normal(size=(len(points[::7]), 3))
    index = np.arange(count)
    return {
        "host_ns": 10**15 + index * period_ns,
        "number": index,
        "tick": 1 + index * period_ns // 1000,
        "q": q,
        "qref": random.normal(size=(count, 2)),
        "i": i,
        "points": points,
        "quality": np.zeros((count, 3), np.uint8),
    }


def frames_of(columns: dict[str, np.ndarray], cuts: list[int]) -> list[Frame]:
    maker, found = FrameMaker(2, POSE), []
    for first, last in zip([0, *cuts], [*cuts, None]):
        found += maker.add("run", {name: values[first:last] for name, values in columns.items()})
    return found + maker.end()


@pytest.mark.parametrize("period_ns", [50_000, 1_000_000, 33_000_000])
def test_frames_hold_every_row_once_and_every_peak(period_ns: int) -> None:
    count = 2000 if period_ns < 10_000_000 else 50
    columns = rows(count, period_ns)
    random = np.random.default_rng(1)
    frames = frames_of(columns, sorted(random.choice(count, 30, replace=False).tolist()))
    assert sum(frame.rows for frame in frames) == count
    bins = (columns["host_ns"] - columns["host_ns"][0]) // FRAME_NS
    assert [frame.bin for frame in frames] == np.unique(bins).tolist()
    for frame in frames:
        here = bins == frame.bin
        for joint in range(2):
            there = columns["i"][here, joint]
            there = there[~np.isnan(there)]
            if not len(there):
                assert np.isnan([frame.low[joint], frame.high[joint], frame.mean[joint]]).all()
                continue
            assert (frame.low[joint], frame.high[joint]) == (there.min(), there.max())
            assert frame.mean[joint] == pytest.approx(there.mean())
            q = columns["q"][here, joint]
            q = q[~np.isnan(q)]
            assert (frame.q[joint] == q[-1]) if len(q) else np.isnan(frame.q[joint])
        points = columns["points"][here]
        seen = points[~np.isnan(points[:, 0])]
        if len(seen):
            x, y, z = seen[-1]
            assert frame.point == pytest.approx([1 - y, 2 + x, 3 + z])
        else:
            assert np.isnan(frame.point).all()


def test_how_rows_are_cut_into_blocks_changes_no_frame() -> None:
    columns = rows(1000, 1_000_000)
    whole = [frame.as_json() for frame in frames_of(columns, [])]
    assert whole == [frame.as_json() for frame in frames_of(columns, list(range(7, 1000, 13)))]
    assert all(json.loads(text) for text in whole)


def test_a_new_run_begins_new_frames_and_an_empty_block_ends_none() -> None:
    maker, ring = FrameMaker(2, None), Ring()
    one, other = rows(30, 1_000_000), rows(30, 1_000_000, seed=2)
    ring.put("a", maker.add("a", one))
    assert maker.add("a", {name: values[:0] for name, values in one.items()}) == []
    left = maker.add("b", other)
    assert left[0].rows == 10 and left[0].t == pytest.approx(0.029)
    assert maker.end()[0].t == pytest.approx(0.029)


def test_the_ring_gives_what_is_new_and_forgets_what_is_old() -> None:
    frames = frames_of(rows(KEPT + 100, FRAME_NS), [])
    ring = Ring()
    ring.put("a", frames[:10])
    assert ring.since(0) == ("a", 10, [frame.as_json() for frame in frames[:10]])
    assert ring.since(10) == ("a", 10, [])
    ring.put("a", frames[10:])
    run, last, kept = ring.since(3)
    assert (run, last, len(kept)) == ("a", len(frames), KEPT) and kept[-1] == frames[-1].as_json()
    ring.put("b", frames[:2])
    assert ring.since(last) == ("b", last + 2, [frame.as_json() for frame in frames[:2]])


def test_telemetry_of_the_last_second() -> None:
    columns = rows(3000, 1_000_000)
    columns["quality"][2500:2750, 1] = int(Quality.SATURATED | Quality.STALE)
    telemetry = Telemetry(["counter.0", "analog.0", "tracker"], "analog")
    for first in range(0, 3000, 10):
        telemetry.add({name: values[first : first + 10] for name, values in columns.items()})
    table = telemetry.table()
    assert table["rate"] == pytest.approx(1000)
    assert table["clock"]["device"] == "analog" and table["clock"]["tick_rate"] == pytest.approx(1e6)
    doubts = {(one["channel"], one["doubt"]): one["share"] for one in table["doubtful"]}
    assert doubts.keys() == {("analog.0", "saturated"), ("analog.0", "stale")}
    assert doubts["analog.0", "stale"] == pytest.approx(0.25, rel=0.02)
    telemetry.begin()
    assert telemetry.table() == {"rate": None, "clock": None, "doubtful": []}
