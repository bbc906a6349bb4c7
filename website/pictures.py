"""The signature of every effect: what its first instrument shows of it, simulated on the Puma with and without it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from io import BytesIO
from typing import TYPE_CHECKING

import numpy as np

import armscope
from arm_io.types import Array
from arm_model import Arm
from arm_model.effects import Effect, Instrument, Variable
from arm_model.effects.description_errors import CURRENT_LIMIT
from arm_model.effects.sensing import DROPPED_TRIGGER, MISSED_COUNTS
from arm_model.tables.link_shapes import Cylinder
from arm_report.palette import AFTER, BEFORE, GRID
from website.effects import example_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from armscope.api.simulation import Simulation

MODEL = "config/models/puma560.toml"
EXPERIMENT = "config/experiments/excitation.toml"
JOINT = 2
"""The shoulder: it moves fast, and carries most of the weight."""
RATE = 200.0
TARGET = (0.05, 0.0, 0.1)
"""m in the frame of the last link: where the tracker looks."""
POINTS = 2500
WITHIN: dict[str, dict[str, float]] = {
    MISSED_COUNTS.name: {"time": 5.0},
    DROPPED_TRIGGER.name: {"row": 1000.0, "count": 3.0, "period": 1.0 / RATE},
    CURRENT_LIMIT.name: {"limit": 2.0},
}
"""Values with which an event happens within the motion."""
UNITS = {
    Variable.POSITION: "rad",
    Variable.MOTOR_ANGLE: "rad, within a turn",
    Variable.VELOCITY: "rad/s",
    Variable.ACCELERATION: "rad/s²",
    Variable.LOAD: "N m",
    Variable.CURRENT: "A",
    Variable.CURRENT_RATE: "A/s",
}


@dataclass(frozen=True)
class Picture:
    """A PNG file and what it shows."""

    png: bytes
    caption: str


def picture(effect: Effect) -> Picture:
    """What the first instrument that observes the effect shows of it."""
    from matplotlib.figure import Figure

    arm = _arm(effect.cylinder)
    chosen = [parameter for parameter in effect.parameters if parameter.linear or not parameter.derived]
    values = {one.name: float(example_text(one)) for one in chosen} | WITHIN.get(effect.name, {})
    joint = JOINT if effect.per_joint else None
    without, having = _simulated(effect.cylinder), _run(arm.with_effect(effect.name, joint=joint, **values))
    figure = Figure(figsize=(8.4, 3.0), layout="constrained", dpi=110)
    axis = figure.subplots()
    shown = JOINT - 1 if joint else int(np.argmax(np.std(having.i - without.i, axis=0)))
    what = _draw(axis, effect, _Pair(without, having, shown))
    axis.grid(color=GRID)
    axis.set_axisbelow(True)
    file = BytesIO()
    figure.savefig(file, format="png")
    units = {one.name: "" if one.unit == "1" else f" {one.unit}" for one in effect.parameters}
    given = ", ".join(f"{name} {value:g}{units[name]}" for name, value in values.items() if value)
    whose = f"at joint {joint} of " if joint else "of "
    return Picture(file.getvalue(), f"{what}. Simulated {whose}the Puma 560 on an exciting motion, with {given}.")


@dataclass(frozen=True)
class _Pair:
    """Two runs, and the joint (from 0) that is looked at."""

    without: Simulation
    having: Simulation
    joint: int

    def change(self, angle: bool) -> tuple[Array, str, str]:
        """(n,) change of the joint's recorded angle or current, its name, and its unit."""
        if angle:
            return 1e3 * (self.having.q - self.without.q)[:, self.joint], "recorded angle", "mrad"
        return 1e3 * (self.having.i - self.without.i)[:, self.joint], "current", "mA"


