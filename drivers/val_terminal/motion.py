"""Experiments as commands of VAL: what is typed, one after the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivers.val_terminal import protocol as val
from drivers.val_terminal.config import Config
from experiment import Experiment
from experiment.segments import Drive, Hold, Move, Repeat, Segment

SMALLEST = 5e-4  # deg: no move
PERCENT_TOLERANCE = 1e-6
MOST_SEGMENTS = 100_000


@dataclass(frozen=True)
class Step:
    """Commands to type one after the other, or, with none, seconds to wait."""

    commands: tuple[str, ...] = ()
    seconds: float = 0.0


def steps(experiment: Experiment, config: Config) -> list[Step]:
    """The steps of ``experiment`` from its start pose on; ValueError says what VAL cannot do from its terminal."""
    if (count := _count(experiment.segment)) > MOST_SEGMENTS:
        raise ValueError(f"it is {count} segments; at most {MOST_SEGMENTS} are typed, one by one")
    at = degrees(experiment.start, config)
    found: list[Step] = []
    for segment in _flat(experiment.segment):
        match segment:
            case Hold():
                found.append(Step(seconds=segment.duration))
            case Drive():
                joint = segment.joint - 1
                sign = config.sign[joint]
                if segment.to is not None:
                    target = sign * np.degrees(segment.to) + config.zero[joint]
                else:
                    target = at[joint] + sign * np.degrees(segment.by or 0.0)
                if not abs(target - at[joint]) <= SMALLEST:
                    found.append(Step((val.drive(joint + 1, target - at[joint], _percent(segment.speed)),)))
                at[joint] = target
            case Move() if config.dialect == "val2":
                at = degrees(segment.to, config)
                found.append(Step((val.program_speed(_percent(segment.speed)), val.move(at))))
            case _:
                can = "hold, drive and move" if config.dialect == "val2" else "hold and drive"
                raise ValueError(f"cannot execute a segment of type {segment.type!r}; it can {can}")
    return found


def degrees(angles: list[float], config: Config) -> list[float]:
    """VAL's joint angles (deg) at ``angles`` (rad) of the model."""
    return [float(s * np.degrees(q) + z) for s, q, z in zip(config.sign, angles, config.zero)]


def _percent(fraction: float) -> int:
    percent = round(fraction * 100) if 0 < fraction <= 1 else 0  # 0 for NaN
    if percent < 1 or not abs(percent - fraction * 100) <= PERCENT_TOLERANCE:
        raise ValueError(f"a speed of {fraction:g} is not a whole number of per cent, which VAL requires")
    return percent


def _count(segments: list[Segment]) -> int:
    """Segments with all repetitions, without writing them out."""
    return sum(_count(s.segment) * s.times if isinstance(s, Repeat) else 1 for s in segments)


def _flat(segments: list[Segment]) -> list[Segment]:
    flat: list[Segment] = []
    for segment in segments:
        flat += _flat(segment.segment) * segment.times if isinstance(segment, Repeat) else [segment]
    return flat
