"""Stills: well-formed SVG of every kind of chart, each value where its axis says, no page too large."""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from arm_report import Chart, Level, Panel, Series, Zone
from arm_report.palette import AFTER, BEFORE
from arm_report.scales import Scale, scale_of
from arm_report.stills import FINE, MOST_STILLS, still, stills

X = np.linspace(0.0, 10.0, 50)


def drawn(*panels: Panel, columns: int = 1, shared: bool = False) -> ElementTree.Element:
    return ElementTree.fromstring(
        still(Chart(name="a", title="<a> & b", panels=panels, columns=columns, shared=shared))
    )


def points(path: str) -> np.ndarray:
    """Corners of the path of one line, px from the top left corner of its axes."""
    first, _, rest = path.removeprefix("M").partition("l")
    numbers = [[float(x) for x in re.findall(r"-?\d+", part)] for part in (first, rest)]
    return np.cumsum(np.reshape(numbers[0] + numbers[1], (-1, 2)), axis=0) / FINE


def lines(root: ElementTree.Element, colour: str) -> list[ElementTree.Element]:
    return [one for one in root.iter("path") if one.get("stroke") == colour and "l" in one.get("d", "")]


def test_a_line_goes_through_its_values() -> None:
    y = np.sin(X)
    root = drawn(
        Panel(series=(Series(x=X, y=y, colour=AFTER),), x="t", y="y", x_range=(0.0, 10.0), y_range=(-2.0, 2.0))
    )
    axes = next(one for one in root.iter("svg") if one.get("x"))
    width, height = float(axes.get("width", 0)), float(axes.get("height", 0))
    (line,) = lines(root, AFTER)
    expected = np.column_stack([X / 10.0 * width, (2.0 - y) / 4.0 * height])
    np.testing.assert_allclose(points(line.get("d", "")), expected, atol=0.6 / FINE)


def test_a_gap_interrupts_a_line() -> None:
    y = np.where((X > 4.0) & (X < 6.0), np.nan, X)
    (line,) = lines(drawn(Panel(series=(Series(x=X, y=y, colour=AFTER),), x="t", y="y")), AFTER)
    assert line.get("d", "").count("M") == 2


def test_every_kind_of_panel_is_well_formed() -> None:
    band = np.full(50, 0.1)
    kinds = [
        Series(x=X, y=X, colour=AFTER, kind=kind, two_std=band, label=f"<{kind}>") for kind in ("line", "dots", "both")
    ]
    bars = Series(x=np.array([3.0, -1.0]), y=np.array([0.0, 1.0]), colour=BEFORE, kind="bars")
    many = np.linspace(-1.0, 1.0, 5000)
    panels = (
        Panel(
            series=tuple(kinds), x="a & b", y="two\nlines", title="x < y", zones=(Zone(low=1.0, high=2.0, label="z"),)
        ),
        Panel(series=(bars,), x="change", y="", names=("first & one", "second"), linear=5.0),
        Panel(series=(Series(x=X + 0.1, y=X + 0.1, colour=AFTER),), x="f, Hz", y="a", log_x=True, log_y=True),
        Panel(series=(Series(x=1.7e9 + 9e4 * X, y=X, colour=AFTER, dashed=True),), x="date", y="a", dates=True),
        Panel(series=(Series(x=many, y=many, colour=AFTER, kind="dots"),), x="x, m", y="y, m", equal=True),
        Panel(series=(), x="x", y="y", levels=(Level(value=2.0, axis="x", words="here"), Level(value=0.0))),
        Panel(series=(Series(x=X[:1], y=X[:1], colour=AFTER, kind="dots", hollow=True),), x="x", y="y"),
        Panel(series=(Series(x=X, y=np.full(50, np.nan), colour=AFTER),), x="x", y="y"),
    )
    root = drawn(*panels, columns=2)
    texts = {one.text for one in root.iter("text")}
    assert {"a & b", "two lines", "x < y", "first & one", "here", "z", "<dots>"} <= texts
    assert root.get("aria-label") == "<a> & b" and "nan" not in ElementTree.tostring(root, encoding="unicode")


def test_panels_above_each_other_share_their_axis() -> None:
    panels = [Panel(series=(Series(x=k * X, y=X, colour=AFTER),), x="t, s", y="y") for k in (1.0, 2.0)]
    root = drawn(*panels, shared=True)
    first, second = (points(one.get("d", "")) for one in lines(root, AFTER))
    np.testing.assert_allclose(first[:, 0] - first[0, 0], (second[:, 0] - second[0, 0]) / 2, atol=1.0 / FINE)
    assert [one.text for one in root.iter("text")].count("t, s") == 1


