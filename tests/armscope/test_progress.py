"""How far a computation is, in words that say no more than is known; drawn in terminals only."""

from __future__ import annotations

import os
import pty
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import armscope
from arm_io.progress import Step, following, report
from armscope.progress import Display, shown
from tests.arm_archive.lab import record
from tests.armscope.test_terminal import in_terminal


class Clock:
    now = 100.0

    def __call__(self) -> float:
        return self.now


def test_a_count_gives_the_time_left_of_its_step_from_the_steps_done() -> None:
    clock = Clock()
    display = Display(clock)
    display(Step("smoothing", 0, 8, detail="a.mcap"))
    assert display.sentence() == "smoothing: a.mcap" and display.share == 0.0
    clock.now += 10.0
    display(Step("smoothing", 2, 8, detail="b.mcap"))
    assert display.share == 0.25 and display.time() == "10 s, about 30 s left of this step"
    clock.now += 170.0
    display(Step("smoothing", 4, 8))
    assert display.time() == "3:00, about 3:00 left of this step"


def test_what_was_done_before_the_stage_began_counts_for_nothing() -> None:
    clock = Clock()
    display = Display(clock)
    display(Step("importing", 50, 100))
    clock.now += 10.0
    display(Step("importing", 75, 100))
    assert display.time() == "10 s, about 10 s left of this step"


def test_a_search_says_that_its_rounds_are_not_known() -> None:
    clock = Clock()
    display = Display(clock)
    display(Step("looking for causes", 0, detail="cause 1"))
    clock.now += 6.0
    display(Step("looking for causes", 2, detail="cause 3"))
    assert display.share is None
    assert display.time() == "2 done, 3.0 s each, how many will follow is not known"


def test_a_sentence_without_a_count_promises_nothing_and_begins_anew() -> None:
    clock = Clock()
    display = Display(clock)
    display("uncertainty")
    clock.now += 4.0
    assert display.time() == "4.0 s, time left not known" and display.share is None
    display("report")
    assert display.time() == "0.0 s, time left not known"


def test_a_second_pass_over_a_file_is_a_step_of_its_own() -> None:
    clock = Clock()
    display = Display(clock)
    display(Step("reading", 90, 100))
    clock.now += 50.0
    display(Step("reading", 10, 100))
    clock.now += 3.0
    display(Step("reading", 40, 100))
    assert display.time() == "3.0 s, about 6.0 s left of this step"


def test_reports_from_below_reach_who_follows_and_nobody_else() -> None:
    told: list[str] = []
    report("reading", 1, 2)
    with following(told.append):
        report("reading", 3, 4)
    report("reading", 5, 6)
    assert [(one.stage, one.done, one.of) for one in told if isinstance(one, Step)] == [("reading", 3, 4)]


def test_without_a_terminal_nothing_is_drawn_and_rich_is_not_imported(capfd: pytest.CaptureFixture[str]) -> None:
    with shown() as display:
        display(Step("smoothing", 1, 2))
        assert display.live is None
    assert capfd.readouterr() == ("", "")


def test_large_files_report_how_far_they_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from daq.recording import open_recording
    from daq.recording.mcap_file import walk
    from daq.recording.tables import csv_reader

    monkeypatch.setattr(walk, "REPORTED", 1000)
    monkeypatch.setattr(csv_reader, "BLOCK_CHARACTERS", 1000)
    record(tmp_path / "run.mcap")
    (tmp_path / "run.csv").write_text("t,q1,i1\n" + "".join(f"{k / 100},0.5,1.5\n" for k in range(500)))
    rises("reading", lambda: open_recording(tmp_path / "run.mcap"))
    rises("reading", lambda: csv_reader.read_csv(tmp_path / "run.csv"))


def rises(stage: str, work: Callable[[], object]) -> None:
    """Asserts that ``work`` reports one stage, how much of it is done, ever more, and never more than there is."""
    told: list[Step] = []
    with following(lambda sentence: told.append(sentence) if isinstance(sentence, Step) else None):
        work()
    done = [step.done for step in told]
    assert {step.stage for step in told} == {stage}
    assert len(done) > 2 and done == sorted(done) and done[-1] <= (told[-1].of or 0)


