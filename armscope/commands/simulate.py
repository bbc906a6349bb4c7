"""``armscope simulate``: the model run on an experiment, or on the demands of a recording."""

from __future__ import annotations

import json
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from arm_io import InputError
from arm_io.types import Array
from arm_model.description import Arm, EffectTerm
from arm_model.model_file import read_model
from arm_model.motion import Motion
from arm_model.sensing import recorded
from arm_model.simulation.simulation import Demand, Sampled, simulate
from arm_model.tracking import tracked
from daq.recording import open_recording
from daq.recording.parts import Attachments
from daq.recording.provenance import file_identity, provenance
from daq.recording.table import write_table
from experiment import Experiment, demand_of, read_experiment
from identification.preprocessing.demands import tracked_as_recorded

RATE = 1000.0
"""Rows/s where neither the experiment nor the command line says."""


@dataclass(frozen=True)
class _Task:
    """What is to be simulated: rows at ``times`` s; ``powered``: with the drives on."""

    arm: Arm
    demand: Demand
    times: Array
    start: Array | None
    powered: bool
    experiment: str | None


def command(
    model: Annotated[Path, typer.Option(help="the arm (config/models/*.toml)")],
    out: Annotated[Path, typer.Option(help="the recording to write (replaced if it is there)")],
    experiment: Annotated[Path | None, typer.Option(help="what the arm is to do")] = None,
    like: Annotated[Path | None, typer.Option(help="a recording whose demanded positions the arm is to follow")] = None,
    rate: Annotated[float | None, typer.Option(help="rows/s; default: the experiment's, else 1000")] = None,
    target: Annotated[str | None, typer.Option(help="x,y,z m of a tracker's target on the last link: adds xyz")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="print the result as JSON")] = False,
) -> None:
    if (experiment is None) == (like is None):
        raise InputError("simulate", "wants either --experiment or --like")
    arm = read_model(model)
    if arm.controller is None:
        raise InputError(model, "has no [controller]; following demanded positions wants one")
    task = _of_experiment(arm, experiment, rate) if experiment is not None else _of_recording(arm, like, rate)
    point = None if target is None else _point(target)
    began = time.perf_counter()
    motion = _run(task)
    seconds = time.perf_counter() - began
    readings = recorded(task.arm, motion)
    source = {"model": file_identity(model), "demands": file_identity(experiment or like or model)}
    attachments = Attachments(
        model=model.read_text(encoding="utf-8"),
        experiment=task.experiment,
        provenance=provenance("simulated", source=source),
    )
    write_table(
        out,
        motion.t,
        {"q": readings.q, "i": readings.current, "qref": motion.demand},
        attachments,
        joints=[joint.name or f"joint{number}" for number, joint in enumerate(arm.joints, 1)],
        effort=[joint.drive_constant for joint in arm.joints],
        xyz=None if point is None else tracked(task.arm, motion.t, motion.q, point),
    )
    duration = float(motion.t[-1] - motion.t[0])
    result = {"file": str(out), "rows": len(motion.t), "joints": len(arm), "duration": duration, "seconds": seconds}
    if as_json:
        print(json.dumps(result))
    else:
        print(
            f"{out}: {len(motion.t)} rows of {len(arm)} joint{'s' * (len(arm) > 1)}, {duration:.2f} s simulated in {seconds:.3f} s"
        )


def _of_experiment(arm: Arm, path: Path, rate: float | None) -> _Task:
    wanted: Experiment = read_experiment(path)
    if len(wanted.start) != len(arm):
        raise InputError(path, f"is for {len(wanted.start)} joints, the model has {len(arm)}")
    if wanted.setup.payload is not None:
        x, y, z = wanted.setup.payload.com
        load = EffectTerm("payload", None, {"mass": wanted.setup.payload.mass, "x": x, "y": y, "z": z})
        arm = replace(arm, effects=(*arm.effects, load))
    demand = demand_of(wanted)
    rows = rate or wanted.rate or RATE
    times = np.arange(int(np.floor(demand.duration * rows + 1e-9)) + 1) / rows
    text = path.read_text(encoding="utf-8")
    return _Task(arm, demand, times, None, not wanted.setup.drives_off, text)


def _of_recording(arm: Arm, path: Path | None, rate: float | None) -> _Task:
    assert path is not None
    recording = open_recording(path)
    for note in recording.notes:
        print(f"warning: {path}: {note}", file=sys.stderr)
    if recording.qref is None:
        raise InputError(path, "has no demanded positions (qref); a recording with them is wanted")
    if recording.joints != len(arm):
        raise InputError(path, f"has {recording.joints} joints, the model has {len(arm)}")
    if len(recording) < 2:
        raise InputError(path, f"has {len(recording)} rows; at least two are wanted")
    t, demanded = recording.t, _without_holes(path, recording.t, recording.qref)
    times = t if rate is None else np.arange(int(np.floor(t[-1] * rate + 1e-9)) + 1) / rate

    def demand(at: Array) -> Array:
        return np.column_stack([np.interp(at, t, demanded[:, j]) for j in range(len(arm))])

    wanted = recording.attachments.get("experiment.toml")
    tracked = Sampled(demand) if tracked_as_recorded(recording, arm) else demand
    return _Task(arm, tracked, times, None, True, None if wanted is None else wanted.decode())


def _without_holes(path: Path, t: Array, values: Array) -> Array:
    """Missing samples filled by linear interpolation in time."""
    filled = values.copy()
    for j in range(values.shape[1]):
        there = ~np.isnan(values[:, j])
        if not there.any():
            raise InputError(path, f"has no demanded positions of joint {j + 1} (qref{j + 1})")
        filled[:, j] = np.interp(t, t[there], values[there, j])
    return filled


def _run(task: _Task) -> Motion:
    if task.powered:
        duration = float(task.times[-1])
        return simulate(
            task.arm,
            task.demand,
            duration=duration,
            rate=RATE,
            times=task.times,
            start=task.start,
        )
    shown = task.demand(task.times)
    still = np.tile(task.demand(np.zeros(1))[0], (len(task.times), 1))
    nothing = np.zeros_like(still)
    return Motion(task.times, still, nothing, still, nothing, nothing, nothing, shown)


def _point(text: str) -> Array:
    try:
        point = np.array([float(part) for part in text.split(",")])
    except ValueError:
        point = np.zeros(0)
    if point.shape != (3,):
        raise InputError("--target", f"{text!r} is not x,y,z in m, as 0.05,0,0.1")
    return point
