"""Commands on spoiled copies of a stranger's files: cut short, numbers that are none, other columns, wrong names.

Each ends in a result, or in one line with nothing written. A file may be spoiled and still say something whole.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from armscope.exit_status import UNUSABLE_INPUT
from tests.foreign.ended import Ended, called, unrendered

Generator = np.random.Generator
LOST = 4
"""Exit status: done, but rows of a recording are missing."""
WORDS = ("nan", "inf", "-inf", "1e999", "-1e300", "1e300", "-1", "0", '"word"', "word", "", "[]", "{}", "true")
"""Where a number was."""
NUMBER = re.compile(r"(?<![\w.])-?\d+\.?\d*(?:e[-+]?\d+)?(?![\w.])")


@dataclass(frozen=True)
class Files:
    """An arm's model, two recordings of it, and the first of them as a table."""

    model: Path
    fit: Path
    held_out: Path
    table: Path


def through_spoiled_files(seed: int, folder: Path, count: int) -> Iterator[Ended]:
    """``spoiled_commands`` on what ``through_every_command`` left in a folder; none where a file of it is missing."""
    models = [one for one in (folder / "arm.urdf", folder / "arm.toml") if one.exists()]
    files = Files(*models[:1], folder / "run1.mcap", folder / "run2.mcap", folder / "run.csv") if models else None
    if files is not None and all(one.exists() for one in (files.fit, files.held_out, files.table)):
        (folder / "spoiled").mkdir()
        yield from spoiled_commands(files, folder / "spoiled", np.random.default_rng([seed, 2]), count)


def spoiled_commands(files: Files, folder: Path, rng: Generator, count: int) -> Iterator[Ended]:
    """``count`` spoiled models, tables and recordings, each by every command that reads it; and wrong names.

    folder: an empty one, which keeps the spoiled files of commands that did not end well
    """
    out = folder / "out"
    for _ in range(count):
        bad = folder / f"bad{files.model.suffix}"
        bad.write_text(spoiled_text(files.model.read_text(), rng))
        yield from _each(_of_model(replace(files, model=bad), out), bad, out)
        bad = folder / "bad.csv"
        bad.write_text(spoiled_table(files.table.read_text(), rng))
        yield from _each(_of_table(files, bad, out), bad, out)
        bad = folder / "bad.mcap"
        bad.write_bytes(spoiled_bytes(files.fit.read_bytes(), rng))
        yield from _each(_of_recording(replace(files, fit=bad), out), bad, out)
    yield from _each(_of_names(files, out), files.model, out)


def spoiled_text(text: str, rng: Generator) -> str:
    """Cut short, a line less or twice, a number replaced, or a stray character."""
    lines, kind = text.splitlines(keepends=True), rng.integers(6)
    at = int(rng.integers(len(lines)))
    if kind == 0:
        return text[: int(rng.integers(len(text)))]
    if kind == 1:
        return "".join(lines[:at] + lines[at + 1 :])
    if kind == 2:
        return "".join(lines[: at + 1] + lines[at:])
    if kind == 3:
        place = int(rng.integers(len(text)))
        return text[:place] + str(rng.choice(list('"]}=\0\x1b<&\u2028'))) + text[place:]
    numbers = list(NUMBER.finditer(text))
    if not numbers:
        return ""
    chosen = numbers[int(rng.integers(len(numbers)))]
    return text[: chosen.start()] + str(rng.choice(WORDS)) + text[chosen.end() :]


def spoiled_table(text: str, rng: Generator) -> str:
    """A field, a column's name or values, the order of the rows or their number is another."""
    header, *rows = [line.split(",") for line in text.splitlines()]
    column, row, kind = int(rng.integers(len(header))), int(rng.integers(len(rows))), rng.integers(8)
    if kind == 0:
        header = [*header[:column], str(rng.choice(["q99", "q1", "", "torque", "t", "q0"])), *header[column + 1 :]]
    elif kind == 1:
        header, *rows = ([*one[:column], *one[column + 1 :]] for one in (header, *rows))
    elif kind == 2:
        rows = [[*one[:column], rows[0][column], *one[column + 1 :]] for one in rows]
    elif kind == 3:
        rows = rows[row:] + rows[:row]
    elif kind == 4:
        rows = rows[: int(rng.integers(4))]
    elif kind == 5:
        return text[: int(rng.integers(len(text)))]
    else:
        last = row + 1 if kind == 6 else len(rows)
        word = str(rng.choice(WORDS))
        rows = [[*one[:column], word, *one[column + 1 :]] if row <= k < last else one for k, one in enumerate(rows)]
    return "\n".join(map(",".join, [header, *rows])) + "\n"


