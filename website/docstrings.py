"""Docstrings as Markdown: a column of names beside a column of meanings becomes a list of definitions.

This is an extension of griffe, with which mkdocstrings reads the code.
"""

from __future__ import annotations

import re
from html import escape
from typing import Any

import griffe


class Columns(griffe.Extension):
    """Rewrites the docstring of every object as it is loaded."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Markdown in place of columns."""
        if obj.docstring is not None:
            obj.docstring.value = markdown(obj.docstring.value)


def markdown(docstring: str) -> str:
    """The docstring with definition lists, double backquotes as single ones, and ``Raises`` in a paragraph."""
    done: list[str] = []
    entries: list[tuple[str, str]] = []
    for line in [*docstring.replace("``", "`").splitlines(), ""]:
        entry = re.fullmatch(r"([A-Za-z_]\w*(?:, [A-Za-z_]\w*)*)\s{2,}(\S.*)", line) if line[:1] != " " else None
        short = re.fullmatch(r"([a-z_]\w+) (is called .*|of .*)", line) if entries else None
        if entry or short:
            name, text = (entry or short).groups()  # type: ignore[union-attr]
            entries.append((name, text))
        elif entries and line.startswith("  "):
            entries[-1] = (entries[-1][0], f"{entries[-1][1]} {line.strip()}")
        else:
            done += _listed(entries)
            entries = []
            if line.startswith("Raises ") and done and done[-1]:
                done.append("")
            done.append(line)
    return "\n".join(done).rstrip()


def _listed(entries: list[tuple[str, str]]) -> list[str]:
    if not entries:
        return []
    rows = [f"<dt>{escape(name)}</dt><dd>{_spans(text)}</dd>" for name, text in entries]
    return ["", '<dl class="columns" markdown="block">', *rows, "</dl>", ""]


def _spans(text: str) -> str:
    """HTML of one line, its backquoted parts as code."""
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", escape(text, quote=False))