def test_stills_of_a_long_report_stay_small_and_keep_their_peak(monkeypatch: pytest.MonkeyPatch) -> None:
    y = np.random.default_rng(1).standard_normal(1_000_000)
    y[777_777] = 500.0
    panel = Panel(series=(Series(x=np.arange(1e6), y=y, colour=AFTER),), x="t, s", y="y", y_range=(-500.0, 500.0))
    charts = [Chart(name=f"c{k}", title="t", panels=(panel,) * 4, columns=2) for k in range(3)]
    whole = sum(map(len, stills(charts)))
    assert whole < 0.4 * MOST_STILLS
    monkeypatch.setattr("arm_report.stills.MOST_STILLS", whole * 2 // 3)
    few = stills(charts)
    assert sum(map(len, few)) <= whole * 2 // 3
    (line, *_) = lines(ElementTree.fromstring(few[0]), AFTER)
    assert points(line.get("d", ""))[:, 1].min() == 0.0


@given(st.floats(-1e6, 1e6), st.floats(1e-6, 1e6), st.integers(2, 12))
def test_ticks_are_round_and_on_their_axis(low: float, span: float, most: int) -> None:
    scale = Scale(low=low, high=low + max(span, 1e-6 * abs(low)))
    values = [value for value, _ in scale.ticks(most)]
    assert len(values) <= most + 1 and all(scale.low <= value <= scale.high for value in values)
    steps = np.diff(values)
    assert np.allclose(steps, steps[:1].mean() if len(steps) else 0.0, rtol=1e-3)


@given(st.floats(1e-9, 1e9), st.floats(1.5, 1e9), st.integers(2, 12))
def test_logarithmic_ticks_lie_at_their_logarithm(low: float, times: float, most: int) -> None:
    scale = Scale(low=low, high=low * times, log=True)
    for value, text in scale.ticks(most):
        assert float(scale.place(value)) == pytest.approx(np.log(value / low) / np.log(times), abs=1e-9)
        assert float(text.replace("\N{MINUS SIGN}", "-")) == pytest.approx(value, rel=1e-5)


@given(st.lists(st.floats(allow_nan=True, allow_infinity=True, width=32), max_size=20), st.booleans())
def test_every_value_has_a_place_between_the_ends(values: list[float], log: bool) -> None:
    array = np.array(values)
    scale = scale_of([array], None, log=log, linear=None, dates=False)
    shown = np.isfinite(array) & ((array > 0.0) | (not log))
    places = scale.place(array[shown])
    assert ((places >= 0.0) & (places <= 1.0)).all() and scale.ticks(5) is not None


def test_no_tick_lies_between_two_rows() -> None:
    """Forty poses had ticks at the rows 2.5, 7.5 ..; three had them at halves."""
    for count in (3, 7, 40):
        rows = Series(x=np.arange(1.0, count + 1), y=np.ones(count), colour=AFTER)
        panel = Panel(series=(rows,), x="row", y="distance, mm")
        assert panel.whole and not replace(panel, series=(replace(rows, x=rows.x / 2),)).whole
        scale = scale_of([rows.x], None, log=False, linear=None, dates=False, whole=True)
        values = [value for value, _ in scale.ticks(8)]
        assert len(values) > 1 and all(value % 1.0 == 0.0 for value in values)


def test_a_date_reads_as_a_date() -> None:
    day = 86_400.0
    texts = [text for _, text in Scale(low=1.7e9, high=1.7e9 + 20 * day, dates=True).ticks(5)]
    assert len(texts) >= 2 and all(re.fullmatch(r"2023-1[12]-\d\d", text) for text in texts)
    far = Scale(low=0.0, high=30 * 365 * day, dates=True).ticks(5)
    assert 2 <= len(far) <= 6


def test_a_report_is_drawn_without_matplotlib() -> None:
    code = "import sys, arm_report.page, arm_report.write; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_the_words_at_an_instant_do_not_cover_the_title() -> None:
    level = Level(value=0.0, axis="x", words="a.mcap")
    root = drawn(Panel(title="joint 1", series=(Series(x=X, y=X, colour=AFTER),), x="t", y="y", levels=(level,)))
    (title,) = (one for one in root.iter("text") if one.text == "joint 1")
    (words,) = (one for one in root.iter("text") if one.text == "a.mcap")
    axes = next(one for one in root.iter("svg") if one.get("x"))
    assert float(title.get("y", 0)) < float(axes.get("y", 0)) < float(words.get("y", 0))
