"""What a client may name in a daemon's folder of recordings: recordings in it, and nothing else on the machine."""

from __future__ import annotations

import hashlib
import os

import pytest
from hypothesis import given
from hypothesis import strategies as st

from arm_io import InputError
from daq.service.transfer.folder import MOST_PIECE, RecordingsFolder

SECRET = b"lab:secret\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> RecordingsFolder:
    top = tmp_path_factory.mktemp("top")
    (top / "secret.mcap").write_bytes(SECRET)
    path = top / "recordings"
    (path / "inner").mkdir(parents=True)
    (path / "folder.mcap").mkdir()
    (path / "inner/b.mcap").write_bytes(SECRET)
    (path / "passwords").write_bytes(SECRET)
    (path / ".hidden.mcap").write_bytes(SECRET)
    (path / "link.mcap").symlink_to(top / "secret.mcap")
    os.mkfifo(path / "pipe.mcap")
    (path / "a.mcap").write_bytes(bytes(range(256)) * 4096)
    (path / "a.mcap.active").write_bytes(b"unfinished")
    return RecordingsFolder(path)


def test_listed_and_read(folder: RecordingsFolder) -> None:
    assert {entry["name"]: entry["bytes"] for entry in folder.list()} == {"a.mcap": 1 << 20, "a.mcap.active": 10}
    answer = folder.checksum("a.mcap")
    content = (folder.path / "a.mcap").read_bytes()
    assert answer == {"name": "a.mcap", "bytes": 1 << 20, "sha256": hashlib.sha256(content).hexdigest()}
    pieces = [folder.read("a.mcap", offset, MOST_PIECE) for offset in range(0, len(content) + 1, MOST_PIECE)]
    assert b"".join(pieces) == content
    assert folder.read("a.mcap", 1 << 61, 5) == b""


PARTS = st.sampled_from(
    [
        "..",
        ".",
        "/",
        "a",
        "a.mcap",
        ".mcap",
        "inner",
        "link",
        "pipe",
        "folder",
        "passwords",
        ".hidden",
        "\\0",
        "\n",
        "\ud800",
        "é",
        "/etc/passwd",
        "secret.mcap",
    ]
)


@given(st.one_of(st.text(max_size=300), st.lists(PARTS, max_size=6).map("".join)))
def test_no_name_reads_anything_else(folder: RecordingsFolder, name: str) -> None:
    for use in (folder.checksum, lambda name: folder.read(name, 0, 100)):
        if name in ("a.mcap", "a.mcap.active"):
            assert use(name)
        else:
            with pytest.raises(InputError):
                use(name)
    try:
        place = folder.place(name)
    except InputError:
        return
    assert place.parent == folder.path
    assert place.name == name
    assert len(os.fsencode(name + ".active")) <= 255


@pytest.mark.parametrize(
    "name", ["../secret.mcap", "inner/b.mcap", "passwords", ".hidden.mcap", "link.mcap", "pipe.mcap", "folder.mcap", ""]
)
def test_tricks(folder: RecordingsFolder, name: str) -> None:
    with pytest.raises(InputError):
        folder.read(name, 0, 100)
