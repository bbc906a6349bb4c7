"""The front door itself: what it costs to open, and how it ends."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from armscope.application import spread
from armscope.cli import run
from armscope.exit_status import INTERRUPTED
from armscope.usage import COMMANDS
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table

HEAVY = {"numpy", "scipy", "matplotlib", "zenoh", "llvmlite", "mcap", "pydantic", "rich", "tomllib", "tomli_w"}


def imported_by(root: Path, *arguments: str) -> tuple[str, set[str]]:
    """Standard output of a command line in a process of its own, and the modules that it imported."""
    code = (
        "import sys; from armscope.cli import run; status = run(sys.argv[1:])\n"
        "print('\\n'.join(sorted(sys.modules)), file=sys.stderr); sys.exit(status)"
    )
    shown = subprocess.run([sys.executable, "-c", code, *arguments], cwd=root, capture_output=True, text=True)
    assert shown.returncode == 0, shown.stderr
    return shown.stdout, set(shown.stderr.split())


@pytest.mark.parametrize("arguments", [["--help"], ["-h"], ["--version"], []])
def test_the_list_of_commands_imports_no_command_and_nothing_heavy(arguments: list[str], root: Path) -> None:
    shown, modules = imported_by(root, *arguments)
    assert arguments == ["--version"] or all(f"  {name} " in shown for name in COMMANDS)
    assert not modules & HEAVY and not {name for name in modules if name.startswith("armscope.commands")}
    # Typer alone takes ten times as long as Python's own start
    assert not modules & {"typer", "click", "inspect", "tempfile"}


@pytest.mark.parametrize("columns", [20, 50, 80, 300])
def test_the_list_of_commands_is_one_text_and_fits(
    columns: int, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    assert run(["--help"]) == 0
    alone = capsys.readouterr().out
    assert run(["--no-color", "--help"]) == 0
    assert capsys.readouterr().out == alone
    assert max(map(len, alone.splitlines())) <= max(columns, 45)
    assert " ".join(alone.split()).count(" ".join(COMMANDS["diagnose"].split())) == 1


@pytest.mark.parametrize("arguments", [["trend", "x", "--limit"], ["model", "--json=3", "x"]])
def test_a_refused_option_is_named_with_its_command(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(arguments) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"error: {arguments[0]}: Option '--")
    assert said.endswith(f"; see 'armscope {arguments[0]} --help'\n")


def test_a_command_imports_no_other(root: Path) -> None:
    _, modules = imported_by(root, "identify", "--help")
    commands = {name for name in modules if name.startswith("armscope.commands.")}
    assert commands == {"armscope.commands.identify", "armscope.commands.options"}
    assert not modules & HEAVY


def test_a_recording_is_opened_without_scipy(root: Path, tmp_path: Path) -> None:
    """It takes as long to import as everything else that ``info`` needs."""
    t = np.arange(20) / 100.0
    write_table(tmp_path / "a.mcap", t, {"q": np.zeros((20, 1)), "i": np.zeros((20, 1))}, Attachments())
    shown, modules = imported_by(root, "info", str(tmp_path / "a.mcap"))
    assert "20" in shown and "numpy" in modules and "scipy" not in modules


def test_every_command_has_a_file_and_every_file_a_command(root: Path) -> None:
    files = {path.stem for path in (root / "armscope/commands").glob("*.py")} - {"__init__", "options"}
    assert {name.rstrip("_").replace("_", "-") for name in files} == set(COMMANDS)


@pytest.mark.parametrize(
    "arguments",
    [
        ["juggle"],
        ["--juggle"],
        ["record"],
        ["info"],
        ["info", "a", "b"],
        ["info", "a", "--juggle"],
        ["--no-color", "info", "a"],
        ["identify", "a", "--model", ""],
        ["replay", "a", "--speed", "fast"],
        ["replay", "a", "--speed", "nan"],
        ["replay", "a", "--wait", "-3"],
        ["model", "--effects", "a.toml", "--out", "b.toml"],
        ["model", "--effects", "--gear", "100"],
        ["model", "a.toml", "--equations", "text", "--formulations"],
        ["model", "a.toml", "--equations", "text", "--json"],
        ["view", "a", "--port", "99999"],
        ["export", "a", "--out", "b", "--to", "xml"],
    ],
)
def test_a_wrong_command_line_is_one_line_and_exit_2(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(arguments) == 2
    shown = capsys.readouterr()
    assert shown.out == "" and shown.err.startswith("error: ") and shown.err.count("\n") == 1
    assert "Value error" not in shown.err


def test_what_was_meant_is_proposed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["dignose"]) == 2
    assert capsys.readouterr().err == "error: dignose: no such command; did you mean diagnose?\n"
    recording = tmp_path / "run.mcap"
    recording.write_bytes(b"\x89MCAP0\r\n")
    assert run(["model", str(recording)]) == 2
    assert "is a recording (MCAP); a text file is expected here" in capsys.readouterr().err


def test_one_option_takes_several_values() -> None:
    line = ["--fit", "a", "b", "--held-out", "c", "--out", "d"]
    wide = ["--fit", "a", "--fit", "b", "--held-out", "c", "--out", "d"]
    assert spread(line, ("--fit", "--held-out")) == wide
    assert spread(["--gear", "100", "-80", "-h"], ("--gear",)) == ["--gear", "100", "--gear", "-80", "-h"]


@pytest.mark.parametrize("arguments", [["--help"], ["model", "--effects", "--json"]])
def test_a_reader_that_has_gone_is_no_error(arguments: list[str], root: Path) -> None:
    """As ``armscope --help | true``: the pipe is closed before anything is written to it."""
    theirs, ours = os.pipe()
    os.close(theirs)
    command = [sys.executable, "-m", "armscope", *arguments]
    ended = subprocess.run(command, cwd=root, stdout=ours, stderr=subprocess.PIPE, text=True)
    os.close(ours)
    assert (ended.returncode, ended.stderr) == (1, "")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="only Linux has a device that is always full")
@pytest.mark.parametrize("arguments", [["--version"], ["model", "--effects", "--json"]])
def test_output_to_a_full_disk_ends_in_one_line(arguments: list[str], root: Path) -> None:
    command = [sys.executable, "-m", "armscope", *arguments]
    with open("/dev/full", "w") as full:
        ended = subprocess.run(command, cwd=root, stdout=full, stderr=subprocess.PIPE, text=True)
    line = "error: standard output: cannot be written: No space left on device\n"
    assert (ended.returncode, ended.stderr) == (2, line)


UNFINISHED = """
import sys, time
from types import SimpleNamespace
import armscope.application
from armscope.cli import main
from arm_io.results import whole_path
from arm_io.whole_folder import whole_folder

