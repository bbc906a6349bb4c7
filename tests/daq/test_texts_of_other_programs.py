"""Tables as programs write them: encodings, comments, numbers of rows, dates, structures; or one clear line."""

from __future__ import annotations

import gzip
import re
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

import armscope
from arm_model import read_model
from armscope.cli import run

T = np.arange(40) * 0.005
Q = np.stack([np.sin(3 * T), np.cos(5 * T)], axis=1)
I = 2.0 * Q + 0.1
NAMES = "t,q1,q2,i1,i2"
ROWS = [[repr(float(value)) for value in row] for row in np.column_stack([T, Q, I])]
TABLE = "\n".join([NAMES, *map(",".join, ROWS)]) + "\n"
GERMAN = "Zeit [s];Winkel 1 [°];Winkel 2 [°];Strom 1 [A];Strom 2 [A]\n" + "\n".join(
    ";".join(str(float(cell) * (180 / np.pi if place in (1, 2) else 1.0)).replace(".", ",") for place, cell in one)
    for one in map(enumerate, ROWS)
)


def instants(text: Callable[[float], str], head: str = NAMES) -> str:
    return head + "\n" + "\n".join(",".join([text(float(row[0])), *row[1:]]) for row in ROWS) + "\n"


def at(zone: str = "", separator: str = "T", hour: int = 23) -> Callable[[float], str]:
    return lambda t: f"2026-03-01{separator}{hour}:59:{59 + t if t < 1 else 0:012.9f}{zone}"


def read(*arguments: str) -> armscope.Recording:
    assert run(["import", *arguments, "--out", "run.mcap"]) == 0
    return armscope.open("run.mcap")


def check(run: armscope.Recording) -> None:
    np.testing.assert_allclose(run.t, T, atol=1e-12)
    np.testing.assert_allclose(run.q, Q, rtol=1e-14, atol=1e-14)
    np.testing.assert_allclose(run.i, I, rtol=1e-14, atol=1e-14)


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(
    ("text", "encoding", "options"),
    [
        (TABLE, "utf-8", []),
        (TABLE, "utf-8-sig", []),
        (TABLE, "utf-16", []),
        (TABLE.replace("\n", "\r\n"), "utf-16", []),
        (GERMAN, "cp1252", ["--guess"]),
        (GERMAN, "utf-8", ["--guess"]),
        ("\n".join(["# of Monday", "# 2 joints", TABLE]), "utf-8", []),
        ("# " + TABLE, "utf-8", []),  # as numpy.savetxt has it
        (GERMAN.replace("Zeit", "# Werkstatt Süd\n#Zeit"), "cp1252", ["--guess"]),
        (NAMES.join([",", "\n"]) + "\n".join(f"{k},{','.join(row)}" for k, row in enumerate(ROWS)), "utf-8", []),
    ],
    ids=["plain", "mark", "utf-16", "utf-16 crlf", "cp1252", "utf-8", "comments", "savetxt", "cp1252 comment", "index"],
)
def test_texts(text: str, encoding: str, options: list[str]) -> None:
    Path("table.csv").write_bytes(text.encode(encoding))
    check(read("table.csv", *options))


def test_a_column_without_a_name_is_said_to_be_left_out(capfd: pytest.CaptureFixture[str]) -> None:
    Path("table.csv").write_text("," + TABLE.replace("\n", "\n0,")[:-2])
    check(read("table.csv"))
    assert "the first column has no name, as numbers of rows have none: left out" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("text", "first"),
    [
        (instants(at()), 1772409599),
        (instants(at("Z", " ")), 1772409599),
        (instants(at("+01:00")), 1772405999),
        (instants(at("-0530", " ")), 1772429399),
        # the index of a DataFrame has no name
        (instants(at(" UTC", " "), ",q1,q2,i1,i2"), 1772409599),
    ],
    ids=["local", "Z", "+01:00", "-0530", "index"],
)
def test_dates_and_times_of_day(text: str, first: int) -> None:
    Path("table.csv").write_text(text)
    run = read("table.csv")
    check(run)
    assert run.wall_ns[0] == first * 10**9


def test_nanoseconds_are_kept() -> None:
    Path("table.csv").write_text(
        "t,q1,i1\n2026-03-01 10:00:00.000000001,0,1\n2026-03-01 10:00:00.000000002,1,1\n2026-03-01 10:00:01,2,1\n"
    )
    np.testing.assert_array_equal(read("table.csv").t, [0.0, 1e-9, 0.999999999])


def test_instants_of_parquet_say_their_unit() -> None:
    pandas = pytest.importorskip("pandas")
    table = pandas.DataFrame(np.column_stack([Q, I]), columns=["q1", "q2", "i1", "i2"])
    for name, times in {
        "t": pandas.to_datetime("2026-03-01") + pandas.to_timedelta(T, unit="s"),
        "time": pandas.to_datetime("2026-03-01T00:00Z") + pandas.to_timedelta(T, unit="s"),
        "timestamp": pandas.to_timedelta(T, unit="s"),
    }.items():
        table.set_index(pandas.Index(times, name=name)).to_parquet("table.parquet")
        check(read("table.parquet", "--guess"))


