"""Analyses of a page without a browser: steps with their share arrive, and no job stays under way for ever."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from arm_io.progress import Step
from arm_page.analyses import Analyses, Analysis

SECONDS = 60.0
"""For a process to start: the machine may be busy."""


class Unreadable(str):
    """Text that the other process cannot take apart."""

    def __reduce__(self) -> Any:
        return (int, ("none",))


def stepping(
    fit: Sequence[Path], held_out: Sequence[Path], model: Path, out: Path, progress: Callable[[str], None]
) -> str:
    """Waits at its third step of four until there is a file."""
    progress(Step("smoothing", 3, 4, detail="a.mcap"))
    while not (out / "go").exists():
        time.sleep(0.02)
    return Unreadable("done") if held_out else "done"


def begin(folder: Path, held_out: list[Path]) -> Analyses:
    known = Analysis(name="step", title="Step", help="", needs_points=False, run=stepping)
    analyses = Analyses([known], folder / "model.toml", folder)
    analyses.begin("step", [folder / "a.mcap"], held_out)
    return analyses


def wait_for(analyses: Analyses, there: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    end = time.monotonic() + SECONDS
    while not there(analyses.list()[0]):
        assert time.monotonic() < end, analyses.list()
        time.sleep(0.02)
    return analyses.list()[0]


def test_a_step_arrives_with_its_share(tmp_path: Path) -> None:
    analyses = begin(tmp_path, [])
    job = wait_for(analyses, lambda job: job["says"] == "smoothing: a.mcap")
    assert job["state"] == "working" and job["share"] == 0.75
    Path(job["folder"], "go").touch()
    job = wait_for(analyses, lambda job: job["state"] != "working")
    assert (job["state"], job["says"], job["share"]) == ("done", "done", None)


def test_a_job_whose_answer_cannot_be_read_has_failed_and_the_next_may_begin(tmp_path: Path) -> None:
    analyses = begin(tmp_path, [tmp_path / "b.mcap"])
    job = wait_for(analyses, lambda job: job["says"] == "smoothing: a.mcap")
    Path(job["folder"], "go").touch()
    job = wait_for(analyses, lambda job: job["state"] not in ("waiting", "working"))
    assert job["state"] == "failed" and "ValueError" in job["says"]
    analyses.begin("step", [tmp_path / "a.mcap"], [])
    analyses.close()
