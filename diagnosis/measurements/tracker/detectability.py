"""Effects that the tracked points cannot show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from arm_model.effects import CATALOGUE, Instrument, observed_by
from diagnosis.cause import EffectKey, Undetectable
from diagnosis.measurements.tracker.candidates import TrackedCandidate
from diagnosis.measurements.tracker.joint_fit import State
from diagnosis.measurements.tracker.model import LIMITS
from diagnosis.measurements.tracker.points import Side
from diagnosis.measurements.tracker.regression import Linear, columns_of, linear
from identification.kinematics.estimation import stacked


def no_tracker(placed: bool, fitted: bool) -> list[Undetectable]:
    """All effects that only a tracker shows, for recordings without one."""
    if placed:
        why = "the model places its joints as URDF does; the tracker's points are compared with D-H models only"
        experiment = "armscope calibrate, whose model.toml has D-H parameters"
    else:
        which = "held-out" if fitted else "fitted"
        why, experiment = (
            f"no {which} recording has points of a tracker",
            "the same motion with a tracker (columns x, y, z)",
        )
    return [Undetectable(effect, None, why, experiment) for effect in only_tracked()]


def only_tracked() -> list[str]:
    """Effects that neither currents nor encoders show."""
    tracked = {Instrument.TRACKER, Instrument.CALIBRATION}
    return [effect.name for effect in observed_by(Instrument.TRACKER) if set(effect.observed_by) <= tracked]


def sizes(every: Sequence[TrackedCandidate], nothing: State, sides: Sequence[Side]) -> dict[TrackedCandidate, float]:
    """m rms: motion of the held-out points by the largest typical size of every effect, frame and target refitted."""
    parts = [linear(nothing, side) for side in sides]
    return {c: float(np.sqrt(_typical_squares(c, nothing, sides, parts))) for c in every}


def undetectable_by_tracker(
    moves: Mapping[TrackedCandidate, float], level: float, known: set[EffectKey]
) -> list[Undetectable]:
    """Effects that only a tracker shows and that move the held-out points too little.

    level: m, std that the points leave undetermined; moves: see ``sizes``.
    """
    invisible, tracked_only = [], only_tracked()
    for candidate, size in moves.items():
        if candidate.effect in tracked_only and candidate.key not in known and size < LIMITS.detectable * level:
            where = f" at joint {candidate.joint}" if candidate.joint else ""
            by = f"by {1e3 * size:.2g} mm rms" if size > 1e-3 * level else "negligibly"
            why = (
                f"even {_typical(candidate)[1]}{where} would move these points {by}; "
                f"their uncertainty is {1e3 * level:.2g} mm"
            )
            invisible.append(
                Undetectable(
                    candidate.effect,
                    candidate.joint,
                    why,
                    candidate.definition.observed_by[Instrument.TRACKER].experiment,
                )
            )
    return invisible


def visible(moves: Mapping[TrackedCandidate, float], level: float) -> frozenset[EffectKey]:
    """Effects that these points would show, whatever the currents do."""
    return frozenset(candidate.key for candidate, size in moves.items() if size >= LIMITS.detectable * level)


def _typical_squares(
    candidate: TrackedCandidate, nothing: State, sides: Sequence[Side], parts: Sequence[Linear]
) -> float:
    """m^2 per coordinate: largest effect of its parameters on the held-out points, frame and target refitted."""
    columns = [columns_of(candidate, nothing, side, part) / candidate.scales for side, part in zip(sides, parts)]
    free = [stacked(part.free) for part in parts]
    largest = 0.0
    for k, typical in enumerate(_typical(candidate)[0]):
        in_fit, in_held_out = (c[:, :, k].ravel() * typical for c in columns)
        refitted = np.linalg.solve(
            free[0].T @ free[0] + nothing.estimate.noise**2 * np.eye(free[0].shape[1]), free[0].T @ in_fit
        )
        largest = max(largest, float(np.mean((in_held_out - free[1] @ refitted) ** 2)))
    return largest


def _typical(candidate: TrackedCandidate) -> tuple[list[float], str]:
    parameters = {p.name: p for p in CATALOGUE[candidate.effect].parameters}
    own = candidate.names and set(candidate.names) <= set(parameters)
    names = candidate.names if own else (next(iter(parameters)),)
    values = [parameters[name].typical[1] for name in names]
    words = ", ".join(parameters[n].sized(f"{v:g} {parameters[n].unit}") for n, v in zip(names, values))
    return values, words
