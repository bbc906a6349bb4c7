"""The result of a run for a person: its file is named from the working directory where it is there."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from armscope.api.recording import text_of
from armscope.cli import run

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


def test_a_folder_that_is_not_there_is_named_as_it_was_given(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    rig, motion = "config/puma560_sim.toml", "config/experiments/excitation.toml"
    assert run(["record", "--rig", rig, "--experiment", motion, "--out", "none/a.mcap"]) == 2
    said = capfd.readouterr().err.splitlines()[-1]
    assert said == "error: none/a.mcap: cannot be written: there is no folder none"


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="needs a folder in which nobody can write")
def test_a_place_that_cannot_be_written_is_named_as_it_was_given(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir("/proc")
    rig, motion = "config/puma560_sim.toml", "config/experiments/excitation.toml"
    assert run(["record", "--rig", rig, "--experiment", motion, "--out", "self/a.mcap"]) == 2
    assert capfd.readouterr().err.splitlines()[-1].startswith("error: self/a.mcap: cannot be written: ")
