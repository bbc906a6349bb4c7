"""Commands that the documents show: whole lines of indented or fenced blocks, and code within a sentence."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

PROGRAMS = ("armscope", "make", "python", "pytest", "pip")
LINE = re.compile(rf"^(?:\$ )?((?:{'|'.join(PROGRAMS)})(?: .*)?)$")
NOT_RUN = re.compile(r"<!-- not run: (.+) -->")
INLINE = re.compile(rf"`((?:{'|'.join(PROGRAMS)}) [^`]+)`")


@dataclass(frozen=True)
class Command:
    """One command of a document; ``line`` from 1; ``whole``: a line of its own, which a reader copies.

    not_run  why no test runs it: of ``<!-- not run: WHY -->`` before its block; empty where one does
    """

    document: str
    line: int
    text: str
    whole: bool
    not_run: str = ""

    @property
    def words(self) -> list[str]:
        """Its words as a shell splits them, without comment and brackets of what is optional."""
        return shlex.split(re.sub(r"[\[\]…]", " ", self.text).replace("...", " "), comments=True)

    def __str__(self) -> str:
        return f"{self.document}:{self.line}: {self.text}"


def documents(root: Path) -> list[Path]:
    """Everything that a reader may copy a command from."""
    return [root / "README.md", root / "CONTRIBUTING.md", *sorted((root / "docs").rglob("*.md"))]


def commands(root: Path) -> Iterator[Command]:
    """All commands, document by document."""
    for path in documents(root):
        name = path.relative_to(root).as_posix()
        yield from _of(name, path.read_text(encoding="utf-8"))


def _of(name: str, text: str) -> Iterator[Command]:
    fenced, before, began, why = False, "", 0, ""
    for number, line in enumerate(text.splitlines(), 1):
        if mark := NOT_RUN.fullmatch(line):
            why = mark[1]
            continue
        if line.startswith("```"):
            fenced = not fenced
            continue
        code = line[4:] if line.startswith("    ") else line if fenced else None
        if code is None:
            why = why if not line else ""
            yield from (Command(name, number, match, False) for match in INLINE.findall(line))
            continue
        if before:
            code, number = f"{before} {code.strip()}", began
            before = ""
        if code.endswith("\\") and LINE.match(code):
            before, began = code[:-1].rstrip(), number
        elif match := LINE.match(code.rstrip()):
            yield Command(name, number, match[1], True, why)
