"""Pages of reports: well-formed whatever the words, self-contained, and every table a rectangle."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from markupsafe import Markup

from arm_report import Chart, Panel, Report, Series, image, inline, table, warning
from arm_report.palette import AFTER

ALONE = {"meta", "img", "br"}
TEXT = st.text(st.characters(exclude_categories=["Cs", "Cc"]))


class Checked(HTMLParser):
    """Collects text and cells per row; AssertionError where an end does not match its beginning."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.text: list[str] = []
        self.rows: list[int] = []
        self.tags: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        if tag not in ALONE:
            self.open.append(tag)
        if tag == "tr":
            self.rows.append(0)
        if tag in ("td", "th"):
            self.rows[-1] += int(dict(attrs).get("colspan") or 1)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text.append(data)


def checked(html: str) -> Checked:
    parser = Checked()
    parser.feed(html)
    parser.close()
    assert parser.open == []
    return parser


def report(words: str, chart: Chart | None = None, *, joints: tuple[str, ...] = ()) -> Report:
    """A page that has these words in each of its parts."""
    content = {"words": words, "chart": chart}
    return Report(title=words, template="tests.arm_report/page.html", content=content, joints=joints)


@given(TEXT)
def test_words_stay_words(words: str) -> None:
    page = checked(report(words).html())
    assert not {"script", "b"} & set(page.tags)
    assert words.strip() == "" or "".join(page.text).count(words) >= 8


def test_sentences_have_the_signs_of_a_page() -> None:
    """Those that the terminal writes with letters; a file's name keeps its own."""
    page = "".join(checked(report("a->b+-c.mcap: 3.0 -> 4.5 +- 0.1 N m").html()).text)
    assert page.count("a->b+-c.mcap: 3.0 \N{RIGHTWARDS ARROW} 4.5 \N{PLUS-MINUS SIGN} 0.1 N m") == 4


def test_names_of_users_cannot_leave_their_place() -> None:
    evil = "</script><script>alert(1)</script>\"'&"
    line = Series(x=np.arange(3.0), y=np.arange(3.0), colour=AFTER, label=evil)
    chart = Chart(name="evil", title=evil, panels=(Panel(series=(line,), x=evil, y=evil, title=evil),))
    html = report(evil, chart, joints=(evil,)).html()
    page = checked(html)
    # the data and the page's own script, and none of the user's
    assert page.tags.count("script") == 2
    data = json.loads(html.partition('id="data">')[2].partition("</script>")[0])
    assert data["joints"] == [evil] and data["charts"][0]["panels"][0]["series"][0]["label"] == evil


@given(st.lists(st.lists(st.just("x"), min_size=1, max_size=4)))
def test_every_row_of_a_table_is_as_wide_as_its_head(rows: list[list[str]]) -> None:
    assert checked(table(rows, ["a", "b", "c", "d"], (1, 2), (0,))).rows == [4] * (len(rows) + 1)


def test_a_cell_is_text_unless_it_is_markup() -> None:
    html = table([["<b>", Markup("<i>x</i>")]], ["a", "b"])
    assert "&lt;b&gt;" in html and "<i>x</i>" in html
    assert "&lt;b&gt;" in warning("<b>")


def test_a_picture_carries_its_data_and_its_words() -> None:
    from matplotlib.figure import Figure

    html = image(Figure(figsize=(1, 1)), 'a "picture" & more')
    assert "data:image/png;base64,iVBOR" in html
    assert 'alt="a &quot;picture&quot; &amp; more"' in html


def test_the_scripts_of_a_page_in_a_notebook_cannot_reach_the_notebook() -> None:
    frame = inline("<script>parent.stolen = 1</script>")
    assert 'sandbox="allow-scripts"' in frame and "allow-same-origin" not in frame and "<script" not in frame


def test_every_colour_of_a_plot_is_of_the_palette(root: Path) -> None:
    for package in ("daq", "identification", "diagnosis", "comparison", "armscope"):
        for path in (root / package).rglob("*.py"):
            assert re.findall(r'["\']#[0-9a-fA-F]{3,8}["\']', path.read_text()) == [], path