def spoiled_bytes(data: bytes, rng: Generator) -> bytes:
    """Cut short, a byte changed, a stretch missing or of zeros."""
    at, kind = int(rng.integers(len(data))), rng.integers(4)
    if kind == 0:
        return data[:at]
    if kind == 1:
        return data[:at] + bytes([data[at] ^ int(rng.integers(1, 256))]) + data[at + 1 :]
    end = min(at + int(rng.integers(1, 3000)), len(data))
    return data[:at] + (b"" if kind == 2 else bytes(end - at)) + data[end:]


def _of_model(files: Files, out: Path) -> Iterator[Sequence[object]]:
    model = ("--model", files.model)
    yield "model", files.model
    yield "model", files.model, "--out", out.with_suffix(".toml")
    yield "model", files.model, "--out", out.with_suffix(".urdf")
    yield "excite", *model, "--out", out.with_suffix(".toml"), "--duration", 3, "--harmonics", 2, "--candidates", 32
    yield "simulate", *model, "--like", files.fit, "--out", out.with_suffix(".mcap")
    yield "identify", files.fit, *model, "--check"
    yield "identify", files.fit, *model, "--out", out
    yield "diagnose", "--fit", files.fit, *model, "--distort", "joint1.viscous", "--out", out
    yield "compare", files.fit, files.held_out, *model, "--out", out
    yield "calibrate", *model, "--target", "0.05,0.02,0.1", "--poses", 8, "--out", out


def _of_table(files: Files, table: Path, out: Path) -> Iterator[Sequence[object]]:
    model = ("--model", files.model)
    yield "import", table, "--out", out.with_suffix(".mcap")
    yield "compare", table, files.held_out, *model, "--out", out
    yield "calibrate", table, *model, "--target", "0.05,0.02,0.1", "--out", out


def _of_recording(files: Files, out: Path) -> Iterator[Sequence[object]]:
    model = ("--model", files.model)
    yield "info", files.fit
    yield "recover", files.fit, "--out", out.with_suffix(".mcap")
    yield "plot", files.fit, "--out", out.with_suffix(".svg")
    yield "export", files.fit, "--out", out.with_suffix(".csv")
    yield "simulate", *model, "--like", files.fit, "--out", out.with_suffix(".mcap")
    yield "identify", files.fit, *model, "--check"
    yield "identify", files.held_out, "--held-out", files.fit, *model, "--check"
    yield "diagnose", "--fit", files.fit, *model, "--distort", "joint1.viscous", "--out", out
    yield "compare", files.held_out, files.fit, *model, "--out", out
    yield "calibrate", files.fit, *model, "--target", "0.05,0.02,0.1", "--out", out


def _of_names(files: Files, out: Path) -> Iterator[Sequence[object]]:
    model = ("--model", files.model)
    for name in ("joint99.viscous", "joint0.viscous", "joint1.word", "viscous", "joint1.", ".", "", "jointnan.viscous"):
        yield "diagnose", "--fit", files.fit, *model, "--distort", name, "--out", out
    for target in ("nan,0,0", "1,2", "word", "1,2,3,4", "=1,2,3", "1e999,0,0", ""):
        yield "calibrate", files.fit, *model, "--target", target, "--out", out
        yield "simulate", *model, "--like", files.fit, "--target", target, "--out", out.with_suffix(".mcap")
    for joint in ("99", "0", "-1", "word"):
        yield "plot", files.fit, "--joint", joint, "--out", out.with_suffix(".svg")
    yield "excite", *model, "--out", out.with_suffix(".toml"), "--duration", "nan"
    yield "excite", *model, "--out", out.with_suffix(".toml"), "--harmonics", 0
    yield "simulate", *model, "--like", files.fit, "--temperature", "nan", "--out", out.with_suffix(".mcap")


def _each(lines: Iterator[Sequence[object]], spoiled: Path, out: Path) -> Iterator[Ended]:
    """Each command line; of one that did not end well, the spoiled file is kept beside the others."""
    for line in lines:
        with unrendered():
            ended = _judged(called(*line), out)
        if not ended.well:
            kept = spoiled.with_name(f"kept{len(list(out.parent.glob('kept*')))}{spoiled.suffix}")
            shutil.copy(spoiled, kept)
        yield ended


def _judged(ended: Ended, out: Path) -> Ended:
    """With the files that a refusal left behind as its flaw; a result is removed, for the next command."""
    written = [one for one in out.parent.iterdir() if one.name.startswith((out.name, "."))]
    for one in written:
        shutil.rmtree(one) if one.is_dir() else one.unlink()
    if ended.status == UNUSABLE_INPUT and written:
        return replace(ended, status=None, said=f"{ended.said}left behind: {[one.name for one in written]}")
    return replace(ended, status=0) if ended.status == LOST else ended
