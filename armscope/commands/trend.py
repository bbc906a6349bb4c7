"""``armscope trend``: which parameters moved over many results, since when, how fast, and when they reach a limit."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from arm_io import InputError, check_folder
from arm_io.json_text import json_text
from armscope.commands.options import Json, Pdf, Png, pictures
from armscope.exit_status import CHANGED, DONE
from armscope.progress import shown

if TYPE_CHECKING:
    from comparison.trend import Trend

FARTHEST = 36_500.0
"""days within which a limit may be asked for."""
MANY = ("--limit",)
"""Options that take several values."""


def command(
    results: Annotated[
        list[str],
        typer.Argument(
            metavar="RESULT",
            help="three or more identification.json or diagnosis.json, their folders, or a folder to search (archive)",
        ),
    ],
    limit: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUE ...",
            help="say when a limit is reached: joint3.coulomb=..12 (at most), =12.. (at least), =12, or =+50%",
        ),
    ] = None,
    fail_within: Annotated[
        float | None,
        typer.Option(
            metavar="DAYS",
            help="end with exit status 5 if a limit is passed, or reached within DAYS after the last result; 0: passed",
        ),
    ] = None,
    kind: Annotated[str | None, typer.Option(metavar="KIND", help="of a folder: identification or diagnosis")] = None,
    arm: Annotated[str | None, typer.Option(metavar="ARM", help="of a folder: part of the arm's name")] = None,
    path: Annotated[str | None, typer.Option(metavar="PATH", help="of a folder: part of the results' paths")] = None,
    since: Annotated[
        str | None,
        typer.Option(
            metavar="DATE", help="of a folder: from this year, month or day on, UTC: 2026, 2026-01, 2026-01-31"
        ),
    ] = None,
    until: Annotated[
        str | None, typer.Option(metavar="DATE", help="of a folder: until this year, month or day, included")
    ] = None,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="folder for trend.json, trend.html")] = None,
    png: Png = False,
    pdf: Pdf = False,
    as_json: Json = False,
) -> int:
    from arm_archive import Filters
    from arm_report import wrapped
    from armscope.api.trend import trend
    from comparison.trend import limits_from

    if fail_within is not None and not (limit and 0 <= fail_within <= FARTHEST):
        what = f"must be between 0 and {FARTHEST:g} days (is {fail_within:g})" if limit else "needs a --limit"
        raise InputError("--fail-within", what)
    limits = [its for one in limit or [] for its in limits_from(one)]
    filters = Filters(kind=kind, arm=arm, path=path, since=since, until=until)
    if out is not None:
        check_folder(out)
    with shown(as_json) as progress:
        result = trend(results, limits, filters=filters, progress=progress)
        table = result.to_json() if out is None else result.write(out, pictures=pictures(png, pdf))
    if as_json:
        print(json_text(table))
    else:
        print(wrapped(str(result) if out is None else f"{result}\n{out / 'trend.html'}"))
    return DONE if fail_within is None else _status(result, fail_within)


def _status(result: Trend, days: float) -> int:
    """CHANGED, and a line on standard error, where a limit is passed or will be within so many days."""
    near = [one for one in result.limited if one.reached_within(days)]
    if not near:
        return DONE
    names = ", ".join(one.moved.history.quantity.name for one in near)
    print(f"limit passed, or reached within --fail-within {days:g} days: {names}", file=sys.stderr)
    return CHANGED
