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

from armscope.application import command_of
from armscope.cli import run
from armscope.completion import SHELLS, options_of
from armscope.usage import COMMANDS, EXAMPLES
from tests.arm_archive.lab import record

COLOUR = re.compile(r"\x1b\[[0-9;]*[349][0-7][;m]")


@pytest.mark.parametrize("name", COMMANDS)
def test_help_shows_examples_within_80_columns(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run([name, "--help"]) == 0
    shown = capsys.readouterr().out
    assert "\x1b" not in shown
    # a type is a letter or a kind of file, not Python's word for it
    assert re.findall(r"<[a-z][^>]*>|list\[", shown) == []
    examples = shown.partition("examples:\n")[2].strip().splitlines()
    assert [line.strip() for line in examples] == list(EXAMPLES[name])
    assert max(len(line) for line in shown.partition("examples:")[0].splitlines()) <= 80


@pytest.mark.parametrize("line", [line for lines in EXAMPLES.values() for line in lines])
def test_examples_are_command_lines_that_parse(line: str) -> None:
    program, name, *arguments = shlex.split(line.partition(" > ")[0])
    assert program == "armscope" and line in EXAMPLES[name]
    command_of(name).make_context(name, arguments)


@pytest.mark.parametrize("name", COMMANDS)
def test_every_result_is_also_json(name: str) -> None:
    assert "--json" in options_of(command_of(name))


@pytest.fixture(scope="module")
def completion() -> dict[str, str]:
    options = {name: options_of(command_of(name)) for name in COMMANDS}
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


@pytest.mark.parametrize(
    ("line", "expected", "other"),
    [
        ("armscope arch", {"archive"}, {"trend"}),
        ("armscope trend --li", {"--limit"}, {"--arm"}),
        ("armscope archive lab plot --ver", {"--verdict"}, {"--animate"}),
        ("armscope archive lab plot --an", set(), {"--animate"}),
        ("armscope info ru", {"run.mcap"}, {"record"}),
    ],
)
def test_fish_completes(
    line: str, expected: set[str], other: set[str], completion: dict[str, str], tmp_path: Path
) -> None:
    if shutil.which("fish") is None:
        pytest.skip("there is no fish")
    (tmp_path / "run.mcap").touch()
    (tmp_path / "script").write_text(completion["fish"])
    code = f'source ./script; complete -C "{line}"'
    shown = subprocess.run(["fish", "--no-config", "-c", code], cwd=tmp_path, capture_output=True, text=True)
    words = {one.split("\t")[0] for one in shown.stdout.splitlines()}
    assert shown.stderr == "" and expected <= words and not words & other


@pytest.mark.parametrize(
    ("typed", "completed"),
    [
        ("armscope arch", "armscope archive"),
        ("armscope trend --li", "armscope trend --limit"),
        ("armscope info ru", "armscope info run.mcap"),
    ],
)
def test_zsh_completes(typed: str, completed: str, completion: dict[str, str], tmp_path: Path) -> None:
    if shutil.which("zsh") is None:
        pytest.skip("there is no zsh")
    (tmp_path / "run.mcap").touch()
    (tmp_path / "script").write_text(completion["zsh"])
    ours, theirs = pty.openpty()
    environment = {**os.environ, "TERM": "xterm", "HOME": str(tmp_path)}
    zsh = subprocess.Popen(
        ["zsh", "-f", "-i"], cwd=tmp_path, stdin=theirs, stdout=theirs, stderr=theirs, env=environment
    )
    os.close(theirs)
    try:
        # the line that is completed becomes the argument of print
        os.write(ours, b"PS1='> '; autoload -Uz compinit; compinit -u; source ./script; print rea''dy\n")
        until(ours, "ready")
        os.write(ours, f"{typed}\t\x01print -r -- \x05 >said; print do''ne\n".encode())
        until(ours, "done")
        assert (tmp_path / "said").read_text().strip() == completed
    finally:
        zsh.kill()
        zsh.wait()
        os.close(ours)


def until(terminal: int, text: str) -> str:
    """What a terminal shows until a text has come."""
    shown = ""
    while text not in shown:
        shown += os.read(terminal, 65536).decode(errors="replace")
    return shown


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
