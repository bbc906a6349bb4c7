"""Many results of one arm in; what moved since when, and when it will reach a limit, out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from arm_io import InputError
from arm_io.progress import Step, silent
from armscope.api.comparison import Comparable, stored_result

if TYPE_CHECKING:
    from arm_archive import Filters
    from comparison import Stored
    from comparison.trend import Limit, Trend

RESULTS = ("identification.json", "diagnosis.json")


def trend(
    results: Comparable | Sequence[Comparable],
    limits: Mapping[str, float | str] | Sequence[Limit] = (),
    *,
    filters: Filters | None = None,
    progress: Callable[[str], None] = silent,
) -> Trend:
    """How the parameters of an arm moved over many identifications, or many diagnoses.

    results  files, folders of results, or folders in which results are searched for (``armscope.open_archive``)
    limits   name of a quantity -> value that it must not pass, "..14" (at most), "14.." (at least), "+50%" of the first
    filters  of results that are searched for
    Of a folder, a result that cannot be read is left out, with a warning; one that is named itself is refused.
    Raises InputError where there are fewer than three, of different kinds, or of different arms.
    """
    from comparison.trend import limits_from, trend_of

    listed = list(results) if isinstance(results, Sequence) and not isinstance(results, str) else [results]
    warnings: list[str] = []
    found = [one for each in listed for one in _expanded(each, filters, warnings)]
    given = list(limits) if not isinstance(limits, Mapping) else []
    for name, value in limits.items() if isinstance(limits, Mapping) else ():
        given += limits_from(f"{name}={value}")
    stored: list[Stored] = []
    for one in found:
        progress(Step("reading results", len(stored), len(found)))
        stored.append(stored_result(one))
    return trend_of(stored, given, warnings=warnings, progress=progress)


def _expanded(one: Comparable, filters: Filters | None, warnings: list[str]) -> list[Comparable]:
    """A folder without a result of its own stands for all results below it; a warning names those not readable."""
    folder = Path(one) if isinstance(one, str | PathLike) else None
    if folder is None or not folder.is_dir() or any((folder / name).is_file() for name in RESULTS):
        return [one]
    from arm_archive import Filters, open_archive

    with open_archive(folder) as archive:
        wanted = filters or Filters()
        rows = archive.rows(wanted)
        # An unreadable result states neither arm nor date: those filters would hide it.
        unreadable = archive.rows(Filters(kind=wanted.kind, path=wanted.path, state="unreadable"))
    rows = [row for row in rows if Path(row["path"]).name in RESULTS and row["state"] == "whole"]
    warnings += [
        f"{folder / row['path']}: {row['note']}; left out of the trend"
        for row in unreadable
        if Path(row["path"]).name in RESULTS
    ]
    kinds = sorted({row["kind"] for row in rows})
    if len(kinds) > 1:
        raise InputError(folder, f"holds results of {len(kinds)} kinds; choose one with --kind ({' or '.join(kinds)})")
    arms = sorted({row["arm"] or "" for row in rows})
    if len(arms) > 1:
        raise InputError(folder, f"holds results of {len(arms)} arms; choose one with --arm ({', '.join(arms[:5])})")
    if not rows:
        such = "" if filters in (None, Filters()) else " that the options select"
        raise InputError(folder, f"holds no identification.json or diagnosis.json{such}, nor do its folders")
    return [folder / row["path"] for row in rows]
