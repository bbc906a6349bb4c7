"""No command replaces a file that it reads: ``--out`` of a table or recording that is an input is refused."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from armscope.cli import run

TABLE = "t,q1,i1\n0,0,1\n0.01,0.1,1\n0.02,0.2,1\n"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("table.csv").write_text(TABLE)
    assert run(["import", "table.csv", "--out", "run.mcap"]) == 0
    Path("link.csv").symlink_to("table.csv")
    return tmp_path


@pytest.mark.parametrize(
    "arguments",
    [
        ["import", "table.csv", "--out", "table.csv"],
        ["import", "link.csv", "--out", "table.csv"],
        ["export", "run.mcap", "--out", "run.mcap"],
        ["simulate", "--model", "model.toml", "--like", "run.mcap", "--out", "run.mcap"],
        ["excite", "--model", "model.toml", "--out", "model.toml"],
    ],
)
def test_what_is_read_is_not_replaced(
    folder: Path, root: Path, arguments: list[str], capfd: pytest.CaptureFixture[str]
) -> None:
    shutil.copy(root / "config/models/emps.toml", "model.toml")
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    capfd.readouterr()
    assert run(arguments) == 2
    assert (
        capfd.readouterr().err
        == f"error: {arguments[-1]}: is read here, and would be replaced; --out must name another file\n"
    )
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
