"""``armscope identify``: recordings in, parameters with honest uncertainty out."""

from __future__ import annotations

import json
import sys
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from identification.result import Identification, Value


MANY = ("--held-out",)
"""Options that take several values."""


class Method(StrEnum):
    ols = "ols"
    wls = "wls"
    irls = "irls"
    iv = "iv"
    didim = "didim"
    motor_link = "motor-link"
    sequence = "sequence"
    friction = "friction"


class Friction(StrEnum):
    symmetric = "symmetric"
    asymmetric = "asymmetric"


def command(
    run: Annotated[list[Path], typer.Argument(metavar="RUN.mcap...", help="recordings to fit")],
    model: Annotated[
        Path, typer.Option(metavar="MODEL.toml", help="geometry and drives, and the values to start from")
    ],
    out: Annotated[Path, typer.Option(metavar="DIR", help="folder for identification.json, report.html, model.toml")],
    held_out: Annotated[
        list[Path] | None,
        typer.Option("--held-out", metavar="RUN.mcap", help="a recording to judge by; may be repeated"),
    ] = None,
    method: Annotated[
        Method,
        typer.Option(
            help="ols, wls, irls: least squares on the inverse dynamics; iv, didim: against the simulated closed loop; motor-link: one"
            " joint a run; sequence: one joint a run, tip first; friction: tuned in the simulated closed loop"
        ),
    ] = Method.wls,
    friction: Annotated[
        Friction, typer.Option(help="asymmetric: viscous and Coulomb friction of their own for each direction")
    ] = Friction.symmetric,
    as_json: Annotated[bool, typer.Option("--json", help="print identification.json and nothing else")] = False,
) -> None:
    """Identifies an arm."""
    from rich.console import Console

    from arm_model.model_file import read_model
    from daq.recording import open_recording
    from identification.files import write_identification
    from identification.methods import identify_by
    from inputs import check_folder

    check_folder(out)
    arm = read_model(model)
    fitted = [open_recording(path) for path in run]
    held = [open_recording(path) for path in held_out or []]
    with Console(stderr=True, quiet=not sys.stderr.isatty()).status("reading") as status:
        result = identify_by(method.value, fitted, arm, held_out=held, friction=friction.value, progress=status.update)
        status.update("report")
        table = write_identification(out, result)
    if as_json:
        print(json.dumps(table))
    else:
        _print(result, out)


def _print(result: Identification, out: Path) -> None:
    from rich.console import Console

    from identification.report import verdict

    console = Console(highlight=False)
    base = {value.name for value in result.base}
    named = [value for value in result.parameters if value.std is not None]
    sums = [value for value in result.base if value.name not in {v.name for v in named}]
    console.print(_table(named, "parameter"))
    if sums and base:
        console.print(_table(sums, "only together"))
    for warning in result.warnings:
        console.print(f"warning: {warning}", markup=False, soft_wrap=True)
    console.print(verdict(result), markup=False, soft_wrap=True)
    console.print(f"{out / 'report.html'}, identification.json, model.toml", markup=False, soft_wrap=True)


def _table(values: list[Value], what: str) -> object:
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    table.add_column(what, overflow="fold", max_width=60)
    for heading in ("value", "2 std", "(formula)"):
        table.add_column(heading, justify="right")
    table.add_column("unit")
    table.add_column("")
    for value in values:
        table.add_row(
            value.name,
            f"{value.value:.5g}",
            f"{2 * value.std:.2g}" if value.std is not None else "",
            f"{2 * value.std_formula:.2g}" if value.std_formula is not None else "",
            value.unit,
            "" if value.identifiable else "not identifiable here",
        )
    return table
