"""Every command, option, make target and module that a document names exists."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import pytest

from armscope.cli import run
from armscope.usage import COMMANDS
from tests.conftest import ROOT
from tests.documents.commands import PROGRAMS, Command, commands, documents

ALL = list(commands(ROOT))
EVERYWHERE = {"--help", "--no-color", "--version"}
PLACEHOLDER = re.compile(r"[A-Z]+|benchmarks\.NAME")
NOT_IN_THE_REPOSITORY = {"can.viewer": "of python-can", "listen.py": "written by the reader, from the page itself"}
"""What ``python`` runs that is not ours, and where it is from."""


@cache
def _options(name: str) -> frozenset[str]:
    """Options of a command, as its help lists them."""
    import contextlib
    import io

    with contextlib.redirect_stdout(io.StringIO()) as said:
        assert run([name, "--help"]) == 0
    return frozenset(re.findall(r"(?<![\w-])--?[a-z][\w-]*", said.getvalue()))


def _wrong(command: Command) -> str | None:
    program, *rest = command.words
    if program == "armscope":
        return _wrong_armscope(rest)
    if program == "make":
        targets = set(re.findall(r"^([a-z][\w-]*):", (ROOT / "Makefile").read_text(), re.M))
        named = [word for word in rest if "=" not in word]
        return next((f"no target {word}" for word in named if word not in targets), None)
    if program == "pytest":
        return next((f"no {word}" for word in rest if word.startswith("tests") and not (ROOT / word).exists()), None)
    if program == "python":
        return _wrong_module(rest)
    return None


def _wrong_armscope(words: list[str]) -> str | None:
    if not words or words[0].startswith("-") or PLACEHOLDER.fullmatch(words[0]):
        return None
    if words[0] not in COMMANDS:
        return f"no command {words[0]}"
    used = {word.partition("=")[0] for word in words[1:] if re.match(r"--?[a-z]", word)}
    unknown = used - _options(words[0]) - EVERYWHERE
    return f"{words[0]} has no {', '.join(sorted(unknown))}" if unknown else None


def _wrong_module(words: list[str]) -> str | None:
    if "-c" in words:
        return None
    words = words[words.index("-m") :] if "-m" in words else words
    module = words[1] if words[0] == "-m" else words[0]
    if module == "armscope":
        return _wrong_armscope(words[2:])
    if module in NOT_IN_THE_REPOSITORY or PLACEHOLDER.fullmatch(module):
        return None
    place = ROOT / module.replace(".", "/")
    found = [path for path in (place.with_suffix(".py"), place / "__main__.py", place) if path.is_file()]
    if not found:
        return f"no module {module}"
    source = found[0].read_text(encoding="utf-8")
    return next((f"{module} has no {w}" for w in words if w.startswith("--") and f'"{w}"' not in source), None)


@pytest.mark.parametrize("document", sorted({command.document for command in ALL}))
def test_every_command_and_option_of_a_document_exists(document: str) -> None:
    wrong = [f"{command}\n    {why}" for command in ALL if command.document == document and (why := _wrong(command))]
    assert not wrong, "\n".join(wrong)


def test_a_wrong_option_is_found() -> None:
    def wrong(text: str) -> str | None:
        return _wrong(Command("x.md", 1, text, True))

    assert wrong("armscope plot RUN.mcap --outt x.png  # a picture") == "plot has no --outt"
    assert wrong("armscope plott RUN.mcap") == "no command plott"
    assert wrong("make everything") == "no target everything"
    assert wrong("python -m benchmarks.nothing") == "no module benchmarks.nothing"
    assert wrong("python -m tests.blind --nothing") == "tests.blind has no --nothing"
    assert wrong("armscope plot RUN.mcap [--out X.png] ...") is None


def test_all_lines_that_begin_with_a_command_are_seen() -> None:
    """An independent count: lines of blocks whose first word is one of the programs."""
    start = re.compile(rf"^    (?:\$ )?(?:{'|'.join(PROGRAMS)})\b")
    counted = sum(bool(start.match(line)) for path in documents(ROOT) for line in Path(path).read_text().splitlines())
    assert sum(command.whole for command in ALL) >= counted - 3 > 80
