"""A page that is killed takes the daemon that it started with it, which first ends the run as SIGTERM does."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import pytest

from arm_io import read_toml
from daq.recording import open_recording
from daq.service import holder_of
from tests.arm_page.room import open_room, rig_table

pytestmark = [pytest.mark.xdist_group("page"), pytest.mark.slow]
SECONDS = 60.0
"""For anything to happen: the machine may be busy."""


def wait_until(there: Callable[[], object]) -> None:
    end = time.monotonic() + SECONDS
    while not there():
        assert time.monotonic() < end
        time.sleep(0.05)


@pytest.mark.parametrize("moving", [True, False])
def test_the_daemon_of_a_killed_page_finishes_the_file_and_ends(moving: bool, tmp_path: Path) -> None:
    with open_room(tmp_path, rig_table(f"page killed {moving}")) as room:
        name = read_toml(tmp_path / "rig.toml")["name"]
        _, shown = room.ask("/api/preview/long.toml")
        status, answer = room.ask("/api/command/arm", {"experiment": "long.toml", "sha256": shown["sha256"]})
        assert status == 200, answer
        if moving:
            assert room.ask("/api/command/start", {})[0] == 200
            time.sleep(1.0)
        assert holder_of(name) is not None
        room.process.kill()
        room.process.wait()
        wait_until(lambda: holder_of(name) is None)
    files = list((tmp_path / "recordings").iterdir())
    assert len(files) == moving
    for path in files:
        recording = open_recording(path)
        assert recording.finished and recording.run is not None
        assert recording.run["ending"]["reason"] == "terminated" and recording.ledger.lost == 0