def work(*_, **options):
    with whole_folder("results", "result") as here, whole_path("moving.gif") as picture:
        (here / "report.html").write_text("half a page")
        picture.write_text("half a picture")
        print("begun", flush=True)
        time.sleep(60)

armscope.application.application = lambda: SimpleNamespace(main=work)
main(["info"])
"""


def test_an_interruption_before_the_command_is_known_is_one_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(_: list[str]) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("armscope.cli.answer", interrupted)
    assert run(["diagnose"]) == INTERRUPTED
    assert capsys.readouterr().err == "interrupted\n"


def test_nothing_unfinished_is_left_of_a_command_that_is_told_to_end(tmp_path: Path, root: Path) -> None:
    """SIGTERM, of ``timeout``, ``kill`` or systemd, left ``.results*.part`` with half of the results."""
    process = subprocess.Popen(
        [sys.executable, "-c", UNFINISHED],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(root)},
        stdout=subprocess.PIPE,
    )
    assert process.stdout is not None and process.stdout.readline() == b"begun\n"
    assert len(list(tmp_path.iterdir())) == 2
    process.terminate()
    process.stdout.close()
    assert process.wait(30) == -signal.SIGTERM
    assert list(tmp_path.iterdir()) == []


def test_without_its_packages_no_daemon_is_started_for_a_page(
    tmp_path: Path, root: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It opened the devices of the rig, and said then what was missing."""
    monkeypatch.setitem(sys.modules, "starlette", None)
    line = ["page", str(root / "config/puma560_sim.toml"), "--recordings", str(tmp_path / "recordings")]
    assert run(line) == 2
    said = capsys.readouterr().err
    assert said.startswith("error: page: needs the package starlette") and "daemon" not in said
    assert list(tmp_path.iterdir()) == []
