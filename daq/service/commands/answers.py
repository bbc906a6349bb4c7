"""Answers to commands whose work is done on other threads."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

Outcome = Future[Any]


class PendingAnswers:
    """Outcomes that commands still wait for. All methods belong to the service's thread."""

    def __init__(self) -> None:
        self._working: list[tuple[Outcome, Callable[[Any], Any], Outcome]] = []
        self._until_idle: list[Outcome] = []

    def of(self, work: Outcome, then: Callable[[Any], Any] = lambda result: result) -> Outcome:
        """The answer ``then(result)`` to a command, once ``work`` on another thread is done; or its error."""
        answer: Outcome = Future()
        self._working.append((work, then, answer))
        return answer

    def at_idle(self) -> Outcome:
        """The answer to a command that waits for the state idle."""
        answer: Outcome = Future()
        self._until_idle.append(answer)
        return answer

    def settle(self) -> None:
        """Sends the answers whose work is done."""
        done = [entry for entry in self._working if entry[0].done()]
        self._working = [entry for entry in self._working if not entry[0].done()]
        for work, then, answer in done:
            try:
                answer.set_result(then(work.result()))
            except Exception as error:
                answer.set_exception(error)

    def settle_idle(self, result: dict[str, Any] | None) -> None:
        """Sends the answers that wait for the state idle; ``result``: of the run that has ended, if one has."""
        waiting, self._until_idle = self._until_idle, []
        for answer in waiting:
            answer.set_result({"state": "idle", "last": result})
