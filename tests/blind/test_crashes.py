"""A case that crashes is told, and the cases after it are run and told all the same."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

import tests.blind.__main__ as suite


def _fails(case: suite.AnyCase, cache: Path | None) -> suite.Outcome:
    raise ValueError(f"no answer to {case.name}")


def test_every_case_is_told_where_some_crash(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(suite, "judged", _fails)
    monkeypatch.setattr(
        sys, "argv", ["blind", "--generator=second", "--seed=3", "--cases=3", "--kind=empties", "--workers=1"]
    )
    with pytest.raises(SystemExit, match="3 of 3 cases crashed"):
        suite.main()
    told = capsys.readouterr().out
    assert [line.split()[1] for line in told.splitlines() if "CRASHED" in line] == ["CRASHED"] * 3
    assert all(f"no answer to empties-{k}-nothing" in told for k in range(3))
