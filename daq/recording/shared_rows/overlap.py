"""Whether recordings hold the same measured rows: copies, parts of one another, the same data in another file format.

A row is known by a hash of its values alone, so that cutting, other time stamps and another file do not hide it. Rows
that a recording repeats in itself, as an arm at standstill with quantised instruments does, say nothing; single others
coincide by chance where one motion is recorded twice. What a copy has and chance does not: a run of successive rows
that the other recording holds in the same order. Of very long recordings the rows of some hashes are compared alone,
the same ones in each (Broder, On the resemblance and containment of documents, 1997).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from hashlib import sha256

import numpy as np
from numpy.typing import NDArray

from arm_io import InputError
from daq.recording.blocks import open_long
from daq.recording.reader import Recording
from daq.recording.shared_rows.row_keys import Keys, row_keys

LONGEST, SHORTEST = 500, 50
"""Successive rows in the same order, half of those that may be, that no chance explains: where noise is a fiftieth of a
step of the instruments, a repeated motion of 10 s at 1 kHz has runs of 200."""
SHARE = 0.01
"""Of the rows of the recording that has the larger share in common: less is no matter."""
MOST = 4_000_000
"""Rows that are compared, of all recordings together."""


@dataclass(frozen=True, kw_only=True)
class Overlap:
    """Recordings ``one`` < ``other`` (from 0) hold the same rows; share: of those of ``other``, what is in ``one``."""

    one: int
    other: int
    share: float


def overlaps(recordings: Sequence[Recording]) -> list[Overlap]:
    """Which recordings share rows of angles and currents, as they were recorded; of three alike, each with the next."""
    rows = sum(len(recording) * recording.averaged for recording in recordings)
    one_in = np.uint64(2 ** max(0, int(np.ceil(np.log2(max(rows, 1) / MOST)))))
    return overlaps_of([_keys_of(recording, one_in) for recording in recordings])


def overlaps_of(keys: Sequence[Keys]) -> list[Overlap]:
    """Which of several sequences of rows have a run in common, or are equal."""
    found, sides = [], [_Rows(one) for one in keys]
    for one, other in _candidates(sides):
        x, y = sides[one], sides[other]
        shares = [float(np.isin(these.keys, those.keys).mean()) for these, those in ((y, x), (x, y))]
        least = np.clip(min(len(x.once), len(y.once)) // 2, SHORTEST, LONGEST)
        in_order = max(_longest_run(x, y), _longest_run(y, x)) >= least and max(shares) >= SHARE
        if in_order or np.array_equal(x.keys, y.keys):
            found.append(Overlap(one=one, other=other, share=shares[0]))
    return found


@dataclass(frozen=True)
class _Rows:
    """The keys of a recording in their order."""

    keys: Keys

    @cached_property
    def _counted(self) -> tuple[Keys, NDArray[np.intp], NDArray[np.intp]]:
        return np.unique(self.keys, return_index=True, return_counts=True)

    @cached_property
    def once(self) -> Keys:
        """Keys that occur once, sorted."""
        keys, _, count = self._counted
        return keys[count == 1]

    @cached_property
    def at(self) -> NDArray[np.intp]:
        """Rows of ``once``."""
        _, first, count = self._counted
        return first[count == 1]

    @cached_property
    def repeated(self) -> Keys:
        """Keys that occur more than once, sorted."""
        keys, _, count = self._counted
        return keys[count > 1]


def digest(recording: Recording) -> str:
    """16 hexadecimal digits that are the same for the same rows, whatever file and order they are in."""
    total = np.sum(_keys_of(recording, np.uint64(1)), dtype=np.uint64)
    return f"{int(total):016x}"


def _keys_of(recording: Recording, every: np.uint64) -> Keys:
    """Keys of the rows in the file, also if the recording holds means of them."""
    if recording.averaged > 1:
        try:
            return _sampled(_recorded(recording), every)
        except InputError:  # the file no longer exists, so the means are used
            pass
    return _sampled([recording], every)


def _sampled(pieces: Iterable[Recording], every: np.uint64) -> Keys:
    """The keys that are multiples of ``every``: the same ones in any recording."""
    keys = [row_keys(one.q, one.i) for one in pieces]
    return np.concatenate([np.empty(0, np.uint64), *(one[one % every == 0] for one in keys)])


def _recorded(recording: Recording) -> Iterator[Recording]:
    """The blocks of its file, as far as the recording reaches."""
    first, last = recording.number[0], recording.number[-1] + recording.averaged
    for block in open_long(recording.path).blocks():
        inside = (block.number >= first) & (block.number < last)
        yield replace(block, q=block.q[inside], i=block.i[inside])


def _candidates(sides: Sequence[_Rows]) -> list[tuple[int, int]]:
    """Pairs of recordings that share enough rows for a run, or have equal length."""
    if not sides:
        return []
    keys = np.concatenate([one.once for one in sides])
    owner = np.repeat(np.arange(len(sides)), [len(one.once) for one in sides])
    order = np.argsort(keys, kind="stable")
    keys, owner = keys[order], owner[order]
    both = np.flatnonzero(keys[1:] == keys[:-1])
    pairs, count = np.unique(np.stack([owner[both], owner[both + 1]], axis=1), axis=0, return_counts=True)
    found = {(int(one), int(other)) for (one, other), rows in zip(pairs, count) if rows >= SHORTEST}
    alike: dict[bytes, int] = {}
    for number, side in enumerate(sides):
        digest = sha256(side.keys.tobytes()).digest()
        if len(side.keys) and digest in alike:
            found.add((alike[digest], number))
        alike[digest] = number
    return sorted(found)


def _longest_run(one: _Rows, other: _Rows) -> int:
    """Of successive rows of ``one`` that ``other`` has in the same order; rows that either repeats do not count."""
    order = np.argsort(one.at)
    keys = one.once[order]
    keys = keys[~np.isin(keys, other.repeated)]
    if not len(keys) or not len(other.once):
        return 0
    place = np.minimum(np.searchsorted(other.once, keys), len(other.once) - 1)
    at = np.where(other.once[place] == keys, other.at[place], -1)
    breaks = np.flatnonzero((at[1:] <= at[:-1]) | (at[:-1] < 0))
    longest = int(np.diff(np.concatenate([[-1], breaks, [len(at) - 1]])).max())
    return longest if longest > 1 or (at >= 0).any() else 0
