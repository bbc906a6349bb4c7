"""The pages of compare and trend: which recordings, and what to do about a change."""

from __future__ import annotations

from pathlib import Path

from comparison.report.html import shortest


def test_files_of_the_same_name_are_told_apart_by_their_folders(tmp_path: Path) -> None:
    paths = [str(tmp_path / day / name) for day in ("monday", "friday") for name in ("fit.mcap", "check.mcap")]
    assert shortest(paths) == ["monday/fit.mcap", "monday/check.mcap", "friday/fit.mcap", "friday/check.mcap"]
    assert shortest(paths[:2]) == ["fit.mcap", "check.mcap"]
    assert shortest(["a/identification.json", "b/c/identification.json"]) == [
        "a/identification.json",
        "b/c/identification.json",
    ]
