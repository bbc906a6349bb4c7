"""Files cut off or damaged anywhere: recovery never fails, never invents a row, and accounts for every one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arm_io import InputError
from daq.acquisition.ledger import LedgerSummary, Loss, LossReason
from daq.recording import Recording, open_recording
from daq.recording.messages.row_format import format_of
from daq.recording.missing_rows import FoundRows, reconciled
from daq.recording.parts import Attachments
from daq.recording.recorder import Recorder
from daq.recording.recover import recover
from tests.daq.recorded import COLUMNS, LAYOUT, make_rows

ROWS, LOST, CHUNK = 240, (100, 120), 20
LOSS = Loss(LOST[0], LOST[1] - LOST[0], LossReason.NOT_LATCHED, "card")


@dataclass(repr=False)
class Original:
    """A finished file of 11 chunks, the same without its end, and the rows in both (number -> row of ``truth``)."""

    finished: bytes
    unfinished: bytes
    folder: Path


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Original]:
    folder = tmp_path_factory.mktemp("damage")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("daq.recording.recorder.CHUNK_BYTES", CHUNK * len(format_of(LAYOUT.to_json()).template))
        patch.setattr("os.fsync", lambda handle: None)
        patch.setattr("os.fdatasync", lambda handle: None)
        recorder = Recorder(folder / "run.mcap", LAYOUT, Attachments(rig='name = "bench"'))
        recorder.append(make_rows(0, LOST[0]))
        recorder.append(make_rows(LOST[1], ROWS - LOST[1]))
        recorder.finish(losses=[LOSS])
        finished = (folder / "run.mcap").read_bytes()
        # Attachments after the last chunk begin at the ledger: a process killed just before has written exactly this.
        yield Original(finished, finished[: finished.index(b"ledger.json") - 29], folder)


def rescue(original: Original, data: bytes) -> tuple[Recording, bool]:
    """The recording recovered from a file with that content, and whether recovery called it complete."""
    damaged, out = original.folder / "damaged.mcap", original.folder / "out.mcap"
    damaged.write_bytes(data)
    result = recover(damaged, out, replace=True)
    recording = open_recording(out)  # strict: what was recovered is whole
    assert recording.finished and not recording.notes
    assert recording.ledger == result.ledger
    return recording, result.complete


def check(recording: Recording, *, complete: bool, sure: bool = True) -> None:
    """No row is wrong, none is there twice, and all are accounted for."""
    truth = make_rows(0, ROWS)
    numbers = recording.number
    assert (np.diff(numbers) > 0).all() and not ((numbers >= LOST[0]) & (numbers < LOST[1])).any()
    for name, field in COLUMNS.items():
        np.testing.assert_array_equal(getattr(recording, name), getattr(truth, field)[numbers], err_msg=name)
    assert recording.ledger.balanced and recording.ledger.recorded == len(numbers)
    everything = len(numbers) == ROWS - LOSS.rows
    assert not complete or everything
    if sure:
        assert recording.ledger.triggers == ROWS
        missing = set(range(ROWS)) - set(numbers.tolist())
        listed = [number for loss in recording.ledger.losses for number in range(loss.first, loss.first + loss.rows)]
        assert sorted(listed) == sorted(missing)


def test_a_whole_file_is_only_copied(original: Original) -> None:
    recording, complete = rescue(original, original.finished)
    check(recording, complete=complete)
    assert recording.ledger.losses == (LOSS,) and recording.rig == {"name": "bench"}


def test_a_file_without_its_end_has_all_its_rows(original: Original) -> None:
    recording, complete = rescue(original, original.unfinished)
    check(recording, complete=complete)
    assert [loss.reason for loss in recording.ledger.losses] == [LossReason.UNKNOWN]
    (original.folder / "cut.mcap").write_bytes(original.unfinished)
    as_it_is = open_recording(original.folder / "cut.mcap")
    assert not as_it_is.finished and as_it_is.notes and len(as_it_is) == ROWS - LOSS.rows


@settings(max_examples=60)
@given(share=st.floats(0, 1))
def test_truncated_anywhere(original: Original, share: float) -> None:
    data = original.finished[: int(share * len(original.finished))]
    head = original.finished.index(b"armscope:progress") + 200
    try:
        recording, complete = rescue(original, data)
    except InputError:
        assert len(data) < head
        return
    check(recording, complete=complete, sure=len(data) >= head)


@settings(max_examples=150)
@given(
    whole=st.booleans(),
    hits=st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(1, 255)), min_size=1, max_size=4),
)
def test_bytes_changed_anywhere(original: Original, whole: bool, hits: list[tuple[float, int]]) -> None:
    data = bytearray(original.finished if whole else original.unfinished)
    places = [int(share * len(data)) for share, _ in hits]
    for place, (_, change) in zip(places, hits):
        data[place] ^= change
    head = original.finished.index(b"armscope:progress")
    progress_hit = any(head - 40 < place < head + 200 for place in places)
    recording, complete = rescue(original, bytes(data))
    check(recording, complete=complete, sure=not progress_hit)
    assert len(recording) >= ROWS - LOSS.rows - CHUNK * len(hits), (
        "more rows are gone than were in the chunks that were hit"
    )


def test_the_count_in_the_head_is_found_behind_damage(original: Original) -> None:
    """A channel record ahead of it and the first chunk are hit: which rows are gone is still known."""
    data = bytearray(original.finished)
    data[data.index(b"/joint_states") - 16] ^= 255  # in the length of the channel's record
    data[data.index(b"zstd") + 500] ^= 1
    recording, complete = rescue(original, bytes(data))
    check(recording, complete=complete)
    assert recording.number[0] == CHUNK and recording.ledger.losses[0] == Loss(0, CHUNK, LossReason.DAMAGED)


@settings(max_examples=40)
@given(start=st.floats(0, 1), length=st.integers(1, 40_000), seed=st.integers(0, 99))
def test_a_stretch_overwritten(original: Original, start: float, length: int, seed: int) -> None:
    """As by a broken block of the disk: zeros (seed 0) or rubbish."""
    place = int(start * len(original.finished))
    count = len(original.finished[place : place + length])
    rubbish = bytes(count) if seed == 0 else np.random.default_rng(seed).bytes(count)
    data = original.finished[:place] + rubbish + original.finished[place + count :]
    progress = original.finished.index(b"armscope:progress")
    recording, complete = rescue(original, data)
    check(recording, complete=complete, sure=place > progress + 200 or place + count < progress - 40)


@pytest.mark.parametrize("window", [64, 100, 4096])
def test_a_landmark_is_found_wherever_the_windows_of_the_search_end(
    original: Original, window: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A stretch of several windows is overwritten; the chunks behind it are there."""
    monkeypatch.setattr("daq.recording.mcap_file.walk.WINDOW", window)
    for length in range(5000, 5100, 7):
        start = original.finished.index(b"zstd")
        data = original.finished[:start] + bytes(length) + original.finished[start + length :]
        recording, complete = rescue(original, data)
        check(recording, complete=complete)
        assert len(recording) >= ROWS - LOSS.rows - 3 * CHUNK


