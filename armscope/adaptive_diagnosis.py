"""``armscope diagnose --rig``: continues where the verdict has an ambiguity group.

It shows the discriminating experiment, records it twice, and diagnoses again.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from arm_io import DeviceFault, InputError, counted
from arm_model.collision import read_chain
from armscope.api.recording import record
from armscope.commands.record import run_shown
from daq.recording import Recording, open_recording
from daq.rig import Rig, chain_of, check_motion, read_rig
from diagnosis import Diagnosis, in_words
from diagnosis.experiments import Separation, separations
from diagnosis.report import title
from experiment import write_experiment
from identification.experiment_design import Limits

Say = Callable[[str], None]
SIDES = ("fit", "held_out")
"""Each experiment is recorded twice: once to find causes in, once to judge by."""


@dataclass
class Case:
    """What is known so far: recordings to fit and to hold out, and their diagnosis.

    Also the experiments that would resolve its groups, and what was recorded of them.
    """

    fit: list[Recording]
    held_out: list[Recording]
    result: Diagnosis
    separate: dict[int, Separation]
    experiments: list[dict[str, Any]] = field(default_factory=list)
    lost: bool = False


@dataclass(frozen=True)
class Bench:
    """The rig that experiments are recorded on; ``yes``: a real arm may be moved without asking.

    ``keep``: writes what is known so far.
    """

    file: Path
    rig: Rig
    out: Path
    yes: bool
    say: Say
    judge: Callable[[list[Recording], list[Recording]], Diagnosis]
    keep: Callable[[Case], None]

    @property
    def simulated(self) -> bool:
        """Whether every device is a simulated one, so that nothing real can move."""
        return bool(self.rig.device) and all(one.driver.startswith("sim_backend.") for one in self.rig.device)


def rig_of(path: Path, joints: int) -> Rig:
    """The rig file; InputError where it has another number of joints, or no devices to record with."""
    rig = read_rig(path)
    if rig.joints != joints:
        raise InputError(path, f"has {counted(rig.joints, 'joint')}, the model {joints}")
    if not rig.device:
        raise InputError(path, "has no devices; an experiment cannot be recorded on it")
    return rig


def limits_of(rig: Rig, drive_constant: np.ndarray) -> Limits:
    """Limits of the rig file: position rad, speed rad/s, torque N m (current times ``drive_constant`` (n,) N m/A).

    A limit that the file does not state is infinite.
    """
    none = np.full(rig.joints, np.inf)
    limits = rig.limits
    position = np.column_stack([-none, none]) if limits.position is None else np.array(limits.position, float)
    speed = none if limits.speed is None else np.array(limits.speed, float)
    torque = none if limits.current is None else np.array(limits.current, float) * drive_constant
    return Limits(position, speed, none, torque)


def go_on(bench: Bench, case: Case, most: int, progress: Say) -> Case:
    """Records experiments until no group is left that a motion can resolve, or ``most`` were recorded.

    ``case`` has been written before; each further stage is written completely before the next begins.

    DeviceFault where a run fails, KeyboardInterrupt where it is stopped: what was known before stands, and so do the
    recordings.
    """
    limits = limits_of(bench.rig, case.result.arm.joint_array("drive_constant"))
    while True:
        case.separate = separations(case.result, limits, progress)
        bench.keep(case)
        place = next((k for k, one in case.separate.items() if one.experiment and not _had(case, one)), None)
        if place is None or len(case.experiments) >= most or case.lost:
            return case
        separation = case.separate[place]
        if not _allowed(bench, case, place, separation, most):
            return case
        paths = _recorded(bench, separation, case)
        case.fit.append(open_recording(paths[0]))
        case.held_out.append(open_recording(paths[1]))
        case.experiments.append(
            {"files": list(map(str, paths)), "motion": separation.words, "distance": separation.distance}
        )
        if not case.lost:
            case.result = bench.judge(case.fit, case.held_out)


def _had(case: Case, one: Separation) -> bool:
    return any(before["motion"] == one.words for before in case.experiments)


def _allowed(bench: Bench, case: Case, place: int, separation: Separation, most: int) -> bool:
    """Shows the experiment; whether it may be run."""
    assert separation.experiment is not None
    cause = case.result.causes[place]
    members = " or ".join(map(in_words, cause.group))
    bench.say(f"experiment {len(case.experiments) + 1} of at most {most}, for {title(cause)}: is it {members}?")
    bench.say(
        f"  {separation.words}; recorded twice; discrimination distance {separation.distance:.0f} standard deviations"
    )
    problems = check_motion(bench.rig, separation.experiment, chain_of(bench.rig, read_chain))
    if problems:
        bench.say(f"  not run: {problems[0]}")
        return False
    if bench.simulated:
        return True
    needed = separation.experiment.setup.instruction
    if needed:
        bench.say(f"  before it: {needed}")
    if (bench.yes and not needed) or (sys.stdin.isatty() and _confirmed()):
        return True
    why = "it needs a person at the arm" if bench.yes else "moving a real arm must be confirmed (--yes)"
    bench.say(f"  not run: {why}; the experiment file is written, for 'armscope record'")
    return False


def _confirmed() -> bool:
    import typer

    return typer.confirm("  Is the workspace clear, and may the arm move?", default=False, err=True)


def _recorded(bench: Bench, separation: Separation, case: Case) -> list[Path]:
    """The two recordings of an experiment."""
    assert separation.experiment is not None
    number = 1
    while any((bench.out / f"experiment_{number}{rest}").exists() for rest in (".toml", "_fit.mcap", "_held_out.mcap")):
        number += 1
    file = bench.out / f"experiment_{number}.toml"
    write_experiment(file, separation.experiment, heading=separation.words)
    paths = [bench.out / f"experiment_{number}_{side}.mcap" for side in SIDES]
    for path in paths:
        with run_shown() as progress:
            result = record(bench.file, file, path, progress=progress).to_json()
        ending = result["ending"]
        if ending["fault"]:
            raise DeviceFault(bench.rig.name, f"{ending['sentence']}; {path} has the rows recorded until then")
        if ending["reason"] in ("stopped", "terminated"):
            raise KeyboardInterrupt
        if result["ledger"]["lost"]:
            bench.say(f"  {path}: {result['ledger']['lost']} rows were lost; it is not used for diagnosis")
            case.lost = True
    return paths
