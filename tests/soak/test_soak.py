"""Twenty seconds of the soak; ``make soak`` runs it for minutes or hours."""

from __future__ import annotations

import json
from pathlib import Path

from tests.soak.report import as_table, growth_of, write
from tests.soak.soak import Soak


def test_twenty_seconds_among_guests_that_misbehave(root: Path, tmp_path: Path) -> None:
    (tmp_path / "soak").mkdir()
    soak = Soak(root, tmp_path / "soak", seed=3)
    soak.go(20.0)
    table = as_table(soak.account, 20.0)
    write(tmp_path, table)
    assert table["wrong"] == []
    assert table["triggers"] == table["recorded"] + sum(table["lost"].values()) > 50_000
    assert table["runs"]["killed"] == 1 and len(table["crowd"]) == 4
    assert json.loads((tmp_path / "soak.json").read_text())["schema"] == "armscope.soak/1"
    assert "| wrong | nothing |" in (tmp_path / "soak.md").read_text()


def test_memory_that_grows_is_told() -> None:
    """The measure itself: what comes in the first minute does not count, what comes after it does."""
    times = [10.0 * k for k in range(60)]
    warm = [(t, 100.0 + min(t, 60.0)) for t in times]
    leak = [(t, 100.0 + 0.1 * t) for t in times]
    rise = growth_of(leak)
    assert growth_of(warm) == 0.0 and rise is not None and rise > 30.0
    assert growth_of(leak[:10]) is None
