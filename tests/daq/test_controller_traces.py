"""Traces as the recorders of robot controllers export them: two header lines, preambles, times of day, percent."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from armscope.cli import run
from tests.daq.foreign_tables import imported

ROWS = 30


def _written(path: Path, header: str, separator: str = ";", decimal: str = ",", time: str = "") -> Path:
    """A table of two joints below a header: 20 k deg and -k deg, k/4 and 2 k; times k/100, or ``time`` with {k}."""
    lines = []
    for k in range(ROWS):
        cells = [time.format(k=k) if time else f"{k / 100}", f"{20 * k}", f"{-k}", f"{k / 4}", f"{2 * k}"]
        lines.append(separator.join([cells[0], *(cell.replace(".", decimal) for cell in cells[1:])]))
        if not time:
            lines[-1] = lines[-1].replace(".", decimal)
    path.write_text(header + "\n" + "\n".join(lines) + "\n", encoding="utf-8")
    return path


UNITS_BELOW = "Zeit;Ist A1;Ist A2;Strom A1;Strom A2\ns;Grad;Grad;A;A"
GROUPS = "Time;Position;;Current;\ns;A1;A2;A1;A2"
PREAMBLE = "Robotics signal log\nController: 77\n\nTime [s];J1 Pos [deg];J2 Pos [deg];J1 Current [A];J2 Current [A]"


@pytest.mark.parametrize("header", [UNITS_BELOW, GROUPS, PREAMBLE, "t;j1;j2;i1;i2"])
def test_the_names_stand_above_the_first_row_of_numbers(header: str, tmp_path: Path) -> None:
    recording = imported(_written(tmp_path / "trace.csv", header), "--guess")
    k = np.arange(ROWS)
    np.testing.assert_allclose(recording.t, k / 100, atol=1e-12)
    np.testing.assert_allclose(np.rad2deg(recording.q), np.column_stack([20 * k, -k]), atol=1e-9)
    np.testing.assert_allclose(recording.i, np.column_stack([k / 4, 2 * k]))


def test_a_mapping_names_columns_with_the_units_below_them(tmp_path: Path) -> None:
    table = _written(tmp_path / "trace.csv", UNITS_BELOW.replace("A;A", "%;%"))
    (tmp_path / "map.toml").write_text(
        'separator = ";"\ndecimal = ","\n[columns]\nt = "Zeit [s]"\nq = "Ist A{1} [Grad]"\ni = "Strom A{1} [%]"\n'
        '[units]\nq = "deg"\ni = "A"\n[scale]\ni = [0.2, 0.05]\n'
    )
    recording = imported(table, "--map", str(tmp_path / "map.toml"))
    np.testing.assert_allclose(recording.i[4], [0.2 * 1.0, 0.05 * 8.0])
    assert recording.current_unit(1) == "A"


@pytest.mark.parametrize("word", ["Motorstrom", "Torque"])
def test_percent_is_a_unit_of_the_drive_and_said_to_be_one(
    word: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    header = f"Time [s];A1 Pos [deg];A2 Pos [deg];A1 {word} [%];A2 {word} [%]"
    recording = imported(_written(tmp_path / "trace.csv", header), "--guess")
    np.testing.assert_allclose(recording.i[4], [1.0, 8.0])
    assert recording.current_unit(1) == "%"
    assert "i is in % of what each drive calls 100 %" in capsys.readouterr().err


@pytest.mark.parametrize(("time", "step"), [("10:00:{k:02d},125", 1.0), ("9:00:{k:02d}", 1.0), ("0.{k:03d} sec", 1e-3)])
def test_times_of_day_and_durations(time: str, step: float, tmp_path: Path) -> None:
    header = "Time;J1 Pos [deg];J2 Pos [deg];J1 Current [A];J2 Current [A]"
    recording = imported(_written(tmp_path / "trace.csv", header, time=time), "--guess")
    np.testing.assert_allclose(recording.t, step * np.arange(ROWS), atol=1e-9)


def test_times_of_day_go_on_after_midnight(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("daq.recording.tables.csv_reader.BLOCK_CHARACTERS", 64)
    clock = [f"{s // 3600 % 24:02d}:{s // 60 % 60:02d}:{s % 60:02d}.5" for s in range(86390, 86390 + ROWS)]
    lines = [f"{text},{20 * k},{k}" for k, text in enumerate(clock)]
    (tmp_path / "trace.csv").write_text("Time,J1 Pos [deg],J1 Current [A]\n" + "\n".join(lines) + "\n")
    recording = imported(tmp_path / "trace.csv", "--guess")
    np.testing.assert_allclose(recording.t, np.arange(ROWS))


def test_a_german_date_is_that_of_the_recording(tmp_path: Path) -> None:
    header = "Zeitstempel;Ist A1 [Grad];Ist A2 [Grad];Strom A1 [A];Strom A2 [A]"
    table = _written(tmp_path / "trace.csv", header, time="02.03.2026 10:00:{k:02d},125")
    recording = imported(table, "--guess")
    np.testing.assert_allclose(recording.t, np.arange(ROWS))
    assert np.datetime64(int(recording.wall_ns[0]), "ns") == np.datetime64("2026-03-02T10:00:00.125")


@pytest.mark.parametrize(
    ("time", "said"),
    [
        ("03/02/2026 10:00:{k:02d}", "of times, 2026-03-01 10:00:00.125, 01.03.2026 10:00:00,125 and 10:00:00.125"),
        ("1.000.{k:03d},0", "thousands must not be separated"),
    ],
)
def test_times_that_may_mean_two_things_are_refused(
    time: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    header = "Time;J1 Pos [deg];J2 Pos [deg];J1 Current [A];J2 Current [A]"
    table = _written(tmp_path / "trace.csv", header, time=time)
    assert run(["import", str(table), "--guess", "--out", str(tmp_path / "run.mcap")]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "run.mcap").exists()


def test_names_with_blanks_are_not_split_at_them(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Split at blanks, 'Time', 'Pos' and 'Effort' would be a table, but its rows have one cell."""
    (tmp_path / "trace.csv").write_text("Time [x],A1 Pos q,A1 Effort z\n" + "0.0,1,2\n0.1,1,2\n")
    assert run(["import", str(tmp_path / "trace.csv"), "--guess", "--out", str(tmp_path / "run.mcap")]) == 2
    assert "--map says which of Time [x], A1 Pos q, A1 Effort z are t, q1, i1" in capsys.readouterr().err
