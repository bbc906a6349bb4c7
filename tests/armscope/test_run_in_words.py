"""The result of a run for a person: its file is named from the working directory where it is there."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from armscope.api.recording import text_of
from armscope.cli import run
from armscope.commands.record import status_of

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


def test_many_losses_are_summed_by_reason_and_device() -> None:
    gone = {"rows": 9, "first": 90, "sentence": "a device was unplugged or stopped answering", "detail": "currents"}
    often = [{"rows": 1 + (k == 3), "first": 4 * k, "sentence": "made no row", "detail": "counter"} for k in range(20)]
    losses = [*often, gone]
    said = text_of(ENDED | {"file": "a.mcap", "ledger": {"lost": 30, "triggers": 100, "losses": losses}})
    assert (
        "lost: 21 in 20 places from trigger 0 to 76, at most 2 at once (from trigger 12 on): made no row (counter)"
        in said
    )
    assert "lost: 9 in 1 place from trigger 90 on: a device was unplugged or stopped answering (currents)" in said
    few = text_of(ENDED | {"file": "a.mcap", "ledger": {"lost": 10, "triggers": 100, "losses": [often[0], gone]}})
    assert "lost: 1 from trigger 0 on: made no row (counter)" in few


def test_values_that_a_device_did_not_give_are_losses() -> None:
    ended = ENDED | {"file": "a.mcap", "missing": {"currents": 3}, "ending": {"sentence": "", "fault": False}}
    assert "5 rows of 'sweep'; currents has NO VALUE in 3 rows" in text_of(ended)
    assert status_of(ended) == 4
    assert status_of(ended | {"missing": {}}) == 0


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
