"""Every command of docs/thesis.md runs, and gives the numbers that the page states."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

COMMAND = re.compile(r"^    ((?:python -m|armscope) .+)$|`((?:python -m|armscope) [a-z][^`]+)`", re.MULTILINE)

PAGE = (Path(__file__).resolve().parents[2] / "docs/thesis.md").read_text()
COMMANDS = sorted({a or b for a, b in COMMAND.findall(PAGE)})


def run(root: Path, folder: Path, command: str) -> str:
    """Standard output of a command of the page, run in a folder of its own."""
    words = shlex.split(command)
    words = [sys.executable, *words[1:]] if words[0] == "python" else [sys.executable, "-m", *words]
    environment = {**os.environ, "PYTHONPATH": str(root), "MPLBACKEND": "agg"}
    done = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, timeout=900)
    assert done.returncode == 0, done.stderr
    return done.stdout


def number(pattern: str, text: str) -> float:
    found = re.search(pattern, text)
    assert found, (pattern, text)
    return float(found[1])


def _identify_is_described_elsewhere(command: str) -> bool:
    """The options alone are named here; docs/identification.md has the whole command."""
    return command == "armscope identify --method friction"


def test_the_page_has_its_commands() -> None:
    assert {"python -m examples.motor_link", "python -m examples.vertical --out vertical"} <= set(COMMANDS)
    assert len(COMMANDS) >= 10


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("command", [c for c in COMMANDS if not _identify_is_described_elsewhere(c)])
def test_every_command_of_the_page_runs(command: str, root: Path, tmp_path: Path) -> None:
    said = run(root, tmp_path, command)
    if "examples.motor_link" in command:
        _table_5_1(json.loads(run(root, tmp_path, f"{command} --json")))
    if "examples.vertical" in command:
        assert "backlash of joint 2" in said
        gap, std = number(r"half gap (\S+) ±", said), number(r"half gap \S+ ± (\S+) rad", said)
        assert abs(gap - 1e-3) < std < 4e-4  # printed with two std
    if "examples.coupling" in command:
        _table_5_2(json.loads((tmp_path / "coupling/coupling.json").read_text()))
    if "thesis_kinematics" in command:
        assert 78 < number(r"circle_point_both_improvement_percent\s+(\S+)", said) < 86
        assert 88 < number(r"move2_improvement_percent\s+(\S+)", said) < 93
        assert 90 < number(r"move3_improvement_percent\s+(\S+)", said) < 95
        assert number(r"sweeps_and_40_poses_improvement_percent\s+(\S+)", said) > 99.4
    if "benchmarks.pendulum" in command:
        assert number(r"ours_vs_scipy\s+(\S+)", said) > 10
        assert number(r"differs_sympy_lambdify\s+(\S+)", said) < 1e-9


def _table_5_1(table: dict[str, dict[str, float]]) -> None:
    for name, row in table.items():
        for column, value in row.items():
            bound = 0.011 if column.startswith("thesis") else 0.003
            assert abs(value - row["given"]) < bound * max(row["given"], 1.0), (name, column)


def _table_5_2(table: dict[str, dict[str, dict[str, dict[str, float]]]]) -> None:
    """Moving others make friction negative; without their torque it is what it is."""
    friction = table["joint2"]["values"]["coulomb_positive"]
    assert friction["others moving"] < 0
    assert abs(friction["coupling taken out"] / friction["true"] - 1) < 0.1
    assert abs(friction["whole arm"] / friction["true"] - 1) < 0.02
