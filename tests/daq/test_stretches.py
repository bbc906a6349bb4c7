"""Stretches of a recording, read by ranges of bytes, hold the rows that the whole recording has there, no others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arm_io import InputError
from daq.acquisition.ledger import Loss, LossReason
from daq.recording import Attachments, Ranges, open_recording
from daq.recording.recorder import Recorder
from daq.recording.stretches import NEAR
from tests.daq.recorded import COLUMNS, LAYOUT, make_rows
from tests.daq.test_long_recordings import RIG

ROWS = 20_000
LOST = [Loss(3000, 7, LossReason.NOT_LATCHED), Loss(9000, 500, LossReason.LOST_EDGE)]


class File:
    """A file of which ranges are read, and counted."""

    def __init__(self, data: bytes) -> None:
        self.data, self.count = data, 0

    def read(self, start: int, end: int) -> bytes:
        self.count += end - start
        return self.data[start:end]

    def ranges(self) -> Ranges:
        found = Ranges.of("a.mcap", self.read, len(self.data))
        assert found is not None
        return found


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """20 s with two losses."""
    path = tmp_path_factory.mktemp("stretches") / "run.mcap"
    with Recorder(path, LAYOUT, Attachments(rig=RIG), live=False) as recorder:
        for first, last in ((0, 3000), (3007, 9000), (9500, ROWS)):
            for begin in range(first, last, 200):
                recorder.append(make_rows(begin, min(200, last - begin)))
        recorder.finish(losses=LOST)
    return path


@settings(max_examples=15)
@given(begin=st.floats(0, 19), length=st.floats(0.002, 20))
def test_a_stretch_has_the_rows_of_the_whole(
    recorded: Path, tmp_path_factory: pytest.TempPathFactory, begin: float, length: float
) -> None:
    file, whole = File(recorded.read_bytes()), open_recording(recorded)
    path = tmp_path_factory.mktemp("cut") / "stretch.mcap"
    low, high = whole.wall_ns[0] + round(1e9 * begin), whole.wall_ns[0] + round(1e9 * (begin + length))
    rows = slice(*np.searchsorted(whole.wall_ns, [low, high]).tolist())
    if rows.start == rows.stop:
        with pytest.raises(InputError, match=r"a\.mcap: has no rows from"):
            file.ranges().write([(begin, begin + length)], [path])
        return
    file.ranges().write([(begin, begin + length)], [path])
    part = open_recording(path)
    for name in COLUMNS:
        np.testing.assert_array_equal(getattr(part, name), getattr(whole, name)[rows], err_msg=name)
    np.testing.assert_allclose(part.t, whole.t[rows] - whole.t[rows][0], atol=1e-12)
    first, last = whole.number[rows][0], whole.number[rows][-1]
    assert part.rig == whole.rig and part.finished and not part.notes
    assert part.ledger.balanced and part.ledger.lost == last - first + 1 - len(part)
    assert {loss.reason for loss in part.ledger.losses} <= {loss.reason for loss in LOST}


def test_only_what_is_needed_is_read(recorded: Path, tmp_path: Path) -> None:
    file = File(recorded.read_bytes())
    paths = [tmp_path / "1.mcap", tmp_path / "2.mcap"]
    file.ranges().write([(2.0, 3.0), (15.0, 16.0)], paths)
    assert [len(open_recording(path)) for path in paths] == [pytest.approx(1000, abs=1)] * 2
    assert file.count < 0.25 * len(file.data) + 2 * NEAR


def test_a_file_without_an_intact_summary_has_no_index(recorded: Path) -> None:
    data = recorded.read_bytes()
    flipped = bytearray(data)
    flipped[-100] ^= 1
    for broken in (b"", data[:20], data[:-1], bytes(flipped), data[:-8] + bytes(8)):
        assert Ranges.of("a.mcap", File(broken).read, len(broken)) is None


@settings(max_examples=20)
@given(place=st.floats(0, 1), bit=st.integers(0, 7))
def test_a_damaged_file_never_gives_a_wrong_row(
    recorded: Path, tmp_path_factory: pytest.TempPathFactory, place: float, bit: int
) -> None:
    data, path = bytearray(recorded.read_bytes()), tmp_path_factory.mktemp("cut") / "stretch.mcap"
    data[int(place * (len(data) - 1))] ^= 1 << bit
    file, whole = File(bytes(data)), open_recording(recorded)
    ranges = Ranges.of("a.mcap", file.read, len(data))
    if ranges is None:
        return
    try:
        ranges.write([(4.0, 12.0)], [path])
    except InputError as error:
        assert "is damaged" in str(error)
        assert not list(path.parent.iterdir())
        return
    part = open_recording(path)
    rows = slice(*np.searchsorted(whole.number, [part.number[0], part.number[-1] + 1]).tolist())
    np.testing.assert_array_equal(part.q, whole.q[rows])
    np.testing.assert_array_equal(part.number, whole.number[rows])
