"""What is missing in the recordings that are read: said in one place, whoever reads them and for whatever purpose."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

from daq.acquisition.ledger import SENTENCES, LedgerSummary

UNSURE = "the number of rows after the last one is unknown"
"""Note of a recording whose end is missing, and the count of its rows with it."""
MOST_LINES = 10


@dataclass(frozen=True)
class Account:
    """A recording's file, its ledger, and sentences about damage of the file."""

    path: Path
    ledger: LedgerSummary
    notes: tuple[str, ...]


_listeners: list[Callable[[Account], None]] = []
_silent = ContextVar("silent", default=False)


def opened(account: Account) -> None:
    """Reports the account of a recording that was read to all listeners."""
    for listener in () if _silent.get() else _listeners:
        listener(account)


@contextmanager
def unreported() -> Iterator[None]:
    """While the block runs, this thread reads recordings without reports: for lists that show losses themselves."""
    before = _silent.set(True)
    try:
        yield
    finally:
        _silent.reset(before)


@contextmanager
def warnings_on(stream: TextIO) -> Iterator[list[Path]]:
    """While the block runs, every recording that is read and lacks rows is reported on ``stream``, once per file.

    Yields a list that collects these files.
    """
    seen: set[Path] = set()
    incomplete: list[Path] = []

    def warn(account: Account) -> None:
        if account.path in seen:
            return
        seen.add(account.path)
        for sentence in sentences(account):
            print(f"warning: {account.path}: {sentence}", file=stream, flush=True)
        if lacks_rows(account):
            incomplete.append(account.path)

    _listeners.append(warn)
    try:
        yield incomplete
    finally:
        _listeners.remove(warn)


def lacks_rows(account: Account) -> bool:
    """Whether rows are missing, or may be."""
    return account.ledger.lost > 0 or UNSURE in account.notes


def sentences(account: Account) -> list[str]:
    """What is missing: rows, their share and the reasons; then what is wrong with the file."""
    ledger, rows = account.ledger, Counter[str]()
    for loss in ledger.losses:
        rows[SENTENCES[loss.reason]] += loss.rows
    if not rows:
        return list(account.notes)
    if len(rows) == 1:
        reasons = next(iter(rows))
    else:
        reasons = "; ".join(f"{count} because {sentence}" for sentence, count in rows.most_common())
    share = 100 * ledger.lost / ledger.triggers
    return [f"{ledger.lost} of {ledger.triggers} rows are missing ({share:.3g} %): {reasons}", *account.notes]


def loss_lines(losses: Sequence[Mapping[str, Any]]) -> list[str]:
    """A line for each loss of a ledger's table; where they are more than ``MOST_LINES``, for each reason and device."""
    if len(losses) <= MOST_LINES:
        return [f"lost: {loss['rows']} from trigger {loss['first']} on: {_why(loss)}" for loss in losses]
    places: dict[str, list[Mapping[str, Any]]] = {}
    for loss in losses:
        places.setdefault(_why(loss), []).append(loss)
    lines = []
    for why, found in places.items():
        most = max(found, key=lambda loss: int(loss["rows"]))
        where = f"1 place from trigger {most['first']} on"
        if len(found) > 1:
            where = f"{len(found)} places from trigger {found[0]['first']} to {found[-1]['first']}"
            where += f", at most {most['rows']} at once (from trigger {most['first']} on)"
        lines.append(f"lost: {sum(loss['rows'] for loss in found)} in {where}: {why}")
    return [*lines, "'armscope info --json' lists each loss"]


def _why(loss: Mapping[str, Any]) -> str:
    return f"{loss['sentence']} ({loss['detail']})" if loss["detail"] else str(loss["sentence"])
