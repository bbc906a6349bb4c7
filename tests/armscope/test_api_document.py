"""Every example of docs/api.md works as it stands, and prints what the page says."""

from __future__ import annotations

import doctest
from pathlib import Path

import pytest

import armscope
from armscope.cli import run


def test_the_examples_print_what_the_page_says(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(["init", "my_arm", "--like", "csv"]) == 0
    capsys.readouterr()
    page = root / "docs/api.md"
    result = doctest.testfile(str(page), module_relative=False, optionflags=doctest.ELLIPSIS | doctest.REPORT_NDIFF)
    assert result.attempted > 20
    assert result.failed == 0, capsys.readouterr().out


def test_the_page_names_everything_that_is_offered(root: Path) -> None:
    page = (root / "docs/api.md").read_text()
    assert [name for name in armscope.__all__ if name not in page and name != "__version__"] == []
