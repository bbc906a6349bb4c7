"""``armscope archive`` as a person and a script use it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from armscope.cli import run
from tests.arm_archive.lab import identification, record


@pytest.fixture
def lab(tmp_path: Path) -> Path:
    for month in (1, 2):
        record(tmp_path / f"{month}/{'long_' * 5}experiment_name.mcap", day=31.0 * month, lost=month - 1)
        values = {"joint1.coulomb": (5.0 + month, 0.1)}
        identification(tmp_path / f"{month}/identified", values, recorded=f"2026-0{month}-01T00:00:00Z")
    return tmp_path


def call(capsys: pytest.CaptureFixture[str], *arguments: object, status: int = 0) -> str:
    assert run(["archive", *map(str, arguments)]) == status
    shown = capsys.readouterr()
    return shown.out if status == 0 else shown.err


def test_the_table(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = call(capsys, lab).splitlines()
    assert lines[0].split() == ["date", "(UTC)", "arm", "experiment", "rows", "lost", "error", "result", "path"]
    assert lines[1].split()[-4:] == ["1.25", "%", "wls", "1/identified/identification.json"]
    assert [line.split()[:2] for line in lines[1:5]] == [
        ["2026-01-01", "00:00"],
        ["2026-02-01", "00:00"],
        ["2026-02-01", "00:00"],
        ["2026-03-04", "00:00"],
    ]
    assert lines[-1] == "4 of 4 entries; 1 with lost rows, 0 with notes"
    assert " 400 " in lines[2]


def test_json_is_what_the_function_returns(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = json.loads(call(capsys, lab, "--json", "--arm", "puma560", "--since", "2026-03", "--lost", "1"))
    assert [(row["rows"], row["lost"], row["date"]) for row in rows] == [(400, 1, "2026-03-04T00:00:00Z")]
    assert json.loads(call(capsys, lab, "parameters", "--json")) == [
        {"name": "joint1.coulomb", "unit": "N m", "results": 2}
    ]


def test_a_parameter_over_months(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = lab / "history.png"
    shown = call(capsys, lab, "plot", "joint1.coulomb", "--out", out)
    assert [line.split()[2:4] for line in shown.splitlines()[1:3]] == [["6.00", "0.20"], ["7.00", "0.20"]]
    assert out.read_bytes()[:4] == b"\x89PNG"
    later = json.loads(call(capsys, lab, "plot", "joint1.coulomb", "--since", "2026-02", "--json"))
    assert [row["value"] for row in later] == [7.0]
    assert "results here have joint1.coulomb" in call(capsys, lab, "plot", "coulomb", status=2)


def test_compare_and_open(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for model in lab.rglob("model.toml"):
        model.unlink()
    changed = json.loads(call(capsys, lab, "compare", "1/identified", "2/identified", "--json"))
    assert [one["change"] for one in changed["changes"]] == [1.0]
    shown = json.loads(call(capsys, lab, "open", "2/identified", "--json"))
    assert shown["reports"] == [str(lab / "2/identified/report.html")]
    assert shown["parameters"][0]["value"] == 7.0
    assert "may be any of" in call(capsys, lab, "open", "identified", status=2)
    assert "is nothing in" in call(capsys, lab, "open", "nowhere", status=2)


@pytest.mark.parametrize(
    "arguments",
    [["DIR", "plot"], ["DIR", "list", "x"], ["DIR/none"], ["DIR", "dance"], ["DIR", "plot", "x", "--out", "a.txt"]],
)
def test_wrong_use_is_one_line(lab: Path, arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    error = call(capsys, *(one.replace("DIR", str(lab)) for one in arguments), status=2)
    assert error.startswith("error: ") and error.count("\n") == 1
