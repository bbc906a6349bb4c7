"""A model run on an experiment, or on the demands of a recording."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from arm_io import InputError, counted, read_text
from arm_io.progress import silent
from arm_io.types import Array, Progress
from arm_model import Arm, EffectTerm, Motion, write_model
from arm_model.collision import chain_of
from arm_model.effects.description_errors import PAYLOAD
from arm_model.sensing import Readings, recorded
from arm_model.simulation import Demand, row_times, servo_period, simulate_at
from arm_model.tables import constant_temperatures, recorded_temperatures
from arm_model.tracking import tracked
from armscope.api.reading import File, Source, open_recording, read_experiment, read_model
from armscope.shipped import found
from daq.recording import Attachments, Recording, write_table
from daq.recording.provenance import file_identity, provenance
from experiment import Experiment, demand_of, write_experiment
from identification.preprocessing import check_joints, demand_of_run

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

RATE = 1000.0
"""Rows/s where neither the experiment nor the caller says."""
COLDEST, HOTTEST = -60.0, 200.0
"""degC of a motor: what lies beyond is another unit."""
MOST_NUMBERS = 30_000_000
"""Rows, or ticks of the servos, times joints: six joints at 1 kHz for 73 minutes take 4 GB."""
Point = tuple[float, float, float]


@dataclass(frozen=True)
class _Task:
    """What is to be simulated: rows at ``times`` s; ``powered``: with the drives on."""

    arm: Arm
    demand: Demand
    times: Array
    powered: bool = True
    experiment: str | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, repr=False, eq=False)
class Simulation:
    """What ``simulate`` returns: n rows of J joints, as a recording of the simulated arm would hold them.

    arm       the simulated arm, with the payload of the experiment
    motion    joint, motor and demanded positions, currents and torques without the errors of any instrument
    readings  what encoders and transducers show of it
    xyz       (n, 3) m, the tracker's target in the base frame; None without a target
    seconds   s that the simulation took
    notes     sentences about what is wrong with the recording whose demands were followed
    """

    arm: Arm
    motion: Motion
    readings: Readings
    xyz: Array | None
    seconds: float
    notes: tuple[str, ...]
    attachments: Attachments

    @property
    def t(self) -> Array:
        """(n,) s since the first row."""
        return self.motion.t

    @property
    def q(self) -> Array:
        """(n, J) rad (m), motor encoder over gear ratio."""
        return self.readings.q

    @property
    def i(self) -> Array:
        """(n, J) A as the transducers show it; positive drives the joint in the positive direction."""
        return self.readings.current

    @property
    def qref(self) -> Array:
        """(n, J) rad (m) demanded."""
        return self.motion.demand

    def __len__(self) -> int:
        return len(self.t)

    def __repr__(self) -> str:
        return f"<Simulation of {self.arm.name}: {self}>"

    def __str__(self) -> str:
        joints = len(self.arm)
        return (
            f"{len(self)} rows of {counted(joints, 'joint')}, {self.t[-1] - self.t[0]:.2f} s simulated in "
            f"{self.seconds:.3f} s"
        )

    def to_json(self) -> dict[str, Any]:
        """Size and duration."""
        duration = float(self.t[-1] - self.t[0])
        return {"rows": len(self), "joints": len(self.arm), "duration": duration, "seconds": self.seconds}

    def _repr_html_(self) -> str:
        from html import escape

        from arm_report import image

        return f"<p>{escape(repr(self))}</p>{image(self.plot(), 'positions and currents of all joints over time')}"

    def plot(self) -> Figure:
        """Position over the demanded one, and current, joint by joint."""
        from arm_report.notebook import drawing

        joints = len(self.arm)
        figure = drawing(10, 1.2 + 2.0 * joints)
        axes = figure.subplots(joints, 2, sharex=True, squeeze=False)
        for j, (position, current) in enumerate(axes):
            unit = "rad" if self.arm.joints[j].revolute else "m"
            position.plot(self.t, self.qref[:, j], color="0.7", lw=3, label="demand")
            position.plot(self.t, self.q[:, j], lw=1, label="simulated")
            position.set_ylabel(f"{self.arm.joints[j].name or f'joint {j + 1}'}\nposition [{unit}]")
            current.plot(self.t, self.i[:, j], lw=0.8)
            current.set_ylabel(f"current [{self.arm.joints[j].command_unit}]")
        axes[0, 0].legend(fontsize="small")
        for axis in axes[-1]:
            axis.set_xlabel("t [s]")
        return figure

    def to_pandas(self) -> pandas.DataFrame:
        """By t (s): the columns of ``armscope export``, units in ``attrs["units"]``.

        InputError where pandas is not installed.
        """
        from arm_report.notebook import frame_over_time

        columns, units, joints = {}, {"x": "m", "y": "m", "z": "m"}, self.arm.joints
        for signal, values in (("q", self.q), ("i", self.i), ("qref", self.qref)):
            for number, joint in enumerate(joints, 1):
                columns[f"{signal}{number}"] = values[:, number - 1]
                position = "rad" if joint.revolute else "m"
                units[f"{signal}{number}"] = joint.command_unit if signal == "i" else position
        if self.xyz is not None:
            columns |= dict(zip("xyz", self.xyz.T))
        return frame_over_time(self.t, columns, {"units": {name: units[name] for name in columns}})

    def write(self, path: File) -> Recording:
        """Writes a recording (.mcap), replacing one that is there, and opens it."""
        signals = {"q": self.q, "i": self.i, "qref": self.qref}
        if self.xyz is not None:
            signals["xyz"] = self.xyz
        if (warm := self.arm.temperatures) is not None:
            seen = [warm.at(j, self.t) for j in range(len(self.arm))]
            signals["temp"] = np.column_stack([np.full_like(self.t, np.nan) if one is None else one for one in seen])
        write_table(
            Path(path),
            self.t,
            signals,
            self.attachments,
            extra=None if self.motion.base is None else self.motion.base.columns(),
            joints=[joint.name or f"joint{number}" for number, joint in enumerate(self.arm.joints, 1)],
            effort=[joint.drive_constant for joint in self.arm.joints],
        )
        return open_recording(path)


def simulate(
    model: File | Arm,
    experiment: File | Experiment | None = None,
    *,
    like: Source | None = None,
    rate: float | None = None,
    target: Point | None = None,
    temperature: float | None = None,
    progress: Progress = silent,
) -> Simulation:
    """The arm in closed loop with the position controller of its model.

    model       the arm; it must have a [controller]
    experiment  what the arm is asked to do, or
    like        a recording whose demanded positions it is asked to follow
    rate        rows/s; None: the experiment's, else 1000; as the recording has them
    target      (3,) m: a tracker's target in the frame of the last link; adds ``xyz``
    temperature degC of all motors; None: as recorded in ``like``, else those at which the model's friction holds
    progress    is called with each stage in words
    Raises InputError where the joints differ in number, demands are missing, or the simulation diverges.
    """
    task = _task(model, experiment, like, rate)
    if temperature is not None:
        task = _at_temperature(task, temperature)
    progress(f"simulating {task.times[-1]:.4g} s")
    began = time.perf_counter()
    motion = _run(task)
    seconds = time.perf_counter() - began
    demands = experiment if experiment is not None else like
    source = {"model": _identity(model), "demands": _identity(demands)}
    return Simulation(
        arm=task.arm,
        motion=motion,
        readings=recorded(task.arm, motion),
        xyz=None if target is None else tracked(task.arm, motion.t, motion.q, np.array(target, float)),
        seconds=seconds,
        notes=task.notes,
        attachments=Attachments(
            model=_text(model, write_model),
            experiment=task.experiment,
            provenance=provenance("simulated", source=source, **_units(task.arm)),
            chain=chain_of(task.arm),
        ),
    )


def _units(arm: Arm) -> dict[str, Any]:
    """What a recording without a rig says of the units of q and i."""
    units = {joint.command_unit for joint in arm.joints}
    torques = {"current_unit": "N m"} if units <= {"N m", "N"} else {}
    return {"joint_types": [joint.type for joint in arm.joints], **torques}


def _task(model: File | Arm, experiment: File | Experiment | None, like: Source | None, rate: float | None) -> _Task:
    """What the arm of a model is asked to do; InputError where it cannot."""
    if (experiment is None) == (like is None):
        raise InputError("simulate", "needs either an experiment or a recording whose demands are followed")
    arm = read_model(model)
    if arm.controller is None:
        raise InputError(_name(model), "has no [controller]; following demanded positions needs one")
    if experiment is not None:
        return _of_experiment(arm, experiment, rate)
    assert like is not None
    return _of_recording(arm, open_recording(like), rate)


def _at_temperature(task: _Task, temperature: float) -> _Task:
    """The task with all motors at a temperature, degC."""
    if not COLDEST <= temperature <= HOTTEST:
        raise InputError("--temperature", f"must be between {COLDEST:g} and {HOTTEST:g} degC (is {temperature:g})")
    return replace(task, arm=replace(task.arm, temperatures=constant_temperatures(temperature, len(task.arm))))


def _of_experiment(arm: Arm, source: File | Experiment, rate: float | None) -> _Task:
    asked = read_experiment(source)
    if len(asked.start) != len(arm):
        raise InputError(_name(source), f"is for {counted(len(asked.start), 'joint')}, the model has {len(arm)}")
    if asked.setup.payload is not None:
        load = EffectTerm(PAYLOAD.name, None, asked.setup.payload.parameters)
        arm = replace(arm, effects=(*arm.effects, load))
    demand = demand_of(asked)
    times = _times(demand.duration, asked.rate or RATE if rate is None else rate, arm)
    return _Task(arm, demand, times, not asked.setup.drives_off, _text(source, write_experiment))


def _of_recording(arm: Arm, recording: Recording, rate: float | None) -> _Task:
    path = recording.path
    if recording.qref is None:
        raise InputError(path, "has no demanded positions (qref)")
    check_joints(recording, arm)
    if len(recording) < 2:
        raise InputError(path, f"has {len(recording)} rows; at least two are needed")
    arm = replace(arm, temperatures=recorded_temperatures(recording.t, recording.temp))
    t, demanded = recording.t, _without_holes(path, recording.t, recording.qref)
    _check_size(float(t[-1]), 1 / recording.dt, arm)
    times = t if rate is None else _times(float(t[-1]), rate, arm)
    asked = recording.attachments.get("experiment.toml")
    followed = demand_of_run(replace(recording, qref=demanded), arm)
    text = None if asked is None else asked.decode()
    return _Task(arm, followed, times, experiment=text, notes=tuple(f"{path}: {note}" for note in recording.notes))


def _times(seconds: float, rate: float, arm: Arm) -> Array:
    """(rows,) s from 0 on. InputError where the rate is none."""
    if not 1e-3 <= rate <= 1e7:
        raise InputError("--rate", f"must be between 0.001 and 1e7 rows/s (is {rate:g})")
    _check_size(seconds, rate, arm)
    return row_times(seconds, rate)


def _check_size(seconds: float, rate: float, arm: Arm) -> None:
    """InputError where the simulation would not fit into a laboratory's PC."""
    most = MOST_NUMBERS / len(arm) * min(1 / rate, servo_period(arm))
    if seconds > most:
        raise InputError("simulate", f"{seconds:.5g} s at {rate:g} rows/s; at most {most:.4g} s are simulated at once")


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
        return simulate_at(task.arm, task.demand, task.times)
    shown = task.demand(task.times)
    still = np.tile(task.demand(np.zeros(1))[0], (len(task.times), 1))
    nothing = np.zeros_like(still)
    return Motion(task.times, still, nothing, still, nothing, nothing, nothing, shown)


def _name(source: object) -> str | Path:
    """The name for error messages."""
    if isinstance(source, Recording):
        return source.path
    return source.name if isinstance(source, Arm | Experiment) else Path(str(source))


def _identity(source: object) -> dict[str, Any]:
    """Name and content hash of a file; of an object its name."""
    if isinstance(source, Arm | Experiment):
        return {"object": source.name}
    return file_identity(source.path if isinstance(source, Recording) else found(str(source)))


def _text(source: Any, write: Callable[..., None]) -> str:
    """The file's text; an object's as ``write`` writes it."""
    if not isinstance(source, Arm | Experiment):
        return read_text(found(source))
    with TemporaryDirectory() as folder:
        path = Path(folder, "object.toml")
        write(path, source)
        return path.read_text(encoding="utf-8")
