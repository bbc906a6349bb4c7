"""A folder of results appears whole: interrupted or failing, it is as it was, and nothing is left beside it."""

from __future__ import annotations

from pathlib import Path

import pytest

from arm_io import InputError
from arm_io.whole_folder import whole_folder


def test_all_files_arrive_together_and_others_stay(tmp_path: Path) -> None:
    out = tmp_path / "a" / "results"
    for text in ("first", "second"):
        with whole_folder(out, "results") as there:
            (there / "pictures").mkdir()
            (there / "pictures/one.png").write_text(text)
            (there / "model.toml").write_text(text)
            assert not out.exists() or (out / "model.toml").read_text() == "first"
        (out / "notes.txt").write_text("mine")
    names = sorted(path.name for path in out.rglob("*"))
    assert names == [".results.files", "model.toml", "notes.txt", "one.png", "pictures"]
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
        with whole_folder(out, "results") as there:
            (there / "model.toml").write_text("after")
            raise stop

    with pytest.raises(stop):
        write()
    assert {path: path.read_text() for path in tmp_path.rglob("*.*")} == before
    assert out.exists() == there_before


def test_a_file_in_the_way_is_refused(tmp_path: Path) -> None:
    (tmp_path / "results").write_text("a file")
    with pytest.raises(InputError, match="is a file"), whole_folder(tmp_path / "results", "results"):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["results"]


def _run(out: Path, files: dict[str, str], results: str = "diagnosis") -> None:
    with whole_folder(out, results) as there:
        for name, text in files.items():
            (there / name).parent.mkdir(exist_ok=True)
            (there / name).write_text(text)


def test_files_of_the_run_before_go_and_those_of_others_stay(tmp_path: Path) -> None:
    out = tmp_path / "out"
    _run(out, {"table.json": "1", "separate_2.toml": "move", "separate_3.toml": "turn", "pictures/a.png": "1"})
    _run(out, {"table.csv": "kept"}, "identification")
    (out / "separate_3.toml").write_text("changed by a person")
    (out / "separate_4.toml").write_text("written by a person")
    _run(out, {"table.json": "2", "separate_1.toml": "new"})
    names = {path.name for path in out.rglob("*") if path.is_file() and not path.name.startswith(".")}
    assert names == {"table.json", "table.csv", "separate_1.toml", "separate_3.toml", "separate_4.toml"}
    assert (out / "table.json").read_text() == "2"
    _run(out, {})
    assert not (out / "separate_1.toml").exists() and (out / "separate_3.toml").read_text() == "changed by a person"


@pytest.mark.parametrize("record", ["", "[1]", '{"../outside": "x", "/outside": 3}'])
def test_a_record_that_names_no_files_of_the_folder_removes_none(tmp_path: Path, record: str) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (tmp_path / "outside").write_text("mine")
    (out / ".diagnosis.files").write_text(record)
    _run(out, {"table.json": "1"})
    assert (tmp_path / "outside").read_text() == "mine" and (out / "table.json").read_text() == "1"


@pytest.mark.parametrize("there", ["report.html", "pictures"])
def test_nothing_is_replaced_where_one_file_has_no_place(tmp_path: Path, there: str) -> None:
    out = tmp_path / "out"
    _run(out, {"model.toml": "1", "separate_1.toml": "move"})
    (out / "report.html").mkdir() if there == "report.html" else (out / "pictures").write_text("a file")
    with pytest.raises(InputError, match=f"out/{there}: is a f"):
        _run(out, {"model.toml": "2", "report.html": "2", "pictures/a.png": "2"})
    assert (out / "model.toml").read_text() == "1" and (out / "separate_1.toml").read_text() == "move"
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_errors_name_the_folder_and_not_where_it_is_made(tmp_path: Path) -> None:
    with (
        pytest.raises(InputError, match=f"^{tmp_path}/out/x.json: is wrong"),
        whole_folder(tmp_path / "out", "a") as at,
    ):
        raise InputError(at / "x.json", "is wrong")
