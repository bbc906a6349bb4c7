"""``armscope init``: what it writes is accepted by every command that reads it.

Its README's first commands work as they stand.
"""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path

import pytest

from arm_model import read_model
from armscope.cli import run
from armscope.commands.init import Like
from daq.rig.preflight import check_motion
from daq.rig.rig_file import read_rig
from experiment import read_experiment
from tests.drivers.test_whole_rigs import devices
from tests.ports import free_port


def project(folder: Path, like: str) -> Path:
    """A starter project with an endpoint and a name of its own."""
    project = folder / f"{like}-{os.getpid()}"
    assert run(["init", str(project), "--like", like]) == 0
    rig = project / "rig.toml"
    text = rig.read_text().replace('pace = "wall"', 'pace = "fast"')
    rig.write_text(f'{text}\n[zenoh]\nendpoint = "tcp/127.0.0.1:{free_port()}"\n')
    return project


def first_commands(project: Path) -> list[list[str]]:
    """The commands of the README ahead of its list of what to edit, without 'armscope'."""
    text = (project / "README.md").read_text().partition("What to edit")[0]
    return [line.partition("#")[0].split() for line in re.findall(r"^    armscope (.*)$", text, re.MULTILINE)]


@pytest.mark.parametrize("like", list(Like))
def test_every_file_fits_every_other(tmp_path: Path, like: Like) -> None:
    folder = project(tmp_path, like)
    rig, arm = read_rig(folder / "rig.toml"), read_model(folder / "model.toml")
    assert rig.name == f"{like}_{os.getpid()}" and rig.model_path == folder / "model.toml"
    assert rig.joints == len(arm)
    experiments = sorted((folder / "experiments").glob("*.toml"))
    assert experiments
    for path in experiments:
        motion = read_experiment(path)
        assert len(motion.start) == len(arm)
        assert check_motion(rig, motion) == []
    for text in (path.read_text() for path in folder.rglob("*.toml")):
        assert "config/" not in text, "names a file that the project does not have"
    assert run(["model", str(folder / "model.toml")]) == 0


@pytest.mark.parametrize("like", ["sim", "csv"])
def test_the_first_commands_of_the_readme_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, like: str, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = project(tmp_path, like)
    monkeypatch.chdir(folder)
    commands = [line for line in first_commands(folder) if line[0] not in ("identify", "diagnose")]
    commands = [line for line in commands if "excitation" not in " ".join(line)]  # 26 s each
    assert len(commands) >= 4
    for arguments in commands:
        assert run(arguments) == 0, f"{arguments}: {capsys.readouterr()}"
    assert {"sim": "first.mcap", "csv": "fit.mcap"}[like] in os.listdir()


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="ptys and multicast as on Linux")
@pytest.mark.parametrize(("like", "ports"), [("lab", ("50502", "50702", "50703")), ("can", ("50740",))])
def test_a_rig_of_real_drivers_works_against_its_simulators(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, like: str, ports: tuple[str, ...]
) -> None:
    folder = project(tmp_path, like)
    rig = folder / "rig.toml"
    changes = {port: str(free_port()) for port in ports} | {"/tmp/armscope": str(tmp_path)}
    changes["239.74.163.40"] = f"239.74.163.{os.getpid() % 200 + 50}"
    text = rig.read_text()
    for old, new in changes.items():
        text = text.replace(old, new)
    rig.write_text(text)
    monkeypatch.chdir(folder)
    with devices(root, rig):
        assert run(["doctor", "rig.toml"]) == 0
        (record,) = [line for line in first_commands(folder) if line[0] == "record"]
        assert run(record) in (0, 4)  # a host that is busy may miss a row, and says so
    assert (folder / "first.mcap").is_file()


def test_an_occupied_folder_is_left_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    assert run(["init", str(tmp_path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line == f"error: {tmp_path}: is not empty; a starter project must have a folder of its own"
    assert os.listdir(tmp_path) == ["mine.txt"]
    assert run(["init", str(tmp_path / "mine.txt")]) == 2
    assert "is a file" in capsys.readouterr().err