@pytest.mark.parametrize("name", ["run.parquet", "run.mat", "bag"])
def test_imports_of_every_format_report_how_far_they_are(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from armscope.cli import run
    from daq.recording.messages import bag_rows
    from daq.recording.tables import matlab, open_source, parquet, read_blocks

    for module in (matlab, parquet, bag_rows):
        monkeypatch.setattr(module, "ROWS", 20)
    monkeypatch.setattr(bag_rows, "WAITING", 1)
    record(tmp_path / "run.mcap")
    path = tmp_path / name
    assert (
        run(["export", str(tmp_path / "run.mcap"), "--out", str(path), *(["--to", "ros2"] if name == "bag" else [])])
        == 0
    )
    source = open_source(path)
    rises("reading", lambda: list(read_blocks(source, mapping=source.mapping)))


def test_long_simulations_report_how_far_they_are_and_have_the_same_rows(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from arm_model.simulation import advance

    arm, move = root / "config/models/puma560_worn.toml", root / "config/experiments/excitation_held_out.toml"
    at_once = armscope.simulate(arm, move, rate=333.0)
    monkeypatch.setattr(advance, "PART", 4567)
    in_parts: list[armscope.Simulation] = []
    rises("simulating", lambda: in_parts.append(armscope.simulate(arm, move, rate=333.0)))
    np.testing.assert_array_equal(in_parts[0].q, at_once.q)
    np.testing.assert_array_equal(in_parts[0].i, at_once.i)


def test_a_long_table_reports_how_far_it_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from daq.recording import Attachments, write_table
    from daq.recording.tables import table

    monkeypatch.setattr(table, "CHUNK_BYTES", 10_000)
    signals = {"q": np.zeros((500, 2)), "i": np.zeros((500, 2))}
    rises("writing", lambda: write_table(tmp_path / "a.mcap", np.arange(500) / 100, signals, Attachments()))


CODE = """
import time
from arm_io.progress import Step
from armscope.progress import shown
with shown({as_json}) as progress:
    for done in range(5):
        progress(Step("counting", done, 5))
        time.sleep(0.4)
"""


def drawn(code: str, root: Path, **variables: str) -> str:
    """What a program draws on a terminal that is its standard error."""
    ours, theirs = pty.openpty()
    environment = {**os.environ, "TERM": "xterm-256color", "PYTHONPATH": str(root), **variables}
    process = subprocess.Popen([sys.executable, "-c", code], stderr=theirs, env=environment)
    os.close(theirs)
    text = b""
    try:
        while part := os.read(ours, 65536):
            text += part
    except OSError:
        pass
    os.close(ours)
    assert process.wait(timeout=60) == 0
    return text.decode()


def test_a_terminal_shows_the_time_left_and_is_clean_afterwards(root: Path) -> None:
    text = drawn(CODE.format(as_json=False), root, COLUMNS="80")
    assert "counting" in text and re.search(r"about \d\.\d s left of this step", text)
    # the line is erased at the end, and the cursor shown again
    assert "\x1b[2K" in text.rpartition("counting")[2] and "\x1b[?25h" in text.rpartition("counting")[2]


@pytest.mark.parametrize(("as_json", "term"), [(True, "xterm-256color"), (False, "dumb")])
def test_json_and_a_dumb_terminal_get_none(as_json: bool, term: str, root: Path) -> None:
    assert drawn(CODE.format(as_json=as_json).replace("0.4", "0.01"), root, TERM=term) == ""


def test_a_command_shows_what_it_does(tmp_path: Path, root: Path) -> None:
    record(tmp_path / "run.mcap")
    assert "indexing" in in_terminal(["archive", "."], tmp_path, root)
    assert in_terminal(["archive", ".", "--json"], tmp_path, root) == ""
