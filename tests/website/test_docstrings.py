"""Docstrings with columns become definition lists; names of documents become links."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

pytest.importorskip("mkdocstrings")

import armscope
from website import home, reference
from website.docstrings import markdown


def test_columns_become_a_definition_list() -> None:
    text = markdown("What it is.\n\nfolder  as ``given``\nt, q    one\n        more\nRaises InputError where not.")
    assert "What it is." in text
    assert "<dt>folder</dt><dd>as <code>given</code></dd>" in text
    assert "<dt>t, q</dt><dd>one more</dd>" in text
    assert text.endswith("</dl>\n\nRaises InputError where not.")


def test_prose_stays_prose() -> None:
    prose = "One line.\n\nA paragraph of\ntwo lines, with `code`."
    assert markdown(prose) == prose


def test_every_public_name_is_on_a_page() -> None:
    pages = reference.pages()
    text = "\n".join(pages[name] for name in pages if not name.endswith("index.md"))
    hidden = {"effects", "__version__"}
    assert [name for name in armscope.__all__ if f"::: armscope.{name}\n" not in text and name not in hidden] == []


def test_documents_named_in_prose_become_links(root: Path) -> None:
    text = "see docs/model.md and `docs/page.md`,\n[x](docs/model.md)\n\n    cat docs/model.md\n"
    assert home.linked(text, "effects/backlash.md") == (
        "see [model](../model.md) and [page](../page.md),\n[x](docs/model.md)\n\n    cat docs/model.md\n"
    )
    assert "](docs/" not in home.outside("index.md")


def test_every_document_is_in_the_navigation(root: Path) -> None:
    """A page that is left out ends the build of the site, which only a slow test does."""
    settings = (root / "mkdocs.yml").read_text()
    assert [path.name for path in (root / "docs").glob("*.md") if f": {path.name}\n" not in settings] == []


def test_every_package_whose_names_are_offered_is_loaded(root: Path) -> None:
    """A name of a package that the site does not load ends its build."""
    (listed,) = re.findall(r"preload_modules: \[(.+)\]", (root / "mkdocs.yml").read_text())
    homes = {home.partition(":")[0].partition(".")[0] for home in armscope._HOMES.values()}
    assert homes - {"armscope"} <= set(listed.split(", "))
