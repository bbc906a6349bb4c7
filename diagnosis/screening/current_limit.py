"""Clipped currents: rows pile up at one extreme value of the raw current while its joint is driven."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.special import bdtr

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
from diagnosis.screening.event import Event
from diagnosis.screening.servo_commands import clipped_by_command
from diagnosis.units import recorded_quantity

RUNS_AWAY = 1.5
"""Tracking error of a joint with a clipped current, over the largest one before and in other recordings."""
AVERAGED, FLAT_SECONDS, AT_SECONDS = 0.01, 0.03, 1.0
"""s over which a current is averaged, for which a clipped one is constant once, and in all where few visits tell."""
# of all visits: a single crest of a smooth current may be flat
PILED, BEYOND = 4.0, 0.03
"""Rows at a limit over those in an equally wide range below, at least, and share of them that noise may lift above:
0.02 of them exceed three noises where half of the variance is slower than the noise that is measured. The crests of a
slow current rise beyond their commonest value."""
AGAIN, GAP = 0.25, 0.1
"""Share of the rows at a limit that lie outside its longest visit, at least, and s between two visits: a smooth crest
comes once, or again at another value."""
CHANCE, UNLIKELY = 0.25, 0.01
"""Share of the visits of a healthy current to the level of its largest pile that are flat there (4 of 60 other than
the longest, in slow motions), and probability below which so many are no chance."""
SHARP, SEVERAL = 20.0, 2
"""Rows at a limit in one visit over those in an equally wide range below, at which it is entered and left sharply, and
visits of this kind that a crest does not make: even one as flat as an eighth power has 14. None of 339 joints of
healthy recordings, moves and waves of six arms, has one."""
LEAST, PLAIN = 15.0, 100.0
"""Noises of a current that a limit must exceed at all, and to show by its rows alone: at less, the current of a joint
that goes slowly against its Coulomb friction piles up at its largest value as well."""
FOLLOWS = 0.5
"""Slope of a current over the friction of its joint: less by two deviations, and it is clipped; more, and it is not."""
MEMORY = 0.1
"""s after which the noise of a current says something new."""
TOP, LEVELS = 0.9995, 25
"""Share of the rows below which levels are tried, and how many."""
SMOOTHED, MOVING_SHARE = 0.02, 0.15
"""s over which an angle is smoothed before its speed, and share of the fastest below which friction is another:
its hump is known least of all."""
STANDS, STEPS = 0.1, 8.0
"""s in which a joint that stands turns by less than so many deviations of its recorded angle."""


@dataclass(frozen=True)
class _Pile:
    """A level near the largest value of a joint's averaged current at which its rows pile up.

    level  A, with its noise; at, below, beyond: s of rows within two noises of it, from 8 to 4 below, and 3 above
    turns  of a visit: the joint reverses where it begins or ends, and so may its friction
    """

    level: float
    noise: float
    at: float
    below: float
    beyond: float
    turns: bool = False

    @property
    def flat(self) -> bool:
        """As a clipped current is: near a smooth maximum (a parabola) 2.3 times as many rows are at it as below."""
        return self.at > max(PILED * self.below, FLAT_SECONDS) and not self.exceeded

    @property
    def exceeded(self) -> bool:
        """Whether more rows are above it than noise lifts there."""
        return self.beyond >= BEYOND * self.at

    @property
    def high(self) -> bool:
        """Whether it stays at the level for longer than a smooth maximum would."""
        return self.flat and self.at > AT_SECONDS

    def of(self, values: Array, period: float) -> _Pile:
        """The pile at the same level of other currents (m,), ``period`` s between them."""
        away = (values - self.level) / self.noise
        counts = [np.sum(np.abs(away) < 2.0), np.sum((away > -8.0) & (away < -4.0)), np.sum(away > 3.0)]
        at, below, beyond = (float(count) * period for count in counts)
        return _Pile(self.level, self.noise, at, below, beyond)

    def holds(self, values: Array) -> NDArray[np.bool_]:
        """(m,) rows that are at the level but for their noise."""
        return np.asarray(np.abs(values - self.level) < 4.0 * self.noise)


def current_limits(recordings: Sequence[Recording], arm: Arm | None = None) -> list[Event]:
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

    def limit(j: int) -> Event | None:
        of_joint = [values[:, j] for values in smooth]
        noise = _noise(recordings, of_joint, j, float(still[j]))
        driven = [_driven(r, j) for r in recordings]
        pile = _pile([v[rows] for v, rows in zip(of_joint, driven)], noise, recordings)
        clipped = _clipped(recordings, [np.where(d, v, 0.0) for v, d in zip(of_joint, driven)], j, pile, arm)
        level, std = pile.level, noise
        if not clipped and (by_command := clipped_by_command(recordings, arm, j)) is not None:
            level, std, clipped = by_command.level, by_command.std, by_command.recordings
        if not clipped:
            return None
        quantity = "current" if arm is None else recorded_quantity(arm.joints[j])
        unit = "A" if arm is None else arm.joints[j].command_unit
        return Event(
            effect=CURRENT_LIMIT.name,
            joint=j + 1,
            parameters=[Estimate("limit", level, std, "A")],
            evidence=f"the {quantity} of joint {j + 1} is clipped at {level:.3g} {unit} in {len(clipped)} of "
            f"{len(recordings)} recordings",
            recordings=clipped,
        )

    return [event for event in in_parallel(limit, range(recordings[0].joints)) if event is not None]


def _noise(recordings: Sequence[Recording], smooth: Sequence[Array], j: int, still: float) -> float:
    """A: uncertainty, by noise and converter, of an averaged current of joint j (from 0)."""
    top = max(float(values.max()) for values in smooth)
    rows = max(1, round(AVERAGED / recordings[0].dt))
    noise = float(np.hypot(max(float(scatter(r.i[:, [j]])[0]) for r in recordings) / np.sqrt(rows), still))
    return max(encoder_step(recordings[0].i[:, j]) / 2, 0.0006 * top, noise)


def _pile(values: Sequence[Array], noise: float, recordings: Sequence[Recording]) -> _Pile:
    """The highest pile of |currents| (m,) of the rows that are driven, among levels near their largest."""
    y = np.concatenate(values) if values else np.empty(0)
    period = recordings[0].dt
    if not len(y):
        return _Pile(0.0, noise, 0.0, 0.0, 0.0)
    top = float(np.quantile(y, TOP))
    levels = np.linspace(top - 6.0 * noise, top, LEVELS)
    level = float(levels[np.argmax([np.sum(np.abs(y - tried) < 2.0 * noise) for tried in levels])])
    at = np.abs(y - level) < 2.0 * noise
    level = float(np.median(y[at])) if at.any() else level
    return _Pile(level, noise, 0.0, 0.0, 0.0).of(y, period)


def _clipped(
    recordings: Sequence[Recording], values: Sequence[Array], j: int, pile: _Pile, arm: Arm | None
) -> tuple[int, ...]:
    """Recordings (by index) in which joint j (from 0) moves and its current is clipped; empty where it is not.

    values: (m,) |current|, 0 where the joint is not driven.
    """
    at_level = [pile.holds(current) for current in values]
    moving = tuple(k for k, r in enumerate(recordings) if at_level[k].any() and np.ptp(r.q[:, j]) > 0.01)
    longest = max(_longest(rows) * r.dt for rows, r in zip(at_level, recordings))
    if pile.level < LEAST * pile.noise or longest < FLAT_SECONDS:
        return ()
    # a servo without feed-forward lags by its speed: no farther than where the current was smaller is not away
    usual_lag = max((_lag(r, j) for r, rows in zip(recordings, at_level) if not rows.any()), default=0.0)
    away = [k for k in moving if _runs_away(recordings[k], j, at_level[k], usual_lag)]
    every = np.concatenate([value[value > 0.0] for value in values])
    piles = [_pile([values[k][values[k] > 0.0]], pile.noise, recordings[k : k + 1]) for k in away]
    # what a drive gives in any recording, it gives in all
    if any(one.high and not one.of(every, recordings[0].dt).exceeded for one in piles):
        return moving
    visits = _visits(recordings, values, j, pile)
    if not (pile.high and _again(visits)) and not _returns(visits) and not _sharp(visits):
        return ()
    slope, std = (np.nan, np.inf) if arm is None else _over_friction(recordings, values, j, pile, arm)
    if slope + 2.0 * std < FOLLOWS:
        return moving
    return moving if not slope - 2.0 * std > FOLLOWS and pile.level > PLAIN * pile.noise else ()


def _visits(recordings: Sequence[Recording], values: Sequence[Array], j: int, pile: _Pile) -> list[_Pile]:
    """The rows that each visit of joint j's current to the level, in one direction, adds to a pile."""
    visits = []
    for r, value in zip(recordings, values):
        rows = max(1, round(GAP / r.dt))
        sign = np.sign(ndimage.uniform_filter1d(r.i[:, j], max(1, round(AVERAGED / r.dt))))
        for direction in (1.0, -1.0):
            near = np.pad((value > pile.level - 8.0 * pile.noise) & (sign == direction), rows)
            starts, ends = _stretches(ndimage.binary_closing(near, np.ones(rows, bool))[rows:-rows])
            turns = _turns(r, value, j)
            for start, end in zip(starts, ends):
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


