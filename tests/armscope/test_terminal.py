"""The commands in a terminal and in a pipe: help with examples, completion, colours, JSON."""

from __future__ import annotations

import json
import os
import pty
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from armscope.cli import COMMANDS, parser_of, run, spread
from armscope.completion import SHELLS, options_of
from armscope.usage import EXAMPLES
from tests.arm_archive.lab import record

COLOUR = re.compile(r"\x1b\[[0-9;]*[349][0-7][;m]")
SERVICES = {"daemon", "page", "sim-devices", "view"}
"""Commands that run until they are stopped; they have no result to print."""
NO_RESULT = {*SERVICES, "demo"}
"""The demo shows the outputs of other commands."""
MANY = {"identify": ("--held-out",), "diagnose": ("--fit", "--held-out"), "compare": ("--before", "--after")}


@pytest.mark.parametrize("name", COMMANDS)
def test_help_shows_examples_within_80_columns(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run([name, "--help"]) == 0
    shown = capsys.readouterr().out
    assert "\x1b" not in shown
    examples = shown.partition("examples:\n")[2].strip().splitlines()
    assert [line.strip() for line in examples] == list(EXAMPLES[name])
    assert max(len(line) for line in shown.partition("examples:")[0].splitlines()) <= 80


@pytest.mark.parametrize("line", [line for lines in EXAMPLES.values() for line in lines])
def test_examples_are_command_lines_that_parse(line: str) -> None:
    program, name, *arguments = shlex.split(line.partition(" > ")[0])
    assert program == "armscope" and line in EXAMPLES[name]
    parser_of(name).make_context(name, spread(arguments, MANY.get(name, ())))


@pytest.mark.parametrize("name", sorted(COMMANDS.keys() - NO_RESULT))
def test_every_result_is_also_json(name: str) -> None:
    assert "--json" in options_of(parser_of(name))


@pytest.fixture(scope="module")
def completion() -> dict[str, str]:
    options = {name: options_of(parser_of(name)) for name in COMMANDS}
    return {shell: write(COMMANDS, options) for shell, write in SHELLS.items()}


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["arch"], {"archive"}),
        (["i"], {"init", "info", "import", "identify"}),
        (["trend", "--li"], {"--limit"}),
        (["identify", "a.mcap", "--held"], {"--held-out"}),
        (["info", "ru"], {"run.mcap"}),
    ],
)
def test_bash_completes(words: list[str], expected: set[str], completion: dict[str, str], tmp_path: Path) -> None:
    if shutil.which("bash") is None:
        pytest.skip("there is no bash")
    (tmp_path / "run.mcap").touch()
    (tmp_path / "script").write_text(completion["bash"])
    line = " ".join(f"'{word}'" for word in ["armscope", *words])
    code = (
        f'source ./script; COMP_WORDS=({line}); COMP_CWORD={len(words)}; _armscope; printf "%s\\n" "${{COMPREPLY[@]}}"'
    )
    shown = subprocess.run(["bash", "-c", code], cwd=tmp_path, capture_output=True, text=True)
    assert shown.stderr == "" and set(shown.stdout.split()) == expected


def test_every_shell_knows_every_command_and_option(completion: dict[str, str]) -> None:
    for shell, script in completion.items():
        for name in COMMANDS:
            assert re.search(rf"\b{name}\b", script), (shell, name)
    assert "-l held-out" in completion["fish"] and completion["bash"] in completion["zsh"]


def test_the_command_prints_the_script(completion: dict[str, str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["completion", "bash", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"shell": "bash", "script": completion["bash"]}
    assert run(["completion", "tcsh"]) == 2


def in_terminal(arguments: list[str], folder: Path, root: Path, **variables: str) -> str:
    """What a command shows in a terminal of its own (standard error)."""
    ours, theirs = pty.openpty()
    environment = {name: value for name, value in os.environ.items() if name != "NO_COLOR"}
    environment |= {"TERM": "xterm-256color", "PYTHONPATH": str(root), **variables}
    command = [sys.executable, "-m", "armscope", *arguments]
    process = subprocess.Popen(command, cwd=folder, stderr=theirs, stdout=subprocess.DEVNULL, env=environment)
    os.close(theirs)
    shown = b""
    while True:
        try:
            part = os.read(ours, 65536)
        except OSError:
            break
        if not part:
            break
        shown += part
    os.close(ours)
    assert process.wait(timeout=60) == 0
    return shown.decode()


def test_colours_are_off_when_asked(tmp_path: Path, root: Path) -> None:
    record(tmp_path / "run.mcap")
    assert COLOUR.search(in_terminal(["archive", "."], tmp_path, root))
    for arguments, variables in (([], {"NO_COLOR": "1"}), (["--no-color"], {})):
        shown = in_terminal(["archive", ".", *arguments], tmp_path, root, **variables)
        assert shown and not COLOUR.search(shown)


def test_a_pipe_gets_no_colour_and_no_progress(tmp_path: Path, root: Path) -> None:
    record(tmp_path / "run.mcap")
    environment = {**os.environ, "PYTHONPATH": str(root), "TERM": "xterm-256color"}
    command = [sys.executable, "-m", "armscope", "archive", "."]
    shown = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert shown.returncode == 0 and shown.stderr == "" and "\x1b" not in shown.stdout
