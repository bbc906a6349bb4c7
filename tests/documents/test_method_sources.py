"""The method of a diagnosis: each section asks its question first, and every source and test that it names is there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

PAGES = (
    "docs/diagnosis-method.md",
    "docs/diagnosis-raw-rows.md",
    "docs/diagnosis-beyond-selection.md",
    "docs/diagnosis-next-steps.md",
)


def _sections(root: Path, page: str) -> dict[str, str]:
    parts = re.split(r"^## (.+)\n", (root / page).read_text(encoding="utf-8"), flags=re.M)
    return dict(zip(parts[1::2], parts[2::2]))


@pytest.mark.parametrize("page", PAGES)
def test_every_section_begins_with_the_question_that_it_answers(root: Path, page: str) -> None:
    assert [name for name, text in _sections(root, page).items() if not re.match(r"\n\*[A-Z][^*]+\?\*", text)] == []


@pytest.mark.parametrize("page", PAGES)
def test_every_section_names_a_source_and_a_test(root: Path, page: str) -> None:
    for name, text in _sections(root, page).items():
        assert re.search(r"Source: `", text), name
        assert re.search(r"`[\w/]*test_\w+\.py`|`tests/[\w/]+/`", text), name


@pytest.mark.parametrize(
    "page", [*PAGES, "docs/diagnosis-single-points.md", "docs/first-runs-blind.md", "docs/first-runs-foreign.md"]
)
def test_every_file_that_is_named_is_there(root: Path, page: str) -> None:
    """A path from the root as it stands; a name alone, or the end of a path, of a file below diagnosis/ or tests/."""
    there = [
        path.relative_to(root).as_posix()
        for folder in ("diagnosis", "identification", "tests")
        for path in (root / folder).rglob("*")
    ]
    text = (root / page).read_text(encoding="utf-8")
    named = set(re.findall(r"`([\w/]+\.py|(?:diagnosis|tests|identification)/[\w/]*/)`", text))
    assert len(named) >= 20
    missing = [
        name
        for name in named
        if not (root / name).exists() and not any(f"/{path}".endswith(f"/{name.rstrip('/')}") for path in there)
    ]
    assert missing == []
