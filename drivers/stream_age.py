"""How old the newest byte of a stream is that a device sends at an even pace without stamping it.

What was sent at an even pace and has not come in by its time is still under way: in an adapter, in the kernel, on a
wire. The delay of the newest byte follows Lindley's recursion for a queue: it grows with the time that passes, shrinks
by what the bytes that came took to send, and is never below 0. It is known against the quickest byte so far, whose own
delay is unknown.
"""

from __future__ import annotations

FORGETTING = 0.002  # of the pace: more than crystals differ, little compared with the delays that matter
LEARNING = 200_000_000  # ns in which the pace is learnt and everything taken for fresh
FRESH = 2_000_000  # ns: readings with less delay improve the pace


class StreamAge:
    """``fastest`` bytes/s that the line carries; the device may be slower, but not uneven."""

    def __init__(self, fastest: float) -> None:
        self._shortest = 1e9 / fastest  # ns a byte
        self.restart()

    def restart(self) -> None:
        """The stream begins: its pace is learnt."""
        self._begun: int | None = None
        self._came, self._pace, self._delay = 0, self._shortest, 0.0

    def read(self, now: int, count: int) -> float:
        """ns for which the newest byte was held up, where ``count`` bytes were read at ns ``now``."""
        if self._begun is None:
            self._begun = self._last = now
            return 0.0
        self._came += count
        if now - self._begun > LEARNING:
            spent = count * self._pace * (1 + FORGETTING)
            self._delay = max(0.0, self._delay + now - self._last - spent)
        self._last = now
        if self._delay <= FRESH:
            self._pace = max(self._shortest, (now - self._begun) / max(1, self._came))
        return self._delay
