"""``armscope plot``: a picture of recordings on one another, or of an experiment before it runs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from arm_io import InputError, counted
from arm_io.progress import Step
from arm_report.picture_file import check_picture, save_picture
from armscope.api.reading import note_gaps
from armscope.commands.options import Json
from armscope.motion import draw, space_of
from armscope.progress import shown
from daq.recording import LongRecording, open_long, plot

if TYPE_CHECKING:
    from arm_model import Arm


def command(
    recordings: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN.mcap|EXP.toml", help="recordings: measured first, then simulated; or one experiment"
        ),
    ],
    out: Annotated[Path | None, typer.Option(help="the picture (.png, .svg or .pdf)")] = None,
    animate: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.gif|html|mp4",
            help="animation of the arm: the first recording next to the second, or to its demands; needs no --out",
        ),
    ] = None,
    fps: Annotated[float, typer.Option(min=1.0, max=100.0, help="frames per second of --animate")] = 25.0,
    speed: Annotated[float, typer.Option(min=0.001, max=1000.0, help="speed of --animate relative to real time")] = 1.0,
    joint: Annotated[list[int] | None, typer.Option(help="only this joint; may be repeated")] = None,
    model: Annotated[
        Path | None,
        typer.Option(
            metavar="MODEL.toml", help="of an experiment or --animate: the arm; default: the rig's, the recording's"
        ),
    ] = None,
    rig: Annotated[
        Path | None, typer.Option(metavar="RIG.toml", help="of an experiment: the rig, for its limits and its [space]")
    ] = None,
    space: Annotated[
        Path | None,
        typer.Option(metavar="SPACE.toml", help="of an experiment: floor and boxes, instead of those of the rig"),
    ] = None,
    as_json: Json = False,
) -> None:
    if out is None and animate is None:
        raise InputError("--out", "is missing; give the name of a picture, or --animate")
    if out is not None:
        check_picture(out)
    if recordings[0].suffix == ".toml":
        if animate is not None:
            raise InputError("--animate", "is for recordings; simulate the experiment first")
        if len(recordings) > 1 or joint or out is None:
            raise InputError(recordings[0], "is an experiment: it is drawn alone, with all joints")
        _draw_motion(recordings[0], out, model, rig, space)
        print(json.dumps({"file": str(out)}) if as_json else out)
        return
    for option, given in (("--model", model if animate is None else None), ("--rig", rig), ("--space", space)):
        if given is not None:
            raise InputError(option, "is for the picture of an experiment (EXP.toml), not of recordings")
    data = [open_long(path) for path in recordings]
    joints = max(recording.joints for recording in data)
    for number in joint or []:
        if not 1 <= number <= joints:
            raise InputError("--joint", f"there is no joint {number}; it must be 1 to {joints}")
    if animate is not None:
        _animate(animate, data, model, fps, speed, as_json)
    if out is not None:
        save_picture(plot(data, joints=joint or []), out)
    written = [str(path) for path in (out, animate) if path is not None]
    print(json.dumps({"file": written[0], "files": written}) if as_json else "\n".join(written))


def _animate(
    path: Path, data: list[LongRecording], model: Path | None, fps: float, speed: float, as_json: bool
) -> None:
    """The first recording's arm beside the second's, or beside what was demanded of it."""
    from arm_model.collision import chain_of
    from armscope.animation import Movement, animate, check_animation, instants, movements
    from armscope.animation.surfaces import capsule_surfaces, read_surfaces

    check_animation(path)
    arm = _arm(data[0], model)
    note_gaps(model, "picture")
    chain = chain_of(arm)
    for recording in data:
        if recording.joints != len(chain):
            raise InputError(recording.path, f"has {counted(recording.joints, 'joint')}, the model has {len(chain)}")
    if not len(data[0]):
        raise InputError(data[0].path, "has no rows")
    when = instants(data[0].duration, fps, speed, path.suffix.lower())
    measured, demanded = movements(data[0], when.t, data[0].path.stem)
    other = None if demanded is None else Movement("demanded", demanded)
    if len(data) > 1:
        other, _ = movements(data[1], when.t, data[1].path.stem)
    with shown(as_json) as progress:
        animate(
            path,
            chain,
            when,
            measured,
            other,
            surfaces=read_surfaces(model) or capsule_surfaces(arm),
            progress=lambda share: progress(Step("drawing", share, 1.0)),
        )


def _arm(recording: LongRecording, model: Path | None) -> Arm:
    """Of --model, else of the model in the recording."""
    from arm_model import carried_arm, on_fixed_base, read_model

    purpose = "a picture of the arm's motion"
    if model is not None:
        return on_fixed_base(read_model(model), model, purpose)
    if recording.model is None:
        raise InputError(recording.path, "has no model with it; give one: --model MODEL.toml")
    where = f"{recording.path}: model.toml"
    return on_fixed_base(carried_arm(recording.model, where), where, purpose)


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
    note_gaps(arm, "collisions")
    if len(experiment.start) != len(chain):
        raise InputError(path, f"is for {counted(len(experiment.start), 'joint')}, the model has {len(chain)}")
    limits = None if checked is None or checked.limits.position is None else np.array(checked.limits.position)
    if limits is not None and len(limits) != len(chain):
        raise InputError("--rig", f"has {counted(len(limits), 'joint')}, the model has {len(chain)}")
    draw(out, demand_of(experiment), chain, space_of(checked, space), limits)
