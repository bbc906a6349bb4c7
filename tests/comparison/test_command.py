"""``armscope compare``: what it prints and writes, its exit status, and every bad input in one line."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

import armscope
from arm_model.model_file import write_model
from armscope.cli import run
from daq.recording import Attachments, write_table
from tests.comparison.second_day import LEVELS, puma, record
from tests.comparison.test_results import FIRST, diagnosis, identification


@pytest.fixture(scope="module")
def folder(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Recordings of two joints: first.mcap, again.mcap, worn.mcap (+50 % at joint 2); model.toml; results."""
    folder, arm = tmp_path_factory.mktemp("compare"), puma(root, 2)
    short = {"seconds": 14.0, "rate": 125.0}
    for noise, name in enumerate(("first", "again", "worn")):
        record(
            folder / f"{name}.mcap", arm, noise, levels=(LEVELS[0], LEVELS[1] * (1.5 if noise == 2 else 1.0)), **short
        )
    write_model(folder / "model.toml", arm)
    identification(folder / "identified", FIRST)
    diagnosis(folder / "diagnosed", [("backlash", 2, {"half_gap": (0.001, 4e-5)})])
    off = 'name = "off"\nstart = [0.0, 0.0]\nfull_speed = [1.0, 1.0]\nfull_acceleration = [1.0, 1.0]\n'
    off += 'setup = { drives_off = true }\nsegment = [{ type = "hold", duration = 1.0 }]\n'
    record(folder / "off.mcap", arm, 5, experiment=off, **short)
    whole = (folder / "first.mcap").read_bytes()
    (folder / "recovered.mcap.active").write_bytes(whole[: len(whole) * 3 // 4])
    assert run(["recover", str(folder / "recovered.mcap.active")]) == 0  # all its rows were on the disk
    (folder / "empty").mkdir()
    (folder / "text.json").write_text("{")
    (folder / "other.json").write_text('{"schema": "armscope.info/1"}')
    (folder / "bare.json").write_text('{"schema": "armscope.identification/1"}')
    return folder


def test_report_and_exit_status(folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    pair = [str(folder / "first.mcap"), str(folder / "worn.mcap"), "--model", str(folder / "model.toml")]
    assert run(["compare", *pair, "--out", str(tmp_path / "out"), "--fail-above", "10%", "--pdf"]) == 5
    captured = capfd.readouterr()
    line = "Coulomb friction of joint 2: "
    assert line in captured.out and "%" in captured.out.split(line)[1].splitlines()[0]
    said = r"changed beyond --fail-above 10%: joint2\.coulomb(; \d+ points? of friction curves)?\n"
    assert re.fullmatch(said, captured.err)
    table_ahead = captured.out.partition("quantity ")[2].partition("\n*: significant")[0]
    rows = [re.split(r"\s{2,}", row) for row in table_ahead.splitlines()[1:]]
    assert len(rows) > 5
    for _, before, after, change, two_std, *_ in rows:
        steps = [10.0 ** -len(value.partition(".")[2]) for value in (before, after, change)]
        assert all(float(two_std) / 1001 < step < float(two_std) for step in steps), (before, two_std)
    table = json.loads((tmp_path / "out/compare.json").read_text())
    assert table["schema"] == "armscope.comparison/1" and table["changed"]
    assert {c["name"] for c in table["changes"] if c["significant"] and c["kind"] != "curve"} == {"joint2.coulomb"}
    page = (tmp_path / "out/compare.html").read_text()
    assert "ranks the likely physical origins" in " ".join(page.split())
    assert page.count(line) == 1 and page.count('wide still"><svg') == 2
    assert "http" not in page.replace("http-equiv", "")
    assert " \N{PLUS-MINUS SIGN} " in page.split(line)[1][:60] and "\N{RIGHTWARDS ARROW}" in page.split(line)[1][:30]
    assert {path.name for path in (tmp_path / "out/pictures").iterdir()} == {"changes.pdf", "friction_curves.pdf"}
    # Beyond 60 % or 500 deviations nothing changed; between days on which nothing did, nothing is beyond 0.
    for limit, status in (("60%", 0), ("500", 0), ("5", 5)):
        assert run(["compare", *pair, "--fail-above", limit]) == status
    capfd.readouterr()
    pair[1] = str(folder / "again.mcap")
    assert run(["compare", *pair, "--fail-above", "0", "--json"]) == 0
    captured = capfd.readouterr()
    assert json.loads(captured.out)["changed"] is False and captured.err == ""


def test_groups_on_the_command_line(folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    days = tmp_path / "days"
    days.mkdir()
    for name in ("first", "again"):
        shutil.copy(folder / f"{name}.mcap", days)
    worn, model = str(folder / "worn.mcap"), str(folder / "model.toml")
    found = []
    for sides in (
        ["--before", str(folder / "first.mcap"), str(folder / "again.mcap"), "--after", worn],
        [f"{folder / 'first.mcap'},{folder / 'again.mcap'}", worn],
        [str(days), worn],
    ):
        assert run(["compare", *sides, "--model", model, "--json"]) == 0
        table = json.loads(capfd.readouterr().out)
        assert len(table["before"]) == 2 and len(table["after"]) == 1
        found.append(sorted(table["changes"], key=lambda one: one["name"]))
    assert [c["change"] for c in found[0]] == pytest.approx([c["change"] for c in found[1]], nan_ok=True)
    assert [c["name"] for c in found[2]] == [c["name"] for c in found[0]]


def test_a_table_is_compared_like_the_recording(folder: Path, tmp_path: Path) -> None:
    for name in ("first", "worn"):
        assert run(["export", str(folder / f"{name}.mcap"), "--out", str(tmp_path / f"{name}.csv")]) == 0
    model = folder / "model.toml"
    tables = armscope.compare(tmp_path / "first.csv", tmp_path / "worn.csv", model)
    recordings = armscope.compare(armscope.open(folder / "first.mcap"), str(folder / "worn.mcap"), model)
    assert tables.before == (str(tmp_path / "first.csv"),)
    for one, other in zip(tables.changes, recordings.changes):
        assert one.quantity == other.quantity and one.change == pytest.approx(other.change, rel=1e-6)


def test_results_as_objects(folder: Path) -> None:
    found = [armscope.identify(folder / f"{name}.mcap", folder / "model.toml") for name in ("first", "worn")]
    assert found[0].to_json()["blocks"] >= 12
    result = armscope.compare(*found)
    assert "joint2.coulomb" in {one.quantity.name for one in result.significant}
    assert "Coulomb friction of joint 2" in repr(result)
    assert result.plot().axes


MODEL = ["--model", "model.toml"]
BAD = {
    "no sides": ([], "(given: no arguments)"),
    "one side": (["first.mcap"], "(given: 1 argument)"),
    "three sides": (["first.mcap", "again.mcap", "worn.mcap"], "(given: 3 arguments)"),
    "both ways": (["first.mcap", "again.mcap", "--before", "worn.mcap"], "(given: 2 arguments, --before)"),
    "half a group": (["--before", "first.mcap"], "(given: no arguments, --before)"),
    "absent": (["none.mcap", "again.mcap", *MODEL], "none.mcap: no such file"),
    "no model": (["first.mcap", "again.mcap"], "first.mcap contains no model"),
    "no such model": (["first.mcap", "again.mcap", "--model", "none.toml"], "none.toml: no such file"),
    "same recording": (
        ["first.mcap", "first.mcap", *MODEL],
        "100% of its rows are in first.mcap; before and after must be two recordings",
    ),
    "copy on one side": (
        ["--before", "first.mcap", "--before", "recovered.mcap", "--after", "again.mcap", *MODEL],
        "of its rows are in first.mcap, which is on the same side",
    ),
    "drives off": (["first.mcap", "off.mcap", *MODEL], "off.mcap: was recorded with the drives off"),
    "other arm": (
        ["first.mcap", "again.mcap", "--model", "config/models/puma560.toml"],
        "first.mcap: has 2 joints, the model 'Unimation Puma 560' has 6",
    ),
    "empty folder": (["empty", "first.mcap", *MODEL], "empty: holds no identification.json"),
    "mixed kinds": (["identified", "first.mcap", *MODEL], "is a result, first.mcap is a recording"),
    "mixed results": (["identified", "diagnosed"], "is one of diagnoses, identified/identification.json one of"),
    "result twice": (["identified", "identified/identification.json"], "is given twice"),
    "model for results": (["identified", "bare.json", *MODEL], "--model: is for recordings"),
    "no JSON": (["identified", "text.json"], "text.json: is no JSON"),
    "other JSON": (["identified", "other.json"], "other.json: is no result of identify or diagnose"),
    "without parameters": (["identified", "bare.json"], "bare.json: base_parameters"),
    "threshold": (["first.mcap", "again.mcap", "--fail-above", "much"], "--fail-above: must be a size"),
    "negative threshold": (["first.mcap", "again.mcap", "--fail-above=-1"], "--fail-above: must be a size"),
    "threshold without a number": (["first.mcap", "again.mcap", "--fail-above", "nan%"], "--fail-above: must be"),
    "out is a file": (
        ["first.mcap", "again.mcap", *MODEL, "--out", "model.toml"],
        "model.toml: is read here, and would be replaced",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_line(
    case: str, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    arguments, says = BAD[case]
    out = [] if "--out" in arguments else ["--out", str(tmp_path / "out")]
    assert run(["compare", *arguments, *out]) == 2
    captured = capfd.readouterr()
    errors = [line for line in captured.err.splitlines() if not line.startswith("note: ")]
    assert captured.out == "" and len(errors) == 1 and errors[0].startswith("error: ")
    assert says in errors[0]
    assert not (tmp_path / "out").exists()


def test_joints_that_all_rest(root: Path, folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    t = np.arange(1000) / 100
    still = np.random.default_rng(0).normal(0.0, 1e-3, (1000, 2))
    write_table(tmp_path / "still.mcap", t, {"q": np.ones((1000, 2)), "i": still}, Attachments())
    sides = [str(folder / "first.mcap"), str(tmp_path / "still.mcap"), "--model", str(folder / "model.toml")]
    assert run(["compare", *sides]) == 2
    assert "still.mcap: no joint moves" in capfd.readouterr().err
