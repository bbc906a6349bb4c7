"""Every test that docs/endurance.md names is there, so that ``pytest -k`` finds it."""

from __future__ import annotations

import re
from pathlib import Path


def test_every_test_that_is_named_is_there(root: Path) -> None:
    text = (root / "docs/endurance.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`(test_\w+)`", text))
    assert len(named) > 50
    written = "".join(path.read_text(encoding="utf-8") for path in (root / "tests").rglob("*.py"))
    assert sorted(named - set(re.findall(r"def (test_\w+)\(", written))) == []
    assert [path for path in re.findall(r"`(tests/[\w/]+\.py)`", text) if not (root / path).is_file()] == []
