"""Every command of every document is run as it stands, in order, in a folder that has the files it names.

A document marks what is not run: the line ``<!-- not run: REASON -->`` before a block. Of a synopsis, the command is
run without what stands in brackets, and with it. What runs until it is stopped runs until its document ends.
"""

from __future__ import annotations

import importlib.util
import re
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from armscope.cli import run
from tests.conftest import ROOT
from tests.documents.commands import Command, commands
from tests.documents.scenes import lay_out

RUN_BY = {
    "docs/first-hour-own-arm.md": "tests/armscope/test_first_hour.py",
    "docs/thesis.md": "tests/armscope/test_thesis.py",
}
"""Documents whose commands another test runs, and whose numbers it compares."""
ALL = [command for command in commands(ROOT) if command.whole and command.document not in RUN_BY]
READY = {"daemon": "is open", "page": "to watch only", "sim-devices": "ready", "view": "showing"}
"""Commands that run until they are stopped, and what they say on standard error when they are ready."""
VALUES = {
    "COMMAND": "info",
    "NAME": "RUN.mcap",
    "NAME=VALUE": "joint3.coulomb=30",
    "ARM": "Puma 560",
    "DATE": "2026-01",
    "M": "wls",
    "N": "1",
    "X": "10%",
    "Z": "-0.7",
}
"""What a reader puts in the place of a word in capitals; names of files are the files' names."""
SECOND = {"RESULT": ["RESULT", "RESULT2", "RESULT3"]}


def variants(command: Command) -> list[list[str]]:
    """The command lines that a command stands for."""
    text = command.text.partition("  #")[0].replace("[the same options]", "").replace(" ...", "")
    if command.text.startswith("armscope"):
        text = re.sub(r"(?<=\w)\|[\w|]+", "", text)
    without, having = re.sub(r"\[[^\]]*\]", "", text), re.sub(r"[\[\]]", "", text)
    return [_filled(shlex.split(one, comments=True)) for one in dict.fromkeys([without, having])]


def _filled(words: list[str]) -> list[str]:
    repeated = {name: iter(many) for name, many in SECOND.items()}
    return [next(repeated[word]) if word in repeated else VALUES.get(word, word) for word in words]


def statuses(words: list[str]) -> set[int]:
    """With which a command may end: samples lost where a recording was cut off, changed where that is asked for."""
    return (
        {0} | ({4} if any(".active" in word for word in words) else set()) | ({5} if "--fail-above" in words else set())
    )


def without_ffmpeg(words: list[str]) -> bool:
    """Whether the command makes a film that this machine cannot make; other tests say so."""
    there = shutil.which("ffmpeg") or importlib.util.find_spec("imageio_ffmpeg")
    return any(word.endswith(".mp4") for word in words) and not there


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.filterwarnings("error::RuntimeWarning")  # a reader would see its line
@pytest.mark.parametrize("document", sorted({command.document for command in ALL}))
def test_every_command_runs(
    document: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    theirs = [command for command in ALL if command.document == document and not command.not_run]
    if not theirs:
        pytest.skip("the document says of each of its commands why it is not run")
    lay_out(document, tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    wrong: list[str] = []
    with ExitStack() as stack:
        for command in theirs:
            for words in variants(command):
                if words[0] == "armscope" and len(words) > 1 and words[1] in READY:
                    stack.enter_context(_until_stopped(words, tmp_path))
                    continue
                if without_ffmpeg(words):
                    continue
                out = _redirected(words, tmp_path)
                status = run(words[1:]) if words[0] == "armscope" else _python(words[1:], tmp_path)
                said = capfd.readouterr()
                if out is not None:
                    out.write_text(said.out)
                if status not in statuses(words):
                    wrong.append(f"{command}\n    {shlex.join(words)}\n    ended with {status}: {said.err[-300:]}")
    assert not wrong, "\n".join(wrong)


def _python(arguments: list[str], folder: Path) -> int:
    return subprocess.run([sys.executable, *arguments], cwd=folder, stdin=subprocess.DEVNULL).returncode


def _redirected(program: list[str], home: Path) -> Path | None:
    """The file behind > or >>, which are taken off the command."""
    for sign in (">", ">>"):
        if sign in program:
            place = program.index(sign)
            path = Path(program[place + 1].replace("~", str(home)))
            del program[place:]
            return path
    return None


@contextmanager
def _until_stopped(words: list[str], folder: Path) -> Iterator[None]:
    """A service, ready; told to end at the end of the block. Not by SIGINT, which background jobs of a shell ignore."""
    command = [sys.executable, "-m", *words]
    process = subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    try:
        said = ""
        while READY[words[1]] not in said:
            line = process.stderr.readline()
            said += line
            assert line, said
        yield
        process.send_signal(signal.SIGTERM)
        assert process.wait(60) == 0
    finally:
        process.kill()
        process.wait()


def test_what_is_not_run_has_a_reason() -> None:
    left_out = [command for command in ALL if command.not_run]
    assert 0 < len(left_out) < len(ALL) / 5
    assert all(len(command.not_run) > 15 for command in left_out)
    assert all(
        document in (ROOT / test).read_text() or Path(document).name in (ROOT / test).read_text()
        for document, test in RUN_BY.items()
    )


def test_a_synopsis_stands_for_the_command_without_and_with_its_options() -> None:
    command = Command("x.md", 1, "armscope identify RUN.mcap ... [--shape auto|free] [--out DIR]  # a|b", True)
    assert variants(command) == [
        ["armscope", "identify", "RUN.mcap"],
        ["armscope", "identify", "RUN.mcap", "--shape", "auto", "--out", "DIR"],
    ]
