"""Limits of the drives' currents that differ between the sides: rows pile up at one value, and beyond it on the other.

A limit is no term of a regression: the motion obeys the torque that the drive gives. The raw currents show it, as they
do to a diagnosis (``diagnosis.screening.current_limit``). On a side without one, the largest current is the least that
its limit may be; where that is no more than the other side's limit, nothing can be said.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from scipy import ndimage, stats

from arm_model import Arm
from comparison.change import Change, Quantity
from daq.recording import Recording
from diagnosis.screening.current_limit import AVERAGED, current_limits

TOP = 0.999
"""Share of the rows of a side below its largest current."""
BEYOND = 4.0
"""Deviations of a limit by which currents of the other side must exceed it."""
SHARE = 0.02
"""Share of a limit by which they must exceed it, if that is more."""


def limit_changes(before: Sequence[Recording], after: Sequence[Recording], arm: Arm) -> list[Change]:
    """One per joint whose current is clipped on a side."""
    return list(_changes((before, after), arm))


def _changes(sides: tuple[Sequence[Recording], Sequence[Recording]], arm: Arm) -> Iterator[Change]:
    limits = [{event.joint: event.parameters[0] for event in current_limits(side, arm)} for side in sides]
    for joint in sorted({j for one in limits for j in one if j is not None}):
        shown = "" if all(joint in one for one in limits) else " (of a side without: its largest current)"
        quantity = Quantity(
            name=f"joint{joint}.current_limit.limit",
            words=f"current limit of joint {joint}{shown}",
            unit="A",
            kind="effect",
            joint=joint,
        )
        values: list[float] = []
        stds: list[float] = []
        for side, found, other in zip(sides, limits, reversed(limits)):
            limit = found.get(joint)
            values.append(_largest(side, joint) if limit is None else limit.value)
            stds.append(float((limit or other[joint]).std or 0.0))
        std = math.hypot(*stds)
        z = (values[1] - values[0]) / max(std, 1e-300)
        clear = abs(values[1] - values[0]) > max(BEYOND * std, SHARE * min(values))
        # a limit on one side alone: the other's currents must go beyond it
        beyond = values[1] > values[0] if joint in limits[0] else values[0] > values[1]
        if not all(joint in one for one in limits) and not (clear and beyond):
            quantity = quantity.not_comparable("the currents of one side do not exceed the limit of the other")
        p = float(2 * stats.norm.sf(abs(z))) if clear else 1.0
        tested = None if quantity.why else p
        yield Change(
            quantity=quantity,
            before=values[0],
            after=values[1],
            std_before=stds[0],
            std_after=stds[1],
            std=std,
            p=tested,
            corrected=None if tested is None else min(1.0, tested * len(arm)),
        )


def _largest(recordings: Sequence[Recording], joint: int) -> float:
    """A: that nearly no averaged current of a joint (from 1) exceeds, of the recording with the largest."""
    found = []
    for one in recordings:
        rows = max(1, round(AVERAGED / one.dt))
        found.append(np.nanquantile(np.abs(ndimage.uniform_filter1d(one.i[:, joint - 1], rows)), TOP))
    return float(max(found))
