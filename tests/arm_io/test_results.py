"""Folders and files for results: made whole, or refused in one line with nothing left behind."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from arm_io import InputError, check_folder, make_folder, write_text, write_toml


def test_a_folder_that_can_be_is_not_made_by_checking_it(tmp_path: Path) -> None:
    check_folder(tmp_path / "a" / "b")
    assert list(tmp_path.iterdir()) == []
    make_folder(tmp_path / "a" / "b")
    make_folder(tmp_path / "a" / "b")
    assert (tmp_path / "a" / "b").is_dir()


@pytest.mark.parametrize("name", ["file", "file/below"])
@pytest.mark.parametrize("function", [check_folder, make_folder])
def test_a_file_is_no_folder(tmp_path: Path, name: str, function: object) -> None:
    (tmp_path / "file").write_text("mine")
    with pytest.raises(InputError, match="is a file; expected a folder for the results"):
        function(tmp_path / name)  # type: ignore[operator]
    assert (tmp_path / "file").read_text() == "mine"


def test_text_is_written_whole_over_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    path.write_text("before")
    write_text(path, "after")
    assert path.read_text() == "after"
    assert [file.name for file in tmp_path.iterdir()] == ["report.html"]


def test_no_folder_and_a_folder_in_the_way_are_refused_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="x.toml: cannot be written: there is no folder"):
        write_toml(tmp_path / "none" / "x.toml", {"a": 1})
    (tmp_path / "x.toml").mkdir()
    with pytest.raises(InputError, match="x.toml: is a folder"):
        write_toml(tmp_path / "x.toml", {"a": 1})
    assert [file.name for file in tmp_path.iterdir()] == ["x.toml"]


@pytest.mark.skipif(sys.platform == "win32", reason="limits of a process are POSIX")
def test_a_full_disk_leaves_what_was_there(tmp_path: Path, root: Path) -> None:
    """A real limit of the file system, in a process of its own."""
    path = tmp_path / "report.html"
    path.write_text("before")
    code = (
        "import resource, signal, sys; from arm_io import InputError, write_text\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN); resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))\n"
        "try: write_text(sys.argv[1], 'x' * 100_000)\n"
        "except InputError as error: sys.exit(str(error))"
    )
    ended = subprocess.run([sys.executable, "-c", code, path], cwd=root, capture_output=True, text=True)
    assert (ended.returncode, ended.stderr) == (1, f"{path}: cannot be written: File too large\n")
    assert path.read_text() == "before"
    assert [file.name for file in tmp_path.iterdir()] == ["report.html"]
