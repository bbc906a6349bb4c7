"""Whatever is named as a file, at any command: one line, status 2, nothing left behind, and nobody waits."""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np
import pytest
import tomli_w

from arm_io import DeviceFault, InputError, check_file, check_folder, read_toml, whole_file
from arm_io.files import read_file
from armscope.cli import run
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table

pytestmark = pytest.mark.timeout(60)
LONG = "x" * 300


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """A folder with a good recording, table, and everything that is no file to read."""
    t = np.arange(1000) * 1e-3
    q = np.outer(np.sin(3 * t), np.ones(6))
    write_table(tmp_path / "good.mcap", t, {"q": q, "i": q, "qref": q}, Attachments())
    (tmp_path / "good.csv").write_text("t,q1,i1\n" + "".join(f"{x:.3f},{x:.3f},0.1\n" for x in t))
    (tmp_path / "deep.toml").write_text("a = " + "[" * 5000 + "]" * 5000)
    (tmp_path / "digits.toml").write_text("a = " + "9" * 5000)
    (tmp_path / "latin.toml").write_bytes(b'a = "\xff"')
    (tmp_path / "file").write_text("")
    os.symlink(os.devnull, tmp_path / "device")
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    return tmp_path


READERS = {
    "record": ["--rig", "{bad}", "--experiment", "{experiment}", "--out", "{out}"],
    "record experiment": ["--rig", "{rig}", "--experiment", "{bad}", "--out", "{out}"],
    "daemon": ["--rig", "{bad}"],
    "doctor": ["{bad}"],
    "sim-devices": ["{bad}"],
    "status": ["{bad}"],
    "stop": ["{bad}"],
    "disarm": ["{bad}"],
    "reset": ["{bad}"],
    "fetch": ["{bad}", "run.mcap"],
    "info": ["{bad}"],
    "recover": ["{bad}", "--out", "{out}"],
    "replay": ["{bad}", "--wait", "0"],
    "view": ["{bad}"],
    "export": ["{bad}", "--out", "{out}"],
    "plot": ["{bad}", "--out", "{out}.png"],
    "import": ["{bad}", "--out", "{out}"],
    "import rig": ["{place}/good.csv", "--rig", "{bad}", "--out", "{out}"],
    "model": ["{bad}"],
    "model urdf": ["{bad}.urdf"],
    "simulate": ["--model", "{bad}", "--experiment", "{experiment}", "--out", "{out}"],
    "simulate experiment": ["--model", "{model}", "--experiment", "{bad}", "--out", "{out}"],
    "simulate like": ["--model", "{model}", "--like", "{bad}", "--out", "{out}"],
    "excite": ["--model", "{bad}", "--out", "{out}"],
    "identify": ["{bad}", "--model", "{model}", "--out", "{out}"],
    "identify model": ["{place}/good.mcap", "--model", "{bad}", "--out", "{out}"],
    "diagnose": ["--fit", "{bad}", "--model", "{model}", "--out", "{out}"],
    "diagnose model": ["--fit", "{place}/good.mcap", "--model", "{bad}", "--out", "{out}"],
    "calibrate": ["{bad}", "--model", "{model}", "--out", "{out}"],
    "calibrate tracker": ["{place}/good.mcap", "--tracker", "{bad}", "--model", "{model}", "--out", "{out}"],
}
BAD = [
    "",
    LONG,
    "{place}/" + LONG,
    "{place}/folder",
    "{place}/pipe",
    "{place}/device",
    "{place}/deep.toml",
    "{place}/digits.toml",
    "{place}/latin.toml",
    "{place}/file",
    "{place}/file/x",
    "/proc/self/mem",
    "/proc/kmsg",
]


def refused(command: str, options: list[str], capsys: pytest.CaptureFixture[str], **words: object) -> None:
    arguments = [option.format(**words) for option in options]
    assert run([command.split(" ")[0], *arguments]) == 2, arguments
    line = capsys.readouterr().err
    assert line.startswith("error: ") and line.count("\n") == 1, line


