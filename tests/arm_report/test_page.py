"""Pages of reports: well-formed whatever the words, self-contained, and every table a rectangle."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from arm_report import image, note, page, table, verdict, warning

ALONE = {"meta", "img", "br"}


class Checked(HTMLParser):
    """Collects text and cells per row; AssertionError where an end does not match its beginning."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.text: list[str] = []
        self.rows: list[int] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
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


@given(st.text(st.characters(exclude_categories=["Cs", "Cc"])))
def test_words_stay_words(words: str) -> None:
    html = page(words, [verdict(words), warning(words), note("plain")])
    assert re.findall("<script|<b>", html) == []
    assert words.strip() == "" or "".join(checked(html).text).count(words) >= 4


@given(st.lists(st.lists(st.just("x"), min_size=1, max_size=4)))
def test_every_row_of_a_table_is_as_wide_as_its_head(rows: list[list[str]]) -> None:
    assert checked(table(rows, ["a", "b", "c", "d"], (1, 2), (0,))).rows == [4] * (len(rows) + 1)


def test_a_picture_carries_its_data_and_its_words() -> None:
    from matplotlib.figure import Figure

    html = image(Figure(figsize=(1, 1)), 'a "picture" & more')
    assert "data:image/png;base64,iVBOR" in html
    assert 'alt="a &quot;picture&quot; &amp; more"' in html


def test_every_colour_of_a_plot_is_of_the_palette(root: Path) -> None:
    for package in ("daq", "identification", "diagnosis", "armscope"):
        for path in (root / package).rglob("*.py"):
            assert re.findall(r'["\']#[0-9a-fA-F]{3,8}["\']', path.read_text()) == [], path
