"""``armscope plot``: a picture of one recording, or of several on one another."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from arm_io import InputError, check_file
from armscope.commands.options import Json
from daq.recording import open_long, plot


def command(
    recordings: Annotated[list[Path], typer.Argument(help="RUN.mcap ...: measured first, then simulated")],
    out: Annotated[Path, typer.Option(help="the picture (.png, .svg or .pdf)")],
    joint: Annotated[list[int] | None, typer.Option(help="only this joint (may be given more than once)")] = None,
    as_json: Json = False,
) -> None:
    if out.suffix.lower() not in (".png", ".svg", ".pdf"):
        raise InputError(out, "the name of a picture must end in .png, .svg or .pdf")
    check_file(out)
    data = [open_long(path) for path in recordings]
    joints = max(recording.joints for recording in data)
    for number in joint or []:
        if not 1 <= number <= joints:
            raise InputError("--joint", f"there is no joint {number}; it must be 1 to {joints}")
    figure = plot(data, joints=joint or [])
    try:
        figure.savefig(out, dpi=110)
    except OSError as error:
        raise InputError(out, f"cannot be written: {error.strerror}") from None
    print(json.dumps({"file": str(out)}) if as_json else out)
