"""``armscope identify``: estimates parameters, with their uncertainty, from recordings."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from arm_io.json_text import json_text
from armscope import allocation
from armscope.api.identification import Friction, Method, Shape
from armscope.api.reading import note_gaps
from armscope.commands.options import HeldOut, Json, Pdf, Png, pictures
from armscope.progress import shown

if TYPE_CHECKING:
    from identification.preprocessing import Readiness


MANY = ("--held-out",)
"""Options that take several values."""


def command(
    run: Annotated[list[Path], typer.Argument(metavar="RUN.mcap", help="recordings to fit")],
    model: Annotated[Path, typer.Option(metavar="MODEL.toml", help="geometry, drives and initial values")],
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="folder for identification.json, report.html, model.toml")
    ] = None,
    held_out: HeldOut = None,
    method: Annotated[
        Method,
        typer.Option(
            help="ols, wls, irls: least squares on the inverse dynamics; iv: instrumental variables; didim: "
            "closed-loop output error;"
            " motor-link: one joint per run; sequence: one joint per run, tip first; friction: friction only, tuned "
            "in closed loop"
        ),
    ] = "wls",
    friction: Annotated[
        Friction | None,
        typer.Option(
            help="asymmetric: direction-dependent viscous and Coulomb friction; default: asymmetric if the model "
            "has viscous friction per direction"
        ),
    ] = None,
    shape: Annotated[
        Shape,
        typer.Option(
            help="friction over speed: straight, a line (Coulomb and viscous); free, a curve; auto, a curve at the "
            "joints where held-out data justify it"
        ),
    ] = "auto",
    only_check: Annotated[
        bool,
        typer.Option("--check", help="only report whether identify and diagnose can use the recordings; write nothing"),
    ] = False,
    png: Png = False,
    pdf: Pdf = False,
    mat: Annotated[
        bool,
        typer.Option(
            "--mat", help="also write DIR/identification.mat: parameters, covariance, measured and predicted torques"
        ),
    ] = False,
    as_json: Json = False,
) -> None:
    """Identifies an arm."""
    allocation.for_computation()
    from arm_io import InputError, check_folder
    from armscope.api.floating_base import floats

    if out is None and not only_check:
        raise InputError("--out", "is missing: a folder for the results; or give --check to check the recordings only")
    if out is not None:
        check_folder(out)
    if floats(model):
        options = {
            "--method": method != "wls",
            "--friction": friction is not None,
            "--shape": shape != "auto",
            "--check": only_check,
            "--mat": mat,
        }
        _identify_base(run, model, held_out or [], out, pictures(png, pdf), as_json, options)
        return
    note_gaps(model, "dynamics")
    chosen: dict[str, Any] = {"held_out": held_out or [], "method": method, "friction": friction}
    if out is None or only_check:
        _check(run, model, chosen, as_json)
    else:
        _identify(run, model, chosen | {"shape": shape}, out, {"pictures": pictures(png, pdf), "mat": mat}, as_json)


def _check(run: list[Path], model: Path, chosen: dict[str, Any], as_json: bool) -> None:
    """Says what recordings are good for; writes nothing."""
    from armscope.api.identification import check

    with shown(as_json) as progress:
        ready = check(run, model, **chosen, progress=progress)
        progress.hide()
        _print_readiness(ready, as_json)


def _identify(
    run: list[Path], model: Path, chosen: dict[str, Any], out: Path, files: dict[str, Any], as_json: bool
) -> None:
    """An arm on a fixed base: the parameters, and the report with its files in ``out``."""
    from arm_report import wrapped
    from armscope.api.identification import identify

    with shown(as_json) as progress:
        result = identify(run, model, **chosen, progress=progress)
        progress("report")
        table = result.write(out, **files)
    written = f"{out / 'report.html'}, identification.json, model.toml{', identification.mat' if files['mat'] else ''}"
    print(json_text(table) if as_json else wrapped(f"{result}\n{written}"))


def _identify_base(
    run: list[Path],
    model: Path,
    held_out: list[Path],
    out: Path | None,
    kinds: Sequence[str],
    as_json: bool,
    options: dict[str, bool],
) -> None:
    """An arm on a floating base; InputError for ``options`` that were given and are for a fixed one."""
    from armscope.api.floating_base import identify_base, refuse

    refuse(model, options)
    assert out is not None, "only --check needs none"
    with shown(as_json) as progress:
        result = identify_base(run, model, held_out=held_out, progress=progress)
        progress("report")
        table = result.write(out, pictures=kinds)
    print(json_text(table) if as_json else f"{result}\n{out / 'report.html'}, identification.json, model.toml")


_READINESS = (
    "joint",
    "travel",
    "top speed",
    "noise, rms",
    "rows used",
    "largest torque",
    "rows excluded",
)


def _print_readiness(ready: Readiness, as_json: bool) -> None:
    from arm_report import text_table, wrapped

    if as_json:
        print(json_text(ready.to_json()))
        return
    lines = []
    for run in ready.runs:
        lines.append(f"{run.run}: {run.rows} rows of {run.period * 1e3:.4g} ms")
        cells = [
            (
                str(joint.joint),
                f"{joint.travel:.3g} {joint.unit}",
                f"{joint.top_speed:.3g} {joint.unit}/s",
                f"{joint.noise:.1g} {joint.unit}",
                f"{joint.used / run.rows:.0%}",
                "" if joint.torque is None else f"{joint.torque:.0%} of its limit",
                ", ".join(f"{reason} {rows / run.rows:.0%}" for reason, rows in joint.left_out.items()),
            )
            for joint in run.joints
        ]
        lines += text_table(cells, _READINESS, numbers=range(6))
    lines += [f"warning: {warning}" for warning in ready.warnings]
    print(wrapped("\n".join([*lines, ready.sentence])))
