"""A recording as tables of pandas and xarray, and as it shows itself: the same numbers, with units and names."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from daq.recording import open_recording, write_csv
from tests.arm_archive.lab import record

pandas = pytest.importorskip("pandas")
pytest.importorskip("xarray")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory):
    rig = 'name = "cell 4"\n[[joint]]\nname = "j1"\n[[joint]]\nname = "j2"\ntype = "prismatic"\n'
    return open_recording(record(tmp_path_factory.mktemp("run") / "run.mcap", lost=5, rig=rig))


def test_pandas_has_the_columns_of_the_export(run, tmp_path: Path) -> None:
    frame = run.to_pandas()
    write_csv(tmp_path / "run.csv", run)
    again = pandas.read_csv(tmp_path / "run.csv", index_col="t")
    assert list(frame.columns) == list(again.columns) and frame.index.name == "t"
    assert np.array_equal(frame.to_numpy(), again.to_numpy()) and np.array_equal(frame.index, again.index)
    assert frame.attrs["units"] == {"q1": "rad", "q2": "m", "i1": "A", "i2": "A"}
    assert frame.attrs["rows_lost"] == 5 and frame.attrs["rig"] == "cell 4"


def test_xarray_has_joints_and_units(run) -> None:
    data = run.to_xarray()
    assert list(data.joint.values) == ["j1", "j2"]
    assert np.array_equal(data.q.sel(joint="j2").values, run.q[:, 1])
    assert np.array_equal(data.t.values, run.t) and data.t.attrs["units"] == "s"
    assert data.q.attrs["units"] == "rad or m" and data.i.attrs["units"] == "A"
    assert str(data.date.values[0])[:19] == "2026-01-01T00:00:00"
    assert "qref" not in data and data.attrs["rows_lost"] == 5
    assert all(isinstance(value, str | int) for value in data.attrs.values())


def test_it_shows_rows_losses_and_a_picture(run) -> None:
    page = run._repr_html_()
    assert "400 of 2 joints" in page and "405 triggers = 400 recorded + 5 lost" in page
    assert "5 of 405 rows are missing" in page and page.count("<img") == 1
    assert len(page) < 100_000 and not re.search(r"<(html|body|style)", page)


def test_an_empty_recording_shows_itself(tmp_path: Path) -> None:
    empty = open_recording(record(tmp_path / "empty.mcap", rows=0))
    assert "0 of 2 joints" in empty._repr_html_() and empty.to_pandas().empty


def test_without_pandas_one_sentence_says_what_to_install(run, monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    from arm_io import InputError

    for name in ("pandas", "xarray"):
        monkeypatch.setitem(sys.modules, name, None)
        with pytest.raises(InputError, match=r"pip install 'armscope\[notebook\]'"):
            getattr(run, f"to_{name}")()