@settings(max_examples=60)
@given(rubbish=st.binary(max_size=300), with_magic=st.booleans())
def test_other_files_are_refused(original: Original, rubbish: bytes, with_magic: bool) -> None:
    path = original.folder / "other.mcap"
    path.write_bytes((b"\x89MCAP0\r\n" if with_magic else b"") + rubbish)
    with pytest.raises(InputError):
        open_recording(path)


def test_a_damaged_chunk_is_in_the_ledger(original: Original) -> None:
    data = bytearray(original.finished)
    data[data.index(b"zstd") + 500] ^= 1
    path = original.folder / "chunk.mcap"
    path.write_bytes(data)
    recording = open_recording(path)
    assert len(recording) < ROWS - LOSS.rows and "cannot be read" in recording.notes[0]
    assert recording.ledger.losses[0] == Loss(0, CHUNK, LossReason.DAMAGED)


def test_a_damaged_file_is_not_read_unnoticed(original: Original) -> None:
    """In an attachment, nothing shows what is lost."""
    data = bytearray(original.finished)
    data[data.index(b"zstd") + 500] ^= 1
    data[data.index(b"rig.toml") + 60] ^= 1
    path = original.folder / "broken.mcap"
    path.write_bytes(data)
    with pytest.raises(InputError, match="is damaged: bytes .* 'armscope recover' keeps what can be read"):
        open_recording(path)
    assert len(open_recording(path, damaged=True)) < ROWS - LOSS.rows


def test_it_never_writes_over_its_source_or_another_file(original: Original) -> None:
    source, other = original.folder / "run2.mcap", original.folder / "other2.mcap"
    source.write_bytes(original.unfinished)
    other.write_bytes(original.finished)
    with pytest.raises(InputError, match="damaged file itself"):
        recover(source, source, replace=True)
    with pytest.raises(InputError, match="exists already"):
        recover(source, other)
    assert source.read_bytes() == original.unfinished and other.read_bytes() == original.finished


def test_rows_that_the_ledger_counts_and_nothing_places_are_lost_after_the_last_one() -> None:
    """The chunks and the progress of the recorder are damaged, the ledger behind them is not."""
    found = FoundRows(np.array([[0, 89, 0]]), finished=True)
    ledger, certain = reconciled(found, LedgerSummary(triggers=100, latched=100, recorded=100), None)
    assert certain and ledger.balanced
    assert [(loss.first, loss.rows, loss.reason) for loss in ledger.losses] == [(90, 10, LossReason.DAMAGED)]
