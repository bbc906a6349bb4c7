"""Compares friction of a night with the value expected at its recorded temperature.

Friction parameters, and causes that are named for friction, are regressed on the mean temperature of their joint over
the reference nights (weighted least squares, a straight line). A night is compared with the line at its own
temperature. The variance of the comparison has three parts: that of level and slope, the scatter of the reference
nights about their lines, and the error of a straight line: friction of greased gears falls exponentially (Bittencourt,
Gunnarsson, J. Dyn. Sys. Meas. Control 134(5), 051013, 2012). Far from the reference nights this error is large, and no
change is named that temperature can explain.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from arm_fleet.judging.scatter import of_friction
from arm_io.types import Array
from comparison import Change, Estimate, Quantity, moderate

BENDS = 0.03
"""1/K, standard deviation of the relative change of the slope of friction over temperature, per kelvin."""
FEWEST = 3
"""Minimum number of reference nights with a temperature for the scatter about a line."""


@dataclass(frozen=True)
class Line:
    """Prediction of a quantity at the temperature of a night, from the reference nights.

    level, variance  predicted value and its variance, without scatter beyond the standard deviations of the nights
    left      standard deviation of the error of the straight line at that temperature
    ratio     variance about the line over that expected from the deviations; ``freedom``: its degrees of freedom
    stated    least degrees of freedom of the standard deviations
    """

    level: float
    variance: float
    left: float
    ratio: float
    freedom: int
    stated: float


def regressed(
    changes: Sequence[Change], quantities: Sequence[Quantity], estimates: Sequence[Estimate], temperature: Array
) -> list[Change]:
    """The same changes; those of friction relative to the prediction at the temperature of the night.

    estimates    of the n reference nights and then of the night, of all ``quantities``
    temperature  (n + 1, J) degC, NaN where it is not known
    """
    place = {one.name: k for k, one in enumerate(quantities)}
    lines = {}
    for one in changes:
        name = one.quantity.name
        if one.p is not None and one.after is not None and name in place and of_friction(one):
            line = _line(estimates, place[name], _of_joint(temperature, one.quantity.joint))
            if line is not None:
                lines[name] = line
    scatter = _scatter(changes, lines)
    return [
        _against(
            change,
            lines[change.quantity.name],
            estimates[-1],
            place[change.quantity.name],
            *scatter[change.quantity.name],
        )
        if change.quantity.name in lines
        else change
        for change in changes
    ]


def no_surer(changes: Sequence[Change]) -> list[Change]:
    """The same changes; the p-value of a friction cause is at least that of the identified friction of its joint.

    If temperature replaces one cause by another, no reference night may name the latter: the line of such a cause
    has no data. Identified parameters have their own line.
    """
    surest: dict[int | None, float] = {}
    for one in changes:
        if one.quantity.kind != "cause" and one.p is not None:
            for joint in (one.quantity.joint, None):
                surest[joint] = min(surest.get(joint, 1.0), one.p)
    return [
        replace(change, p=max(change.p, surest[change.quantity.joint]))
        if change.p is not None
        and change.quantity.kind == "cause"
        and of_friction(change)
        and change.quantity.joint in surest
        else change
        for change in changes
    ]


def outside(temperature: Array) -> float:
    """K by which the last row of (n + 1, J) degC is outside the range of the others, at the worst joint; 0: inside."""
    *before, night = temperature
    found = [0.0]
    for joint, its in enumerate(night):
        known = [one[joint] for one in before if np.isfinite(one[joint])]
        if known and np.isfinite(its):
            found += [float(its - max(known)), float(min(known) - its)]
    return max(found)


def _of_joint(temperature: Array, joint: int | None) -> Array:
    """(n + 1,) degC of a joint (from 1), or the mean of all."""
    return np.asarray(temperature.mean(axis=1) if joint is None else temperature[:, joint - 1])


def _line(estimates: Sequence[Estimate], which: int, degc: Array) -> Line | None:
    """None if too few reference nights, or not the night itself, have a temperature and a value."""
    values, raw = (np.array([getattr(estimate, name)[which] for estimate in estimates]) for name in ("values", "raw"))
    there = np.isfinite(values) & np.isfinite(degc) & (raw > 0)
    if not there[-1] or there[:-1].sum() < FEWEST:
        return None
    # Kelvin from the night: the level of the line is its value there.
    y, weight, x = values[:-1][there[:-1]], raw[:-1][there[:-1]] ** -2, (degc[:-1] - degc[-1])[there[:-1]]
    away, level = np.average(x, weights=weight), np.average(y, weights=weight)
    width = float(weight @ (x - away) ** 2)
    if not width:
        # Of one temperature nothing is known at another one.
        return Line(level, np.inf, 0.0, 1.0, 1, 1.0) if away else None
    slope = float(weight @ ((x - away) * y)) / width
    rest = y - level - slope * (x - away)
    freedom = len(y) - 2
    return Line(
        level=float(level - slope * away),
        variance=float(1 / weight.sum() + away**2 / width),
        left=float(0.5 * BENDS * np.hypot(slope, width**-0.5) * away**2),
        ratio=float(weight @ rest**2) / freedom,
        freedom=freedom,
        stated=min(estimate.freedom for estimate, counted in zip(estimates, there) if counted),
    )


def _scatter(changes: Sequence[Change], lines: Mapping[str, Line]) -> dict[str, tuple[float, float]]:
    """Name -> ratio of the scatter about the lines, at least 1, and its degrees of freedom; one for all causes."""
    found = {}
    for causes in (True, False):
        names = [
            change.quantity.name
            for change in changes
            if change.quantity.name in lines and (change.quantity.kind == "cause") is causes
        ]
        if names:
            of_kind = [lines[name] for name in names]
            ratio, freedom = moderate(
                np.array([one.ratio for one in of_kind]), np.array([float(one.freedom) for one in of_kind])
            )
            for name, its, degrees in zip(names, ratio, freedom):
                found[name] = (float(np.sqrt(max(its, 1.0))), float(degrees) if its > 1 else np.inf)
    return found


def _against(one: Change, line: Line, night: Estimate, which: int, scatter: float, freedom: float) -> Change:
    """A change relative to the line."""
    raw = float(np.hypot(scatter * np.hypot(line.variance**0.5, night.raw[which]), line.left))
    moved = float(night.values[which]) - line.level
    p = float(2 * stats.t.sf(abs(moved) / raw, min(freedom, line.stated)))
    return replace(one, before=line.level, std=raw, p=p, scatter=scatter)
