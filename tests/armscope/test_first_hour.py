"""docs/first-hour-own-arm.md: its commands run and print what it shows; its files are those of MuJoCo."""

from __future__ import annotations

import json
import re
import shlex
import shutil
from pathlib import Path

import pytest

from armscope.cli import run

PAGE = "docs/first-hour-own-arm.md"


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.filterwarnings("error::RuntimeWarning")  # a reader would see its line
def test_every_command_of_the_page_runs_and_prints_what_it_shows(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for file in (root / "examples/own_arm").iterdir():
        shutil.copy(file, tmp_path)
    monkeypatch.chdir(tmp_path)
    text = (root / PAGE).read_text(encoding="utf-8")
    blocks = re.findall(r"((?:^    .*\n)+)", text, re.M)
    printed, commands = "", 0
    for block in blocks:
        lines = [line[4:].rstrip() for line in block.splitlines()]
        if not lines[0].startswith("$ "):
            if " = " not in lines[0]:  # what the command before it printed
                said = printed.splitlines()
                for line in lines:
                    assert any(_alike(line, one) for one in said), line
            continue
        for line in lines:
            command = shlex.split(line.removeprefix("$ "))
            assert command[0] == "armscope"
            assert run(command[1:]) == 0, line
            commands += 1
            captured = capsys.readouterr()
            printed = captured.out
            if "--check" in command:
                assert ": ready" in printed and "…" not in printed
    assert commands == 10
    found = json.loads((tmp_path / "today/diagnosis.json").read_text())
    assert [(one["effect"], one["joint"]) for one in found["causes"]] == [("coulomb_friction", 2)]
    assert abs(found["causes"][0]["parameters"]["coulomb"]["value"] - 1.5) < 0.1


def _alike(shown: str, printed: str) -> bool:
    """Whether a printed line begins with these words; its numbers to a hundredth, as processors differ."""
    words = shown.split()
    return len(printed.split()) >= len(words) and all(map(_same, words, printed.split()))


def _same(one: str, other: str) -> bool:
    """Numbers may also differ by one in the last digit that is shown."""
    try:
        last = 10.0 ** -len(one.partition(".")[2])
        return float(one) == pytest.approx(float(other), rel=0.01, abs=1.001 * last)
    except ValueError:
        return one == other


def test_the_logs_are_those_of_mujoco(root: Path, tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    import numpy as np

    from tests.foreign.first_hour import URDF, log

    assert (root / "examples/own_arm/arm.urdf").read_text() == URDF
    shipped = np.loadtxt(root / "examples/own_arm/today_1.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(log("today", 3), shipped, atol=2e-3)
