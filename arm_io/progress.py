"""How far a computation is: sentences, some with a count, for whoever follows it.

A computation takes a function ``progress`` and calls it with a sentence at each of its stages. Where it knows more, the
sentence is a ``Step``, which carries the count; whoever only prints the sentences need not know. What happens deep
below, such as the reading of a file, is reported by ``report`` to whoever is ``following``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

Progress = Callable[[str], None]
"""Called with a few words on what is being done."""


class _Silent:
    """Takes any progress and says nothing."""

    def __call__(self, *told: object) -> None:
        pass

    def __repr__(self) -> str:
        return "silent"


silent = _Silent()
"""The progress of whoever does not follow; ``help`` shows it by its name."""

_follower: ContextVar[Progress | None] = ContextVar("follower", default=None)


class Step(str):
    """One of several equal steps of a stage: "smoothing", 3 of 8 done. As a text, the stage and its detail.

    stage  what stays the same from step to step
    done   steps that are done
    of     how many there are; None: unknown, such as in a search that ends where nothing more is found
    """

    stage: str
    done: float
    of: float | None

    def __new__(cls, stage: str, done: float, of: float | None = None, *, detail: str = "") -> Step:
        step = super().__new__(cls, f"{stage}: {detail}" if detail else stage)
        step.stage, step.done, step.of = stage, done, of
        return step


@contextmanager
def following(progress: Progress) -> Iterator[None]:
    """While the block runs, ``progress`` is called with every ``report`` of this thread."""
    before = _follower.set(progress)
    try:
        yield
    finally:
        _follower.reset(before)


def report(stage: str, done: float, of: float | None = None) -> None:
    """Reports the progress of a stage to the innermost ``following`` block."""
    progress = _follower.get()
    if progress is not None:
        progress(Step(stage, done, of))
