"""Tables in and out: bit for bit, and one line about what is wrong with others."""

from __future__ import annotations

import math
import struct
import tempfile
import time
from decimal import Decimal
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arm_io import InputError
from armscope.cli import run
from daq.recording import open_recording
from daq.recording.parts import Attachments
from daq.recording.tables.csv_reader import read_csv
from daq.recording.tables.csv_time import TimeUnit
from daq.recording.tables.csv_writer import write_csv
from daq.recording.tables.table import write_table

GOOD = "t,q1,i1,q2,i2\n0,0.1,1,0.2,2\n0.01,0.3,3,0.4,4\n0.02,0.5,5,0.6,6\n"


def write(folder: Path, text: str) -> Path:
    path = folder / "table.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_columns_find_their_joints(tmp_path: Path) -> None:
    table = read_csv(write(tmp_path, "ql2,t,i2,q2,i1,q1,z,x,y\n9,0,2,4,1,3,7,5,6\n,1,2,nan,1,3,7,,6\n"))
    np.testing.assert_array_equal(table.signals["q"], [[3, 4], [3, np.nan]])
    np.testing.assert_array_equal(table.signals["i"], [[1, 2], [1, 2]])
    np.testing.assert_array_equal(table.signals["ql"], [[np.nan, 9], [np.nan, np.nan]])
    np.testing.assert_array_equal(table.xyz, [[5, 6, 7], [np.nan, 6, 7]])
    assert table.joints == 2 and table.rows_with_missing_samples == 1 and "qref" not in table.signals


def test_windows_and_spaces_are_welcome(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_bytes(b"\xef\xbb\xbft, q1 ,i1\r\n0, 1,2\r\n\r\n 1,3 ,\r\n")
    table = read_csv(path)
    np.testing.assert_array_equal(table.t, [0, 1])
    np.testing.assert_array_equal(table.signals["i"], [[2], [np.nan]])


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", r"is empty; the first line must name the columns: t \(s\)|has 0 lines"),
        ("0,1,2\n1,2,3\n", r"line 1: has numbers; the first line must name the columns: t \(s\)"),
        ("t,i1,i2\n0,1,2\n1,2,3\n", r"line 1: column q1 is missing \(and 1 more\); every row needs t \(s\)"),
        ("t,q1,i1\n", "has 0 lines of numbers; there must be at least 2"),
        ("t,q1\n0,1\n1,2\n", "line 1: column i1 is missing"),
        ("t,i1,q_1\n0,1,2\n1,2,3\n", "line 1: column q1 is missing; is it 'q_1'?"),
        ("time,q1,i1\n0,1,2\n1,2,3\n", "line 1: column t is missing"),
        ("t,q1,i1,q3,i3\n0,1,2,3,4\n1,1,2,3,4\n", "line 1: column q2 is missing"),
        ("t,q1,i1,ql2\n0,1,2,3\n1,1,2,3\n", r"line 1: column ql2, but the table \(columns q1, q2, ...\) has 1 joint"),
        ("t,q1,i1,q1\n0,1,2,3\n1,1,2,3\n", "line 1: column 'q1' is there twice"),
        ("t,q1,i1,room\n0,1,2,3\n1,1,2,3\n", "line 1: column 'room' is unknown; known are .*--keep-extra"),
        ("t,q1,i1,x,y\n0,1,2,3,4\n1,1,2,3,4\n", "x, y, z must be all there"),
        ("t,q1,i1\n0,1,2\n1,1\n", "line 3: has 2 cells, the first line names 3 columns"),
        ("t,q1,i1\n0,1,2\n1,one,2\n", "line 3, column q1: 'one' is no number"),
        ("t,q1,i1\n0,1,2\n1,1_0,2\n", "line 3, column q1: '1_0' is no number"),
        ("t,q1,i1\n0,1,2\n1,inf,2\n", "line 3, column q1: 'inf' is not finite"),
        ("t,q1,i1\n0,1,2\n1,1,-1e300\n", "line 3, column i1: -1e.300 is not a measurement"),
        ("t,q1,i1\n0,1,2\n,1,2\n", "line 3, column t: is missing"),
        ("t,q1,i1\n0,1,2\n2,1,2\n1.5,1,2\n", "line 4: t goes from 2 to 1.5; it must increase .* as two tables$"),
        ("t,q1,i1\n0,1,2\n0,1,2\n", "line 3: t goes from 0 to 0; .*: leave out one of both rows$"),
        ("t,q1,i1\n0,1,\n1,2,nan\n", "column i1 has no value in any line"),
        ("t;q1;i1\n0;1;2\n1;1;2\n", "columns are separated by ';', and their names do not say"),
        ("a [ms];b;c\n0;1;2\n1;1;2\n", r"there are 'a \[ms\]', 'b', 'c'$"),
        ("t,q1,i1\n0,1,2\n5e9,1,2\n", "is it in s?"),
        ("t,q1,i1\n0,\xff\n", "."),
    ],
)
def test_wrong_tables_get_one_line(tmp_path: Path, text: str, complaint: str) -> None:
    with pytest.raises(InputError, match=complaint) as refusal:
        read_csv(write(tmp_path, text))
    assert "\n" not in str(refusal.value) and str(refusal.value).startswith(str(tmp_path / "table.csv"))


