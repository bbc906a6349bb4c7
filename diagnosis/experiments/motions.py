"""Motions among which experiments are chosen: families that each excite other effects, within the limits of the arm.

Single moves at several speeds, a ladder of speeds, slow sweeps, small slow ramps of torque, standstill with the drives
on and off, chirps, moves through the place where gravity changes sign, one cycle repeated with holds, and the whole
arm's excitation; with a known payload where asked.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property
from typing import Any

import numpy as np

from arm_io import InputError
from arm_io.types import Array
from arm_model import Arm
from arm_model.system import inverse_dynamics
from experiment import Experiment
from identification.experiment_design import Limits, Series, design_excitation

Segment = dict[str, Any]
"""A segment of an experiment, as its file has it."""

SPEEDS = (0.02, 0.05, 0.1, 0.25, 0.5, 1.0)
"""Shares of the full speed of a joint."""
LONG = 12.0
"""s: longest motion, without the approach."""
RAMPS = 2.0
"""1/s: acceleration over speed; half a second to full speed is what the motors can provide."""
APPROACH = 0.3
"""Share of the full speed of the approach to the pose of a motion."""
MASS = 2.0
"""kg of the known payload."""
TIMES = {1: "once", 2: "twice"}
FEWER = 4
"""Every so many motions, one is tried with a payload: which motion hardly matters then."""
OFF = "switch the drives off and let the brakes hold the arm"
LOAD = (
    f"bolt a known mass to the flange and write its mass and centre into this file ({MASS:g} kg, 50 mm "
    "beyond the flange, in its present orientation)"
)


class Kind(StrEnum):
    """What a motion needs in order to be recorded, the least work first."""

    MOTION = "motion"
    OFF = "drives off"
    PAYLOAD = "known payload"


@dataclass(frozen=True)
class Trial:
    """One motion that could be recorded; ``words``: what moves, how far, how fast; joints: those that move, from 1."""

    words: str
    experiment: Experiment
    joints: tuple[int, ...]


@dataclass(frozen=True)
class Stage:
    """An arm at ``start`` (n,) rad, the poses (rows, n) rad at which trials may take place, and its limits."""

    arm: Arm
    start: Array
    poses: Array
    limits: Limits

    @cached_property
    def excitations(self) -> dict[str, Experiment]:
        """A slow and a brisk motion of all joints together, designed for this arm; those that its limits allow."""
        found = {}
        for seed, pace in enumerate(("slow", "brisk"), 1):
            series = Series(10.0, 0.1 * seed)
            with suppress(InputError):
                found[pace] = design_excitation(self.arm, series, limits=self.limits, candidates=32, seed=seed)
        return found


def room(arm: Arm, visited: Array | None = None, rig: Limits | None = None) -> Limits:
    """Limits of motions: those of the model, those of the rig, and positions (n, 2) visited before."""
    of_model = Limits.of(arm)
    position = np.array([joint.limits or (-1.5, 1.5) for joint in arm.joints], float)
    middle, half = position.mean(axis=1), 0.48 * np.ptp(position, axis=1)
    low, high = middle - half, middle + half
    speed, torque = of_model.speed, of_model.torque
    for other in (rig.position if rig else None, visited):
        if other is not None:
            low, high = np.maximum(low, other[:, 0]), np.minimum(high, other[:, 1])
    if rig is not None:
        speed, torque = np.minimum(speed, 0.8 * rig.speed), np.minimum(torque, 0.8 * rig.torque)
    return Limits(np.column_stack([low, high]), speed, RAMPS * speed, torque)


def trials(stage: Stage, joints: Sequence[int], kind: Kind) -> Iterator[Trial]:
    """All motions of a kind for the joints (from 1) that a question is about."""
    if kind is Kind.OFF:
        yield _standing(stage, stage.start, off=True)  # without drives it stays where it is
        return
    for number, trial in enumerate(_moving(stage, joints)):
        if kind is Kind.PAYLOAD:
            if number % FEWER:
                continue
            trial = with_payload(trial)
        yield trial


def with_payload(trial: Trial) -> Trial:
    """The same motion with a known mass at the flange."""
    mass = {"payload": {"mass": MASS, "com": [0.0, 0.0, 0.05]}, "instruction": LOAD}
    loaded = Experiment.model_validate({**trial.experiment.model_dump(), "setup": mass})
    return replace(trial, words=f"{trial.words}, with a known payload", experiment=loaded)


def _moving(stage: Stage, joints: Sequence[int]) -> Iterator[Trial]:
    for pose in stage.poses:
        for joint in joints:
            yield from of_joint(stage, pose, joint)
        yield _standing(stage, pose, off=False)
    yield from _excitations(stage)


def _experiment(stage: Stage, name: str, pose: Array, segments: list[Segment], **more: Any) -> Experiment:
    there: list[Segment] = []
    if np.max(np.abs(pose - stage.start)) > 1e-6:
        there = [{"type": "move", "to": pose.tolist(), "speed": APPROACH}]
    hold = {"type": "hold", "duration": 0.5}
    return Experiment.model_validate(
        {
            "name": name,
            "start": stage.start.tolist(),
            "full_speed": stage.limits.speed.tolist(),
            "full_acceleration": stage.limits.acceleration.tolist(),
            "segment": [hold, *there, *segments, hold],
            **more,
        }
    )


def _standing(stage: Stage, pose: Array, *, off: bool) -> Trial:
    setup = {"drives_off": True, "instruction": OFF} if off else {}
    name = f"standing still, drives {'off' if off else 'on'}"
    held = [{"type": "hold", "duration": 5.0}]
    return Trial(f"{name}, for 5 s", _experiment(stage, name, pose, held, setup=setup), ())


@dataclass(frozen=True)
class _Axis:
    """One joint (from 1) of a stage, to be moved about a pose (n,) rad."""

    stage: Stage
    pose: Array
    joint: int

    @property
    def low(self) -> float:
        """rad (m): lower limit of the joint."""
        return float(self.stage.limits.position[self.joint - 1, 0])

    @property
    def high(self) -> float:
        """rad (m): upper limit of the joint."""
        return float(self.stage.limits.position[self.joint - 1, 1])

    @property
    def span(self) -> float:
        return self.high - self.low

    @property
    def full(self) -> float:
        """Full speed, rad/s (m/s)."""
        return float(self.stage.limits.speed[self.joint - 1])

    @property
    def unit(self) -> str:
        return "rad" if self.stage.arm.joints[self.joint - 1].revolute else "m"

    def inside(self, margin: float = 0.0) -> float:
        """The position at the pose, at least ``margin`` inside the limits."""
        return float(np.clip(self.pose[self.joint - 1], self.low + margin, self.high - margin))

    def around(self, length: float) -> tuple[float, float]:
        """A stretch of a length within the limits, with the pose as near to its middle as it can be."""
        a = float(np.clip(self.inside() - length / 2, self.low, max(self.low, self.high - length)))
        return a, min(a + length, self.high)

    def to(self, place: float, speed: float) -> Segment:
        """A move at a share of the full speed."""
        return {"type": "drive", "joint": self.joint, "to": place, "speed": speed}

    def chirp(self, middle: float, amplitude: float, low: float, high: float) -> list[Segment]:
        """A chirp about ``middle`` from ``low`` to ``high`` Hz, and the move to its start."""
        band = {"frequency": low, "to_frequency": high, "duration": LONG}
        return [self.to(middle, 0.25), {"type": "chirp", "joint": self.joint, "amplitude": amplitude, **band}]

    def trial(self, name: str, words: str, segments: list[Segment]) -> Trial:
        experiment = _experiment(self.stage, f"joint {self.joint} {name}", self.pose, segments)
        return Trial(f"joint {self.joint} {words}", experiment, (self.joint,))


def of_joint(stage: Stage, pose: Array, joint: int) -> Iterator[Trial]:
    """All families of motions of one joint (from 1) about a pose (n,) rad."""
    axis = _Axis(stage, pose, joint)
    if axis.span < 1e-3:
        return
    yield from _back_and_forth(axis)
    yield _ladder(axis)
    yield _sweep(axis)
    yield from _ramps(axis)
    yield from _chirps(axis)
    yield from _through_the_vertical(axis)
    yield _repeated(axis)


def _back_and_forth(axis: _Axis) -> Iterator[Trial]:
    for share in SPEEDS:
        speed = share * axis.full
        far = min(axis.span, speed * LONG / 2)
        a, b = axis.around(far)
        times = int(np.clip(LONG / (2 * far / speed + 2 * share), 1, 6))
        often = TIMES.get(times, f"{times} times")
        words = f"back and forth {often} between {a:.3g} and {b:.3g} {axis.unit} at {speed:.2g} {axis.unit}/s"
        cycle = {"type": "repeat", "times": times, "segment": [axis.to(b, share), axis.to(a, share)]}
        yield axis.trial(f"at {share:g} of its speed", words, [axis.to(a, 0.25), cycle])


def _ladder(axis: _Axis) -> Trial:
    moves = []
    for share in SPEEDS[1:]:
        a, b = axis.around(min(axis.span, share * axis.full))
        moves += [axis.to(a, 0.25), axis.to(b, share), axis.to(a, share)]
    words = f"back and forth at {', '.join(f'{share * axis.full:.2g}' for share in SPEEDS[1:])} {axis.unit}/s"
    return axis.trial("up a ladder of speeds", words, moves)


def _sweep(axis: _Axis) -> Trial:
    low, high, full = axis.low, axis.high, axis.full
    share = min(1.0, axis.span / full / (LONG / 2))
    words = f"once through {low:.3g} to {high:.3g} {axis.unit} and back at {share * full:.2g} {axis.unit}/s"
    return axis.trial("in a slow sweep", words, [axis.to(low, 0.25), axis.to(high, share), axis.to(low, share)])


def _ramps(axis: _Axis) -> Iterator[Trial]:
    for size in (0.005, 0.02):
        middle = axis.inside(size)
        words = (
            f"swaying slowly (0.15 to 0.4 Hz) by {size:g} {axis.unit} about {middle:.3g} {axis.unit}, so that its "
            "torque ramps up and down"
        )
        yield axis.trial("in slow small ramps of torque", words, axis.chirp(middle, size, 0.15, 0.4))


def _chirps(axis: _Axis) -> Iterator[Trial]:
    acceleration = float(axis.stage.limits.acceleration[axis.joint - 1])
    for fastest in (2.0, 8.0):
        pulse = 2 * np.pi * fastest
        size = 0.9 * min(axis.full / pulse, acceleration / pulse**2, axis.span / 2)
        middle = axis.inside(size)
        words = f"in a chirp of 0.2 to {fastest:g} Hz, {size:.2g} {axis.unit} about {middle:.3g} {axis.unit}"
        yield axis.trial("in a chirp", words, axis.chirp(middle, size, 0.2, fastest))


def _through_the_vertical(axis: _Axis) -> Iterator[Trial]:
    for place in _vertical(axis.stage, axis.pose, axis.joint):
        a, b = max(axis.low, place - 0.2), min(axis.high, place + 0.2)
        share = min(1.0, 0.1 / axis.full)
        cycle = {"type": "repeat", "times": 2, "segment": [axis.to(b, share), axis.to(a, share)]}
        words = (
            f"slowly through {place:.3g} {axis.unit}, where its gravity torque changes sign (twice, "
            f"between {a:.3g} and {b:.3g})"
        )
        yield axis.trial("through the vertical", words, [axis.to(a, 0.25), cycle])


def _repeated(axis: _Axis) -> Trial:
    a, b = axis.around(min(axis.span, axis.full))
    held = [axis.to(b, 0.5), axis.to(a, 0.5), {"type": "hold", "duration": 1.0}]
    cycle = {"type": "repeat", "times": 4, "segment": held}
    words = f"through one cycle four times, with holds, between {a:.3g} and {b:.3g} {axis.unit}"
    return axis.trial("in one cycle repeated", words, [axis.to(a, 0.25), cycle])


def _vertical(stage: Stage, pose: Array, joint: int) -> list[float]:
    """First position within the limits at which the gravity torque of a joint changes sign; other joints at ``pose``.

    [] if there is none.
    """
    low, high = stage.limits.position[joint - 1]
    q = np.tile(pose, (200, 1))
    q[:, joint - 1] = np.linspace(low, high, 200)
    load = inverse_dynamics(stage.arm, q, 0 * q, 0 * q)[:, joint - 1]
    turns = np.flatnonzero(np.diff(np.sign(load)))
    return [float(q[turns[0], joint - 1])] if len(turns) and np.ptp(load) > 1e-3 else []


def _excitations(stage: Stage) -> Iterator[Trial]:
    for pace, series in stage.excitations.items():
        pose = np.array(series.start)
        moving = [segment.model_dump() for segment in series.segment if segment.type == "fourier"]
        name = f"excitation of all joints ({pace})"
        joints = tuple(range(1, len(stage.arm) + 1))
        words = "all joints together in a sum of sines, 10 s"
        yield Trial(words, _experiment(stage, name, pose, moving), joints)
