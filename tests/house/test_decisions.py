"""Decisions are numbered without a gap, dated, one per file, and listed."""

from __future__ import annotations

import re
from pathlib import Path

SECTIONS = ["## Context", "## Decision", "## Consequences"]


def test_every_decision_has_its_parts_and_its_row(root: Path) -> None:
    folder = root / "docs/decisions"
    index = (folder / "README.md").read_text()
    files = sorted(path for path in folder.glob("*.md") if path.name != "README.md")
    assert [path.name[:4] for path in files] == [f"{number:04d}" for number in range(1, len(files) + 1)]
    for path in files:
        text = path.read_text()
        title = re.match(rf"# {path.name[:4]} (.+)\n\n\*\d{{4}}-\d\d-\d\d\. Status: .+\.\*\n", text)
        assert title, path.name
        assert [line for line in SECTIONS if line not in text] == [], path.name
        assert f"| [{path.name[:4]}]({path.name}) | {title[1]} |" in index, path.name
