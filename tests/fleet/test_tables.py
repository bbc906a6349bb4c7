"""Parquet as other programs read it, and the pages of a fleet, from records written by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from arm_fleet.fleet import Fleet, arm_file
from arm_fleet.judging.alarms import alarms
from arm_fleet.judging.verdicts import verdict_of
from arm_fleet.report.tables import write_tables
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
    write_tables(tmp_path, records, {"k1": {"p": 0.5, "p_corrected": 1.0, "named": False}})
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
    write_tables(tmp_path, [], {})
    parquet = pytest.importorskip("pyarrow.parquet")
    assert parquet.read_table(tmp_path / "causes.parquet").num_rows == 0


def test_the_pages(tmp_path: Path) -> None:
    """An arm with a gap from one night on; one night without a result; names are escaped."""
    nights = fleet(3, 3, gap={1: lambda night: 8e-4 if night >= 7 else None})
    wanted = plan(3)
    found = alarms(wanted, nights)
    records = [record(arm, one.night, one.key) for arm, its in nights.items() for one in its]
    records[3] |= FAILED
    records[-1]["files"] = {"diagnosed/report.html": 1}
    own = {arm: [one for one in records if one["arm"] == arm] for arm in nights}
    verdicts = [
        verdict_of(wanted, arm, nights[arm], [one for one in found if one.arm == arm], own[arm]) for arm in nights
    ]
    result = Fleet(plan=wanted, folder=tmp_path, records=records, nights=nights, alarms=found, verdicts=verdicts)
    table = result.write()
    assert table["changed"] == ["arm-1"] and table["failed"] == 1 and table["named_nights"] >= 5
    page = (tmp_path / "fleet.html").read_text()
    assert "1 of 3 arms are changed" in page and "backlash of joint 1" in page
    assert "took &lt;longer&gt;" in page and "took <longer>" not in page
    assert f'href="{arm_file("arm-1")}"' in page
    own_page = (tmp_path / arm_file("arm-1")).read_text()
    assert "step of" in own_page and "Half gap of backlash of joint 1" in own_page
    assert "no result: arm-0 2026-01-04: timeout: took <longer>" in str(result)
