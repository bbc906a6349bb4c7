"""What each of many results says of each quantity, by date."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

import numpy as np

from arm_io import InputError
from arm_io.dates import utc_date_of
from arm_io.types import Array
from comparison.change import Quantity
from comparison.stored.from_results import Stored, check_together, estimates_of

FEWEST_RESULTS = 3
"""Of a trend; two are a comparison."""


@dataclass(frozen=True, kw_only=True)
class History:
    """One quantity in the n results that say something of it, by date.

    days     (n,) since the first result of all, increasing
    values   (n,) in ``quantity.unit``; std (n,): two of them hold 95 %; raw (n,): without the allowance for few blocks
    freedom  (n,) degrees of freedom of ``raw``
    sources  paths of the results
    """

    quantity: Quantity
    days: Array
    values: Array
    std: Array
    raw: Array
    freedom: Array
    sources: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Histories:
    """The histories of all quantities, and the date of day 0."""

    what: str
    start: datetime
    results: tuple[str, ...]
    histories: list[History]
    warnings: list[str]

    def date(self, days: float) -> str | None:
        """'2026-03-04' of a day; None beyond the calendar."""
        try:
            return (self.start + timedelta(days=float(days))).strftime("%Y-%m-%d")
        except OverflowError:
            return None


def histories_of(results: Sequence[Stored], warnings: Sequence[str]) -> Histories:
    """The results by date, and the history of every quantity that two of them or more hold; after further warnings.

    The date is when the recordings were made (``recorded``), else that of the result's file, with a warning.
    InputError for fewer than ``FEWEST_RESULTS`` results, of different kinds, or of models of different structure.
    """
    if len(results) < FEWEST_RESULTS:
        left = "".join(f"; {warning}" for warning in warnings)
        raise InputError(
            "results", f"a trend needs {FEWEST_RESULTS} or more (is {len(results)}); armscope compare takes two{left}"
        )
    check_together(results)
    dates, of_dates = _dates(results)
    order = sorted(range(len(results)), key=lambda k: dates[k])
    results, dates = [results[k] for k in order], [dates[k] for k in order]
    quantities, estimates = estimates_of(results)
    days = np.array([(date - dates[0]).total_seconds() / 86_400 for date in dates])
    warnings = [*warnings, *of_dates, *_too_close(dates)]
    histories = []
    for k, quantity in enumerate(quantities):
        values, std, raw = (
            np.array([getattr(estimate, name)[k] for estimate in estimates]) for name in ("values", "std", "raw")
        )
        there = np.isfinite(values) & np.isfinite(raw) & (raw > 0)
        if there.sum() >= 2:
            histories.append(
                History(
                    quantity=quantity,
                    days=days[there],
                    values=values[there],
                    std=std[there],
                    raw=raw[there],
                    freedom=np.array([estimate.freedom for estimate in estimates])[there],
                    sources=tuple(str(result.path) for result, mine in zip(results, there) if mine),
                )
            )
    names = tuple(str(result.path) for result in results)
    return Histories(what=results[0].what, start=dates[0], results=names, histories=histories, warnings=warnings)


def _dates(results: Sequence[Stored]) -> tuple[list[datetime], list[str]]:
    dates, guessed = [], []
    for one in results:
        recorded = utc_date_of(one.table.get("recorded"))
        if recorded is not None:
            dates.append(datetime.fromisoformat(recorded))
            continue
        try:
            dates.append(datetime.fromtimestamp(os.stat(one.path).st_mtime, UTC))
        except OSError:
            raise InputError(one.path, "does not say when its recordings were made ('recorded')") from None
        guessed.append(one.path.parent.name)
    if not guessed:
        return dates, []
    shown = ", ".join(guessed[:3]) + (" ..." if len(guessed) > 3 else "")
    return dates, [f"{len(guessed)} results do not say when they were recorded; their files' dates count: {shown}"]


def _too_close(dates: Sequence[datetime]) -> list[str]:
    """A sentence where all results, in order of their dates, are of one day: hardly the dates of the recordings."""
    span = dates[-1] - dates[0]
    if span >= timedelta(days=1):
        return []
    return [
        f"all results are dated within {span.total_seconds() / 3600:.2g} h ({dates[0]:%Y-%m-%d}): tables without dates "
        "count as recorded when they are imported, simulations when they are computed; 'armscope import --date' states "
        "the date"
    ]