def _draw(axis: Axes, effect: Effect, pair: _Pair) -> str:
    """Draws the signature and says what it is."""
    instrument, seen = next(iter(effect.observed_by.items()))
    without, having, number = pair.without, pair.having, pair.joint + 1
    speed = without.motion.qd[:, pair.joint]
    if instrument in (Instrument.TRACKER, Instrument.CALIBRATION):
        assert having.xyz is not None and without.xyz is not None
        distance = 1e3 * np.linalg.norm(having.xyz - without.xyz, axis=1)
        _cloud(axis, without.motion.q[:, pair.joint], distance, speed)
        axis.set(xlabel=f"position of joint {number} [rad]", ylabel="distance [mm]")
        return "How far the tracked point is from where the nominal model puts it"
    change, name, unit = pair.change(effect.angle is not None)
    axis.set_ylabel(f"change of the {name} [{unit}]")
    if instrument in (Instrument.RAW, Instrument.LAG):
        _event(axis, without.t, change)
        return f"The {name} of joint {number} with the effect less that without it, over time"
    _cloud(axis, _variable(seen.against, pair), change, speed)
    axis.set_xlabel(f"{seen.against} of joint {number} [{UNITS[seen.against]}]")
    return f"The {name} of joint {number} with the effect less that without it, against {seen.against}"


def _event(axis: Axes, t: Array, change: Array) -> None:
    """The time about where a signal first changes by much."""
    begin = t[np.argmax(np.abs(change) > 0.2 * np.abs(change).max())]
    shown = (t >= begin - 0.25) & (t <= begin + 0.75)
    axis.plot(t[shown], change[shown], color=BEFORE, lw=1.2)
    axis.set_xlabel("t [s]")


def _cloud(axis: Axes, x: Array, y: Array, speed: Array) -> None:
    """Rows as points, by the direction of motion."""
    thin = slice(None, None, max(1, len(x) // POINTS))
    for sign, colour, label in ((1, BEFORE, "moving forward"), (-1, AFTER, "moving back")):
        rows = np.sign(speed[thin]) == sign
        axis.plot(x[thin][rows], y[thin][rows], ".", ms=2.5, color=colour, label=label)
    low, high = np.quantile(y, [0.002, 0.998])
    room = max(0.15 * (high - low), 0.1 * max(abs(low), abs(high)), 1e-9)
    axis.set_ylim(low - room, high + room)
    axis.legend(fontsize="small", markerscale=4)


def _variable(against: Variable, pair: _Pair) -> Array:
    """(n,) what a residual is drawn against, of the joint that is looked at."""
    run, j = pair.without, pair.joint
    motion, joint = run.motion, run.arm.joints[j]
    acceleration = np.gradient(motion.qd[:, j], motion.t)
    return {
        Variable.POSITION: lambda: motion.q[:, j],
        Variable.MOTOR_ANGLE: lambda: np.mod(abs(joint.gear) * motion.q[:, j], 2 * np.pi),
        Variable.VELOCITY: lambda: motion.qd[:, j],
        Variable.ACCELERATION: lambda: acceleration,
        Variable.LOAD: lambda: motion.torque[:, j],
        Variable.CURRENT: lambda: run.i[:, j],
        Variable.CURRENT_RATE: lambda: np.gradient(run.i[:, j], motion.t),
    }[against]()


@cache
def _arm(in_water: bool) -> Arm:
    """The Puma; in water its upper arm is a cylinder."""
    arm = armscope.read_model(MODEL)
    if not in_water:
        return arm
    joints = list(arm.joints)
    upper = Cylinder(start=(-0.43, 0.0, 0.0), end=(0.0, 0.0, 0.0), radius=0.08)
    joints[JOINT - 1] = replace(joints[JOINT - 1], cylinder=upper)
    return replace(arm, joints=tuple(joints))


@cache
def _simulated(in_water: bool) -> Simulation:
    return _run(_arm(in_water))


def _run(arm: Arm) -> Simulation:
    return armscope.simulate(arm, EXPERIMENT, rate=RATE, target=TARGET)
