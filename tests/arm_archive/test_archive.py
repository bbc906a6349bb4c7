"""The index says what the files say, whatever happens to files, index and processes."""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import pytest

from arm_archive import INDEX, Filters, open_archive
from arm_io import InputError
from daq.recording import open_long
from daq.recording.summary import summary
from tests.arm_archive.lab import FRICTION, diagnosis, identification, record, rows_of


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Recordings and results of three months."""
    folder = tmp_path_factory.mktemp("made")
    for month in range(3):
        place = folder / f"2026-{month + 1:02}"
        record(place / "fit.mcap", day=31 * month, lost=10 * month)
        record(place / "scara.mcap", day=31 * month + 1, rows=300, arm="My SCARA", experiment="held_out")
        values = {name: (value + month, std) for name, (value, std) in FRICTION.items()}
        identification(place / "identified", values, recorded=f"2026-{month + 1:02}-01T00:00:00+00:00")
        diagnosis(place / "diagnosed", 1e-3 * month or None, recorded=f"2026-{month + 1:02}-01T12:00:00+02:00")
    return folder


@pytest.fixture
def lab(made: Path, tmp_path: Path) -> Path:
    """A copy of it, to be changed."""
    return Path(shutil.copytree(made, tmp_path / "lab"))


def rebuilt(folder: Path) -> list[dict[str, Any]]:
    (folder / INDEX).unlink(missing_ok=True)
    return rows_of(folder)


def test_a_recording_is_listed_as_info_sees_it(lab: Path) -> None:
    row = next(row for row in rows_of(lab) if row["path"] == "2026-03/fit.mcap")
    table = summary(open_long(lab / row["path"]))
    assert (row["rows"], row["lost"], row["seconds"]) == (400, 20, table["duration"])
    assert row["rate"] == pytest.approx(table["rate"]) and row["joints"] == 2
    assert row["date"] == "2026-03-04T00:00:00Z" == table["start"][:19] + "Z"
    assert (row["arm"], row["rig"], row["experiment"]) == ("Puma 560", "cell 4", "fit")
    assert row["calibration"] == table["calibration"]["hash"] and row["source"] == "measured"
    model = next(one for one in table["attachments"] if one["name"] == "model.toml")
    assert row["model"] == model["sha256"] and row["state"] == "whole"


def test_a_result_is_listed_with_its_parameters_and_report(lab: Path) -> None:
    with open_archive(lab) as archive:
        row = archive.find("2026-02/identified")
        assert (row["kind"], row["verdict"], row["error"]) == ("identification", "wls", 0.0125)
        assert row["report"] == "2026-02/identified/report.html" and row["made_from"] == "fit.mcap, held.mcap"
        assert (row["date"], row["date_of"]) == ("2026-02-01T00:00:00Z", "recording")
        found = archive.parameters(row["path"])
        assert [(p["name"], p["value"], p["std"]) for p in found] == [
            ("joint1.coulomb", 6.0, 0.1),
            ("joint2.coulomb", 8.0, 0.2),
        ]
        worn = archive.find("2026-03/diagnosed")
        assert worn["verdict"] == "explained: backlash of joint 2" and worn["date"] == "2026-03-01T10:00:00Z"
        assert [one["path"] for one in archive.used_in(archive.find("2026-02/fit.mcap"))].count(row["path"]) == 1
        values = [one["value"] for one in archive.history("joint1.coulomb")]
        assert values == [5.0, 6.0, 7.0]
        assert [one["value"] for one in archive.history("joint2.backlash.half_gap")] == [1e-3, 2e-3]
        with pytest.raises(InputError, match=r"results here have joint1.coulomb, joint2.coulomb"):
            archive.history("Coulomb")


def test_a_result_without_a_date_has_that_of_its_file(tmp_path: Path) -> None:
    path = identification(tmp_path / "a", FRICTION)
    for file in path.parent.iterdir():
        os.utime(file, (1.75e9, 1.75e9))
    (row,) = rows_of(tmp_path)
    assert (row["date"], row["date_of"]) == ("2025-06-15T15:06:40Z", "file")


def test_results_of_a_floating_base_are_listed(tmp_path: Path) -> None:
    """Their schemas differ from those of an arm's."""
    drag = {"name": "base.linear_drag_surge", "value": 13.1, "std": 0.4, "unit": "N s/m"}
    tables = {
        "identification": {"method": "wls", "parameters": [{**drag, "identifiable": True}]},
        "diagnosis": {
            "verdict": "explained",
            "causes": [
                {"effect": "thruster_gain", "joint": None, "thruster": 3, "parameters": {"gain": {**drag, "unit": "1"}}}
            ],
        },
    }
    for kind, table in tables.items():
        (tmp_path / f"{kind}.json").write_text(
            json.dumps({"schema": f"armscope.base_{kind}/1", "fit": ["a.mcap"], "held_out": [], **table})
        )
    with open_archive(tmp_path) as archive:
        rows = {row["kind"]: row for row in archive.rows()}
        found = {kind: [one["name"] for one in archive.parameters(row["path"])] for kind, row in rows.items()}
    assert {kind: (row["state"], row["verdict"]) for kind, row in rows.items()} == {
        "identification": ("whole", "wls"),
        "diagnosis": ("whole", "explained: thruster_gain"),
    }
    assert found == {"identification": ["base.linear_drag_surge"], "diagnosis": ["thruster_gain.gain"]}


