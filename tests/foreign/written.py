"""Whether what the commands wrote can be opened: strict JSON, TOML, whole pages, numbers in recordings and tables."""

from __future__ import annotations

import csv
import json
import math
import tomllib
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

VOID = {"area", "base", "br", "col", "embed", "hr", "img", "input", "link", "meta", "source", "track", "wbr"}
"""Elements of HTML that have no end."""


def flaws(folder: Path) -> list[str]:
    """Files below a folder that cannot be opened or hold a number that is none, each with what is wrong with it."""
    found = []
    for path in sorted(folder.rglob("*")):
        hidden = path.name.startswith(".") and path.suffix != ".files"  # which says what a run wrote
        if hidden or path.suffix in (".tmp", ".active", ".part"):
            found.append(f"{path.relative_to(folder)}: left behind half written")
        elif path.is_file() and (reader := READERS.get(path.suffix)):
            try:
                reader(path.read_text(encoding="utf-8"))
            except (ValueError, ElementTree.ParseError) as error:
                found.append(f"{path.relative_to(folder)}: {error}")
    return found


def _no_number(word: str) -> None:
    raise ValueError(f"{word} in JSON")


def _json(text: str) -> None:
    json.loads(text, parse_constant=_no_number)


def _toml(text: str) -> None:
    def check(value: object) -> None:
        if isinstance(value, float) and math.isnan(value):
            raise ValueError("nan in TOML")
        for one in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
            check(one)

    check(tomllib.loads(text))


def _csv(text: str) -> None:
    """Rows as long as their header; fields that are no number stand for what was not measured and stay empty."""
    header, *rows = csv.reader(line for line in text.splitlines() if not line.startswith("#"))
    for number, row in enumerate(rows, 2):
        if len(row) != len(header):
            raise ValueError(f"line {number} has {len(row)} fields, the header {len(header)}")


def _html(text: str) -> None:
    page = _Page()
    page.feed(text)
    page.close()
    if page.open or "html" not in page.seen or "body" not in page.seen:
        raise ValueError(f"no whole page: {page.open[-1:] or 'no body'} is not closed")


class _Page(HTMLParser):
    """Elements that are open, and all that were seen."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.seen: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.add(tag)
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.add(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag in VOID:
            return
        if not self.open or self.open.pop() != tag:
            raise ValueError(f"line {self.getpos()[0]} ends {tag}, which is not open")

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] == "td" and data.strip().lower() in ("nan", "inf", "-inf"):
            raise ValueError(f"line {self.getpos()[0]} has {data.strip()} in a table")


READERS: dict[str, Callable[[str], object]] = {
    ".json": _json,
    ".toml": _toml,
    ".csv": _csv,
    ".html": _html,
    ".urdf": ElementTree.fromstring,
    ".xml": ElementTree.fromstring,
}
