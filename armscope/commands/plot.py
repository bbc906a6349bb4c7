"""``armscope plot``: a picture of recordings on one another, or of an experiment before it runs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from arm_io import InputError
from armscope.commands.options import Json
from armscope.motion import draw, space_of
from armscope.picture import check_picture, save_picture
from daq.recording import open_long, plot


def command(
    recordings: Annotated[
        list[Path], typer.Argument(help="RUN.mcap ...: measured first, then simulated; or EXP.toml, a motion")
    ],
    out: Annotated[Path, typer.Option(help="the picture (.png, .svg or .pdf)")],
    joint: Annotated[list[int] | None, typer.Option(help="only this joint (may be given more than once)")] = None,
    model: Annotated[
        Path | None, typer.Option(metavar="MODEL.toml", help="of an experiment: the arm; default: the rig's model")
    ] = None,
    rig: Annotated[
        Path | None, typer.Option(metavar="RIG.toml", help="of an experiment: the rig, for its limits and its [space]")
    ] = None,
    space: Annotated[
        Path | None, typer.Option(metavar="SPACE.toml", help="of an experiment: floor and boxes, not those of the rig")
    ] = None,
    as_json: Json = False,
) -> None:
    check_picture(out)
    if recordings[0].suffix == ".toml":
        if len(recordings) > 1 or joint:
            raise InputError(recordings[0], "is an experiment: it is drawn alone, with all joints")
        _draw_motion(recordings[0], out, model, rig, space)
        print(json.dumps({"file": str(out)}) if as_json else out)
        return
    for option, given in (("--model", model), ("--rig", rig), ("--space", space)):
        if given is not None:
            raise InputError(option, "is for the picture of an experiment (EXP.toml), not of recordings")
    data = [open_long(path) for path in recordings]
    joints = max(recording.joints for recording in data)
    for number in joint or []:
        if not 1 <= number <= joints:
            raise InputError("--joint", f"there is no joint {number}; it must be 1 to {joints}")
    save_picture(plot(data, joints=joint or []), out)
    print(json.dumps({"file": str(out)}) if as_json else out)


def _draw_motion(path: Path, out: Path, model: Path | None, rig: Path | None, space: Path | None) -> None:
    """A motion before it runs."""
    from arm_model.collision import read_chain
    from daq.rig import read_rig
    from experiment import demand_of, read_experiment

    checked = None if rig is None else read_rig(rig, drivers=False)
    arm = model or (checked.model_path if checked else None)
    if arm is None:
        raise InputError("--model", "is missing, and no --rig names one; the picture of a motion needs the arm")
    experiment, chain = read_experiment(path), read_chain(arm)
    if len(experiment.start) != len(chain):
        raise InputError(path, f"is for {len(experiment.start)} joints, the model has {len(chain)}")
    limits = None if checked is None or checked.limits.position is None else np.array(checked.limits.position)
    if limits is not None and len(limits) != len(chain):
        raise InputError("--rig", f"has {len(limits)} joints, the model has {len(chain)}")
    draw(out, demand_of(experiment), chain, space_of(checked, space), limits)
