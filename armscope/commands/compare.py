"""``armscope compare``: what changed in an arm between two recordings, results, or groups of them."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from arm_io import InputError, counted
from arm_io.json_text import json_text
from armscope import allocation
from armscope.commands.options import Pdf, Png, pictures
from armscope.exit_status import CHANGED, DONE
from armscope.progress import shown

if TYPE_CHECKING:
    from comparison import Change

MANY = ("--before", "--after")
"""Options that take several values."""


def command(
    pair: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="BEFORE AFTER",
            help="each a recording (.mcap, .csv), identification.json, diagnosis.json, the folder of such a result, a "
            "folder of recordings, or several, separated by commas",
            show_default=False,
        ),
    ] = None,
    before: Annotated[
        list[str] | None,
        typer.Option(
            "--before", metavar="A ...", help="instead of BEFORE: a member of the group before; may be repeated"
        ),
    ] = None,
    after: Annotated[
        list[str] | None,
        typer.Option("--after", metavar="B ...", help="instead of AFTER: a member of the group after; may be repeated"),
    ] = None,
    model: Annotated[
        Path | None,
        typer.Option(
            metavar="MODEL.toml", help="model of the arm, for recordings; default: the model that they contain"
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="folder for compare.json, compare.html")] = None,
    fail_above: Annotated[
        str | None,
        typer.Option(
            metavar="X",
            help="exit status 5 if a significant change is above X standard deviations of the change, or above X% of "
            "the value before",
        ),
    ] = None,
    png: Png = False,
    pdf: Pdf = False,
    as_json: Annotated[bool, typer.Option("--json", help="print compare.json and nothing else")] = False,
) -> int:
    """Compares two states of an arm."""
    allocation.for_computation()
    from arm_io import check_folder
    from arm_report import wrapped
    from armscope.api.comparison import compare
    from comparison import Threshold

    sides = _sides(pair or [], before or [], after or [])
    threshold = None if fail_above is None else Threshold.of(fail_above)
    if out is not None:
        check_folder(out)
    with shown(as_json) as progress:
        result = compare(*sides, model, progress=progress)
        table = result.to_json() if out is None else result.write(out, pictures=pictures(png, pdf))
    if as_json:
        print(json_text(table))
    else:
        print(wrapped(str(result) if out is None else f"{result}\n{out / 'compare.html'}"))
    return DONE if threshold is None else _status(threshold.exceeded(result.changes), str(fail_above))


def _sides(pair: list[str], before: list[str], after: list[str]) -> tuple[list[str], list[str]]:
    """Members of both sides; InputError where the command line does not name two."""
    if len(pair) == 2 and not before and not after:
        return _listed(pair[0]), _listed(pair[1])
    if not pair and before and after:
        return [one for each in before for one in _listed(each)], [one for each in after for one in _listed(each)]
    named = f"{len(pair) or 'no'} argument{'' if len(pair) == 1 else 's'}"
    given = ", ".join([named, *(name for name, group in (("--before", before), ("--after", after)) if group)])
    raise InputError(
        "compare",
        f"needs two sides: BEFORE AFTER, or --before A ... --after B ... (given: {given})",
    )


def _listed(text: str) -> list[str]:
    """The files that an argument names, with commas between; a file whose name has a comma is one."""
    return [text] if Path(text).exists() else [part for part in text.split(",") if part]


def _status(above: list[Change], limit: str) -> int:
    if not above:
        return DONE
    points = sum(one.quantity.kind == "curve" for one in above)
    named = [one.quantity.name for one in above if one.quantity.kind != "curve"]
    parts = [", ".join(named[:5]) + (" ..." if len(named) > 5 else "")] if named else []
    parts += [f"{counted(points, 'point')} of friction curves"] if points else []
    print(f"changed beyond --fail-above {limit}: {'; '.join(parts)}", file=sys.stderr)
    return CHANGED
