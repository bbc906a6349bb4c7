"""Options and arguments that several commands have: one wording for one thing."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Json = Annotated[bool, typer.Option("--json", help="print the result as JSON and nothing else")]
ReadyJson = Annotated[
    bool,
    typer.Option(
        "--json", help="when ready, print the addresses as one line of JSON, and nothing else on standard output"
    ),
]
RigOption = Annotated[Path, typer.Option(metavar="RIG.toml", help="the rig")]
RigArgument = Annotated[Path, typer.Argument(metavar="RIG.toml", help="the rig")]
RecordingArgument = Annotated[Path, typer.Argument(metavar="RUN.mcap", help="the recording, finished or not (.active)")]
RecordingOut = Annotated[
    Path,
    typer.Option(
        metavar="RUN.mcap",
        help="the recording to write; of existing files only an imported or simulated recording is replaced",
    ),
]
Png = Annotated[bool, typer.Option("--png", help="also write the report's charts as DIR/pictures/*.png")]
Pdf = Annotated[bool, typer.Option("--pdf", help="also write the report's charts as DIR/pictures/*.pdf")]
HeldOut = Annotated[
    list[Path] | None,
    typer.Option(
        "--held-out", metavar="B.mcap ...", help="held-out recordings; default: the last part of each fitted recording"
    ),
]


def pictures(png: bool, pdf: bool) -> tuple[str, ...]:
    """Kinds of picture files that are asked for."""
    return (*(["png"] if png else []), *(["pdf"] if pdf else []))
