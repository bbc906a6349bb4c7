"""Not one bit of a finished recording changes unseen.

Every record has its checksum, and the one that is damaged is named.
"""

from __future__ import annotations

import json
import re
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode

from armscope.cli import run
from daq.acquisition.ledger import Loss, LossReason
from daq.recording.mcap_file.checksums import Integrity, Verification, verify
from daq.recording.mcap_file.crc32 import crc32_of_parts
from daq.recording.parts import Attachments
from daq.recording.recorder import Recorder
from daq.recording.recover import recover
from tests.daq.recorded import LAYOUT, make_rows

NAMES = {
    Opcode.HEADER: "the header",
    Opcode.SCHEMA: "schema",
    Opcode.CHANNEL: "channel",
    Opcode.CHUNK: "chunk",
    Opcode.MESSAGE_INDEX: "message index",
    Opcode.ATTACHMENT: "attachment",
    Opcode.METADATA: "metadata",
    Opcode.DATA_END: "the data end record",
}
LOSS = Loss(6, 3, LossReason.NOT_LATCHED, "card")


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A finished recording of two chunks, in which three rows are lost."""
    path = tmp_path_factory.mktemp("checksums") / "run.mcap"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("daq.recording.recorder.CHUNK_BYTES", 4000)
        with Recorder(path, LAYOUT, Attachments(rig='name = "bench"')) as recorder:
            recorder.append(make_rows(0, 6))
            recorder.append(make_rows(9, 3))
            recorder.finish(losses=[LOSS])
    return path.read_bytes()


def records(data: bytes) -> Iterator[tuple[int, int, str]]:
    """Where each record begins and ends, and what it must be called; what stands behind the data is one."""
    place, name = 8, "the magic at the beginning"
    yield 0, place, name
    while name != NAMES[Opcode.DATA_END]:
        end = place + 9 + int.from_bytes(data[place + 1 : place + 9], "little")
        name = NAMES[Opcode(data[place])]
        yield place, end, name
        place = end
    yield place, len(data) - 37, "the summary"
    yield len(data) - 37, len(data), "the summary|the footer|the magic at the end"


def check_named(file: bytes, place: int, found: Verification) -> None:
    """The byte at ``place`` was changed, and its record is named."""
    assert found.integrity is Integrity.DAMAGED, place
    (name,) = [name for start, end, name in records(file) if start <= place < end]
    in_list = name == "attachment" and file.rindex(b"checksums.crc32", 0, -500) - 29 <= place
    sentences = "|".join(damage.sentence for damage in found.damages)
    assert re.search("attachment 'checksums.crc32'" if in_list else name, sentences), (place, name, sentences)
    assert len(found.damages) <= 2, sentences


def test_the_file_as_written_is_verified(file: bytes) -> None:
    found = verify(memoryview(file))
    assert found.integrity is Integrity.VERIFIED and not found.damages
    assert found.records == len(list(records(file))) - 1


def test_no_part_of_a_record_is_left_out(file: bytes) -> None:
    """The heads of all records byte by byte, and every 13th byte of the rest; one bit after the other."""
    data = bytearray(file)
    heads = {place for start, end, _ in records(file) for place in range(start, min(start + 40, end))}
    for place in sorted(heads | set(range(0, len(data), 13))):
        data[place] ^= 1 << place % 8
        check_named(file, place, verify(memoryview(data)))
        data[place] = file[place]


@settings(max_examples=40)
@given(share=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
def test_info_and_recover_tell_any_flipped_bit(
    file: bytes, tmp_path_factory: pytest.TempPathFactory, share: float, bit: int
) -> None:
    folder = tmp_path_factory.mktemp("flip")
    data, place = bytearray(file), int(share * len(file))
    data[place] ^= 1 << bit
    path, out = folder / "run.mcap", folder / "again.mcap"
    path.write_bytes(data)
    assert run(["info", str(path), "--verify"]) == 4
    result = recover(path, out)
    assert any("damaged" in note for note in result.notes)
    assert verify(memoryview(out.read_bytes())).integrity is Integrity.VERIFIED


def test_info_names_the_record(file: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """An index that points astray: no row differs, and readers that seek by it would."""
    data = bytearray(file)
    index = next(start for start, _, name in records(file) if name == "message index")
    data[index + 30] ^= 1
    path = tmp_path / "run.mcap"
    path.write_bytes(data)
    assert run(["info", str(path)]) == 4, "three rows were lost during recording"
    assert "damaged" not in capsys.readouterr().out
    assert run(["info", str(path), "--verify"]) == 4
    assert "message index 1 of chunk 1 is damaged" in capsys.readouterr().out
    assert run(["info", str(path), "--verify", "--json"]) == 4
    verification = json.loads(capsys.readouterr().out)["verification"]
    assert verification["integrity"] == "damaged" and len(verification["damages"]) == 1


def test_the_attachment_with_the_ledger_is_covered(file: bytes) -> None:
    data = bytearray(file)
    place = data.index(b'"lost"')
    data[place + 1] ^= 4
    assert "attachment 3 ('ledger.json') is damaged" in verify(memoryview(data)).damages[0].sentence


def test_older_and_unfinished_files_are_no_error(
    file: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without the list: a file of before, which is whole; a file that a crash ended."""
    whole = tmp_path / "old.mcap"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("daq.recording.mcap_file.writer.McapFile.attach", _attach_as_before)
        patch.setattr("daq.recording.mcap_file.checksums.Checksums.of_all", lambda self: 0)
        with Recorder(whole, LAYOUT, Attachments()) as recorder:
            recorder.append(make_rows(0, 20))
    assert run(["info", str(whole), "--verify"]) == 0
    assert "no checksums: written by an older armscope" in capsys.readouterr().out
    cut = tmp_path / "run.mcap.active"
    cut.write_bytes(file[: file.index(b"ledger.json") - 29])
    assert run(["info", str(cut), "--verify"]) == 4
    assert "no checksums of all records: the file was not finished" in capsys.readouterr().out


def _attach_as_before(self: object, name: str, media_type: str, data: bytes) -> None:
    if name != "checksums.crc32":
        _ATTACH(self, name, media_type, data)


_ATTACH = __import__("daq.recording.mcap_file.writer", fromlist=["McapFile"]).McapFile.attach


@given(st.lists(st.binary(max_size=50), min_size=1, max_size=12))
def test_crc_of_parts_is_that_of_the_whole(parts: list[bytes]) -> None:
    crcs = np.array([zlib.crc32(part) for part in parts], np.uint32)
    assert crc32_of_parts(crcs, np.array([len(part) for part in parts])) == zlib.crc32(b"".join(parts))
