"""What a task reads of a night's recordings: stretches of long ones, the same rows wherever they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from arm_fleet import fetched
from arm_fleet.fetching import LEAST, LENGTH, spread
from arm_io import InputError
from armscope.api.fleet_night import sides
from daq.recording import Attachments, open_recording, write_table
from tests.fleet.test_plan import recording


def long_recording(path: Path, seconds: float = 400.0) -> Path:
    """Two joints at 100 rows/s."""
    t = np.arange(round(100 * seconds)) / 100
    q = np.random.default_rng(1).normal(size=(len(t), 2))
    path.parent.mkdir(parents=True, exist_ok=True)
    write_table(path, t, {"q": q, "i": q}, Attachments(provenance={"made": "2026-01-01T23:00:00Z"}))
    return path


@given(seconds=st.floats(LEAST, 1e5), share=st.floats(0, 1))
def test_stretches_are_spread_evenly(seconds: float, share: float) -> None:
    spans = np.array(spread(seconds, share))
    length = spans[:, 1] - spans[:, 0]
    assert spans[0, 0] == 0.0 and spans[-1, 1] <= seconds * (1 + 1e-9)
    assert length.sum() == pytest.approx(max(share * seconds, LEAST)) and np.all(length <= 1.5 * LENGTH + 1e-6)
    gaps = spans[1:, 0] - spans[:-1, 1]
    assert len(gaps) == 0 or (gaps.min() >= -1e-6 and np.ptp(gaps) <= 1e-6 * seconds)


def test_of_a_long_recording_a_fraction_is_read(tmp_path: Path) -> None:
    file = long_recording(tmp_path / "a.mcap")
    found = fetched([str(file)], tmp_path / "cut", {}, 60.0)
    assert found.size == file.stat().st_size and found.read < 0.3 * found.size
    whole, (parts,) = open_recording(file), found.groups
    assert len(parts) == 2
    for path in parts:
        part = open_recording(path)
        assert part.time is not None and part.duration == pytest.approx(30.0, abs=0.02)
        first = round(100 * float(part.time[0]))
        np.testing.assert_array_equal(part.q, whole.q[first : first + len(part)])


def test_short_recordings_are_read_as_they_are(tmp_path: Path) -> None:
    """Also where all together are too long: a cut-off file, which has no index, is read whole."""
    short, long = recording(tmp_path / "short.mcap"), long_recording(tmp_path / "long.mcap", 100.0)
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(long.read_bytes()[:-100])
    places = [str(short), str(long), str(cut)]
    assert fetched(places, tmp_path / "f", {}, None).groups == [[short], [long], [cut]]
    assert fetched(places, tmp_path / "f", {}, 180.0).groups == [[short], [long], [cut]]
    one, two, three = fetched(places, tmp_path / "f", {}, 30.0).groups
    assert one == [short] and three == [cut] and two != [long]
    assert open_recording(two[0]).duration == pytest.approx(30 * 100 / 102, abs=0.1)


def test_a_recording_that_is_damaged_in_a_stretch_is_read_whole(tmp_path: Path) -> None:
    """Its intact rows are examined; the others are losses, not silence."""
    file = long_recording(tmp_path / "a.mcap")
    data = bytearray(file.read_bytes())
    begins = 100_000
    data[begins : begins + 64] = bytes(64)
    file.write_bytes(data)
    found = fetched([str(file)], tmp_path / "cut", {}, 60.0)
    assert found.groups == [[file]] and found.read == found.size
    run = open_recording(file)
    assert run.ledger is not None
    assert 0 < run.ledger.lost < 40_000 and len(run) + run.ledger.lost == 40_000


def test_what_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.mcap: cannot be read"):
        fetched([str(tmp_path / "none.mcap")], tmp_path, {}, 180.0)


@pytest.mark.parametrize(
    ("counts", "fitted", "held_out"),
    [((1,), 1, 0), ((2,), 1, 1), ((6,), 4, 2), ((1, 1), 1, 1), ((2, 2, 3), 4, 3)],
)
def test_the_last_is_held_out(counts: tuple[int, ...], fitted: int, held_out: int) -> None:
    """The last recording, or the last stretches of a single one; a single whole recording is split later."""
    names = [[f"{group}.{k}" for k in range(count)] for group, count in enumerate(counts)]
    fit, rest = sides(names)  # type: ignore[arg-type]
    assert (len(fit), len(rest)) == (fitted, held_out)
    assert fit + rest == [name for group in names for name in group]
