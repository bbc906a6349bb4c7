"""Parquet as other programs read it, and the pages of a fleet, from records written by hand."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from arm_fleet import ArmTasks, fleet_of
from arm_fleet import fleet as judged_fleet
from arm_fleet.judging.alarms import Alarm, Night
from arm_fleet.report.arm import arm_file
from arm_fleet.report.tables import tables_in, tables_of
from arm_model import Arm, read_model
from comparison import Stored
from tests.fleet.test_alarms import fleet, plan


def record(arm: str, night: str, key: str, **more: Any) -> dict[str, Any]:
    parameter = {"value": 4e-4, "std": 5e-5, "unit": "rad"}
    cause = {"effect": "backlash", "joint": 1, "parameters": {"half_gap": parameter}, "confidence": 0.96}
    value = {
        "verdict": "explained",
        "rows": 100,
        "lost": 0,
        "bytes": 5000,
        "relative_error": {"fit": 0.01, "held_out": 0.02},
        "causes": [cause | {"group": [{"effect": "backlash", "joint": 1}], "evidence": "", "origins": []}],
        "parameters": [{"name": "joint1.coulomb", "value": 5.0, "std": 0.1, "unit": "N m", "identifiable": True}],
    }
    table = {"arm": arm, "night": night, "key": key, "state": "done", "reason": "", "value": value, "seconds": 1.5}
    return table | {"cpu_seconds": 1.0, "peak_bytes": 2 * 10**8, "worker": "w", "code": "c", "files": {}} | more


FAILED = {"state": "timeout", "reason": "took <longer>", "value": {}}


def test_other_programs_read_the_tables(tmp_path: Path) -> None:
    records = [record("a1", "2026-01-01", "k1"), record("a1", "2026-01-02", "k2", **FAILED)]
    records.append(record("a1", "", "k0"))
    alarm = Alarm(arm="a1", night="2026-01-01", key="k1", p=0.5)
    with tables_in(tmp_path) as append:
        for one in records:
            append(tables_of([one], {"k1": alarm}))
    polars = pytest.importorskip("polars")
    tasks = polars.read_parquet(tmp_path / "tasks.parquet")
    assert tasks["state"].to_list() == ["done", "timeout", "done"] and tasks["named"].to_list() == [False, None, None]
    pandas = pytest.importorskip("pandas")
    parameters = pandas.read_parquet(tmp_path / "parameters.parquet")
    assert parameters[["arm", "parameter", "value"]].to_numpy().tolist() == [["a1", "joint1.coulomb", 5.0]]
    duckdb = pytest.importorskip("duckdb")
    query = f"SELECT arm, effect, value, night FROM '{tmp_path}/causes.parquet' WHERE night >= DATE '2026-01-01'"
    ((arm, effect, value, night),) = duckdb.sql(query).fetchall()
    assert (arm, effect, value, night.isoformat()) == ("a1", "backlash", 4e-4, "2026-01-01")


def test_an_empty_fleet_has_tables_too(tmp_path: Path) -> None:
    with tables_in(tmp_path):
        pass
    parquet = pytest.importorskip("pyarrow.parquet")
    assert parquet.read_table(tmp_path / "causes.parquet").num_rows == 0


def test_tables_are_written_by_row_groups(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """However many rows, few are held; what fails leaves nothing."""
    monkeypatch.setattr("arm_fleet.report.tables.GROUP", 4)
    parquet = pytest.importorskip("pyarrow.parquet")
    with tables_in(tmp_path) as append:
        for k in range(10):
            append(tables_of([record("a", "2026-01-01", f"{k}")], {}))
    read = parquet.ParquetFile(tmp_path / "tasks.parquet")
    assert [read.metadata.row_group(k).num_rows for k in range(read.num_row_groups)] == [4, 4, 2]
    assert read.read()["key"].to_pylist() == [f"{k}" for k in range(10)]
    (tmp_path / "new").mkdir()
    with pytest.raises(KeyboardInterrupt), tables_in(tmp_path / "new"):
        raise KeyboardInterrupt
    assert not list((tmp_path / "new").iterdir())


def stored(folder: Path, nights: dict[str, list[Night]], arm: Arm, **more: dict[str, Any]) -> list[ArmTasks]:
    """Results on the disk as tasks leave them; ``more``: key -> what its record has otherwise."""
    parts = []
    for name, its in nights.items():
        for night in its:
            place = folder / "results" / night.key
            place.mkdir(parents=True)
            for result in night.results:
                (place / _name(result)).write_text(json.dumps(result.table))
            files = {path.name: path.stat().st_size for path in place.iterdir()}
            table = record(name, night.night, night.key, files=files, **more.get(night.key, {}))
            (place / "record.json").write_text(json.dumps({"schema": "armscope.fleet.record/1", **table}))
        parts.append(ArmTasks(arm=name, model=arm, keys=tuple(one.key for one in its)))
    return parts


def _name(result: Stored) -> str:
    return {"identifications": "identification.json", "diagnoses": "diagnosis.json"}[result.what]


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_the_pages(tmp_path: Path, root: Path, monkeypatch: pytest.MonkeyPatch, workers: int) -> None:
    """An arm with a gap from one night on; one night without a result; names are escaped; on one process or several."""
    monkeypatch.setattr(judged_fleet, "MANY", 10)
    nights = fleet(3, 3, gap={1: lambda night: 8e-4 if night >= 7 else None})
    failed = nights["arm-0"][3].key
    parts = stored(tmp_path, nights, read_model(root / "config/models/two_link.toml"), **{failed: FAILED})
    result = fleet_of(plan(3), tmp_path, parts, workers=workers)
    table = json.loads((tmp_path / "fleet.json").read_text())
    assert table == json.loads(json.dumps(result.to_json(), default=float))
    assert table["changed"] == ["arm-1"] and table["failed"] == 1 and table["named_nights"] >= 5
    assert [one["nights"] for one in table["arms"]] == [13, 14, 14]
    page = (tmp_path / "fleet.html").read_text()
    assert "1 of 3 arms is changed" in page and "backlash of joint 1" in page
    assert "took &lt;longer&gt;" in page and "took <longer>" not in page
    assert f'href="{arm_file("arm-1")}"' in page
    own_page = (tmp_path / arm_file("arm-1")).read_text()
    assert "step of" in own_page and "Half gap of backlash of joint 1" in own_page
    assert "no result: arm-0 2026-01-04: timeout: took <longer>" in str(result)
    polars = pytest.importorskip("polars")
    assert polars.read_parquet(tmp_path / "tasks.parquet")["named"].sum() == table["named_nights"]


def test_what_results_lack_is_said(tmp_path: Path, root: Path) -> None:
    """A limit of no quantity, arms without reference nights, an arm that stopped recording."""
    nights = fleet(2, 3, count=6)
    parts = stored(tmp_path, nights | {"arm-1": nights["arm-1"][:2]}, read_model(root / "config/models/two_link.toml"))
    result = fleet_of(plan(2, limits={"joint9.nothing": 1.0, "joint1.coulomb": "+50%"}), tmp_path, parts)
    assert [note.partition(":")[0] for note in result.notes] == [
        "arm-1 cannot be compared",
        "no recording, although the latest of the fleet is of 2026-01-06",
        "limits",
    ]
    assert "arm-1 (since 2026-01-02)" in result.notes[1]
    assert "joint9.nothing is no quantity of any arm; there are joint1.coulomb, joint2.coulomb" in result.notes[2]
    assert "1 cannot be compared." in str(result)
    assert "joint9.nothing is no quantity" in (tmp_path / "fleet.html").read_text()
    elsewhere = fleet_of(plan(2, baseline=["2027-01-01", "2027-01-05"]), tmp_path, parts)
    assert "arm-0, arm-1 cannot be compared: that needs results of at least 2 nights of the baseline" in str(elsewhere)


def test_limits_that_are_not_kept_are_said(tmp_path: Path, root: Path) -> None:
    """A limit whose side is not clear, and a share of a gap that was zero: neither asks for maintenance."""
    nights = fleet(2, 3, shift={1: lambda night: 3.0 * night}, gap={0: lambda night: 8e-4 if night >= 4 else None})
    parts = stored(tmp_path, nights, read_model(root / "config/models/two_link.toml"))
    limits = {"joint1.coulomb": 1.0, "joint1.backlash.half_gap": "+50%", "joint2.coulomb": "..1"}
    result = fleet_of(plan(2, limits=limits), tmp_path, parts)
    assert result.notes[0] == (
        "limits: joint1.coulomb = 1.0 is not above the first value of arm-0, arm-1: write '..1.0' if it is an upper "
        "limit, '1.0..' if it is a lower one"
    )
    assert result.notes[1].endswith("first value of arm-0 does not differ from zero; give an absolute limit")
    for verdict in result.verdicts:
        (asked,) = [one for one in verdict.actions if "limit" in one]
        assert "joint 2: upper limit 1 N m is passed since the first result" in asked and asked.endswith("now")
        assert verdict.arm != "arm-1" or any("write joint1.coulomb=..1)" in one for one in verdict.moved)
