"""Frames whose number cannot be right: a wrong digit would make every later point look overtaken."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drivers.tracker_stream.protocol import Frames

SLACK = 0.2  # s of frames that may come more than the host's clock says: what was held up on the way
FASTER = 1.1  # times the set rate
OFF = 0.5  # frames that a number may be off its seconds
OFF_RATE = 0.05  # more, per frame since the last: seconds and frames of a tracker hardly drift apart


class Numbering:
    """The frames of one run, in order.

    refused  frames whose number was too far ahead of the host's clock, or did not fit their own seconds
    """

    def __init__(self, rate: float, now: int) -> None:
        self.refused = 0
        self._rate, self._now = rate, now
        self._first: tuple[int, float] | None = None  # (number, seconds) from which the pace is known
        self._last: tuple[int, float] = (0, 0.0)
        self._doubted: tuple[int, float] | None = None  # the frame just refused for its seconds

    def sift(self, frames: Frames, now: int) -> NDArray[np.bool_]:
        """(n,) True for frames that are new and plausible, as read at host ns ``now``.

        A frame with an older number was overtaken or came twice: it is dropped, but not counted as implausible.
        """
        kept = np.zeros(len(frames), bool)
        ahead = self._rate * FASTER * ((now - self._now) * 1e-9 + SLACK)
        for k, frame in enumerate(zip(frames.number.tolist(), frames.seconds.tolist())):
            if frame[0] <= self._last[0]:
                continue
            if frame[0] - self._last[0] > ahead:
                self.refused += 1
            elif self._fits(frame):
                self._first, self._last, self._doubted = self._first or frame, frame, None
                kept[k] = True
            elif self._doubted is not None and frame[0] > self._doubted[0] and frame[1] > self._doubted[1]:
                # Two that go on from each other: what was wrong is the pace, or the tracker's seconds are set anew.
                self._first, self._last, self._doubted = self._doubted, frame, None
                kept[k] = True
            else:
                self.refused, self._doubted = self.refused + 1, frame
        if kept.any():
            self._now = now
        return kept

    def _fits(self, frame: tuple[int, float]) -> bool:
        """Whether number and seconds have advanced alike since the last frame, by the pace of the run so far."""
        if self._first is None or self._last[0] == self._first[0]:
            return True
        pace = (self._last[1] - self._first[1]) / (self._last[0] - self._first[0])
        frames = frame[0] - self._last[0]
        return abs(frame[1] - self._last[1] - pace * frames) <= pace * (OFF + OFF_RATE * frames)
