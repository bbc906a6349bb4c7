"""info, recover, import, export and plot as a person calls them."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from armscope.cli import run
from daq.acquisition.ledger import Loss, LossReason
from daq.recording import open_recording
from daq.recording.parts import Attachments
from daq.recording.recorder import Recorder
from daq.recording.tables.csv_reader import read_csv
from tests.daq.recorded import LAYOUT, make_rows

RIG = 'name = "bench"\n[[joint]]\nname = "carriage"\ntype = "prismatic"\n'


@pytest.fixture
def table(tmp_path: Path) -> Path:
    (tmp_path / "rig.toml").write_text(RIG)
    path = tmp_path / "table.csv"
    lines = [f"{k * 0.01},{np.sin(k / 9)},{'' if k == 7 else np.cos(k / 9)},{np.sin((k + 1) / 9)}" for k in range(100)]
    path.write_text("t,q1,i1,qref1\n" + "\n".join(lines) + "\n")
    return path


@pytest.fixture
def recorded(tmp_path: Path) -> Path:
    path = tmp_path / "run.mcap"
    with Recorder(path, LAYOUT, Attachments(calibration={"hash": "abc"}, provenance={"kind": "measured"})) as recorder:
        recorder.append(make_rows(0, 50))
        recorder.append(make_rows(55, 50))
        recorder.finish(losses=[Loss(50, 5, LossReason.LOST_EDGE)])
    return path


def test_there_and_back(table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, back = tmp_path / "run.mcap", tmp_path / "back.csv"
    assert run(["import", str(table), "--rig", str(tmp_path / "rig.toml"), "--out", str(out)]) == 0
    assert "100 rows of 1 joint, 0.99 s, 1 row with missing samples" in capsys.readouterr().out
    assert run(["export", str(out), "--out", str(back)]) == 0
    before, after = read_csv(table), read_csv(back)
    np.testing.assert_array_equal(before.t, after.t)
    assert before.signals.keys() == after.signals.keys()
    for signal in before.signals:
        np.testing.assert_array_equal(before.signals[signal], after.signals[signal])
    assert sorted(path.name for path in tmp_path.iterdir()) == ["back.csv", "rig.toml", "run.mcap", "table.csv"]


def test_a_date_that_is_stated_is_that_of_the_recording(
    table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run.mcap"
    for text, date in (("2026-03-01", "2026-03-01T00:00:00Z"), ("2026-03-01T10:00:00+01:00", "2026-03-01T09:00:00Z")):
        assert run(["import", str(table), "--date", text, "--out", str(out)]) == 0
        assert open_recording(out).date == date
    assert run(["export", str(out), "--out", str(tmp_path / "back.csv")]) == 0
    assert (tmp_path / "back.csv").read_text() == table.read_text()
    assert run(["import", str(table), "--date", "March", "--out", str(out)]) == 2
    assert "--date: must be a day or a moment, as 2026-03-01" in capsys.readouterr().err
    dated = tmp_path / "dated.csv"
    dated.write_text("t,q1,i1\n" + "".join(f"{1.77e9 + 0.01 * k:.3f},{k / 50},1\n" for k in range(50)))
    assert run(["import", str(dated), "--date", "2026-03-01", "--out", str(tmp_path / "dated.mcap")]) == 2
    assert "has the dates of its rows" in capsys.readouterr().err
    assert not (tmp_path / "dated.mcap").exists()


def test_import_says_what_is_wrong_and_leaves_nothing(
    table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "rig.toml").write_text(RIG + "[[joint]]\n")
    out = tmp_path / "run.mcap"
    assert run(["import", str(table), "--rig", str(tmp_path / "rig.toml"), "--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert error == f"error: {table}: line 1: column q2 is missing (and 1 more); the arm has 2 joints\n"
    assert run(["import", str(table), "--out", str(tmp_path / "nowhere" / "run.mcap")]) == 2
    assert sorted(path.name for path in tmp_path.iterdir()) == ["rig.toml", "table.csv"]


def test_an_import_that_fills_the_disk_leaves_nothing(table: Path, tmp_path: Path, root: Path) -> None:
    limited = (
        "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (5000, 5000));from armscope.cli import run; "
        f"sys.exit(run(['import', {str(table)!r}, '--out', {str(tmp_path / 'run.mcap')!r}]))"
    )
    process = subprocess.run([sys.executable, "-c", limited], cwd=root, capture_output=True, text=True, timeout=60)
    assert process.returncode == 3 and process.stderr.startswith("error: disk: File too large while writing")
    assert process.stderr.count("\n") == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["rig.toml", "table.csv"]


def test_info_accounts_for_every_sample(recorded: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["info", str(recorded), "--json"]) == 4
    info = json.loads(capsys.readouterr().out)
    assert (info["ledger"]["triggers"], info["ledger"]["recorded"], info["ledger"]["lost"]) == (105, 100, 5)
    assert info["ledger"]["losses"][0]["reason"] == "lost_edge" and info["ledger"]["balanced"]
    assert [(gap["row"], gap["triggers"]) for gap in info["gaps"]] == [(49, 5)]
    assert info["schema"] == "armscope.info/1" and info["inputs"] == list(LAYOUT.inputs)
    assert info["rows"] == 100 and info["finished"] and info["calibration"] == {"hash": "abc"}
    recording = open_recording(recorded)
    one = next(row for row in info["signals"] if (row["signal"], row["joint"]) == ("i", 2))
    assert one["missing"] == np.isnan(recording.i[:, 1]).sum() and one["max"] == np.nanmax(recording.i[:, 1])
    assert info["quality_flags"]["saturated"] == np.count_nonzero(recording.quality & 2)
    assert run(["info", str(recorded)]) == 4
    text = capsys.readouterr().out
    assert "105 triggers = 100 recorded + 5 lost" in text and "an edge of the trigger line was missed" in text


def test_recover_and_info_on_a_cut_file(recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cut, out = tmp_path / "cut.mcap.active", tmp_path / "cut.mcap"
    cut.write_bytes(recorded.read_bytes()[:-3000])
    assert run(["info", str(cut)]) == 4
    assert "not finished" in capsys.readouterr().out
    assert run(["recover", str(cut), "--json"]) == 4
    result = json.loads(capsys.readouterr().out)
    assert result["file"] == str(out) and result["triggers"] == 105 and result["lost"] >= 5
    assert open_recording(out).ledger.lost == result["lost"]
    assert run(["recover", str(cut)]) == 2
    assert capsys.readouterr().err.startswith(f"error: {out}: exists already")
    assert run(["recover", str(cut), "--force"]) == 4


@pytest.mark.parametrize("command", ["info", "export", "recover", "plot"])
def test_no_recording(command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "text.mcap").write_text("this is not a recording, but it is long enough to look at")
    out = [] if command == "info" else ["--out", str(tmp_path / ("out.csv" if command == "export" else "out.png"))]
    for name, complaint in (("text.mcap", "is not an MCAP file"), ("absent.mcap", "no such file")):
        assert run([command, str(tmp_path / name), *out]) == 2
        captured = capsys.readouterr()
        assert captured.err.startswith(f"error: {tmp_path / name}: {complaint}") and captured.err.count("\n") == 1
        assert not captured.out
    assert [path.name for path in tmp_path.iterdir()] == ["text.mcap"]


@pytest.mark.parametrize("command", ["info", "export", "recover", "plot"])
def test_json_is_all_that_is_printed(
    command: str, recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    suffix = {"export": ".csv", "plot": ".png"}.get(command, ".mcap")
    out = [] if command == "info" else ["--out", str(tmp_path / f"out{suffix}")]
    status = run([command, str(recorded), *out, "--json"])
    table = json.loads(capsys.readouterr().out)
    assert status == 4, "five rows are missing"
    assert table["file"] == (out[1] if out else str(recorded))


def test_plot_draws_several_on_one_another(table: Path, recorded: Path, tmp_path: Path) -> None:
    from matplotlib.image import imread

    assert run(["import", str(table), "--out", str(tmp_path / "a.mcap")]) == 0
    picture = tmp_path / "picture.png"
    assert run(["plot", str(tmp_path / "a.mcap"), str(recorded), "--out", str(picture)]) == 4, "rows are missing"
    image = imread(picture)[:, :, :3].reshape(-1, 3)
    for colour in ((31, 119, 180), (255, 127, 14)):  # the first two of matplotlib's colour cycle
        assert (np.abs(image * 255 - colour).max(axis=1) < 2).sum() > 100
    assert run(["plot", str(recorded), "--joint", "4", "--out", str(picture)]) == 2
    assert run(["plot", str(recorded), "--out", str(tmp_path / "picture.txt")]) == 2


@pytest.mark.parametrize(
    ("table", "rig", "rows"),
    [("emps/train.csv", "emps", 24841), ("kr300/run_A.csv", "kr300", 2501), ("panda/trajectory_1.csv", "panda", 20544)],
)
def test_published_data_there_and_back(
    shared: Path, root: Path, tmp_path: Path, table: str, rig: str, rows: int
) -> None:
    source, out, back = shared / "data" / table, tmp_path / "run.mcap", tmp_path / "back.csv"
    if not source.is_file():
        pytest.skip(f"no measured data at {source}")
    assert run(["import", str(source), "--rig", str(root / "config" / f"{rig}.toml"), "--out", str(out)]) == 0
    assert run(["export", str(out), "--out", str(back)]) == 0
    before, after = read_csv(source), read_csv(back)
    assert len(after.t) == rows
    assert before.t.tobytes() == after.t.tobytes() and before.signals.keys() == after.signals.keys()
    for signal, values in before.signals.items():
        np.testing.assert_array_equal(values, after.signals[signal])


@pytest.mark.parametrize("name", ["..png", "run.PNG", "a b.svg"])
def test_a_picture_has_the_name_it_was_given(name: str, table: Path, tmp_path: Path) -> None:
    assert run(["import", str(table), "--out", str(tmp_path / "run.mcap")]) == 0
    before = set(tmp_path.iterdir())
    assert run(["plot", str(tmp_path / "run.mcap"), "--out", str(tmp_path / name)]) == 0
    assert set(tmp_path.iterdir()) - before == {tmp_path / name}
