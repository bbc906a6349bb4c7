"""No command replaces a file that it reads, or a recording of a rig; what was imported can be imported again."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from armscope.cli import run
from daq.recording import Attachments
from daq.recording.recorder import Recorder
from daq.recording.several import extent_of
from tests.daq.recorded import LAYOUT, make_rows

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


@pytest.mark.parametrize("state", ["whole", "cut off", "damaged layout"])
@pytest.mark.parametrize(
    "arguments",
    [
        ["import", "table.csv"],
        ["export", "run.mcap", "--to", "csv"],
        ["simulate", "--model", "emps.toml", "--like", "run.mcap"],
        ["excite", "--model", "emps.toml"],
    ],
)
def test_a_recording_of_a_rig_is_not_replaced(
    folder: Path, root: Path, arguments: list[str], state: str, capfd: pytest.CaptureFixture[str]
) -> None:
    shutil.copy(root / "config/models/emps.toml", folder)
    with Recorder(Path("monday.mcap"), LAYOUT, Attachments()) as recorder:
        recorder.append(make_rows(0, 20))
    data = Path("monday.mcap").read_bytes()
    if state == "cut off":
        data = data[:-30]
    elif state == "damaged layout":
        place = data.rindex(b'"joints"')
        data = data[:place] + data[place:].replace(b'"joints"', b'"j`ints"')
        Path("monday.mcap").write_bytes(data)
        assert extent_of(Path("monday.mcap")).rows == 20
    Path("monday.mcap").write_bytes(data)
    capfd.readouterr()
    assert run([*arguments, "--out", "monday.mcap"]) == 2
    assert (
        capfd.readouterr().err
        == "error: monday.mcap: exists already, and no recording of a rig is overwritten; use another name\n"
    )
    assert Path("monday.mcap").read_bytes() == data


def test_what_was_imported_is_imported_again(folder: Path) -> None:
    assert run(["import", "table.csv", "--out", "run.mcap"]) == 0


@pytest.mark.parametrize(
    ("arguments", "victim", "why"),
    [
        (["import", "table.csv"], "link.toml", "is no recording"),
        (["import", "table.csv"], "other.csv", "is no recording"),
        (["simulate", "--model", "emps.toml", "--like", "run.mcap"], "other.csv", "is no recording"),
        (["recover", "run.mcap", "--force"], "other.csv", "is no recording"),
        (["recover", "run.mcap"], "other.csv", "exists"),
        (["excite", "--model", "emps.toml"], "link.toml", "is no experiment file"),
        (["excite", "--model", "emps.toml"], "other.csv", "is no experiment file"),
        (["model", "emps.toml"], "rig.toml", "is no model file"),
        (["export", "run.mcap"], "other.csv", "may be the only copy"),
        (["export", "run.mcap", "--to", "csv"], "link.toml", "may be the only copy"),
        (["export", "run.mcap", "--to", "csv"], "other.mcap", "may be the only copy"),
    ],
)
def test_tables_and_models_are_not_replaced(
    folder: Path, root: Path, arguments: list[str], victim: str, why: str, capfd: pytest.CaptureFixture[str]
) -> None:
    shutil.copy(root / "config/models/emps.toml", folder)
    shutil.copy(root / "config/models/emps.toml", "model.toml")
    shutil.copy(root / "config/puma560_sim.toml", "rig.toml")
    Path("link.toml").symlink_to("model.toml")
    Path("other.csv").write_text(TABLE)
    shutil.copy("run.mcap", "other.mcap")
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    capfd.readouterr()
    assert run([*arguments, "--out", victim]) == 2
    said = capfd.readouterr().err
    assert said.startswith(f"error: {victim}: ") and why in said and said.count("\n") == 1
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    assert Path("link.toml").is_symlink()


@pytest.mark.parametrize(
    "arguments",
    [
        ["import", "table.csv"],
        ["recover", "run.mcap"],
        ["simulate", "--model", "config/models/emps.toml", "--like", "run.mcap"],
        ["record", "--rig", "config/puma560_sim.toml", "--experiment", "config/experiments/excitation.toml"],
    ],
)
@pytest.mark.parametrize("ending", [".csv", ".PARQUET", ".mat"])
def test_no_recording_is_called_a_table(
    folder: Path, arguments: list[str], ending: str, capfd: pytest.CaptureFixture[str]
) -> None:
    before = set(folder.iterdir())
    capfd.readouterr()
    assert run([*arguments, "--out", f"sub.one/new{ending}"]) == 2
    assert capfd.readouterr().err.splitlines()[-1] == (
        f"error: sub.one/new{ending}: a recording is an MCAP file: name it sub.one/new.mcap; "
        "'armscope export' makes tables of it"
    )
    assert set(folder.iterdir()) == before


def test_an_empty_file_is_replaced(folder: Path) -> None:
    Path("new.mcap").touch()
    assert run(["import", "table.csv", "--out", "new.mcap"]) == 0


@pytest.mark.parametrize("name", ["bag.mcap", "bag.db3"])
def test_a_table_is_not_called_a_bag(folder: Path, name: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["export", "run.mcap", "--out", name]) == 2
    assert capfd.readouterr().err == f"error: {name}: a bag is a folder: --to ros2-mcap or ros2, and --out FOLDER\n"
    assert not Path(name).exists()
