"""A folder of results appears whole: interrupted or failing, it is as it was, and nothing is left beside it."""

from __future__ import annotations

from pathlib import Path

import pytest

from arm_io import InputError
from arm_io.whole_folder import whole_folder


def test_all_files_arrive_together_and_others_stay(tmp_path: Path) -> None:
    out = tmp_path / "a" / "results"
    for text in ("first", "second"):
        with whole_folder(out) as there:
            (there / "pictures").mkdir()
            (there / "pictures/one.png").write_text(text)
            (there / "model.toml").write_text(text)
            assert not out.exists() or (out / "model.toml").read_text() == "first"
        (out / "notes.txt").write_text("mine")
    assert sorted(path.name for path in out.rglob("*")) == ["model.toml", "notes.txt", "one.png", "pictures"]
    assert (out / "model.toml").read_text() == (out / "pictures/one.png").read_text() == "second"
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["results"]


@pytest.mark.parametrize("stop", [KeyboardInterrupt, ValueError])
@pytest.mark.parametrize("there_before", [False, True])
def test_an_interrupted_folder_is_as_it_was(tmp_path: Path, stop: type[BaseException], there_before: bool) -> None:
    out = tmp_path / "results"
    if there_before:
        out.mkdir()
        (out / "model.toml").write_text("before")
    before = {path: path.read_text() for path in tmp_path.rglob("*.*")}

    def write() -> None:
        with whole_folder(out) as there:
            (there / "model.toml").write_text("after")
            raise stop

    with pytest.raises(stop):
        write()
    assert {path: path.read_text() for path in tmp_path.rglob("*.*")} == before
    assert out.exists() == there_before


def test_a_file_in_the_way_is_refused(tmp_path: Path) -> None:
    (tmp_path / "results").write_text("a file")
    with pytest.raises(InputError, match="is a file"), whole_folder(tmp_path / "results"):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["results"]
