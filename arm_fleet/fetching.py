"""Copies the recordings of a night to this machine: whole, or only the examined segments of long ones.

An hour of the same arm adds little to three minutes spread over it (``diagnosis`` examines no more). A task therefore
reads only the chunks of some segments. Which rows are examined does not depend on where the recording is stored.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from arm_fleet.storage import asking, file_system
from arm_io import InputError, make_folder
from daq.recording import Ranges

LENGTH = 30.0
"""s: approximate length of a segment."""
LEAST = 10.0
"""s that are examined of every recording, at least, since each may have its own motion."""


@dataclass
class Source:
    """A recording in a file system; ``read`` counts the bytes that were requested."""

    place: str
    system: Any
    path: str
    size: int
    read: int = 0
    ranges: Ranges | None = field(default=None, repr=False)

    def span(self, start: int, end: int) -> bytes:
        """Reads the bytes ``start`` to ``end``. InputError if they cannot be read."""
        with asking(self.place):
            data: bytes = self.system.cat_file(self.path, start=start, end=end)
        self.read += len(data)
        return data


@dataclass(frozen=True)
class Fetched:
    """Paths on this machine, one per recording of the night; bytes of the recordings, and bytes that were read."""

    groups: list[list[Path]]
    size: int
    read: int


def fetched(places: Sequence[str], folder: Path, storage: Mapping[str, Any], seconds: float | None) -> Fetched:
    """The recordings of one night, in the order of their places.

    folder   for the copies, which may be removed afterwards
    storage  options of the file system (fsspec)
    seconds  s that are examined of all of them together, at least ``LEAST`` of each; None: all
    InputError where one cannot be read.
    """
    sources = [_source(place, storage) for place in places]
    total = 0.0
    if seconds is not None:
        for one in sources:
            one.ranges = Ranges.of(one.place, one.span, one.size)
            total += one.ranges.seconds if one.ranges is not None else 0.0
    share = 1.0 if seconds is None else seconds / max(total, seconds)
    groups = [_local(one, share, folder / str(number)) for number, one in enumerate(sources, 1)]
    return Fetched(groups, sum(source.size for source in sources), sum(source.read for source in sources))


def spread(seconds: float, share: float) -> list[tuple[float, float]]:
    """Segments (s, from and to) of about ``LENGTH``, evenly spread over ``seconds``; together ``share`` of it."""
    length = min(max(share * seconds, LEAST), seconds)
    count = max(1, round(length / LENGTH))
    return [(start, start + length / count) for start in np.linspace(0.0, seconds - length / count, count).tolist()]


def _source(place: str, storage: Mapping[str, Any]) -> Source:
    system, path = file_system(place, storage)
    with asking(place):
        return Source(place, system, path, int(system.size(path)))


def _local(source: Source, share: float, folder: Path) -> list[Path]:
    name = source.path.rsplit("/", 1)[-1]
    ranges = source.ranges
    if ranges is not None and share < 1.0 and ranges.seconds > LEAST:
        spans = spread(ranges.seconds, share)
        make_folder(folder)
        paths = [folder / f"{name.removesuffix('.mcap')}_at_{start:.0f}s.mcap" for start, _ in spans]
        try:
            ranges.write(spans, paths)
        except InputError:
            # Damaged in a stretch: of the whole recording the intact rows are read, and the others counted as lost.
            pass
        else:
            return paths
    source.read = source.size
    if "://" not in source.place:
        return [Path(source.place)]
    make_folder(folder)
    with asking(source.place):
        source.system.get_file(source.path, str(folder / name))
    return [folder / name]
