"""Clipped currents: rows pile up at one extreme value of the raw current while its joint is driven."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from arm_io.parallel import in_parallel
from arm_io.types import Array
from arm_model import Arm
from arm_model.effects.description_errors import CURRENT_LIMIT
from arm_model.rigid_body import total_at
from daq.recording import Recording
from diagnosis.cause import Estimate
from diagnosis.residual.noise.channels import angle_noise, scatter, still_noise
from diagnosis.residual.noise.encoder_step import encoder_step
from diagnosis.residual.run_setup import setup_of
from diagnosis.screening.current_piles import (
    FLAT_SECONDS,
    Pile,
    edge_of,
    ends_flat,
    flat_visits,
    pile_of,
    reached_again,
    sharp_visits,
)
from diagnosis.screening.event import Event
from diagnosis.screening.servo_commands import MEMORY, clipped_by_command, fed_forward
from identification import recorded_quantity
from identification.preprocessing.signals import longest_stretch, stretches_of

RUNS_AWAY = 1.5
"""Tracking error of a joint with a clipped current, over the largest one before and in other recordings."""
AVERAGED = 0.01
"""s over which a current is averaged."""
GAP = 0.1
"""s between two visits to a level."""
LEAST = 15.0
"""Noises of a current that a limit must exceed."""
PLAIN = 100.0
"""Noises that it must exceed to show by its rows alone: at less, the current of a joint that goes slowly against its
Coulomb friction piles up at its largest value as well."""
FOLLOWS = 0.5
"""Slope of a current over the friction of its joint: less by two deviations, and it is clipped; more, and it is not."""
SMOOTHED = 0.02
"""s over which an angle is smoothed before its speed."""
MOVING_SHARE = 0.15
"""Share of the fastest speed below which friction is another: its hump is known least of all."""
STANDS = 0.1
"""s for which a joint that stands turns by less than ``STEPS``."""
STEPS = 8.0
"""Deviations of the recorded angle of a joint that stands."""


def current_limits(recordings: Sequence[Recording], arm: Arm) -> list[Event]:
    """Currents whose rows pile up at one extreme value, in either direction, while the joint is driven.

    So do those of a joint that meets nothing but its friction, or always accelerates alike, and those of a slow motion
    at a smooth crest: the pile is a limit where the joint departs from its setpoint meanwhile; or where it is reached
    in several visits, for long or with a flat top each time, and either does not follow the friction of the joint (of
    ``arm``), which changes with speed and direction, or is flat to a hundredth. What rows alone do not show, the
    servo does that asks for more (``servo_commands``).
    """
    smooth = [_averaged(r) for r in recordings]
    # noise that averaging does not remove
    still = still_noise([r for r in recordings if not setup_of(r).drives_off])
    weights = [fed_forward(recording, arm) for recording in recordings]

    def limit(j: int) -> Event | None:
        of_joint = [values[:, j] for values in smooth]
        noise = _noise(recordings, of_joint, j, float(still[j]))
        driven = [_driven(r, j) for r in recordings]
        moving = [v[rows] for v, rows in zip(of_joint, driven)]
        values = [np.where(d, v, 0.0) for v, d in zip(of_joint, driven)]
        pile, edge = (find(moving, noise, recordings[0].dt) for find in (pile_of, edge_of))
        clipped, level, std = _clipped(recordings, values, j, pile, arm), pile.level, noise
        if not clipped:
            clipped, level = _ends_flat(recordings, values, j, edge, arm), edge.level
        if not clipped and (by_command := clipped_by_command(recordings, weights, j)) is not None:
            level, std, clipped = by_command.level, by_command.std, by_command.recordings
        if not clipped:
            return None
        drive = arm.joints[j]
        return Event(
            effect=CURRENT_LIMIT.name,
            joint=j + 1,
            parameters=[Estimate("limit", level, std, "A")],
            evidence=f"the {recorded_quantity(drive)} of joint {j + 1} is clipped at {level:.3g} "
            f"{drive.command_unit} in {len(clipped)} of {len(recordings)} recordings",
            recordings=clipped,
        )

    return [event for event in in_parallel(limit, range(recordings[0].joints)) if event is not None]


def _noise(recordings: Sequence[Recording], smooth: Sequence[Array], j: int, still: float) -> float:
    """A: uncertainty, by noise and converter, of an averaged current of joint j (from 0)."""
    top = max(float(values.max()) for values in smooth)
    rows = max(1, round(AVERAGED / recordings[0].dt))
    noise = float(np.hypot(max(float(scatter(r.i[:, [j]])[0]) for r in recordings) / np.sqrt(rows), still))
    return max(encoder_step(recordings[0].i[:, j]) / 2, 0.0006 * top, noise)


def _clipped(recordings: Sequence[Recording], values: Sequence[Array], j: int, pile: Pile, arm: Arm) -> tuple[int, ...]:
    """Recordings (by index) in which joint j (from 0) moves and its current is clipped; empty where it is not.

    values: (m,) |current|, 0 where the joint is not driven.
    """
    at_level = [pile.holds(current) for current in values]
    moving = tuple(k for k, r in enumerate(recordings) if at_level[k].any() and np.ptp(r.q[:, j]) > 0.01)
    longest = max(longest_stretch(rows) * r.dt for rows, r in zip(at_level, recordings))
    if pile.level < LEAST * pile.noise or longest < FLAT_SECONDS:
        return ()
    # a servo without feed-forward lags by its speed: no farther than where the current was smaller is not away
    usual_lag = max((_lag(r, j) for r, rows in zip(recordings, at_level) if not rows.any()), default=0.0)
    away = [k for k in moving if _runs_away(recordings[k], j, at_level[k], usual_lag)]
    every = np.concatenate([value[value > 0.0] for value in values])
    piles = [pile_of([values[k][values[k] > 0.0]], pile.noise, recordings[k].dt) for k in away]
    # what a drive gives in any recording, it gives in all
    if any(one.high and not one.of(every, recordings[0].dt).exceeded for one in piles):
        return moving
    visits = _visits(recordings, values, j, pile)
    reached = (pile.high and reached_again(visits)) or flat_visits(visits) or sharp_visits(visits)
    if pile.far_exceeded or not reached:
        return ()
    return moving if _no_friction(recordings, values, j, pile, arm) else ()


def _ends_flat(
    recordings: Sequence[Recording], values: Sequence[Array], j: int, edge: Pile, arm: Arm
) -> tuple[int, ...]:
    """``_clipped`` of the level above which nothing is, where the rows just below it are as many as those at it."""
    visits = _visits(recordings, values, j, edge)
    if edge.level < LEAST * edge.noise or edge.exceeded or not (ends_flat(visits) or sharp_visits(visits)):
        return ()
    moving = tuple(k for k, r in enumerate(recordings) if edge.holds(values[k]).any() and np.ptp(r.q[:, j]) > 0.01)
    return moving if _no_friction(recordings, values, j, edge, arm) else ()


def _no_friction(recordings: Sequence[Recording], values: Sequence[Array], j: int, pile: Pile, arm: Arm) -> bool:
    """Whether the rows at a pile do not follow the friction of a joint (from 0); of many noises, may not."""
    slope, std = _over_friction(recordings, values, j, pile, arm)
    if slope + 2.0 * std < FOLLOWS:
        return True
    return not slope - 2.0 * std > FOLLOWS and pile.level > PLAIN * pile.noise


def _visits(recordings: Sequence[Recording], values: Sequence[Array], j: int, pile: Pile) -> list[Pile]:
    """The rows that each visit of joint j's current to the level, in one direction, adds to a pile."""
    visits = []
    for r, value in zip(recordings, values):
        rows = max(1, round(GAP / r.dt))
        sign = np.sign(ndimage.uniform_filter1d(r.i[:, j], max(1, round(AVERAGED / r.dt))))
        turns = _turns(r, value, j)
        for direction in (1.0, -1.0):
            near = np.pad((value > pile.level - 8.0 * pile.noise) & (sign == direction), rows)
            for start, end in stretches_of(ndimage.binary_closing(near, np.ones(rows, bool))[rows:-rows]):
                visits.append(replace(pile.of(value[start:end], r.dt), turns=bool(turns[start] or turns[end - 1])))
    return visits


