"""Joins the rows of all devices: one row per trigger, and a reason for every trigger without one.

One device is the clock: its rows say which triggers there were and when. A trigger becomes a row when every required
device has latched it. What a device did not latch is known once it has delivered a later row, so that the join waits
for the slowest device and loses nothing to a late one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.acquisition.device_stream import MISSING, Stream, Table, cut
from daq.acquisition.ledger import Ledger, LossReason
from daq.rig.channels import Columns

Bools = NDArray[np.bool_]

STAMP_BIAS_NS = 250_000
"""How far two devices' host stamps of one edge may lie apart.

At a trigger period of less than twice this, stamps cannot tell which of two neighbouring triggers a first row belongs
to, and the device's own numbering is trusted.
"""
_BUSY = ": it was still answering when it was due, or the computer was busy"


@dataclass(frozen=True)
class Joined:
    """Complete rows: as ``daq.acquisition.rows.Rows``, before calibration."""

    number: NDArray[np.int64]
    host: NDArray[np.int64]
    tick: NDArray[np.int64]
    counts: NDArray[np.int64]
    volts: NDArray[np.float64]
    points: NDArray[np.float64] | None
    readings: NDArray[np.float64]
    quality: NDArray[np.uint8]


class Join:
    """The streams of one acquisition.

    period_ns  of the trigger
    patience   triggers by which a tracker may lag before its points are given up
    notes      sentences about what was corrected are added to it
    gone       devices that failed, and how (``lose_device``)
    next       first trigger that is not accounted for
    """

    def __init__(
        self,
        clock: Stream,
        others: list[Stream],
        columns: Columns,
        ledger: Ledger,
        period_ns: float,
        patience: int,
        notes: list[str],
    ) -> None:
        self.clock, self.others, self.columns, self.ledger = clock, others, columns, ledger
        self.period_ns, self.patience, self.notes = period_ns, patience, notes
        self.next = 0
        self.gone: dict[str, str] = {}
        self._begin = 0
        self._rebased = False
        self._empty: set[int] = set()  # triggers whose rows had no value at all
        self._aligned: set[str] = {clock.name}

    def begin_at(self, host_ns: int) -> None:
        """Rows of triggers before this host time are not of this run."""
        self._begin = host_ns
        for stream in self.others:
            stream.served = host_ns - round(self.period_ns)

    def lose_device(self, name: str, why: str) -> None:
        """No more rows come from this device; the join no longer waits for it."""
        self.gone[name] = why

    def take(self, last: int | None = None) -> Joined | None:
        """All rows that are certain by now; None if there are none.

        last  the recording ends with this trigger, and no device will deliver any more: triggers up to it that are
              still without a row are lost
        """
        if last is None and not self._rebased:
            return None
        self._align()
        horizon = self._horizon() if last is None else last
        if horizon < self.next or (last is None and self.clock.ready is None):
            return None
        self.ledger.see(horizon + 1)
        rows = self._rows(horizon)
        if rows is not None:
            rows = self._without_empty(rows)
        present = np.empty(0, np.int64) if rows is None else rows.number
        self._account_for_losses(horizon, present)
        self.next = horizon + 1
        for stream in (self.clock, *self.others):
            if not stream.by_time or stream is self.clock:
                stream.drop_through(horizon)
            elif rows is not None:
                stream.drop_before(int(rows.host[-1]))
        return rows

    def rebase(self) -> None:
        """Once: the first trigger after ``begin_at`` gets index 0, if the line was running before."""
        clock = self.clock
        if self._rebased or clock.ready is None or clock.ready["host"][-1] < self._begin:
            return
        self._rebased = True
        before = int(np.searchsorted(clock.ready["host"], self._begin))
        if before:
            first = int(clock.ready["index"][before - 1]) + 1
            for stream in (clock, *self.others):
                if not stream.by_time:
                    stream.move(-first)

    def _horizon(self) -> int:
        """The last trigger that every device has passed."""
        horizon = self.clock.newest
        for stream in self.others:
            if stream.name in self.gone:
                continue
            if stream.required:
                horizon = min(horizon, stream.newest)
            elif not stream.by_time:  # a tracker
                horizon = min(horizon, max(stream.newest, self.clock.newest - self.patience))
            elif self.clock.ready is not None:
                horizon = min(horizon, self._horizon_by_time(stream))
                if stream.repeat == MISSING:  # whether a reading is nearer to a trigger than to the next one
                    horizon = min(horizon, self.clock.newest - 1)
        return horizon

    def _horizon_by_time(self, stream: Stream) -> int:
        """The last trigger before the newest row; one that takes long is not waited for longer than the patience."""
        assert self.clock.ready is not None
        index = self.clock.ready["index"]
        passed = 0 if stream.ready is None else int(np.searchsorted(self.clock.ready["host"], stream.ready["host"][-1]))
        covered = int(index[passed - 1]) if passed else int(index[0]) - 1
        return max(covered, self.clock.newest - self.patience)

    def _align(self) -> None:
        """Once a device: its first row belongs to the trigger at whose time it was latched.

        A device that was armed while the line was already running, or missed the first edge, numbers from a later one.
        """
        clock = self.clock
        for stream in self.others:
            if stream.name in self._aligned or stream.ready is None or clock.ready is None or stream.by_time:
                continue
            self._aligned.add(stream.name)
            if self.period_ns / 2 <= STAMP_BIAS_NS or not (_even(stream.ready) and _even(clock.ready)):
                continue
            ahead = (int(stream.ready["host"][0]) - int(clock.ready["host"][0])) / self.period_ns
            edges = round(ahead) + int(clock.ready["index"][0]) - int(stream.ready["index"][0])
            if edges:
                stream.move(edges)
                self.notes.append(f"{stream.name}: its row 0 was latched by trigger {edges}, as its time shows")

    def _rows(self, horizon: int) -> Joined | None:
        if self.clock.ready is None:
            return None
        stop = int(np.searchsorted(self.clock.ready["index"], horizon, side="right"))
        table = cut(self.clock.ready, 0, stop)
        complete: Bools = table["index"] >= self.next
        places = {}
        for stream in self.others:
            if not stream.by_time:
                places[stream.name], there = _find(stream, table["index"])
                if stream.required:
                    complete &= there
        if not complete.all():
            table = {name: column[complete] for name, column in table.items()}
            places = {name: place[complete] for name, place in places.items()}
        if len(table["index"]) == 0:
            return None
        return self._assemble(table, places)

    def _assemble(self, table: Table, places: dict[str, NDArray[np.int64]]) -> Joined:
        n = len(table["index"])
        values: Table = {
            "counts": np.zeros((n, len(self.columns.counters)), np.int64),
            "volts": np.full((n, len(self.columns.inputs)), np.nan),
            "points": np.full((n, 3), np.nan),
            "readings": np.full((n, len(self.columns.readings)), np.nan),
        }
        quality = np.full((n, self.columns.quality), MISSING, np.uint8)
        for stream in (self.clock, *self.others):
            if stream is self.clock:
                rows, place, flag = table, np.arange(n), np.zeros(n, np.uint8)
            elif stream.ready is None:
                continue
            elif stream.by_time:
                rows = stream.ready
                place, first = nearest(rows["host"], self._known_triggers(table), stream.served)
                place, first = place[:n], first[:n]
                flag = np.where(first, 0, int(stream.repeat)).astype(np.uint8)
                stream.served = max([stream.served, *rows["host"][place[first]][-1:].tolist()])
            else:
                rows, place = stream.ready, places[stream.name]
                flag = np.where(rows["index"][place] == table["index"], 0, MISSING).astype(np.uint8)
            there = (flag & MISSING) == 0
            complete = bool(there.all())
            for name, columns in stream.columns.items():
                if complete:
                    values[name][:, columns] = rows[name][place]
                else:
                    values[name][there, columns] = rows[name][place[there]]
            marks = rows["quality"][place] | flag[:, None]
            quality[:, stream.quality] = marks if complete else np.where(there[:, None], marks, np.uint8(MISSING))
        return Joined(
            table["index"],
            table["host"],
            table["tick"],
            values["counts"],
            values["volts"],
            values["points"] if self.columns.tracker is not None else None,
            values["readings"],
            quality,
        )

    def _known_triggers(self, table: Table) -> NDArray[np.int64]:
        """Host times of the triggers of these rows and of those after them, which a row may be nearer to."""
        assert self.clock.ready is not None
        later = int(np.searchsorted(self.clock.ready["index"], table["index"][-1], side="right"))
        return np.concatenate([table["host"], self.clock.ready["host"][later:]])

    def _without_empty(self, rows: Joined) -> Joined | None:
        """The rows that have at least one value; the others are noted as lost.

        A row is empty where every polled device was disconnected. (Devices that latch make no row then.)
        """
        empty = ((rows.quality & MISSING) != 0).all(axis=1)
        if not (self.columns.counters or self.columns.inputs) or not empty.any():
            return rows
        self._empty.update(rows.number[empty].tolist())
        if empty.all():
            return None
        kept = ~empty
        number, host, tick = (column[kept] for column in (rows.number, rows.host, rows.tick))
        points = None if rows.points is None else rows.points[kept]
        values = rows.counts[kept], rows.volts[kept], points, rows.readings[kept]
        return Joined(number, host, tick, *values, rows.quality[kept])

    def _account_for_losses(self, horizon: int, present: NDArray[np.int64]) -> None:
        """Every trigger of next..horizon is a row or a loss with a reason."""
        self.ledger.latch(len(present))
        if len(present) == horizon + 1 - self.next:
            return
        lost = np.setdiff1d(np.arange(self.next, horizon + 1), present, assume_unique=True)
        for number in lost.tolist():
            self.ledger.lose(number, 1, *self._reason(number))

    def _reason(self, number: int) -> tuple[LossReason, str]:
        if number in self._empty:
            return LossReason.DEVICE_GONE, f"{self.clock.name}: no device had a value"
        for stream in (self.clock, *(s for s in self.others if s.required)):
            if number in stream.indexer.missed:
                return LossReason.LOST_EDGE, stream.name
            _, there = _find(stream, np.array([number]))
            if not there[0]:
                if stream.name in self.gone and number > stream.newest:
                    return LossReason.DEVICE_GONE, f"{stream.name}: {self.gone[stream.name]}"
                return LossReason.NOT_LATCHED, f"{stream.name}{_BUSY if stream.by_time else ''}"
        return LossReason.NOT_LATCHED, self.clock.name


def _find(stream: Stream, index: NDArray[np.int64]) -> tuple[NDArray[np.int64], Bools]:
    """Places of these triggers among a stream's rows, and whether they are there."""
    if stream.ready is None:
        return np.zeros(len(index), np.int64), np.zeros(len(index), bool)
    have = stream.ready["index"]
    place = np.minimum(np.searchsorted(have, index), len(have) - 1)
    return place, have[place] == index


