"""Recordings of any length: read block by block, with no more than a chunk in memory."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daq.recording.contents import Columns, Contents, read_contents
from daq.recording.head import RecordingHead
from daq.recording.mcap_file import walk as mcap_walk
from daq.recording.messages.ros2_messages import STRING, TF
from daq.recording.messages.row_format import RECORD_HEAD, Layout
from daq.recording.messages.viewers import DESCRIPTION_TOPIC, TF_TOPIC, messages_in, viewer_channels
from daq.recording.reader import Recording, head_of, in_base_frame, origin_of, rows_of, time_of

MOST_STEPS = 1 << 20
"""Times between rows of which the median is taken; of a longer recording these are spread evenly."""


@dataclass(frozen=True)
class Message:
    """One ROS message as it stands in the file: its bytes in CDR, and ns since 1970."""

    topic: str
    type: str
    wall_ns: int
    data: bytes


@dataclass(frozen=True, eq=False, repr=False)
class LongRecording(RecordingHead):
    """A recording whose rows are read when they are asked for.

    rows      how many
    dt        median period, s; NaN with fewer than two rows
    duration  s, from the first row to the last
    """

    rows: int
    dt: float
    duration: float
    _contents: Contents
    _origin: NDArray

    def __len__(self) -> int:
        return self.rows

    @property
    def date(self) -> str | None:
        """As ``Recording.date``."""
        return next(self.blocks()).date

    def blocks(self) -> Iterator[Recording]:
        """All rows in their order, one chunk at a time; ``t`` counts from the first row of the recording.

        A recording without rows gives one empty block.

        May be asked again. ``gaps`` of a block are not computed.
        """
        pose = self.base_from_tracker
        for columns in self._contents.pieces() if self.rows else [self._contents.nothing()]:
            t = time_of(self.layout, columns, self._origin)
            yield in_base_frame(rows_of(self, columns, t, gaps=[]), pose)

    def messages(self) -> Iterator[Message]:
        """All messages, a chunk at a time, those for viewers too; may be asked again."""
        form = self._contents.form
        assert form is not None
        viewers = {channel.id: channel.topic for channel in viewer_channels(form)}
        types = {TF_TOPIC: TF, DESCRIPTION_TOPIC: STRING}
        for part in mcap_walk.walk(self._contents.data):
            if isinstance(part, mcap_walk.Pictures):
                for one in messages_in(part.content):
                    topic_name = viewers[one.channel]
                    yield Message(topic_name, types[topic_name], one.wall_ns, one.data)
            if not isinstance(part, mcap_walk.Rows) or part.form.layout != self.layout:
                continue
            rows = part.rows
            data = rows.tobytes()
            for row, wall_ns in enumerate(rows["times1"][:, 0].tolist()):
                for topic in form.topics:
                    start = row * rows.itemsize + topic.start + RECORD_HEAD
                    yield Message(topic.name, topic.type, wall_ns, data[start : start + len(topic.message.template)])


def open_long(path: str | Path, *, damaged: bool = False) -> LongRecording:
    """Reads a recording once from beginning to end, and keeps everything but its rows.

    ``damaged`` and errors: as ``open_recording``.
    """
    path = Path(path)
    contents, times = read_contents(path, _Times)
    head = head_of(path, contents, damaged=damaged)
    return LongRecording(
        **{item.name: getattr(head, item.name) for item in fields(RecordingHead)},
        rows=times.rows,
        dt=times.period(),
        duration=times.duration(),
        _contents=contents,
        _origin=times.origin,
    )


class _Times:
    """What one pass over the rows gives: their number, the first and the last time, and the intervals between them."""

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self.rows = 0
        self.origin = np.empty(0)
        self._last = np.empty(0)
        self._steps: list[NDArray[np.float64]] = []
        self._kept = 0
        self._every = 1

    def append(self, columns: Columns) -> None:
        """The rows that follow."""
        if not len(self.origin):
            self.origin = origin_of(self._layout, columns)
        t = time_of(self._layout, columns, self.origin)
        first = -(self.rows - len(self._last)) % self._every
        steps = np.diff(np.concatenate([self._last, t]))[first :: self._every]
        self._steps.append(steps)
        self._kept += len(steps)
        self.rows += len(t)
        self._last = t[-1:].copy()
        while self._kept > MOST_STEPS:
            self._steps = [np.concatenate(self._steps)[::2]]
            self._kept, self._every = len(self._steps[0]), 2 * self._every

    def period(self) -> float:
        steps = np.concatenate([np.empty(0), *self._steps])
        return float(np.median(steps)) if len(steps) else float("nan")

    def duration(self) -> float:
        return float(self._last[0]) if len(self._last) else 0.0