def _turns(recording: Recording, value: Array, j: int) -> NDArray[np.bool_]:
    """(m,) rows beside those in which joint j (from 0) reverses or is not driven, and the ends of the recording."""
    q = ndimage.gaussian_filter1d(recording.q[:, j], max(1.0, SMOOTHED / recording.dt))
    ahead = np.where(value > 0.0, np.sign(np.gradient(q)), 0.0)
    ahead[[0, -1]] = 0.0
    rows = 2 * max(1, round(AVERAGED / recording.dt)) + 1
    low, high = ndimage.minimum_filter1d(ahead, rows), ndimage.maximum_filter1d(ahead, rows)
    return np.asarray((low != high) | (ahead == 0.0))


def _over_friction(
    recordings: Sequence[Recording], values: Sequence[Array], j: int, pile: Pile, arm: Arm
) -> tuple[float, float]:
    """Slope of the rows at a pile over the friction that a joint (from 0) has at their speeds, and its std.

    1 where a joint meets its friction and a constant load, or accelerates alike; 0 where the drive gives no more.
    """
    x: list[Array] = []
    y: list[Array] = []
    for r, value in zip(recordings, values):
        speed = np.gradient(ndimage.gaussian_filter1d(r.q[:, j], max(1.0, SMOOTHED / r.dt)), r.dt)
        certain = np.abs(speed) > MOVING_SHARE * np.quantile(np.abs(speed), 0.95)
        rows = pile.holds(value) & certain
        up, down = (by_speed[rows] for by_speed in total_at(arm.joints[j], np.abs(speed)))
        friction = np.where(speed[rows] > 0.0, up, -down) / arm.joints[j].drive_constant
        sign = np.sign(ndimage.uniform_filter1d(r.i[:, j], max(1, round(AVERAGED / r.dt))))[rows]
        x.append(sign * friction)
        y.append(value[rows])
    of_friction, of_current = np.concatenate(x), np.concatenate(y)
    square = float(np.sum((of_friction - of_friction.mean()) ** 2)) if len(of_friction) > 2 else 0.0
    if square <= 0.0:
        return np.nan, np.inf
    slope = float((of_friction - of_friction.mean()) @ of_current) / square
    return slope, pile.noise * float(np.sqrt(max(MEMORY / recordings[0].dt, 1.0) / square))