def test_a_table_that_is_no_text_is_refused(tmp_path: Path) -> None:
    (tmp_path / "table.csv").write_bytes(b"t,q1,i1\n0,\xff\xfe,1\n")
    with pytest.raises(InputError, match="line 2, column q1: 'ÿþ' is no number"):
        read_csv(tmp_path / "table.csv")
    with pytest.raises(InputError, match="no such file"):
        read_csv(tmp_path / "absent.csv")


def test_the_rig_has_the_last_word_on_joints(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"column q3 is missing \(and 1 more\); the arm has 3 joints"):
        read_csv(write(tmp_path, GOOD), joints=3)
    with pytest.raises(InputError, match="column q2, but the arm has 1 joint$"):
        read_csv(write(tmp_path, GOOD), joints=1)


def test_extra_columns_are_kept_on_request(tmp_path: Path) -> None:
    path = write(tmp_path, "room,t,q1,i1\n20,0,1,2\n,0.1,1,2\n")
    np.testing.assert_array_equal(read_csv(path, keep_extra=True).extra["room"], [20, np.nan])


NUMBERS = st.floats(-1e15, 1e15) | st.just(math.nan)


@settings(max_examples=40)
@given(
    rows=st.lists(st.tuples(*[NUMBERS] * 8), min_size=2, max_size=20),
    steps=st.lists(st.floats(1e-9, 1e3), min_size=20, max_size=20),
    start=st.floats(-1e3, 1e6),
)
def test_a_table_survives_recording_and_export_to_the_last_bit(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[float, ...]], steps: list[float], start: float
) -> None:
    folder = tmp_path_factory.mktemp("csv")
    t = start + np.cumsum([0.0, *steps[: len(rows) - 1]])
    columns = np.array(rows).T
    columns[:, 0] = np.where(np.isnan(columns[:, 0]), 1.0, columns[:, 0])  # no column without any value
    if (np.diff(t) <= 0).any():
        return
    names = ["q1", "i1", "q2", "i2", "ql2", "temp1", "room", "x"]
    write_first = folder / "first.csv"
    cells = [["" if math.isnan(value) else repr(float(value)) for value in row] for row in columns.T]
    lines = [",".join([repr(float(time)), *row, row[0], row[1]]) for time, row in zip(t, cells)]
    write_first.write_text("\n".join([",".join(["t", *names, "y", "z"]), *lines]) + "\n")
    table = read_csv(write_first, keep_extra=True, unit=TimeUnit.S)
    write_table(folder / "run.mcap", table.t, table.signals | {"xyz": table.xyz}, Attachments(), extra=table.extra)
    write_csv(folder / "second.csv", open_recording(folder / "run.mcap"))
    again = read_csv(folder / "second.csv", keep_extra=True, unit=TimeUnit.S)
    for before, after in [
        (t, again.t),
        (np.column_stack(columns[[0, 2]]).reshape(-1, 2), again.signals["q"]),
        (np.column_stack(columns[[1, 3]]).reshape(-1, 2), again.signals["i"]),
        (columns[4], again.signals["ql"][:, 1]),
        (columns[5], again.signals["temp"][:, 0]),
        (columns[6], again.extra["room"]),
        (columns[7], again.xyz[:, 0]),
    ]:
        assert bits(before) == bits(after)


def bits(values: np.ndarray) -> bytes:
    """Bit patterns; every NaN is the same."""
    return b"".join(struct.pack("<d", math.nan if math.isnan(value) else value) for value in np.ravel(values).tolist())


@pytest.mark.parametrize(
    ("header", "words"),
    [
        ("t,q3000000,i1", "column q3000000: joints are numbered from 1 to at most 64"),
        ("t,q99999999999999,i1", "column q99999999999999: joints are numbered from 1 to at most 64"),
        ("t,q" + "9" * 6000 + ",i1", "joints are numbered"),
        ("t,q65,i65", "at most 64"),
        ("t,q1,i1,q3,i3", "column q2 is missing"),
        (",".join(["t", *(f"a{k}" for k in range(1_000_000))]), "is longer than 65536 characters"),
        (",".join(["t", "q1", "i1", *(f"a{k}" for k in range(9000))]), "column 'a0' is unknown"),
    ],
)
def test_headers_of_no_table_are_refused_at_once(tmp_path: Path, header: str, words: str) -> None:
    began = time.process_time()
    with pytest.raises(InputError, match=words):
        read_csv(write(tmp_path, header + "\n0,0,0\n0.001,0,0\n"))
    assert time.process_time() - began < 5.0


def rows_of(times: list[str]) -> str:
    return "t,q1,i1\n" + "".join(f"{t},{k * 0.001},0.5\n" for k, t in enumerate(times))


