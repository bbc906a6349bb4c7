"""A diagnosis in forked processes, which has the same results as in one."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from arm_io import parallel
from arm_model import write_model
from armscope.cli import run
from tests.diagnosis.numpy_arm import NumpyArm, model, straight

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="other systems work in one process")


def test_files_are_equal_to_the_last_byte(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    arm = NumpyArm(
        ((straight(10.0, 8.0), straight(7.0, 8.0)), (straight(9.0, 5.0), straight(6.0, 5.0))),
        torque=lambda q, v, t, load: np.column_stack([0 * t, 0.8 * np.sin(80.0 * q[:, 1])]),
    )
    for seed in (1, 2):
        arm.record(tmp_path / f"{seed}.mcap", seed, 12.0)
    write_model(tmp_path / "arm.toml", model(((10.0, 7.0), (6.0, 4.0)), (8.0, 5.0)))
    monkeypatch.chdir(tmp_path)
    forks, fork = list[int](), parallel._fork

    def counted(work: object, items: list[object], *args: object) -> None:
        forks.append(len(items))
        fork(work, items, *args)

    monkeypatch.setattr(parallel, "_fork", counted)
    monkeypatch.setattr(parallel, "_forks_safely", lambda: True)
    seen = list[int]()
    for cores in (1, 3):
        monkeypatch.setattr(parallel, "cores", lambda cores=cores: 1 if parallel._sharing else cores)
        words = [
            "diagnose",
            "--fit",
            "1.mcap",
            "--held-out",
            "2.mcap",
            "--model",
            "arm.toml",
            "--out",
            str(cores),
            "--png",
        ]
        assert run(words) == 0
        seen.append(len(forks))
    assert seen[0] == 0 and seen[1] > 20
    once, forked = (
        {path.relative_to(folder).as_posix(): path.read_bytes() for path in Path(folder).rglob("*.*") if path.is_file()}
        for folder in ("1", "3")
    )
    assert "diagnosis.json" in once and "report.html" in once
    assert once == forked
