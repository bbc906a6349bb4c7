"""Charts as data: no peak is lost, numbers survive their encoding, and paper shows what the page does."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from arm_report import Chart, Panel, Series, Zone, figure, write_report
from arm_report.envelope import POINTS, envelope, extremes, rows_per_bucket
from arm_report.palette import AFTER, BEFORE
from arm_report.plain import Arrays, page_data, plain_page
from tests.arm_report.test_page import report

VALUES = st.lists(st.one_of(st.floats(-1e6, 1e6), st.just(float("nan"))), min_size=1, max_size=300)


def decoded(stored: dict[str, Any]) -> np.ndarray:
    """An independent reading of what the scripts read."""
    if "f32" in stored:
        return stored["first"] + np.frombuffer(base64.b64decode(stored["f32"]), "<f4").astype(float)
    raw = np.frombuffer(base64.b64decode(stored["u16"]), "<u2").astype(float)
    return np.where(raw == 65535, np.nan, stored["low"] + raw * stored["step"])


@given(VALUES, st.integers(1, 50))
def test_the_lowest_and_the_highest_of_every_bucket_are_kept(values: list[float], every: int) -> None:
    y = np.array(values)
    rows, drawn = envelope(y, every)
    assert len(rows) == len(drawn) and (np.diff(rows) >= 0).all()
    np.testing.assert_array_equal(y[extremes(y, every)], drawn)
    for k, start in enumerate(range(0, len(y), every)):
        bucket, kept = y[start : start + every], drawn[2 * k : 2 * k + 2] if every > 1 else drawn[k : k + 1]
        if np.isnan(bucket).all():
            assert np.isnan(kept).all()
        else:
            assert (np.nanmin(kept), np.nanmax(kept)) == (np.nanmin(bucket), np.nanmax(bucket))
            assert not np.isnan(kept).any() or every == 1


@given(st.integers(1, 10**7))
def test_no_series_has_more_points_than_a_page_can_take(rows: int) -> None:
    every = rows_per_bucket(rows)
    assert rows <= POINTS or -(-rows // every) * 2 <= POINTS + 2
    assert (every == 1) == (rows <= POINTS)


@given(VALUES, st.booleans())
def test_numbers_survive_their_encoding(values: list[float], exact: bool) -> None:
    y, arrays = np.array(values), Arrays()
    assert arrays.put(y, exact=exact) == arrays.put(y.copy(), exact=exact) == 0
    read = decoded(arrays.stored[0])
    known = np.isfinite(y)
    np.testing.assert_array_equal(np.isfinite(read), known)
    if known.any():
        span = np.ptp(y[known])
        assert np.abs(read[known] - y[known]).max() <= (2e-7 if exact else 1 / 65534) * (span + 1e-9)


@pytest.fixture(scope="module")
def long() -> Chart:
    """Six joints for 20 minutes at 1 kHz, with one row that stands out."""
    t = np.arange(1_200_000) / 1000.0
    y = np.sin(t) + 0.1 * np.random.default_rng(1).standard_normal(len(t))
    y[777_777] = 50.0
    panels = tuple(
        Panel(
            series=(
                Series(x=t, y=joint * y, colour=BEFORE, label="before"),
                Series(x=t, y=-y, colour=AFTER, label="after"),
            ),
            x="time, s",
            y="current, A",
            zones=(Zone(low=-1.0, high=1.0),),
            joint=joint,
        )
        for joint in range(1, 7)
    )
    return Chart(name="long", title="six joints", panels=panels, shared=True, height=1.5)


def test_twenty_minutes_of_six_joints_are_small_and_keep_their_peak(long: Chart) -> None:
    table = plain_page([long], None, [])
    y = decoded(table["arrays"][table["charts"][0]["panels"][0]["series"][0]["y"]])
    assert len(y) <= POINTS + 2 and y.max() == pytest.approx(50.0, rel=1e-4)
    assert rows_per_bucket(1_200_000) == 1200


def test_a_page_of_many_charts_stays_small(long: Chart, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("arm_report.plain.MOST_DATA", 30_000)
    monkeypatch.setattr("arm_report.stills.MOST_STILLS", 30_000)
    text, points = page_data([long], None, [])
    assert len(text) <= 30_000 and 200 <= points < POINTS
    table = json.loads(text)
    assert decoded(table["arrays"][table["charts"][0]["panels"][0]["series"][0]["y"]]).max() == pytest.approx(
        50.0, rel=1e-4
    )
    html = report("long", long).html()
    assert len(html) < 200_000 and f"of every {rows_per_bucket(1_200_000, points)} rows" in html


def test_charts_are_written_as_pictures_and_the_json_last(tmp_path: Path) -> None:
    x = np.array([1.0, 2.0, 3.0])
    series = (
        Series(x=x, y=x, two_std=0.1 * x, kind="both", colour=AFTER, label="a"),
        Series(x=x, y=x, two_std=x, colour=BEFORE, label="b"),
    )
    bars = Series(x=np.array([30.0, -2.0]), y=np.array([0.0, 1.0]), kind="bars", colour=AFTER)
    panels = (
        Panel(series=series, x="speed, rad/s", y="friction, N m", log_x=True),
        Panel(series=(bars,), x="change", y="", names=("one", "two"), linear=5.0),
    )
    chart = Chart(name="both", title="both", panels=panels)
    made = write_report(tmp_path / "out", ("report.html", "a.json"), report("x", chart), {"a": 1}, ("png", "pdf"))
    assert made == {"a": 1}
    names = sorted(str(path.relative_to(tmp_path / "out")) for path in (tmp_path / "out").rglob("*.*"))
    assert names == ["a.json", "pictures/both.pdf", "pictures/both.png", "report.html"]
    assert (tmp_path / "out/pictures/both.pdf").read_bytes().startswith(b"%PDF")
    drawn = figure(chart)
    assert [axis.get_xlabel() for axis in drawn.axes] == ["speed, rad/s", "change"]
    ticks = [one.get_text() for axis in drawn.axes for one in axis.get_xticklabels()]
    assert {"0", "5", "10"} <= set(ticks) and not any("$" in text for text in ticks)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("value", [1e-4, 3e-4, 0.0])
def test_equal_values_on_a_logarithmic_axis_have_limits_about_them(value: float) -> None:
    """Of a power of ten, matplotlib made both limits the same, and warned of it; of zeros, it has none."""
    series = Series(x=np.arange(5.0), y=np.full(5, value), colour="#000000", kind="dots")
    (axis,) = figure(Chart(name="a", title="a", panels=(Panel(series=(series,), x="row", y="mm", log_y=True),))).axes
    low, high = axis.get_ylim()
    assert low < high and (value == 0.0 or low < value < high)