@pytest.mark.parametrize(
    ("times", "words"),
    [
        ([str(k) for k in range(20)], "goes by 1 from row to row; is it in s\\? Give --time-unit s, ms, us or ns"),
        ([str(1000 * k) for k in range(20)], "goes by 1000 .* --time-unit"),
        ([str(10 * k + 0.5) for k in range(20)], "goes by 10 .* --time-unit"),
        (["1700000000000", "1700000000001"], "as ms since 1970 do; give --time-unit"),
        (["1700000000000000", "1700000000001000"], "as us since 1970 do; give --time-unit"),
        (["1700000000000000000", "1700000000000050000"], "as ns since 1970 do; give --time-unit"),
    ],
)
def test_times_that_do_not_look_like_seconds_are_asked_about(tmp_path: Path, times: list[str], words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_csv(write(tmp_path, rows_of(times)))
    assert len(read_csv(write(tmp_path, rows_of(times)), unit=TimeUnit.NS).t) == len(times)


@settings(max_examples=60)
@given(
    st.sampled_from(list(TimeUnit)),
    st.lists(st.integers(1, 2_000_000_000), min_size=2, max_size=30),
    st.booleans(),
    st.integers(0, 10**9),
)
def test_times_in_any_unit_since_any_time_lose_nothing(
    unit: TimeUnit, steps: list[int], of_epoch: bool, nanoseconds: int
) -> None:
    """Steps in ns, written with all digits.

    What is read is the nearest float64 to the exact time since the first row, or the start.
    """
    digits = {"s": 9, "ms": 6, "us": 3, "ns": 0}[unit]
    first = (1_700_000_000 * of_epoch) * 10**9 + nanoseconds
    exact = [first + sum(steps[:k]) for k in range(len(steps) + 1)]
    texts = [str(Decimal(value).scaleb(-digits).normalize()) for value in exact]
    with tempfile.TemporaryDirectory() as folder:
        table = read_csv(write(Path(folder), rows_of(texts)), unit=unit)
    origin = first if of_epoch else 0
    assert table.t.tolist() == [float(Fraction(value - origin, 10**9)) for value in exact]
    assert table.start_ns == (first if of_epoch else None)


def test_times_of_the_epoch_are_relative_in_the_recording_and_come_back(tmp_path: Path) -> None:
    texts = [f"17000000{k // 1000:02d}.{k % 1000:03d}123456" for k in range(3000)]
    table, run_file, back = write(tmp_path, rows_of(texts)), tmp_path / "run.mcap", tmp_path / "back.csv"
    assert run(["import", str(table), "--out", str(run_file)]) == 0
    recording = open_recording(run_file)
    # to the last bit, where float64 since 1970 has 0.24 us
    np.testing.assert_array_equal(recording.t, np.arange(3000) / 1000)
    assert recording.wall_ns[0] == 1_700_000_000_000_123_456 and recording.wall_ns[-1] == 1_700_000_002_999_123_456
    assert run(["export", str(run_file), "--out", str(back)]) == 0
    assert [line.split(",")[0] for line in back.read_text().splitlines()[1:]] == texts


def test_a_motion_that_would_be_a_thousand_times_too_slow_is_asked_about(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A logger of 2 kHz that counts ms: rows 0.5 apart may be seconds, but no arm is as slow."""
    t = np.arange(4000) / 2000
    q = 0.5 * np.sin(2 * np.pi * 0.7 * t)
    table, out = tmp_path / "run.csv", tmp_path / "run.mcap"
    table.write_text("t,q1,i1\n" + "".join(f"{1000 * a},{b},{b}\n" for a, b in zip(t, q)))
    assert run(["import", str(table), "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert "no joint moves faster than 0.002 rad/s" in said and "--time-unit" in said and said.count("\n") == 1
    assert not out.exists()
    assert run(["import", str(table), "--out", str(out), "--time-unit", "ms"]) == 0
    # as fast as it is, and slow sweeps of a calibration
    for scale in (1.0, 20.0):
        table.write_text("t,q1,i1\n" + "".join(f"{scale * a},{b},{b}\n" for a, b in zip(t, q)))
        assert run(["import", str(table), "--out", str(out)]) == 0


def test_the_command_asks_for_the_unit_and_takes_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table, out = write(tmp_path, rows_of([str(k) for k in range(2000)])), tmp_path / "run.mcap"
    assert run(["import", str(table), "--out", str(out)]) == 2
    assert capsys.readouterr().err.count("\n") == 1 and not out.exists()
    assert run(["import", str(table), "--out", str(out), "--time-unit", "ms"]) == 0
    np.testing.assert_array_equal(open_recording(out).t, np.arange(2000) / 1000)
    assert run(["import", str(table), "--out", str(out), "--time-unit", "hours"]) == 2


@pytest.mark.filterwarnings("error")
def test_a_single_line_is_refused_in_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "one.csv"
    path.write_text("t,q1,i1\n0,0.1,1\n")
    with pytest.raises(InputError, match="has 1 lines of numbers; there must be at least 2"):
        read_csv(path)
