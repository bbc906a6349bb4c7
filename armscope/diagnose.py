"""``armscope diagnose``: what the simulation gets wrong, why, the extended model, the gain."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from diagnosis.diagnose import Diagnosis


MANY = ("--fit", "--held-out")
"""Options that take several values."""


def command(
    model: Annotated[Path, typer.Option(metavar="MODEL.toml", help="the model whose simulation is judged")],
    fit: Annotated[list[Path], typer.Option(metavar="A.mcap ...", help="recordings to find causes in")],
    out: Annotated[Path, typer.Option(metavar="DIR", help="folder for diagnosis.json, report.html, model.toml")],
    held_out: Annotated[
        list[Path] | None,
        typer.Option("--held-out", metavar="B.mcap ...", help="to judge by; without any, the last 40 % of each"),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="print diagnosis.json and nothing else")] = False,
) -> None:
    """Diagnoses recordings against a model."""
    from rich.console import Console

    from arm_model.model_file import read_model
    from daq.recording import open_recording
    from diagnosis.diagnose import diagnose
    from diagnosis.files import write_diagnosis
    from diagnosis.split import split
    from inputs import check_folder

    check_folder(out)
    arm = read_model(model)
    fitted = [open_recording(path) for path in fit]
    held = [open_recording(path) for path in held_out or []]
    if not held:
        print("warning: no recording is held out; the last 40 % of each is judged by, a weaker test", file=sys.stderr)
        fitted, held = (list(parts) for parts in zip(*map(split, fitted)))
    with Console(stderr=True, quiet=not sys.stderr.isatty()).status("reading") as status:
        result = diagnose(arm, fitted, held, progress=status.update)
        status.update("report")
        table = write_diagnosis(out, result, fitted, held)
    if as_json:
        print(json.dumps(table))
    else:
        _print(result, out)


def _print(result: Diagnosis, out: Path) -> None:
    from rich.console import Console
    from rich.table import Table

    from diagnosis.report import sentence, title

    console = Console(highlight=False)
    console.print(sentence(result), markup=False, soft_wrap=True)
    for warning in result.warnings:
        console.print(f"warning: {warning}", markup=False, soft_wrap=True)
    if result.causes:
        table = Table(box=None, pad_edge=False)
        for heading in ("cause", "parameters", "held-out error", "confidence"):
            table.add_column(heading)
        for cause in result.causes:
            values = ", ".join(
                f"{p.name} {p.value:.4g} ± {2 * p.std:.2g}{'' if p.unit == '1' else ' ' + p.unit}"
                for p in cause.parameters
            )
            table.add_row(
                title(cause), values, f"{cause.before:.3g} -> {cause.after:.3g} {cause.unit}", f"{cause.confidence:.0%}"
            )
        console.print(table)
    console.print(f"{out / 'report.html'}", markup=False, soft_wrap=True)