@pytest.mark.parametrize("reader", READERS)
def test_what_is_no_file_to_read(reader: str, place: Path, root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = sorted(place.iterdir())
    config = root / "config"
    known = {
        "rig": config / "puma560_sim.toml",
        "model": config / "models/puma560.toml",
        "experiment": config / "experiments/slow_sweep_1.toml",
    }
    if reader == "model urdf":
        os.mkfifo(place / "pipe.urdf")
        before = sorted(place.iterdir())
    for bad in BAD:
        refused(reader, READERS[reader], capsys, bad=bad.format(place=place), place=place, out=place / "out", **known)
    assert sorted(place.iterdir()) == before


def test_a_rig_that_no_daemon_opens_has_no_page(
    place: Path, root: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    table = read_toml(root / "config/puma560_sim.toml")
    table["device"][0]["driver"] = "drivers.nothing"
    table.update(name="page without a driver", model=str(root / "config/models/puma560.toml"))
    (place / "rig.toml").write_text(tomli_w.dumps(table))
    before = sorted(place.iterdir())
    monkeypatch.chdir(place)
    refused("page", ["rig.toml", "--no-browser"], capsys)
    assert sorted(place.iterdir()) == before


WRITERS = {
    "record": ["--rig", "{rig}", "--experiment", "{experiment}", "--out", "{out}"],
    "recover": ["{place}/good.mcap", "--out", "{out}"],
    "export": ["{place}/good.mcap", "--out", "{out}"],
    "plot": ["{place}/good.mcap", "--out", "{out}.png"],
    "import": ["{place}/good.csv", "--out", "{out}"],
    "model": ["{model}", "--out", "{out}.toml"],
    "model urdf": ["{panda}", "--out", "{out}.urdf"],
    "simulate": ["--model", "{model}", "--experiment", "{experiment}", "--rate", "50", "--out", "{out}"],
}
NO_FILE = [
    "",
    LONG,
    "{place}/" + LONG,
    "{place}/folder",
    "{place}/pipe",
    "{place}/device",
    "{place}/absent/x",
    "{place}/file/x",
    "/proc/x",
    "/",
    ".",
    "..",
]


@pytest.mark.parametrize("writer", WRITERS)
def test_what_is_no_name_of_a_file_to_write(
    writer: str, place: Path, root: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(place)
    for ending in ("png", "toml", "urdf"):
        os.mkfifo(place / f"pipe.{ending}")
        os.symlink(os.devnull, place / f"device.{ending}")
        (place / f"folder.{ending}").mkdir()
    before = sorted(place.iterdir())
    config = root / "config"
    words = {
        "rig": config / "puma560_sim.toml",
        "model": config / "models/puma560.toml",
        "panda": config / "models/panda.toml",
        "experiment": config / "experiments/slow_sweep_1.toml",
    }
    ends = WRITERS[writer][-1].removeprefix("{out}")
    for bad in NO_FILE:
        if not (ends and bad.strip("/.") == ""):  # '..png' is a name
            refused(writer, WRITERS[writer], capsys, out=bad.format(place=place), place=place, **words)
    assert sorted(place.iterdir()) == before
    assert os.path.realpath(place / "device") == os.devnull


FOLDERS = {
    "identify": ["{place}/good.mcap", "--model", "{model}", "--out", "{out}"],
    "diagnose": ["--fit", "{place}/good.mcap", "--model", "{model}", "--out", "{out}"],
    "calibrate": ["--model", "{model}", "--cube", "--out", "{out}"],
    "demo": ["--out", "{out}"],
    "daemon": ["--rig", "{rig}", "--recordings", "{out}"],
    "init": ["{out}"],
}


@pytest.mark.parametrize("command", FOLDERS)
def test_what_is_no_folder_to_write(command: str, place: Path, root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = sorted(place.iterdir())
    words = {"model": root / "config/models/puma560.toml", "rig": root / "config/puma560_sim.toml"}
    for bad in (
        "",
        LONG,
        "{place}/" + LONG,
        "{place}/file",
        "{place}/file/x",
        "{place}/pipe",
        "{place}/device",
        "/proc/x",
    ):
        refused(command, FOLDERS[command], capsys, out=bad.format(place=place), place=place, **words)
    assert sorted(place.iterdir()) == before


@pytest.mark.parametrize(
    ("entry", "value"),
    [
        (("name",), ""),
        (("name",), LONG),
        (("model",), LONG),
        (("trigger", "rate"), 1e300),
        (("trigger", "rate"), 1e-300),
        (("watchdog",), 1e300),
        (("watchdog",), 1e15),
        (("device", 0, "driver"), ""),
        (("device", 0, "driver"), "..x"),
        (("device", 0, "name"), LONG),
        (("simulation", "settle"), 1e15),
    ],
)
def test_rig_files_that_ended_in_a_traceback(
    entry: tuple[str | int, ...], value: object, place: Path, root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = read_toml(root / "config/puma560_sim.toml") | {"model": str(root / "config/models/puma560.toml")}
    inner = table
    for key in entry[:-1]:
        inner = inner[key]  # type: ignore[index]
    inner[entry[-1]] = value  # type: ignore[index]
    (place / "rig.toml").write_text(tomli_w.dumps(table))
    refused("doctor", ["{rig}"], capsys, rig=place / "rig.toml")


def test_names_that_only_programs_can_give(tmp_path: Path) -> None:
    for name in ("a\0b", "\ud800", "x" * 231):
        with pytest.raises(InputError):
            check_file(tmp_path / name)
        with pytest.raises(InputError):
            check_folder(tmp_path / name)
        with pytest.raises(InputError), whole_file(tmp_path / name):
            pass
    check_file(tmp_path / ("x" * 230))
    with whole_file(tmp_path / ("x" * 230)) as file:
        file.write("whole")
    with pytest.raises(InputError, match="larger than"):
        read_file(tmp_path / ("x" * 230), most=4)


def test_arguments_that_are_not_utf8(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["info", "\udcff.mcap"]) == 2
    assert (
        capsys.readouterr().err
        == "error: '\\udcff.mcap': is not UTF-8; results name their files, and are written in UTF-8\n"
    )


@pytest.mark.parametrize("seconds", [-86400.0, 2.0**31])
def test_a_clock_before_1970_or_after_2038_is_a_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seconds: float, root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(time, "time_ns", lambda: int(seconds * 1e9))
    with pytest.raises(DeviceFault, match="clock: the host's clock is"):
        write_table(
            tmp_path / "run.mcap", np.arange(3.0), {"q": np.zeros((3, 1)), "i": np.zeros((3, 1))}, Attachments()
        )
    model, experiment = root / "config/models/puma560.toml", root / "config/experiments/slow_sweep_1.toml"
    simulate = [
        "simulate",
        "--model",
        model,
        "--experiment",
        experiment,
        "--rate",
        "50",
        "--out",
        tmp_path / "run.mcap",
    ]
    assert run(list(map(str, simulate))) == 3
    assert capsys.readouterr().err.startswith("error: clock: ")
    assert list(tmp_path.iterdir()) == []