@pytest.mark.parametrize(
    ("filters", "count"),
    [
        ({}, 12),
        ({"kind": "recording"}, 6),
        ({"arm": "puma560"}, 6),
        ({"arm": "scara"}, 3),
        ({"arm": "puma-560", "kind": "recording", "lost": 10}, 2),
        ({"kind": "recording", "lost": 0}, 4),
        ({"since": "2026-02"}, 8),
        ({"since": "2026-02", "until": "2026-02"}, 4),
        ({"until": "2026-01-01"}, 3),
        ({"until": "2026-01-01T00"}, 2),
        ({"since": "2026-02-01T01:00:00+01:00", "until": "2026-02-01T00:00:00Z"}, 2),
        ({"verdict": "backlash"}, 2),
        ({"experiment": "heldout", "calibration": "C0FF"}, 3),
        ({"calibration": "ff"}, 0),
        ({"path": "2026_02/"}, 4),
        ({"state": "damaged"}, 0),
    ],
)
def test_filters(lab: Path, filters: dict[str, Any], count: int) -> None:
    assert len(rows_of(lab, **filters)) == count


@pytest.mark.parametrize(
    "wrong", [{"since": "2026-13"}, {"until": "yesterday"}, {"since": "26"}, {"lost": -1}, {"kind": "x"}, {"state": ""}]
)
def test_wrong_filters(wrong: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=f"--{next(iter(wrong))}: must be"):
        Filters(**wrong)


def test_only_changed_files_are_read(lab: Path) -> None:
    for path in lab.rglob("*.*"):
        os.utime(path, (1.7e9, 1.7e9))
    with open_archive(lab) as archive:
        assert (archive.update.read, archive.update.unchanged) == (12, 0)
    (lab / "2026-01/fit.mcap").rename(lab / "moved.mcap")
    (lab / "2026-01/scara.mcap").unlink()
    (lab / "2026-02/identified/model.toml").write_text('name = "Another"\n')
    with open_archive(lab) as archive:
        assert (archive.update.read, archive.update.gone, archive.update.unchanged) == (2, 2, 9)
        assert archive.find("moved")["rows"] == 400 and archive.find("2026-02/identified")["arm"] == "Another"
        assert len(archive) == 11


def test_a_file_rewritten_within_the_clock_of_files_is_read_again(tmp_path: Path) -> None:
    """The same size and the same time as what was indexed: a file system that counts in seconds."""
    path = identification(tmp_path / "a", FRICTION)
    now = int(time.time())
    for value in (5.0, 6.0):
        identification(tmp_path / "a", {"joint1.coulomb": (value, 0.1)})
        for file in path.parent.iterdir():
            os.utime(file, (now, now))
        with open_archive(tmp_path) as archive:
            assert archive.history("joint1.coulomb")[0]["value"] == value


@pytest.mark.parametrize("seed", range(6))
def test_an_updated_index_equals_a_new_one(lab: Path, seed: int) -> None:
    """Files moved, deleted, damaged, cut off, added, between updates, in any order."""
    draw = random.Random(seed)
    for step in range(6):
        files = sorted(path for path in lab.rglob("*") if path.suffix in (".mcap", ".json", ".active"))
        path = draw.choice(files)
        match draw.choice(["move", "delete", "cut", "flip", "add", "garbage", "unfinished"]):
            case "move":
                path.rename(path.with_name(f"x{step}{path.name}"))
            case "delete":
                path.unlink()
            case "cut":
                os.truncate(path, draw.randrange(1, path.stat().st_size))
            case "flip":
                data = bytearray(path.read_bytes())
                data[draw.randrange(len(data))] ^= 0x10
                path.write_bytes(data)
            case "add":
                record(lab / f"new{step}/run.mcap", day=step, lost=step)
            case "garbage":
                path.write_bytes(draw.randbytes(500))
            case "unfinished" if path.suffix == ".mcap":
                path.rename(f"{path}.active")
        updated = rows_of(lab)
        assert updated == rebuilt(lab)
        assert all(row["note"] for row in updated if row["state"] != "whole")


