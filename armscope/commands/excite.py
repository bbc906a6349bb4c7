"""``armscope excite``: the motion that shows an arm's parameters best, as an experiment that ``record`` runs."""

from __future__ import annotations

import json
import sys
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from armscope.commands.options import Json

if TYPE_CHECKING:
    from arm_model import Arm
    from daq.rig import Rig
    from experiment import Experiment
    from identification.experiment_design import Limits, Series


class Criterion(StrEnum):
    d = "d"
    condition = "condition"


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
    criterion: Annotated[
        Criterion, typer.Option(help="d: D-optimal; condition: minimum condition number")
    ] = Criterion.d,
    candidates: Annotated[int, typer.Option(min=32, help="number of candidate motions")] = 1600,
    seed: Annotated[int, typer.Option(help="seed of the random candidates; the same seed gives the same motion")] = 1,
    as_json: Json = False,
) -> None:
    """Designs an excitation."""
    from arm_io import InputError
    from arm_model import read_model
    from daq.rig import read_rig
    from experiment import write_experiment
    from identification.experiment_design import Series
    from identification.preprocessing import rate_beside

    checked = None if rig is None else read_rig(rig, drivers=False)
    path = model or (checked.model_path if checked else None)
    if path is None:
        raise InputError("--model", "is missing, and no --rig names one")
    arm = read_model(path)
    series = Series(duration, fundamental, harmonics)
    designed = _design(arm, series, _limits(arm, checked), criterion, candidates, seed)
    if checked is not None and checked.trigger is not None:
        rate = rate_beside(arm, checked.trigger.rate)
        if rate != checked.trigger.rate:
            designed = designed.model_copy(update={"rate": rate})
    write_experiment(out, designed, heading=f"Excitation for {arm.name}, seed {seed}, {candidates} candidates.")
    if as_json:
        joints = len(arm)
        table = {"file": str(out), "duration": duration, "joints": joints, "harmonics": harmonics}
        print(json.dumps(table | {"rate": designed.rate}))
    else:
        sampled = f", {designed.rate:g} rows/s (not a multiple of the setpoint rate)" if designed.rate else ""
        print(f"{out}: {duration:g} s, {harmonics} harmonics of {fundamental:g} Hz for {len(arm)} joints{sampled}")


def _limits(arm: Arm, rig: Rig | None) -> Limits:
    """The limits of the arm, and of the rig if one is given; InputError if their joints differ in number."""
    from arm_io import InputError
    from identification.experiment_design import Limits

    limits = Limits.of(arm)
    if rig is None:
        return limits
    if rig.joints != len(arm):
        raise InputError("--rig", f"has {rig.joints} joints, the model '{arm.name}' has {len(arm)}")
    return limits.within(arm, **rig.limits.model_dump())


def _design(arm: Arm, series: Series, limits: Limits, criterion: Criterion, candidates: int, seed: int) -> Experiment:
    """The best of the candidate motions; shows progress on a terminal."""
    from rich.console import Console
    from rich.progress import Progress

    from identification.experiment_design import design_excitation

    with Progress(console=Console(stderr=True), disable=not sys.stderr.isatty(), transient=True) as bar:
        task = bar.add_task("designing", total=1.0)
        return design_excitation(
            arm,
            series,
            criterion=criterion.value,
            limits=limits,
            candidates=candidates,
            seed=seed,
            progress=lambda share, text: bar.update(task, completed=share, description=text),
        )
