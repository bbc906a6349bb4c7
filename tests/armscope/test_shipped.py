"""Shipped files are found by the names that documents use, from any folder, in a checkout or installed."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from armscope.application import with_shipped
from armscope.cli import run
from armscope.shipped import found, shipped_file, shipped_folder


def test_every_file_that_a_document_names_is_shipped(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    suffixes = "toml|json|xml|service"
    named = {
        name
        for page in [root / "README.md", *(root / "docs").rglob("*.md")]
        for name in re.findall(rf"config/[\w/@-]+\.(?:{suffixes})\b", page.read_text())
    }
    assert len(named) > 10
    assert {name for name in named if shipped_file(name) is None} == set()


def test_what_is_in_place_comes_first(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    name = Path("config/models/puma560.toml")
    assert found(name) == shipped_folder() / "models/puma560.toml" == root / name
    name.parent.mkdir(parents=True)
    name.write_text("mine")
    assert found(name) == name
    for nothing in (
        "config/models/none.toml",
        "models/puma560.toml",
        "config/../config/emps.toml",
        "config",
        "/config/x",
    ):
        assert found(nothing) == Path(nothing)


def test_the_command_line_takes_them_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(["model", "config/models/scara.toml"]) == 0
    printed = capsys.readouterr()
    assert printed.out.startswith("SCARA")
    assert printed.err == "note: there is no config/models/scara.toml here; using the file shipped with armscope\n"


def test_no_shipped_file_is_written_to(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    name, own = "config/models/scara.toml", str(shipped_folder() / "models/scara.toml")
    assert with_shipped(["--out", name, f"--out={name}"]) == ["--out", name, f"--out={name}"]
    assert with_shipped([f"--model={name}", "--model", name]) == [f"--model={own}", "--model", own]
