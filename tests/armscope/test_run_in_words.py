"""The result of a run for a person: its file is named from the working directory where it is there."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from armscope.api.recording import text_of

ENDED = {
    "rows": 5,
    "experiment": "sweep",
    "ledger": {"lost": 0, "triggers": 5, "losses": []},
    "ending": {"sentence": "the motion has ended"},
    "notes": [],
}


@pytest.mark.parametrize(
    ("place", "more", "named"),
    [
        ("here/runs/a.mcap", {}, "runs/a.mcap: 5 rows"),
        ("elsewhere/a.mcap", {}, "{root}/elsewhere/a.mcap: 5 rows"),
        # of a daemon's machine, whose folders are others of the same names
        ("here/a.mcap", {"endpoint": "tcp/rig:7447", "fetched": None}, "{root}/here/a.mcap: 5 rows"),
    ],
)
def test_the_file_of_a_run(
    place: str, more: dict[str, Any], named: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    assert text_of(ENDED | more | {"file": str(tmp_path / place)}).startswith(named.format(root=tmp_path))
