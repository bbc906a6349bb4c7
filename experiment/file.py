"""The experiment file (``config/experiments/*.toml``): run by ``record`` and ``simulate``, written by ``excite``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from arm_io import InputError, check_table, read_toml, write_toml
from arm_io.table import Rate, Table
from experiment.demand import demand_of
from experiment.segments import Chirp, Drive, Fourier, Move, Repeat, Segment, Setpoints

DEEPEST_REPEAT = 5
"""Of repeats in one another.

Every one may double what is kept of the motion inside (``experiment.demand.Repeated``).
"""


class Payload(Table):
    """A known body bolted to the flange before the run."""

    mass: Annotated[float, Field(gt=0)]  # kg
    com: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m, in the frame of the last link
    inertia: tuple[float, float, float, float, float, float] = (0.0,) * 6  # kg m2 about com: xx, yy, zz, xy, yz, xz

    @property
    def parameters(self) -> dict[str, float]:
        """The parameters of the effect ``payload`` that it is."""
        entries = zip(("ixx", "iyy", "izz", "ixy", "iyz", "ixz"), self.inertia)
        return {"mass": self.mass, **dict(zip("xyz", self.com)), **dict(entries)}


class Setup(Table):
    """Manual preparation of the arm before this run; a simulated rig does it automatically."""

    payload: Payload | None = None
    drives_off: bool = False  # motors unpowered, brakes on: what the current channels show is their own offset
    instruction: str = ""  # one sentence for the person at the arm


class Experiment(Table):
    """One motion of the arm and how to sample it.

    start              (joints,) rad or m: the pose in which the arm stands before the first segment
    full_speed         (joints,) rad/s: what ``speed = 1`` of a segment means
    full_acceleration  (joints,) rad/s2 of the trapezoidal ramps
    rate               rows/s; None: as the rig file says
    """

    name: str
    description: str = ""
    start: list[float] = Field(min_length=1)
    full_speed: list[Annotated[float, Field(ge=1e-9)]]
    full_acceleration: list[Annotated[float, Field(ge=1e-9)]]
    rate: Rate | None = None
    setup: Setup = Setup()
    segment: list[Segment] = Field(min_length=1)

    @model_validator(mode="after")
    def _joints_agree(self) -> Self:
        joints = len(self.start)
        for name in ("full_speed", "full_acceleration"):
            if len(getattr(self, name)) != joints:
                raise ValueError(f"'{name}' has {len(getattr(self, name))} entries, 'start' has {joints}")
        _check_joints(self.segment, joints, "segment")
        return self


def _check_joints(segments: list[Segment], joints: int, place: str) -> None:
    if place.count(".segment") > DEEPEST_REPEAT:
        raise ValueError(f"{place}: repeats are nested more than {DEEPEST_REPEAT} deep")
    for number, segment in enumerate(segments, 1):
        here = f"{place}[{number}]"
        if isinstance(segment, Drive | Chirp) and segment.joint > joints:
            raise ValueError(f"{here}.joint: {segment.joint} is not in 1..{joints}")
        if isinstance(segment, Move) and len(segment.to) != joints:
            raise ValueError(f"{here}.to: has {len(segment.to)} entries, needs {joints}")
        if isinstance(segment, Fourier) and len(segment.sine) != joints:
            raise ValueError(f"{here}.sine: has {len(segment.sine)} rows, needs {joints}")
        if isinstance(segment, Setpoints) and any(len(row) != joints for row in segment.positions):
            raise ValueError(f"{here}.positions: every row needs {joints} entries")
        if isinstance(segment, Repeat):
            _check_joints(segment.segment, joints, f"{here}.segment")


def read_experiment(path: str | Path) -> Experiment:
    """Reads an experiment file; InputError names the file, the entry and what would be right."""
    return experiment_of(read_toml(path), path)


def experiment_of(table: Mapping[str, Any], where: str | Path) -> Experiment:
    """The experiment in a table as a file has it; ``where`` names it in InputErrors."""
    experiment = check_table(where, table, Experiment)
    try:
        demand_of(experiment)
    except InputError as error:
        raise InputError(where, error.what) from None
    return experiment


def write_experiment(path: str | Path, experiment: Experiment, *, heading: str = "") -> None:
    """Writes an experiment file that ``read_experiment`` reads back as an equal Experiment."""
    write_toml(path, experiment.model_dump(exclude_none=True, exclude_defaults=True, mode="json"), heading=heading)
