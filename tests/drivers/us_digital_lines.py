"""US Digital counters beside their simulators on ptys, and what their rows have to be worth on a busy machine."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from drivers import RigContext
from drivers.blocks import join
from drivers.counting import extend
from drivers.protocols import Block, EdgeSource, Plan, Quality
from tests.drivers.swing import AMPLITUDE, counts, swing_wires

POLL = Plan(EdgeSource.POLL, 100.0, None)
FASTEST = 2 * np.pi / 4 * AMPLITUDE  # counts/s
PROMPT = 0.012  # s: a question and its answer, where the row is not marked LATE
ASKED = 2 * PROMPT * FASTEST  # counts: one question at the preset, one at the row
STREAMED = 0.008 * FASTEST + ASKED / 2  # held up by 2 ms, counted from the quickest byte; one question at the preset
NOT_NOW = Quality.MISSING | Quality.STALE | Quality.LATE  # a row so marked does not show the count at its time


def pair(driver: Any, simulator: Any, where: Any) -> Iterator[tuple[Any, Any]]:
    box = simulator.make("counter", where, swing_wires())
    box.open()
    device = driver.make("counter", where, RigContext())
    yield device, box
    device.close()
    box.close()


def poll_until(device: Any, done: Callable[[Block], object], every: float = 0.005, rows: int = 5000) -> Block:
    """Rows until one is as is awaited."""
    blocks = []
    while not blocks or not done(blocks[-1]):
        assert len(blocks) < rows, "what is awaited does not come"
        blocks.append(device.poll())
        time.sleep(every)
    return join(blocks, 1)


def missing(row: Block) -> bool:
    return bool(row.quality[0, 0] & Quality.MISSING)


def preset(device: Any, count: int) -> int:
    """Sets the register; the ns at which it was done, on a busy machine by a try that was not held up."""
    while True:
        begun = time.monotonic_ns()
        device.preset(0, count)
        done = time.monotonic_ns()
        if done - begun < PROMPT * 1e9:
            return (begun + done) // 2


def poll_for(device: Any, seconds: float, every: float = 0.005) -> Block:
    blocks, end = [], time.monotonic() + seconds
    while time.monotonic() < end:
        blocks.append(device.poll())
        time.sleep(every)
    return join(blocks, 1)


def error_of(block: Block, width: int, start: int, count: int) -> np.ndarray:
    """Measured minus true counts of rows that should show their time's, from ``count`` at ns ``start``."""
    shown = (block.quality[:, 0] & NOT_NOW) == 0
    assert shown.any()
    measured = extend(block.counts[shown, 0], width, count)
    return measured - count - (counts(0, block.host[shown]) - counts(0, np.array([start]))[0])
