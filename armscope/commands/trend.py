"""``armscope trend``: which parameters moved over many results, since when, how fast, and when they reach a limit."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from arm_io import check_folder
from arm_io.json_text import json_text
from armscope.commands.options import Json, Pdf, Png, pictures
from armscope.progress import shown

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
) -> None:
    from arm_archive import Filters
    from arm_report import wrapped
    from armscope.api.trend import trend
    from comparison.trend import limits_from

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