def test_a_damaged_index_is_made_again(lab: Path) -> None:
    good = rows_of(lab)
    data = (lab / INDEX).read_bytes()
    draw = random.Random(0)
    wounds = [draw.randbytes(5000), data[: len(data) // 2], b"", data[:100] + draw.randbytes(len(data) - 100)]
    for wound in wounds:
        (lab / INDEX).write_bytes(wound)
        with open_archive(lab) as archive:
            assert archive.rows() == good
            assert wound == b"" or "is damaged" in archive.notes[0]
        with open_archive(lab) as archive:
            assert not archive.notes and archive.rows() == good


def test_an_index_of_another_version_is_made_again(lab: Path) -> None:
    good = rows_of(lab)
    with sqlite3.connect(lab / INDEX) as connection:
        connection.execute("DROP TABLE parameter")
        connection.execute("PRAGMA user_version = 99")
    connection.close()
    assert rows_of(lab) == good


def test_a_database_of_somebody_else_is_left_alone(lab: Path) -> None:
    with sqlite3.connect(lab / INDEX) as connection:
        connection.execute("CREATE TABLE entry (mine TEXT)")
    connection.close()
    before = (lab / INDEX).read_bytes()
    with pytest.raises(InputError, match="a database of another program"):
        open_archive(lab)
    assert (lab / INDEX).read_bytes() == before


INDEXER = """
import sys, time
import arm_archive.archive as archive
archive.COMMIT = 0.0
folder, start = sys.argv[1], float(sys.argv[2])
time.sleep(max(0.0, start - time.time()))
with archive.open_archive(folder, progress=lambda done, of, path: print(done, flush=True)) as opened:
    print("rows", len(opened), opened.notes, flush=True)
"""


def indexer(folder: Path, root: Path, start: float = 0.0, **options: Any) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", INDEXER, str(folder), str(start)]
    return subprocess.Popen(command, cwd=root, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options)


def test_processes_that_index_at_once_agree(lab: Path, root: Path) -> None:
    at = time.time() + 1.0
    running = [indexer(lab, root, at) for _ in range(2)]
    for one in running:
        output, errors = one.communicate(timeout=60)
        assert one.returncode == 0 and errors == "" and output.endswith("rows 12 ()\n")
    together = rows_of(lab)
    with open_archive(lab) as archive:
        assert len(archive.parameters()) == 3
    assert together == rebuilt(lab)


def test_an_indexer_that_is_killed_leaves_what_it_had_read(lab: Path, root: Path) -> None:
    for number in range(60):
        shutil.copy(lab / "2026-01/fit.mcap", lab / f"copy{number}.mcap")
    for path in lab.rglob("*.*"):
        os.utime(path, (1.7e9, 1.7e9))
    killed = indexer(lab, root)
    assert killed.stdout is not None
    for _ in range(15):
        killed.stdout.readline()
    killed.send_signal(signal.SIGKILL)
    killed.communicate(timeout=30)
    with open_archive(lab) as archive:
        assert 0 < archive.update.read < 72 and archive.update.unchanged >= 10 and not archive.notes
        kept = archive.rows()
    assert kept == rebuilt(lab)


READ_ONLY = """
import os, sys
from arm_archive import open_archive
with open_archive(sys.argv[2]):  # loads every module while all files can be read
    pass
if os.geteuid() == 0:
    os.seteuid(65534)
with open_archive(sys.argv[1]) as opened:
    print(len(opened), opened.update.read, *opened.notes, sep="|")
"""


@pytest.mark.parametrize(("index", "read"), [("whole", 0), ("old", 1), ("none", 12)])
def test_a_folder_that_cannot_be_written(lab: Path, root: Path, index: str, read: int) -> None:
    for path in lab.rglob("*.*"):
        os.utime(path, (1.7e9, 1.7e9))
    if index != "none":
        rows_of(lab)
    if index == "old":
        os.utime(lab / "2026-01/fit.mcap", (1.6e9, 1.6e9))
    with tempfile.TemporaryDirectory() as place:
        shutil.copytree(lab, Path(place, "lab"))
        folders = [Path(place), *(path for path in Path(place).rglob("*") if path.is_dir())]
        for folder in folders:
            folder.chmod(0o555)
        command = [sys.executable, "-c", READ_ONLY, f"{place}/lab", str(lab)]
        shown = subprocess.run(command, cwd=root, capture_output=True, text=True)
        for folder in folders:
            folder.chmod(0o755)
    assert shown.returncode == 0, shown.stderr
    assert shown.stdout.startswith(f"12|{read}")
    assert ("what is read now is not kept" in shown.stdout) == (index != "whole")


def test_no_folder_at_all(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="must be a folder of recordings"):
        open_archive(tmp_path / "none")
