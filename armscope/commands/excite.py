"""``armscope excite``: the motion that shows an arm's parameters best, as an experiment that ``record`` runs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from arm_io.json_text import json_text
from arm_io.progress import Step
from arm_io.toml import check_kind
from armscope.commands.options import Json
from armscope.progress import shown

if TYPE_CHECKING:
    from arm_clearance import Chain, Pairs, Space
    from arm_model import Arm
    from daq.rig import Rig
    from experiment import Experiment
    from identification.experiment_design import Limits, Series


Criterion = Literal["d", "condition"]


def command(
    out: Annotated[Path, typer.Option(metavar="EXP.toml", help="the experiment file to write")],
    model: Annotated[
        Path | None, typer.Option(metavar="MODEL.toml", help="the arm, with its limits; default: the rig's model")
    ] = None,
    rig: Annotated[
        Path | None, typer.Option(metavar="RIG.toml", help="also observe the limits of this rig, as record requires")
    ] = None,
    duration: Annotated[
        float, typer.Option(min=2.0, help="duration, s (preferably whole periods of the fundamental)")
    ] = 20.0,
    fundamental: Annotated[float, typer.Option(min=0.01, help="fundamental frequency, Hz")] = 0.1,
    harmonics: Annotated[int, typer.Option(min=1, max=20, help="number of harmonics per joint")] = 5,
    criterion: Annotated[Criterion, typer.Option(help="d: D-optimal; condition: minimum condition number")] = "d",
    candidates: Annotated[int, typer.Option(min=32, help="number of candidate motions")] = 1600,
    seed: Annotated[int, typer.Option(help="seed of the random candidates; the same seed gives the same motion")] = 1,
    floor: Annotated[
        float | None,
        typer.Option(metavar="Z", help="z of the floor or table top in the base frame, m; all links stay above it"),
    ] = None,
    space: Annotated[
        Path | None,
        typer.Option(metavar="SPACE.toml", help="floor, boxes and limits of the tool; default: the rig's [space]"),
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="also draw the motion (.png, .svg or .pdf)")
    ] = None,
    trajectory: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE",
            help="also write points: JointTrajectory (.yaml, .json), .csv or URScript (.script); may be repeated",
        ),
    ] = None,
    trajectory_rate: Annotated[
        float,
        typer.Option(
            min=1.0, max=10_000.0, help="points per second of --trajectory; for URScript, the rate of the robot"
        ),
    ] = 125.0,
    as_json: Json = False,
) -> None:
    from arm_io import counted
    from arm_report.picture_file import check_picture
    from armscope.motion import clearance_in_words, clearance_of, draw, travel_in_words, travel_of
    from experiment import check_trajectory, demand_of, write_experiment, write_trajectory
    from identification.experiment_design import Series

    check_kind(out, "segment")
    if plot is not None:
        check_picture(plot)
    task = _task(model, rig, space, floor)
    for path in trajectory or []:
        check_trajectory(path, len(task.arm))
    series = Series(duration, fundamental, harmonics)
    search = {"criterion": criterion, "candidates": candidates, "seed": seed}
    designed = _off_the_setpoints(task.arm, _design(task, series, as_json, search), task.rig)
    write_experiment(out, designed, heading=f"Excitation for {task.arm.name}, seed {seed}, {candidates} candidates.")
    demand = demand_of(designed)
    if plot is not None:
        draw(plot, demand, task.chain, task.around, task.limits.position)
    points = {str(path): write_trajectory(path, demand, task.names, trajectory_rate) for path in trajectory or []}
    if as_json:
        table = {"file": str(out), "duration": duration, "joints": len(task.arm), "harmonics": harmonics}
        clearance = clearance_of(demand, task.chain, task.pairs)
        table |= {"trajectories": points, "rate": designed.rate, "travel": travel_of(demand), "clearance": clearance}
        print(json_text(table))
        return
    joints = counted(len(task.arm), "joint")
    sampled = f", {designed.rate:g} rows/s (not a multiple of the setpoint rate)" if designed.rate else ""
    print(f"{out}: {duration:g} s, {harmonics} harmonics of {fundamental:g} Hz for {joints}{sampled}")
    sentences = travel_in_words(demand, task.arm) + clearance_in_words(demand, task.chain, task.pairs)
    print("\n".join(f"  {line}" for line in sentences))
    for file, count in points.items():
        print(f"{file}: {count} points, {trajectory_rate:g} per second")


@dataclass(frozen=True)
class _Task:
    """What a motion is designed for: the arm, its rig if one is given, and what the motion must keep within.

    chain, around, pairs  capsules of the arm, the space around it, and which of them must stay apart
    """

    arm: Arm
    rig: Rig | None
    limits: Limits
    chain: Chain
    around: Space | None
    pairs: Pairs | None

    @property
    def names(self) -> list[str]:
        """Of the joints."""
        return [joint.name or f"joint{number}" for number, joint in enumerate(self.arm.joints, 1)]


def _task(model: Path | None, rig: Path | None, space: Path | None, floor: float | None) -> _Task:
    """The arm and its bounds as the options say; notes on stderr what the model lacks. Raises InputError."""
    from arm_clearance import pairs_of
    from arm_model import on_fixed_base, read_model
    from arm_model.collision import chain_of
    from armscope.api.reading import note_gaps
    from armscope.motion import space_of
    from daq.rig import read_rig

    checked = None if rig is None else read_rig(rig, drivers=False)
    source = _model_path(model, checked)
    arm = on_fixed_base(read_model(source), source, "'armscope excite'")
    note_gaps(source, "dynamics", "collisions")
    chain, around = chain_of(arm), space_of(checked, space, floor)
    pairs = None if around is None else pairs_of(chain, around)
    return _Task(arm, checked, replace(_limits(arm, checked), pairs=pairs), chain, around, pairs)


def _model_path(model: Path | None, rig: Rig | None) -> Path:
    """The model given, else the rig's."""
    from arm_io import InputError

    path = model or (rig.model_path if rig else None)
    if path is None:
        raise InputError("--model", "is missing, and no --rig names one")
    return path


def _off_the_setpoints(arm: Arm, designed: Experiment, rig: Rig | None) -> Experiment:
    """The experiment, sampled at no multiple of the setpoint rate if the rig's own rate is one."""
    from identification.preprocessing import stated_period
    from identification.preprocessing.folding import rate_beside

    period = stated_period(arm)
    if rig is None or rig.trigger is None or (rate := rate_beside(period, rig.trigger.rate)) == rig.trigger.rate:
        return designed
    return designed.model_copy(update={"rate": rate})


def _limits(arm: Arm, rig: Rig | None) -> Limits:
    """The limits of the arm, and of the rig if one is given; InputError if their joints differ in number."""
    from arm_io import InputError, counted
    from identification.experiment_design import Limits

    limits = Limits.of(arm)
    if rig is None:
        return limits
    if rig.joints != len(arm):
        raise InputError("--rig", f"has {counted(rig.joints, 'joint')}, the model '{arm.name}' has {len(arm)}")
    return limits.within(arm, **rig.limits.model_dump())


def _design(task: _Task, series: Series, as_json: bool, search: dict[str, Any]) -> Experiment:
    """The best of the candidate motions, ``design_excitation``; shows progress on a terminal."""
    from identification.experiment_design import design_excitation

    with shown(as_json) as progress:
        return design_excitation(
            task.arm,
            series,
            limits=task.limits,
            **search,
            progress=lambda share, text: progress(Step("designing", share, 1.0, detail=text)),
        )