def _again(visits: Sequence[_Pile]) -> bool:
    """Whether enough of the rows at a pile lie outside its longest visit."""
    at = [visit.at for visit in visits]
    return sum(at) - max(at, default=0.0) >= AGAIN * sum(at) > 0.0


def _returns(visits: Sequence[_Pile]) -> bool:
    """Whether more visits to a level are flat than those of a healthy current by chance (binomial test).

    The longest visit is left out, because the level may have been chosen by it.
    """
    longest = max((visit.at for visit in visits), default=0.0)
    flat = [visit.flat for visit in visits if FLAT_SECONDS <= visit.at < longest]
    return any(flat) and 1.0 - float(bdtr(sum(flat) - 1, len(flat), CHANCE)) < UNLIKELY


def _sharp(visits: Sequence[_Pile]) -> bool:
    """Whether several visits are entered and left sharply, but not by friction; lower crests are not asked."""
    sharp = [visit for visit in visits if visit.at > max(SHARP * visit.below, FLAT_SECONDS) and not visit.turns]
    beyond, at = sum(visit.beyond for visit in sharp), sum(visit.at for visit in sharp)
    return len(sharp) >= SEVERAL and beyond < BEYOND * at


def _over_friction(
    recordings: Sequence[Recording], values: Sequence[Array], j: int, pile: _Pile, arm: Arm
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
    starts, ends = _stretches(flat)
    if recording.qref is None or len(starts) == 0:
        return False
    longest = int(np.argmax(ends - starts))
    start, end = int(starts[longest]), int(ends[longest])
    error = np.abs(recording.qref[:, j] - recording.q[:, j])
    return (end - start) * recording.dt > FLAT_SECONDS and bool(
        error[end - 1] > RUNS_AWAY * max(usual, error[: start + 1].max())
    )


def _longest(flags: NDArray[np.bool_]) -> int:
    """Length of the longest run of True."""
    starts, ends = _stretches(flags)
    return int(np.max(ends - starts, initial=0))


def _stretches(flags: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First rows of all runs of True, and those after their last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.view(np.int8), [0]])))
    return edges[::2], edges[1::2]
