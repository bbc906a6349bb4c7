"""The index of 1000 recordings and 200 results: making it, bringing it up to date, asking it.

The recordings are copies of one of 2000 rows, six joints at 1 kHz with raw rows (some 0.4 MB each); the results hold 60
parameters. "opened" is what a person waits for: every file looked at for changes, the index read, all rows returned;
``json`` is the same for the simplest alternative, one JSON file read and filtered.

Run as ``python -m benchmarks.archive [--json]``.
"""

from __future__ import annotations

import json
import os
import shutil
import tempfile
import time
from pathlib import Path

from arm_archive import INDEX, Filters, open_archive
from benchmarks.mcap_io import make_rows, write_ours
from benchmarks.report import report

RECORDINGS, RESULTS, PARAMETERS = 1000, 200, 60
ROUNDS = 5


def make_lab(folder: Path) -> None:
    """A folder per ten recordings, and the results."""
    first = folder / "first.mcap"
    write_ours(first, make_rows(2000))
    for number in range(RECORDINGS - 1):
        place = folder / f"day{number // 10}"
        place.mkdir(exist_ok=True)
        shutil.copy(first, place / f"run{number}.mcap")
    for number in range(RESULTS):
        place = folder / f"result{number}"
        place.mkdir()
        values = [
            {"name": f"p{k}", "expression": f"p{k}", "value": 1.0, "std": 0.1, "unit": "", "identifiable": True}
            for k in range(PARAMETERS)
        ]
        table = {
            "schema": "armscope.identification/1",
            "method": "wls",
            "parameters": values,
            "base_parameters": values,
            "relative_error": {"fit": 0.01, "held_out": 0.01},
        }
        (place / "identification.json").write_text(json.dumps(table))
        (place / "model.toml").write_text('name = "Puma 560"\n')
    for path in folder.rglob("*.*"):
        os.utime(path, (1.7e9, 1.7e9))


def seconds(folder: Path) -> tuple[float, int, int]:
    """s to open the archive and take all rows; files read, entries."""
    began = time.perf_counter()
    with open_archive(folder) as archive:
        rows = archive.rows()
    return time.perf_counter() - began, archive.update.read, len(rows)


def main() -> None:
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        make_lab(folder)
        made, read, entries = seconds(folder)
        assert read == entries == RECORDINGS + RESULTS
        opened = min(seconds(folder)[0] for _ in range(ROUNDS))
        os.utime(folder / "first.mcap")
        updated, read, _ = seconds(folder)
        assert read == 1
        with open_archive(folder) as archive:
            began = time.perf_counter()
            found = archive.rows(Filters(arm="puma560", since="2023", kind="identification"))
            asked = time.perf_counter() - began
            began = time.perf_counter()
            assert len(archive.history("p7")) == len(found) == RESULTS
            history = time.perf_counter() - began
            everything = folder / "all.json"
            tables = [row | {"parameters": archive.parameters(row["path"])} for row in archive.rows()]
            everything.write_text(json.dumps(tables))
            began = time.perf_counter()
            json.loads(everything.read_text())
            as_json = time.perf_counter() - began
        report(
            {
                "made_s": made,
                "made_MB_per_s": RECORDINGS * (folder / "first.mcap").stat().st_size / made / 1e6,
                "opened_s": opened,
                "one_changed_s": updated,
                "filtered_s": asked,
                "history_s": history,
                "json_read_s": as_json,
                "index_MB": (folder / INDEX).stat().st_size / 1e6,
                "json_MB": everything.stat().st_size / 1e6,
            }
        )


if __name__ == "__main__":
    main()