def nearest(rows: NDArray[np.int64], triggers: NDArray[np.int64], served: int = -1) -> tuple[NDArray[np.int64], Bools]:
    """(triggers,) place of the row nearest in time to each trigger (host ns), and whether it is that row's nearest.

    ``rows`` and ``triggers`` must both increase.

    served  rows up to this time have served an earlier trigger already
    """
    after = np.searchsorted(rows, triggers)
    before, after = np.maximum(after - 1, 0), np.minimum(after, len(rows) - 1)
    place = np.where(np.abs(rows[after] - triggers) < np.abs(triggers - rows[before]), after, before)
    order = np.lexsort((np.abs(rows[place] - triggers), place))
    best = np.ones(len(order), bool)
    best[1:] = place[order][1:] != place[order][:-1]
    first = np.zeros(len(triggers), bool)
    first[order[best]] = True
    return place, first & (rows[place] > served)


def _even(table: Table) -> bool:
    """Whether the host stamps lie as evenly as the triggers."""
    steps, intervals = np.diff(table["index"]), np.diff(table["host"])
    if len(steps) < 3 or (steps <= 0).any():
        return False
    pace = np.median(intervals / steps)
    return bool(pace > 0 and np.median(np.abs(intervals / steps / pace - 1)) < 0.25)
