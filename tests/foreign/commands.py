"""Every command on one stranger's arm, in one process: how each of them ended."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from armscope.application import DONE
from armscope.exit_status import UNUSABLE_INPUT
from tests.foreign.ended import Ended, called
from tests.foreign.logged_elsewhere import as_logged_elsewhere
from tests.foreign.options import SHARE, Options
from tests.foreign.random_arms import stranger
from tests.foreign.written import flaws

METHODS = ("ols", "irls", "iv", "didim", "motor-link", "sequence", "friction")
FORMS = ("text", "latex", "python", "c")
TARGET = ("--target", "0.05,0.02,0.1")


def through_every_command(seed: int, folder: Path) -> Iterator[Ended]:
    """Each command on the arm of this seed, then what cannot be opened of all that they wrote.

    Commands that need a file that another refused to write are left out.
    """
    yield from _commands(seed, folder)
    if found := flaws(folder):
        yield Ended("written", None, "\n".join(found))


@dataclass(frozen=True)
class Case:
    """One arm's files, and what is drawn for its commands: options from a source of their own."""

    model: Path
    real: Path
    folder: Path
    rng: np.random.Generator
    options: Options


def _commands(seed: int, folder: Path) -> Iterator[Ended]:
    arm, rng = stranger(seed), np.random.default_rng([seed, 1])
    case = Case(*arm.write(folder), folder, rng, Options(np.random.default_rng([seed, 3]), len(arm.model), folder))
    yield (first := called("model", case.model))
    if first.status != DONE:
        return
    yield called("model", case.model, "--json")
    yield called("model", case.model, "--equations", rng.choice(FORMS))
    yield from _converted(case)
    recorded = yield from _recorded(case, seed)
    if None in recorded:
        return
    fit, held_out = (one for one in recorded if one is not None)
    yield from _read(case, fit)
    if arm.urdf or rng.random() < 0.5:
        fit, held_out = yield from _logged_elsewhere(case, fit, held_out)
    yield from _analysed(case, fit, held_out)
    yield from _compared(case, fit, held_out)


def _converted(case: Case) -> Iterator[Ended]:
    for name in ("again.urdf", "again.toml"):
        yield (written := called("model", case.model, "--out", case.folder / name))
        if written.status == DONE:
            yield called("model", case.folder / name)


def _recorded(case: Case, seed: int) -> Iterator[Ended]:
    """Two designed motions, simulated with the model and recorded from the real arm."""
    short = ("--duration", 3, "--fundamental", 0.5, "--harmonics", 3, "--candidates", 32)
    recorded: list[Path | None] = []
    for number in (1, 2):
        motion, recording = case.folder / f"motion{number}.toml", case.folder / f"run{number}.mcap"
        recorded.append(None)
        line = ("excite", "--model", case.model, "--out", motion, "--seed", seed + number, *short)
        yield (designed := called(*line, *(more := case.options.of("excite"))))
        if designed.status != DONE and more:  # a floor in the way, another robot's program
            yield (designed := called(*line))
        if designed.status != DONE:
            continue
        line = ("simulate", "--model", case.model, "--experiment", motion, "--out", case.folder / "of_model.mcap")
        yield called(*line, *case.options.of("simulate"))
        line = ("simulate", "--model", case.real, "--experiment", motion, "--out", recording)
        yield (made := called(*line, "--rate", case.options.one_of(100, 200, 200, 500), *TARGET))
        if made.status == DONE:
            recorded[-1] = recording
    return recorded


def _read(case: Case, recording: Path) -> Iterator[Ended]:
    of = case.options.of
    yield called("info", recording, *of("info"))
    yield called("plot", recording, "--out", case.folder / "run.svg", *of("plot"))
    if case.options.rng.random() < SHARE / 2:
        page = ("--animate", case.folder / "moving.html", "--fps", 2, "--speed", case.options.one_of(1, 4))
        yield called("plot", recording, "--model", case.model, *page)
    yield called("export", recording, "--out", case.folder / "run.csv")
    form = case.options.one_of("parquet", "mat", "csv")
    yield called("export", recording, "--out", case.folder / f"again.{form}")
    yield called("recover", recording, "--out", case.folder / "recovered.mcap", *of("recover"))


def _logged_elsewhere(case: Case, fit: Path, held_out: Path) -> Iterator[Ended]:
    """Both recordings as tables of another program, with what those lack; the recordings again where refused."""
    seed, imported = int(case.rng.integers(1 << 30)), []
    for number, recording in enumerate((fit, held_out), 1):
        table, written = case.folder / f"log{number}.csv", case.folder / f"imported{number}.mcap"
        yield called("export", recording, "--out", table)
        table.write_text(as_logged_elsewhere(table.read_text(), np.random.default_rng(seed)))
        yield (read := called("import", table, "--out", written, *case.options.of("import")))
        imported.append(written if read.status == DONE else recording)
    return imported


def _analysed(case: Case, fit: Path, held_out: Path) -> Iterator[Ended]:
    of, folder = case.options.of, case.folder
    model = ("--model", case.model)
    chosen = (*model, *case.options.one_of(*(3 * [("--held-out", held_out)]), ()))
    yield called("identify", fit, *chosen, "--check")
    for method in ("wls", case.rng.choice(METHODS)):
        out = folder / f"identified_{method}"
        yield called("identify", fit, *chosen, "--method", method, "--out", out, *of("identify"))
    yield called("diagnose", "--fit", fit, *chosen, "--out", folder / "diagnosed", *of("diagnose"))
    distorted = ("--distort", case.options.one_of("joint1.viscous", case.options.parameter()))
    yield called("diagnose", "--fit", fit, *model, *distorted, "--out", folder / "varied", *of("diagnose"))
    yield called("calibrate", fit, *chosen, *TARGET, "--out", folder / "calibrated", *of("calibrate"))
    if case.options.rng.random() < SHARE / 4:  # the search for its place takes longer than all other commands
        yield called("calibrate", *model, *TARGET, "--poses", 12, "--cube", "--out", folder / "cube")
    yield called("calibrate", *model, *TARGET, "--poses", 12, "--out", folder / "poses", *of("calibrate"))
    for name in ("identified_wls", "diagnosed", "calibrated"):
        if (written := folder / name / "model.toml").exists():
            yield (read := called("model", written))
            if read.status == UNUSABLE_INPUT:  # a file that armscope wrote, and cannot read
                yield Ended(read.command, None, read.said)
            yield called("simulate", "--model", written, "--like", fit, "--out", folder / "again.mcap")


def _compared(case: Case, fit: Path, held_out: Path) -> Iterator[Ended]:
    """Recordings and results against each other, and the index of all of them."""
    of, folder = case.options.of, case.folder
    yield called("compare", fit, held_out, "--model", case.model, "--out", folder / "compared", *of("compare"))
    results = [one for one in sorted(folder.glob("identified_*")) if (one / "identification.json").exists()]
    if len(results) > 1:
        yield called("compare", *results[:2], "--json")
        third = shutil.copytree(results[0], folder / "later")
        yield called("trend", *results[:2], third, "--out", folder / "trend", *of("trend"))
    yield called("archive", folder)
    yield called("archive", folder, "parameters", "--json")
    yield called("archive", folder, "plot", case.options.parameter(), "--out", folder / "over_time.svg")
