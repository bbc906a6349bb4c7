"""Many results in, what moved, since when and how fast out."""

from __future__ import annotations

from collections.abc import Sequence

from arm_io.types import Progress
from comparison.stored.from_results import Stored
from comparison.trend.forecast import limits_of
from comparison.trend.history import histories_of
from comparison.trend.limits import Limit
from comparison.trend.movement import movement_of
from comparison.trend.outcome import Trend
from comparison.trend.selection import select


def trend_of(
    results: Sequence[Stored],
    limits: Sequence[Limit] = (),
    *,
    warnings: Sequence[str] = (),
    progress: Progress = lambda _: None,
) -> Trend:
    """How the quantities of an arm moved over its results, of which there must be three or more.

    limits    values that quantities must not pass: the trend says when they will
    warnings  what the trend must also say, such as results that could not be read
    InputError where the results do not belong together, or a limit names a quantity that none of them has.
    """
    progress("histories")
    histories = histories_of(results, warnings)
    progress("trends")
    moved = select(histories.histories)
    stands = limits_of(limits, moved)
    movements = [movement_of(one, stands.get(one.history.quantity.name, ())) for one in moved]
    return Trend(arm=results[0].arm, histories=histories, movements=movements)