def _driven(recording: Recording, j: int) -> NDArray[np.bool_]:
    """(m,) rows in which joint j (from 0) or its setpoint moves.

    A joint that stands under friction holds its last current for as long as it stands, at its limit or not.
    """
    span = max(3, round(STANDS / recording.dt))
    thresholds = {"q": STEPS * angle_noise(recording.q[:, [j]])[0], "qref": 1e-6}
    moves = np.zeros(len(recording), dtype=bool)
    for name, threshold in thresholds.items():
        values = getattr(recording, name)
        if values is not None:
            of_joint = values[:, j]
            turned = ndimage.maximum_filter1d(of_joint, span) - ndimage.minimum_filter1d(of_joint, span) > threshold
            # a window reaches half its length beyond the motion that it sees
            moves |= ndimage.minimum_filter1d(turned, span)
    return moves


def _averaged(recording: Recording) -> Array:
    rows = max(1, round(AVERAGED / recording.dt))
    return np.asarray(np.abs(ndimage.uniform_filter1d(recording.i, rows, axis=0)), float)


def _lag(recording: Recording, j: int) -> float:
    """rad (m): largest distance of joint j (from 0) from its setpoint."""
    return 0.0 if recording.qref is None else float(np.nanmax(np.abs(recording.qref[:, j] - recording.q[:, j])))


def _runs_away(recording: Recording, j: int, flat: NDArray[np.bool_], usual: float) -> bool:
    """Whether a joint is farther from its setpoint than ever at the end of the longest ``flat`` (m,) current.

    usual: the largest distance in recordings without such a current.
    """
    stretches = stretches_of(flat)
    if recording.qref is None or len(stretches) == 0:
        return False
    start, end = stretches[np.argmax(np.diff(stretches))]
    error = np.abs(recording.qref[:, j] - recording.q[:, j])
    return (end - start) * recording.dt > FLAT_SECONDS and bool(
        error[end - 1] > RUNS_AWAY * max(usual, error[: start + 1].max())
    )
