"""The wheel, installed beside other people's packages and used in an empty folder, outside any checkout."""

from __future__ import annotations

import importlib.metadata
import os
import shutil
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow


class Installed:
    """A virtual environment with the wheel in it; it sees the dependencies of the environment that runs the tests."""

    def __init__(self, root: Path, folder: Path) -> None:
        self.home, self.empty = folder / "venv", folder / "empty"
        self.empty.mkdir()
        # A copy: what an earlier build left behind in the checkout must not get into the wheel.
        source = shutil.copytree(
            root, folder / "source", ignore=shutil.ignore_patterns(".*", "build", "*.egg-info", "*.mcap")
        )
        pip = [sys.executable, "-m", "pip", "--disable-pip-version-check"]
        recent = int(importlib.metadata.version("setuptools").partition(".")[0]) >= 77
        wheels = ["wheel", "-q", "--no-deps", "-w", str(folder), *["--no-build-isolation"] * recent, str(source)]
        subprocess.run([*pip, *wheels], check=True, timeout=120)
        (wheel,) = folder.glob("armscope-*.whl")
        venv.create(self.home, with_pip=False)
        python = str(self.home / "bin/python")
        (site,) = self.home.glob("lib/python3*/site-packages")
        # The .pth comes after the environment's own packages: what the wheel carries is found first.
        (site / "dependencies.pth").write_text(sysconfig.get_path("purelib"))
        subprocess.run(
            [*pip, "--python", python, "install", "-q", "--no-deps", str(wheel), "inputs"], check=True, timeout=120
        )

    def run(self, *command: str, timeout: float = 60) -> str:
        """Standard output of a program of the environment, in the empty folder; it must end well."""
        environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
        ended = subprocess.run(
            [str(self.home / "bin" / command[0]), *command[1:]],
            cwd=self.empty,
            env=environment,
            text=True,
            capture_output=True,
            timeout=timeout,
        )
        assert ended.returncode == 0, ended.stderr
        return ended.stdout


@pytest.fixture(scope="module")
def installed(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Installed:
    return Installed(root, tmp_path_factory.mktemp("installed"))


def test_no_module_is_taken_from_the_checkout(installed: Installed, root: Path) -> None:
    names = "armscope arm_io arm_model daq diagnosis drivers experiment identification sim_backend"
    code = f"import {names.replace(' ', ', ')}; print(*(m.__file__ for m in ({names.replace(' ', ', ')})), sep='\\n')"
    files = installed.run("python", "-c", code).splitlines()
    assert len(files) == len(names.split())
    assert all(str(installed.home) in file for file in files)


def test_a_package_for_game_controllers_stays_what_it_is(installed: Installed) -> None:
    """``inputs``, often installed where robots are: it was once the name of a package of ours."""
    code = "import inputs, armscope; print(inputs.__file__, inputs.DeviceManager.__name__, armscope.__version__)"
    file, name, _ = installed.run("python", "-c", code).split()
    assert str(installed.home) in file and name == "DeviceManager"


def test_all_that_is_shipped_is_installed(installed: Installed, root: Path) -> None:
    code = "from armscope.shipped import shipped_folder; print(shipped_folder())"
    folder = Path(installed.run("python", "-c", code).strip())
    assert folder.is_relative_to(installed.home)
    ours = {path.relative_to(root / "config") for path in (root / "config").rglob("*") if path.is_file()}
    theirs = {path.relative_to(folder) for path in folder.rglob("*") if path.is_file()}
    assert {path for path in ours - theirs if path.suffix not in (".py", ".pyc")} == set()


def test_commands_work_in_an_empty_folder(installed: Installed) -> None:
    assert "6 joints" in installed.run("armscope", "model", "config/models/puma560.toml")
    for like in ("sim", "lab", "can", "csv"):
        installed.run("armscope", "init", like, "--like", like)
    assert "all is well" in installed.run("armscope", "doctor", "sim/rig.toml")
    motion = ("--model", "csv/model.toml", "--experiment", "csv/experiments/first_move.toml")
    installed.run("armscope", "simulate", *motion, "--out", "run.mcap")
    installed.run("armscope", "export", "run.mcap", "--out", "table.csv")
    imported = installed.run("armscope", "import", "table.csv", "--rig", "csv/rig.toml", "--out", "again.mcap")
    assert "2 joints" in imported


def test_the_demo_runs_in_an_empty_folder(installed: Installed) -> None:
    printed = installed.run("armscope", "demo", "--out", "demo", timeout=300)
    assert (installed.empty / "demo/identified/report.html").is_file()
    assert (installed.empty / "demo/currents.png").read_bytes().startswith(b"\x89PNG")
    assert Path(printed.splitlines()[-1]).read_bytes().startswith(b"<!doctype html>")
