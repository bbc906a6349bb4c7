"""How a command line ended, in process: its exit status, what it said, and whether that is as the contract has it.

A command may refuse in one line (exit status 2). Everything else that is not a result is a crash: another exception,
a warning of the interpreter or of numpy, a refusal of what a command made up itself, a number that is none in a result,
and a command that takes more time or memory than these small files can need.
"""

from __future__ import annotations

import io
import json
import re
import resource
import signal
import threading
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

from matplotlib.figure import Figure
from PIL import Image

from armscope.application import DONE
from armscope.cli import run
from armscope.exit_status import UNUSABLE_INPUT

CHANGED = 5
"""Exit status of ``compare --fail-above``."""
LONGEST = 900.0
"""s of processor time that a command may take; the longest of 500 arms takes a tenth."""
MEMORY = 4 << 30
"""bytes that the process may ask for."""
SAYS_NOTHING = re.compile(
    r"(?<![\w.-])(nan|[+-]?inf|None|0 of 0|np\.float64)(?![\w-])|\barray\(|<[\w.]+ object|\w+Warning: |\bTraceback "
)
"""What is no number, no quantity and no English; in the text of a command's results and notes."""


@dataclass(frozen=True)
class Ended:
    """How a command ended: its exit status (None: by an exception), standard error or traceback.

    ``flaws`` of the files that all commands wrote stand as one more command that has no exit status.
    """

    command: str
    status: int | None
    said: str

    @property
    def well(self) -> bool:
        """Done, or refused in one line that says what is wrong; beside it only notes and warnings, in plain words."""
        lines = self.said.splitlines()
        beside = [line for line in lines if line.startswith(("note:", "warning:"))]
        if any(SAYS_NOTHING.search(_without_names(line)) for line in beside):
            return False
        if self.status == UNUSABLE_INPUT:
            left = [line for line in lines if line not in beside]
            # the arms here are possible, and have no effects: what is impossible, a command made up
            blames_itself = any(" makes " in line and " impossible: " in line for line in left)
            # and these files are small
            blames_itself |= any("needs more memory" in line for line in left)
            return (
                len(left) == 1 and left[0].startswith("error: ") and not blames_itself and "nan" not in left[0].split()
            )
        if self.status == CHANGED:
            # one line says what did, and beyond what
            return (
                sum(line.startswith("changed beyond --fail-above ") for line in lines) == len(lines) - len(beside) == 1
            )
        return self.status == DONE and len(beside) == len(lines)


class TakesTooLong(BaseException):
    """Raised in a command after ``LONGEST``; no ``except Exception`` of it stops that."""


def called(*arguments: object) -> Ended:
    """One command line, in process; what it prints is judged by ``unfit``."""
    words = [str(one) for one in arguments]
    out, said, line = io.StringIO(), io.StringIO(), " ".join(words)
    try:
        with redirect_stdout(out), redirect_stderr(said), _bounded(), warnings.catch_warnings():
            for category in (RuntimeWarning, UserWarning):
                warnings.simplefilter("always", category)
            status = run(words)
    except (Exception, TakesTooLong):
        return Ended(line, None, traceback.format_exc())
    if status != UNUSABLE_INPUT and (what := unfit(words, out.getvalue())):
        return Ended(line, None, f"{said.getvalue()}printed: {what}")
    return Ended(line, status, said.getvalue())


def unfit(words: list[str], printed: str) -> str:
    """What is wrong with what a command printed; empty where nothing is.

    With ``--json`` it is JSON and nothing else, without NaN and infinity; text has no number that is none. Equations
    are programs.
    """
    if "--json" in words:
        try:
            json.loads(printed, parse_constant=_no_number)
        except ValueError as error:
            return f"no strict JSON: {error}"
        return ""
    found = None if "--equations" in words else SAYS_NOTHING.search(_without_names(printed))
    return "" if found is None else repr(printed[max(found.start() - 60, 0) : found.end() + 60])


def _without_names(text: str) -> str:
    """Without what is quoted: names and words of the stranger's own files."""
    return re.sub(r"'[^'\n]*'|\"[^\"\n]*\"", "''", text)


def _no_number(word: str) -> None:
    raise ValueError(f"{word} in JSON")


@contextmanager
def _bounded() -> Iterator[None]:
    """Within it, ``LONGEST`` s of processor time may pass; only a process's main thread can be stopped."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(_: int, frame: FrameType | None) -> None:
        raise TakesTooLong(f"more than {LONGEST:g} s of processor time")

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, LONGEST)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def bound_memory() -> None:
    """From now on this process may have ``MEMORY``; beyond it a command ends in one line, which is a crash here."""
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, resource.getrlimit(resource.RLIMIT_DATA)[1]))


@contextmanager
def unrendered() -> Iterator[None]:
    """Pictures are composed, but not turned into pixels, which takes most of the time of a report."""
    rendered = Figure.savefig

    def left_out(_: Figure, to: Any, **options: Any) -> None:
        if options.get("format") == "png":
            Image.new("RGB", (1, 1)).save(to, "png")
        elif hasattr(to, "write"):
            to.write("<svg/>" if isinstance(to, io.StringIO) else _dot())
        else:
            Path(to).write_text("<svg/>")

    Figure.savefig = left_out  # type: ignore[method-assign]
    try:
        yield
    finally:
        Figure.savefig = rendered  # type: ignore[method-assign]


def _dot() -> bytes:
    """A picture of one pixel, for what reads a picture again."""
    pixel = io.BytesIO()
    Image.new("RGB", (1, 1)).save(pixel, "png")
    return pixel.getvalue()


def kind(ended: Ended) -> str:
    """The command and its last line without names, numbers and paths: equal for equal endings."""
    last = ([line for line in ended.said.splitlines() if line.strip()] or [""])[-1]
    if ended.status is None:
        where = re.findall(r'File "[^"]*?/(\w+/\w+\.py)", line (\d+)', ended.said)
        ours = [f"{file}:{line}" for file, line in where if "site-packages" not in file]
        last = f"{ours[-1] if ours else ''} {last}"
    last = re.sub(r"/\S*/", "", last)
    return f"{ended.command.split()[0]}: " + re.sub(r"\d+(\.\d+)?(e[-+]\d+)?", "N", last)[:150]
