"""``armscope simulate``: the model run on an experiment, or on the demands of a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from arm_io import InputError
from arm_io.json_text import json_text
from arm_io.plain_data import point_of
from armscope.api.reading import note_gaps
from armscope.commands.options import Json, RecordingOut
from armscope.progress import shown
from daq.recording.provenance import check_replaceable


def command(
    model: Annotated[Path, typer.Option(metavar="MODEL.toml", help="the arm (config/models/*.toml)")],
    out: RecordingOut,
    experiment: Annotated[Path | None, typer.Option(metavar="EXP.toml", help="the motion")] = None,
    like: Annotated[
        Path | None, typer.Option(metavar="RUN.mcap", help="recording whose demands (qref) the arm follows")
    ] = None,
    rate: Annotated[float | None, typer.Option(help="rows/s; default: the experiment's, else 1000")] = None,
    target: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z",
            help="position of a tracker target in the frame of the last link, m; adds xyz to the recording",
        ),
    ] = None,
    temperature: Annotated[
        float | None,
        typer.Option(
            help="temperature of all motors, degC; default: as in --like, else those to which the friction of the "
            "model refers"
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    from armscope.api.simulation import simulate

    if (experiment is None) == (like is None):
        raise InputError("simulate", "needs either --experiment or --like")
    check_replaceable(out)
    point = None if target is None else point_of(target, "--target")
    with shown(as_json) as progress:
        simulation = simulate(
            model, experiment, like=like, rate=rate, target=point, temperature=temperature, progress=progress
        )
        progress("writing")
        simulation.write(out)
    note_gaps(model, "dynamics")
    print(json_text({"file": str(out)} | simulation.to_json()) if as_json else f"{out}: {simulation}")
