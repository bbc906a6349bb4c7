"""Spoiled copies of a stranger's files: a result, or one line and nothing written (``python -m tests.foreign``)."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_model.model_file import read_model
from armscope.api.reading import for_analysis
from identification.preprocessing.checks import check_recording
from tests.foreign.commands import through_every_command
from tests.foreign.ended import called, unrendered
from tests.foreign.random_arms import stranger
from tests.foreign.spoiled import Files, spoiled_commands, spoiled_table, spoiled_text, through_spoiled_files


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Files:
    """Of an arm of one joint, recorded twice."""
    folder = tmp_path_factory.mktemp("stranger")
    seed = next(seed for seed in range(100) if len(stranger(seed).model) == 1)
    _, model = stranger(seed).write(folder)
    motion, runs = folder / "motion.toml", (folder / "a.mcap", folder / "b.mcap")
    short = ("--duration", 3, "--fundamental", 0.5, "--harmonics", 3, "--candidates", 32)
    assert called("excite", "--model", model, "--out", motion, *short).status == 0
    for run in runs:
        line = ("simulate", "--model", model, "--experiment", motion, "--rate", 200, "--target", "0.05,0.02,0.1")
        assert called(*line, "--out", run).status == 0
    assert called("export", runs[0], "--out", folder / "a.csv").status == 0
    return Files(model, *runs, folder / "a.csv")


def test_wrong_names_and_numbers_are_refused_in_one_line(files: Files, tmp_path: Path) -> None:
    several = list(spoiled_commands(files, tmp_path, np.random.default_rng(1), count=0))
    assert [one for one in several if not one.well or one.status != 2] == []
    assert len(several) > 20


@pytest.mark.parametrize("more", [(), ("--distort", "joint1.viscous")])
def test_a_recording_that_was_cut_off_before_its_first_row_is_refused(
    files: Files, more: tuple[str, ...], tmp_path: Path
) -> None:
    (bad := tmp_path / "bad.mcap").write_bytes(files.fit.read_bytes()[:6000])
    ended = called("diagnose", "--fit", bad, "--model", files.model, "--out", tmp_path / "out", *more)
    assert ended.status == 2
    assert ended.said.splitlines()[-1].endswith("has 0 rows; several seconds of motion are needed")
    assert not (tmp_path / "out").exists()


def test_poses_that_cannot_be_planned_leave_nothing_behind(files: Files, tmp_path: Path) -> None:
    """Refused before the first file, also before what a calibration would write."""
    for more in ((), (files.fit, "--held-out", files.held_out)):
        line = ("calibrate", *more, "--model", files.model, "--target", "0.05,0.02,0.1", "--poses", 100000)
        ended = called(*line, "--out", tmp_path / "out")
        assert ended.status == 2 and not (tmp_path / "out").exists(), ended


def test_most_copies_are_spoiled(files: Files) -> None:
    rng = np.random.default_rng(3)
    model, table = files.model.read_text(), files.table.read_text()
    assert sum(spoiled_text(model, rng) == model for _ in range(100)) < 20
    assert sum(spoiled_table(table, rng) == table for _ in range(100)) < 20


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10))
def test_random_arms_with_spoiled_files(seed: int, tmp_path: Path) -> None:
    with unrendered():
        list(through_every_command(seed, tmp_path))
    assert [one for one in through_spoiled_files(seed, tmp_path, 4) if not one.well] == []


@pytest.mark.filterwarnings("error")
def test_demands_that_are_all_missing_warn_of_nothing(files: Files) -> None:
    ((recording,),) = for_analysis([files.fit])
    assert recording.qref is not None
    check_recording(replace(recording, qref=np.full_like(recording.qref, np.nan)), read_model(files.model))
