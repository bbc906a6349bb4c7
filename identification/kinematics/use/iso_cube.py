"""The ISO 9283 cube: five points of a diagonal plane, as an experiment and as a report.

A cube of given side stands in the workspace, edges parallel to the base frame. P1 is the centre; P2 to P5 lie on the
diagonals of one of the four planes through opposite edges, at a tenth of the diagonal's length from its ends (ISO
9283:1998, 6.8). The arm goes round P1 .. P5 and stands at each.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from arm_io import InputError
from arm_io.types import Array
from arm_model import Arm
from arm_model.rigid_body import forward
from experiment import Experiment
from experiment.segments import Hold, Move, Segment
from identification.kinematics.data.runs import Run
from identification.kinematics.use.correction import Corrected, corrected_inverse, limits_of, within_limits
from identification.preprocessing.signals import stretches_of

NAME = "iso_cube"
"""Name of the experiment, by which a recording is known to be of the cube."""
SIDE = 0.5
"""m: of the cube."""
_ROOM = 1.2
"""A place for a cube has room for one larger by that.

At the edge of its reach the real arm may fall short of the nominal one.
"""
_STANDING = 2e-4
"""rad over a window: at rest."""
_SLIP = 0.01
"""rad: a servo that creeps or slips through its friction has not left."""


@dataclass(frozen=True)
class CubeReport:
    """What a run over the cube showed; all (5,) m.

    before, after  distance from the measured standstill position to the nominal and to the calibrated prediction
    overshoot      how far past the standstill position, along the way in, the target went before it settled
    """

    run: str
    side: float
    before: Array
    after: Array
    overshoot: Array


def cube_points(centre: ArrayLike, side: float = SIDE) -> Array:
    """(5, 3) m: P1 .. P5 of the plane through the cube's lower front and upper back edges (x rising with z)."""
    centre_ = np.asarray(centre, float)
    reach = 0.4 * side  # a tenth of the diagonal from each corner leaves 0.8 of the half side
    corners = np.array([[0, 0, 0], [1, 1, 1], [1, -1, 1], [-1, -1, -1], [-1, 1, -1]], float)
    return centre_ + reach * corners


def cube_targets(arm: Arm, centre: ArrayLike, side: float, posture: ArrayLike, model: Corrected | None = None) -> Array:
    """(5, joints) rad: joint targets for P1 .. P5 with the tool oriented as in ``posture`` (joints,).

    Computed with the nominal ``arm``, or with the calibrated ``model`` so that the real arm goes there. InputError
    names a point out of reach.
    """
    wanted = forward(arm, arm.link_angles(np.asarray(posture, float)))
    use = Corrected(arm) if model is None else model
    out, at = [], np.asarray(posture, float)
    for k, point in enumerate(cube_points(centre, side), 1):
        pose = wanted.copy()
        pose[:3, 3] = point
        try:
            at = corrected_inverse(use, pose, at)
        except InputError:
            raise InputError(
                f"ISO cube P{k}", f"({', '.join(f'{v:.3f}' for v in point)}) m is out of reach with this posture"
            ) from None
        if not within_limits(arm, at[None])[0]:
            raise InputError(f"ISO cube P{k}", "is outside the joint limits; use another posture or centre")
        out.append(at)
    return np.array(out)


def posture_of(arm: Arm) -> Array:
    """(joints,) rad: a posture about whose tool position a cube of ``SIDE`` m can be reached, tool orientation kept.

    Tried are the servo's own pose and random ones in the middle of the joint ranges; InputError if none will do.
    """
    low, high = limits_of(arm)
    generator = np.random.default_rng(0)
    named = arm.controller.inertia_pose if arm.controller is not None else None
    tried = [] if named is None else [np.array(named)]
    tried += [*((low + high) / 2 + generator.uniform(-0.35, 0.35, (400, len(arm))) * (high - low))]
    for posture in tried:
        try:
            cube_targets(arm, forward(arm, arm.link_angles(posture))[:3, 3], _ROOM * SIDE, posture)
        except InputError:
            continue
        return posture
    raise InputError("ISO cube", f"no place was found where a cube of {SIDE:g} m can be reached")


def cube_experiment(targets: Array) -> Experiment:
    """Round the five points and back to the first, standing 3 s at each: slow integral action needs that long."""
    stand = Hold(type="hold", duration=3.0)
    segments: list[Segment] = [stand]
    for q in [*targets[1:], targets[0]]:
        segments += [Move(type="move", to=[float(v) for v in q]), stand]
    joints = targets.shape[1]
    return Experiment(
        name=NAME,
        description=f"ISO 9283 diagonal plane, side {SIDE:g} m, P1 to P5 and back",
        start=[float(v) for v in targets[0]],
        full_speed=[1.0] * joints,
        full_acceleration=[2.0] * joints,
        segment=segments,
    )


def cube_report(run: Run, nominal: Array, calibrated: Array) -> CubeReport | None:
    """Report of a cube run from positions (N, 3) m predicted by the nominal and the calibrated arm.

    None if the arm did not rest at five places.
    """
    stops = standstills(run)
    if len(stops) < 5:
        return None
    before, after, overshoot = np.empty(5), np.empty(5), np.full(5, np.nan)
    for k, (first, last) in enumerate(stops[:5]):
        settled = slice(first + (last - first) // 2, last)
        rest = np.nanmedian(run.xyz[settled], axis=0)
        before[k] = np.linalg.norm(rest - np.nanmedian(nominal[settled], axis=0))
        after[k] = np.linalg.norm(rest - np.nanmedian(calibrated[settled], axis=0))
        if k:
            overshoot[k] = _overshoot(run, first, last, rest)
    overshoot[0] = (
        _overshoot(run, *stops[5], np.nanmedian(run.xyz[stops[5][0] : stops[5][1]], axis=0)) if len(stops) > 5 else 0.0
    )
    return CubeReport(run.name, SIDE, before, after, overshoot)


def standstills(run: Run) -> list[tuple[int, int]]:
    """(first, last exclusive) rows of every stretch of at least 0.3 s in which no joint moves."""
    size = max(2, round(0.05 / run.period)) if run.period > 0 else 2
    still = np.zeros(len(run.t), bool)
    for start in range(0, len(run.t) - size + 1, size):
        part = run.q[start : start + size]
        still[start : start + size] = np.fmax.reduce(np.fmax.reduce(part) - np.fmin.reduce(part)) < _STANDING
    stops: list[tuple[int, int]] = []
    for first, last in stretches_of(still):
        same = stops and np.nanmax(np.abs(run.q[first] - run.q[stops[-1][1] - 1])) < _SLIP
        if same:
            stops[-1] = (stops[-1][0], int(last))
        else:
            stops.append((int(first), int(last)))
    return [(a, b) for a, b in stops if run.t[b - 1] - run.t[a] >= 0.3]


def _overshoot(run: Run, first: int, last: int, rest: Array) -> float:
    """m by which the arm went beyond ``rest``, along the direction of the last centimetres of its approach.

    A value within the noise of the tracker is not an overshoot.
    """
    back = np.linalg.norm(np.nan_to_num(run.xyz[:first] - rest), axis=1)
    away = np.flatnonzero(back > 0.02)
    if not len(away):
        return 0.0
    way = rest - run.xyz[away[-1]]
    ahead = (run.xyz[away[-1] : last] - rest) @ (way / np.linalg.norm(way))
    return float(max(0.0, np.nanmax(ahead)))
