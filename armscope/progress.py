"""Progress on a terminal: what is being done, how much of it is done, and how long this step will still take.

The time left is that of the step at hand, from the steps that are done: what comes after it is not predicted. A stage
whose end is unknown says so.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from arm_io.progress import Step, following

if TYPE_CHECKING:
    from rich.live import Live
    from rich.table import Table

BAR = 20
"""Columns of the bar."""
SOON = 1.0
"""s of a stage before which no time left is given: it would jump."""


class Display:
    """What is being done, as ``Progress`` of a computation; draws nothing without a screen."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._sentence = ""
        self._stage = ""
        self._began = clock()
        self._first = 0.0
        self.live: Live | None = None

    def __call__(self, sentence: str) -> None:
        """A stage, or a step of one, begins."""
        step = sentence if isinstance(sentence, Step) else None
        stage = sentence if step is None else step.stage
        before = self._sentence
        again = step is not None and isinstance(before, Step) and step.done < before.done
        if stage != self._stage or again:
            self._stage, self._began = stage, self._clock()
            self._first = 0.0 if step is None else step.done
        self._sentence = sentence

    @property
    def share(self) -> float | None:
        """0 to 1 of the stage; None where unknown."""
        step = self._sentence
        return min(1.0, step.done / step.of) if isinstance(step, Step) and step.of else None

    def sentence(self) -> str:
        """What is being done, without the file names' length breaking the line."""
        return str(self._sentence)

    def time(self) -> str:
        """How long the stage takes, and how long it will still take, as far as that is known."""
        passed = self._clock() - self._began
        step = self._sentence
        if not isinstance(step, Step):
            return f"{_duration(passed)}, time left not known"
        steps = step.done - self._first
        if step.of is None:
            each = f", {_duration(passed / steps)} each" if steps > 0 else ""
            return f"{step.done:g} done{each}, how many will follow is not known"
        if passed < SOON or steps <= 0:
            return _duration(passed)
        return f"{_duration(passed)}, about {_duration(passed / steps * (step.of - step.done))} left of this step"

    def hide(self) -> None:
        """Takes the line away, for other output."""
        if self.live is not None:
            self.live.stop()

    def show(self) -> None:
        """Shows it again."""
        if self.live is not None:
            self.live.start()

    def __rich__(self) -> Table:
        """One line: spinner, sentence, bar, time."""
        from rich.progress_bar import ProgressBar
        from rich.table import Table
        from rich.text import Text

        line = Table.grid(padding=(0, 1))
        line.add_column(no_wrap=True, overflow="ellipsis", ratio=1)
        cells: list[Text | ProgressBar] = [Text(self.sentence(), "bold")]
        if self.share is not None:
            line.add_column(no_wrap=True)
            cells.append(ProgressBar(total=1.0, completed=self.share, width=BAR))
        line.add_column(no_wrap=True)
        line.add_row(*cells, Text(self.time(), "cyan"))
        return line


@contextmanager
def shown(as_json: bool = False) -> Iterator[Display]:
    """A display on standard error where that is a terminal that can be drawn on, and no JSON is asked for."""
    display = Display()
    if as_json or not sys.stderr.isatty():
        yield display
        return
    from rich.console import Console
    from rich.live import Live

    console = Console(stderr=True)
    if not console.is_interactive:
        yield display
        return
    display("reading")
    live = Live(display, console=console, transient=True, refresh_per_second=8)
    display.live = live
    with live, following(display):
        yield display


def _duration(seconds: float) -> str:
    """'0.4 s', '12 s', '3:05', '1:02:03'."""
    if seconds < 9.95:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    minutes, rest = divmod(whole, 60)
    return f"{minutes}:{rest:02d}" if minutes < 60 else f"{minutes // 60}:{minutes % 60:02d}:{rest:02d}"