STRUCTURES = {
    "nested": {"log": {"time": T, "joint": {"position": Q, "current": I}}},
    "one per joint": {
        "axis": np.array([(T, Q[:, 0], I[:, 0]), (T, Q[:, 1], I[:, 1])], [("t", "O"), ("q", "O"), ("i", "O")])
    },
    "one per sample": {
        "log": np.array([*zip(T, np.tile(Q, 1), I)] * 1, [("t", "O"), ("q", "O"), ("i", "O")]),
    },
    "Simulink": {
        "out": {
            name: {"time": T, "signals": {"values": values, "dimensions": 2.0, "label": name}}
            for name, values in {"q": Q, "i": I}.items()
        }
    },
}


@pytest.mark.parametrize("kind", STRUCTURES)
def test_structures_of_matlab(kind: str) -> None:
    count = 3 if kind == "one per sample" else 1  # more than there may be joints
    t, q, i = (np.tile(one, (count, 1)) for one in (T[:, None], Q, I))
    t[:, 0] += np.repeat(np.arange(count), len(T))
    content = STRUCTURES[kind]
    if count > 1:
        content = {"log": np.array([*zip(t[:, 0], q, i)], [("t", "O"), ("q", "O"), ("i", "O")])}
    savemat("table.mat", content)
    run = read("table.mat", "--guess")
    np.testing.assert_allclose(run.t, t[:, 0], atol=1e-12)
    np.testing.assert_array_equal(run.q, q)
    np.testing.assert_array_equal(run.i, i)


@pytest.mark.parametrize(
    ("make", "why"),
    [
        (lambda path: path.write_bytes(gzip.compress(TABLE.encode())), "is packed by gzip; unpack it"),
        (lambda path: zipfile.ZipFile(path, "w").writestr("a", "b"), "is an Excel workbook or a ZIP file; unpack it"),
        (lambda path: path.write_bytes(bytes(range(256)) * 9), "is no text; expected a table as CSV"),
        (
            lambda path: path.write_bytes(TABLE.encode("utf-16-le")),
            "UTF-16 without a byte order mark; save it in UTF-8",
        ),
        (lambda path: path.write_text(TABLE.replace(",0.1", ",NA", 1)), "'NA[0-9]*' is no number; a missing sample is"),
        (
            lambda path: path.write_text(instants(at()).replace("T23:59:59.005", "x")),
            "line 3, column t: '2026-03-01x[0-9]*' is no date and time",
        ),
        (lambda path: path.write_text(instants(at()).replace("2026-03-01", "2026-13-01")), "column t: Month out of"),
    ],
)
def test_what_is_no_table_is_said(make: Callable[[Path], object], why: str, capfd: pytest.CaptureFixture[str]) -> None:
    make(Path("table.csv"))
    assert run(["import", "table.csv", "--out", "run.mcap"]) == 2
    said = capfd.readouterr().err
    assert said.startswith("error: table.csv: ") and said.count("\n") == 1
    assert re.search(why, said), said
    assert not Path("run.mcap").exists()


def of_plotjuggler(order: list[int], joints: list[str]) -> str:
    """A JointState with a gripper beside the arm, and demands of another topic, as PlotJuggler exports them."""
    columns = {"__time": 1772409599.5 + T, "/joint_states/header/stamp": T}
    for j in order:
        name = f"/joint_states/{joints[j]}/"
        columns |= {f"{name}effort": I[:, j], f"{name}position": Q[:, j], f"{name}velocity": 0 * T}
    columns |= {"/joint_states/finger/position": 0 * T}
    columns |= {f"/arm/joint_demands/{joints[j]}/position": Q[:, j] + 0.1 for j in order}
    rows = [",".join(columns), *(",".join(f"{value:.17g}" for value in row) for row in zip(*columns.values()))]
    return "\n".join(rows) + "\n"


def test_columns_of_plotjuggler_have_topics_and_names_of_joints(root: Path) -> None:
    """In the order of the model's joints, not of the alphabet; the finger has no effort, and is none of the arm's."""
    Path("table.csv").write_text(of_plotjuggler([1, 0], ["shoulder", "elbow"]))
    own = root / "examples/own_arm/arm.urdf"
    first, second = (joint.name for joint in read_model(own).joints)
    Path("arm.urdf").write_text(own.read_text().replace(f'"{first}"', '"shoulder"').replace(f'"{second}"', '"elbow"'))
    run = read("table.csv", "--model", "arm.urdf", "--guess")
    np.testing.assert_allclose(run.t, T, atol=1e-6)  # ten digits of the seconds since 1970
    np.testing.assert_array_equal(run.q, Q)
    np.testing.assert_array_equal(run.i, I)
    np.testing.assert_allclose(run.qref, Q + 0.1)


def test_commanded_positions_beside_actual_ones_are_the_demands() -> None:
    """Of a drive's trace, whose columns have the axis first and the word last."""
    names = [f"Axis {j} {word}" for word in ("Actual Position", "Motor Current", "Commanded Position") for j in (1, 2)]
    rows = np.column_stack([1e3 * T, Q, I, Q + 0.1])
    lines = [",".join(f"{value:.17g}" for value in row) for row in rows]
    Path("table.csv").write_text("\n".join([",".join(["Time [ms]", *names]), *lines]) + "\n")
    run = read("table.csv", "--guess")
    check(run)
    np.testing.assert_allclose(run.qref, Q + 0.1)
