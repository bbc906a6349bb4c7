"""``armscope archive``: find, compare, plot and open the recordings and results in a folder."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from arm_io import InputError
from arm_io.json_text import json_text
from arm_io.progress import Step
from arm_report.picture_file import check_picture, save_picture
from armscope.commands.options import Json
from armscope.progress import shown

if TYPE_CHECKING:
    from arm_archive import Archive, Filters


class Action(StrEnum):
    """The actions of the command."""

    LIST = "list"
    PARAMETERS = "parameters"
    PLOT = "plot"
    COMPARE = "compare"
    OPEN = "open"


NAMES = {Action.LIST: 0, Action.PARAMETERS: 0, Action.PLOT: 1, Action.COMPARE: 2, Action.OPEN: 1}
"""How many names each action takes."""


def command(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="folder of recordings and results, with its subfolders")
    ],
    action: Annotated[
        Action,
        typer.Argument(
            metavar="ACTION",
            help="list; parameters (list their names); plot PARAMETER; compare A B; open PATH (or a part of it)",
        ),
    ] = Action.LIST,
    names: Annotated[
        list[str] | None, typer.Argument(metavar="NAME", help="arguments of the action", show_default=False)
    ] = None,
    kind: Annotated[
        str | None, typer.Option(metavar="KIND", help="recording, identification, diagnosis, kinematics, comparison")
    ] = None,
    arm: Annotated[str | None, typer.Option(metavar="ARM", help="part of the arm's name, such as puma560")] = None,
    rig: Annotated[str | None, typer.Option(metavar="RIG", help="part of the rig's name")] = None,
    experiment: Annotated[str | None, typer.Option(metavar="EXP", help="part of the experiment's name")] = None,
    path: Annotated[str | None, typer.Option(metavar="PATH", help="part of the path")] = None,
    since: Annotated[
        str | None, typer.Option(metavar="DATE", help="from this year, month or day on, UTC: 2026, 2026-01, 2026-01-31")
    ] = None,
    until: Annotated[str | None, typer.Option(metavar="DATE", help="until this year, month or day, included")] = None,
    lost: Annotated[int | None, typer.Option(metavar="ROWS", help="at most this number of lost rows")] = None,
    verdict: Annotated[str | None, typer.Option(metavar="WORDS", help="part of a result's verdict: backlash")] = None,
    calibration: Annotated[str | None, typer.Option(metavar="HASH", help="hash of the rig's calibration")] = None,
    state: Annotated[str | None, typer.Option(metavar="STATE", help="whole, unfinished, damaged, unreadable")] = None,
    model: Annotated[
        Path | None, typer.Option(metavar="MODEL.toml", help="model of the arm, to compare recordings")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE|DIR", help="the picture of plot (.png, .pdf, .svg); the folder of compare"),
    ] = None,
    as_json: Json = False,
) -> None:
    from arm_archive import Filters

    given = names or []
    if len(given) != NAMES[action]:
        raise InputError("arguments", f"{action} takes {NAMES[action]} names (is {len(given)}); must be as in --help")
    filters = Filters(
        kind=kind,
        arm=arm,
        rig=rig,
        experiment=experiment,
        path=path,
        since=since,
        until=until,
        lost=lost,
        verdict=verdict,
        calibration=calibration,
        state=state,
    )
    with _opened(folder, as_json) as archive:
        if action is Action.LIST:
            _list(archive, filters, as_json)
        elif action is Action.PARAMETERS:
            _parameters(archive, as_json)
        elif action is Action.PLOT:
            _plot(archive, filters, given[0], out, as_json)
        elif action is Action.COMPARE:
            _compare(archive, given, model, out, as_json)
        else:
            _open(archive, given[0], as_json)


@contextmanager
def _opened(folder: Path, as_json: bool) -> Iterator[Archive]:
    """The archive, with progress and the time left while its index is brought up to date."""
    from arm_archive import open_archive

    with shown(as_json) as progress:
        progress("indexing")
        archive = open_archive(
            folder, progress=lambda done, of, path: progress(Step("indexing", done, of or None, detail=path))
        )
    with archive:
        for note in archive.notes:
            print(f"note: {note}", file=sys.stderr)
        yield archive


def _list(archive: Archive, filters: Filters, as_json: bool) -> None:
    from arm_report import text_table, wrapped

    rows = archive.rows(filters)
    if as_json:
        print(json_text(rows, indent=1))
        return
    head = ("date (UTC)", "arm", "experiment", "rows", "lost", "error", "result", "path")
    cells = [
        (
            (row["date"] or "")[:16].replace("T", " "),
            row["arm"] or "",
            row["experiment"] or "",
            "" if row["rows"] is None else str(row["rows"]),
            "" if row["lost"] is None else str(row["lost"]),
            _error(row),
            _words(row["verdict"]) or ("" if row["state"] == "whole" else row["state"]),
            row["path"],
        )
        for row in rows
    ]
    print(wrapped("\n".join(text_table(cells, head, numbers=(3, 4, 5), shorten=(1, 2, 6), keep=None))))
    wrong = [row for row in rows if row["note"]]
    for row in wrong:
        print(f"note: {row['path']}: {row['note']}", file=sys.stderr)
    lossy = sum(bool(row["lost"]) for row in rows)
    print(f"{len(rows)} of {len(archive)} entries; {lossy} with lost rows, {len(wrong)} with notes")


def _words(verdict: str | None) -> str:
    return (verdict or "").replace("_", " ")


def _error(row: dict[str, Any]) -> str:
    """Held-out error of a result: '0.24 %' of the torque, '0.12 mm' per coordinate."""
    error = row["error"]
    if error is None:
        return ""
    return f"{1e3 * error:.3g} mm" if row["kind"] == "kinematics" else f"{100 * error:.3g} %"


def _parameters(archive: Archive, as_json: bool) -> None:
    from arm_report import text_table, wrapped

    rows = archive.parameters()
    if as_json:
        print(json_text(rows, indent=1))
        return
    cells = [(row["name"], row["unit"], str(row["results"])) for row in rows]
    print(wrapped("\n".join(text_table(cells, ("parameter", "unit", "results"), numbers=(2,), keep=None))))


def _plot(archive: Archive, filters: Filters, name: str, out: Path | None, as_json: bool) -> None:
    from arm_archive import history_figure
    from arm_report import text_table, wrapped
    from arm_report.numbers import value_and_two_std

    if out is not None:
        check_picture(out)
    rows = archive.history(name, filters)
    if out is not None:
        save_picture(history_figure(rows), out)
    if as_json:
        print(json_text(rows, indent=1))
        return
    cells = [
        (
            row["date"][:16].replace("T", " "),
            *value_and_two_std(row["value"], row["std"]),
            row["unit"],
            row["path"],
        )
        for row in rows
    ]
    print(
        wrapped(
            "\n".join(text_table(cells, ("date (UTC)", name, "2 std", "unit", "path"), numbers=(1, 2), keep=(0, 3)))
        )
    )
    print(out or "give --out PICTURE.png to draw it")


def _compare(archive: Archive, names: list[str], model: Path | None, out: Path | None, as_json: bool) -> None:
    from arm_report import wrapped
    from armscope.api.comparison import compare

    before, after = (archive.folder / archive.find(name)["path"] for name in names)
    result = compare(before, after, model)
    table = result.to_json() if out is None else result.write(out)
    if as_json:
        print(json_text(table))
    else:
        print(wrapped(str(result) if out is None else f"{result}\n{out / 'compare.html'}"))


def _open(archive: Archive, name: str, as_json: bool) -> None:
    """Opens the report of a result; of a recording says what it is, and which results were made from it."""
    row = archive.find(name)
    results = archive.used_in(row) if row["kind"] == "recording" else []
    reports = [str(archive.folder / one["report"]) for one in (row, *results) if one["report"]]
    if as_json:
        parameters = archive.parameters(row["path"])
        print(json_text({**row, "parameters": parameters, "reports": reports}, indent=1))
        return
    _describe(row)
    for report in reports:
        print(report)
    if reports and sys.stdout.isatty():
        import webbrowser

        webbrowser.open(Path(reports[0]).absolute().as_uri())


def _describe(row: dict[str, Any]) -> None:
    for name, value in row.items():
        if value is not None:
            print(f"{name:<12}{value:.6g}" if isinstance(value, float) else f"{name:<12}{value}")
