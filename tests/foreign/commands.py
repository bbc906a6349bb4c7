"""Every command on one stranger's arm, in process: how each of them ended.

A command may refuse in one line (exit status 2); any other exception is a crash, and so is a number that is none in a
result (``arm_io`` refuses to write it).
"""

from __future__ import annotations

import io
import re
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from armscope.application import DONE
from armscope.cli import UNUSABLE_INPUT, run
from tests.foreign.random_arms import stranger
from tests.foreign.written import flaws

METHODS = ("ols", "irls", "iv", "didim", "motor-link", "sequence", "friction")
FORMS = ("text", "latex", "python", "c")


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
        """Done, or refused in one line that says what is wrong."""
        if self.status == UNUSABLE_INPUT:
            lines = [line for line in self.said.splitlines() if not line.startswith(("note:", "warning:"))]
            # the arms here are possible, and have no effects: what is impossible, a command made up
            blames_itself = any(" makes " in line and " impossible: " in line for line in lines)
            one_line = len(lines) == 1 and lines[0].startswith("error: ") and "nan" not in lines[0].split()
            return one_line and not blames_itself
        return self.status == DONE


def called(*arguments: object) -> Ended:
    """One command line, in process."""
    words = [str(one) for one in arguments]
    out, said, line = io.StringIO(), io.StringIO(), " ".join(words)
    try:
        with redirect_stdout(out), redirect_stderr(said):
            return Ended(line, run(words), said.getvalue())
    except Exception:
        return Ended(line, None, traceback.format_exc())


def through_every_command(seed: int, folder: Path) -> Iterator[Ended]:
    """Each command on the arm of this seed, then what cannot be opened of all that they wrote.

    Commands that need a file that another refused to write are left out.
    """
    yield from _commands(seed, folder)
    if found := flaws(folder):
        yield Ended("written", None, "\n".join(found))


def _commands(seed: int, folder: Path) -> Iterator[Ended]:
    arm, rng = stranger(seed), np.random.default_rng([seed, 1])
    model, real = arm.write(folder)
    yield (first := called("model", model))
    if first.status != DONE:
        return
    yield called("model", model, "--json")
    yield called("model", model, "--equations", rng.choice(FORMS))
    yield from _converted(model, folder)
    fit, held_out = yield from _recorded(seed, model, real, folder)
    if fit is None or held_out is None:
        return
    yield from _read(fit, folder)
    if arm.urdf:
        fit = folder / "imported.mcap"
    yield from _analysed(rng, model, fit, held_out, folder)
    yield from _compared(model, fit, held_out, folder)


def _converted(model: Path, folder: Path) -> Iterator[Ended]:
    for name in ("again.urdf", "again.toml"):
        yield (written := called("model", model, "--out", folder / name))
        if written.status == DONE:
            yield called("model", folder / name)


def _recorded(seed: int, model: Path, real: Path, folder: Path) -> Iterator[Ended]:
    """Two designed motions, simulated with the model and recorded from the real arm."""
    short = ("--duration", 3, "--fundamental", 0.5, "--harmonics", 3, "--candidates", 32)
    recorded: list[Path | None] = []
    for number in (1, 2):
        motion, recording = folder / f"motion{number}.toml", folder / f"run{number}.mcap"
        recorded.append(None)
        yield (designed := called("excite", "--model", model, "--out", motion, "--seed", seed + number, *short))
        if designed.status != DONE:
            continue
        yield called("simulate", "--model", model, "--experiment", motion, "--out", folder / "of_model.mcap")
        line = ("simulate", "--model", real, "--experiment", motion, "--out", recording)
        yield (made := called(*line, "--rate", 200, "--target", "0.05,0.02,0.1"))
        if made.status == DONE:
            recorded[-1] = recording
    return recorded


def _read(recording: Path, folder: Path) -> Iterator[Ended]:
    yield called("info", recording)
    yield called("plot", recording, "--out", folder / "run.svg")
    yield called("export", recording, "--out", folder / "run.csv")
    yield called("import", folder / "run.csv", "--out", folder / "imported.mcap")
    yield called("recover", recording, "--out", folder / "recovered.mcap")


def _analysed(rng: np.random.Generator, model: Path, fit: Path, held_out: Path, folder: Path) -> Iterator[Ended]:
    chosen = ("--model", model, "--held-out", held_out)
    yield called("identify", fit, *chosen, "--check")
    for method in ("wls", rng.choice(METHODS)):
        out = folder / f"identified_{method}"
        yield called("identify", fit, *chosen, "--method", method, "--out", out)
    yield called("diagnose", "--fit", fit, *chosen, "--out", folder / "diagnosed")
    yield called("diagnose", "--fit", fit, "--model", model, "--distort", "joint1.viscous", "--out", folder / "varied")
    target = ("--target", "0.05,0.02,0.1")
    yield called("calibrate", fit, *chosen, *target, "--out", folder / "calibrated")
    yield called("calibrate", "--model", model, *target, "--poses", 12, "--out", folder / "poses")
    for name in ("identified_wls", "diagnosed", "calibrated"):
        if (written := folder / name / "model.toml").exists():
            yield (read := called("model", written))
            if read.status == UNUSABLE_INPUT:  # a file that armscope wrote, and cannot read
                yield Ended(read.command, None, read.said)
            yield called("simulate", "--model", written, "--like", fit, "--out", folder / "again.mcap")


def _compared(model: Path, fit: Path, held_out: Path, folder: Path) -> Iterator[Ended]:
    """Recordings and results against each other, and the index of all of them."""
    yield called("compare", fit, held_out, "--model", model, "--out", folder / "compared")
    results = [one for one in sorted(folder.glob("identified_*")) if (one / "identification.json").exists()]
    if len(results) > 1:
        yield called("compare", *results[:2], "--json")
        yield called("trend", *results[:2], results[0], "--out", folder / "trend")
    yield called("archive", folder)
    yield called("archive", folder, "parameters", "--json")


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
