"""What is connected to the terminals of the simulated devices.

Times are ns of the host's monotonic clock, arrays int64, never later than now. Every method may be called from any
thread.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Times = NDArray[np.int64]


class TriggerLine:
    """The line that the tracker raises once a sample: low-to-high edges, in order, known up to now."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._edges = np.empty(0, np.int64)

    def add(self, edges: Times) -> None:
        """Edges at these times, all later than those before."""
        with self._lock:
            self._edges = np.concatenate([self._edges, edges])

    def between(self, after: int, until: int) -> Times:
        """Edges later than ``after`` and not later than ``until``."""
        with self._lock:
            first, last = np.searchsorted(self._edges, [after, until], side="right")
            return self._edges[first:last]


class Arm(Protocol):
    """The simulated arm, as its controller's terminal moves it: joints from 1, rad."""

    def position(self, at: int) -> NDArray[np.float64]:
        """(joints,) rad: joint angles as the controller knows them."""
        ...

    def move(self, target: NDArray[np.float64], fraction: float, at: int) -> None:
        """Starts a joint-interpolated move to ``target`` (joints,) rad at ``fraction`` of full speed."""
        ...

    def moving(self, at: int) -> bool: ...
    def halt(self, at: int) -> None: ...


@dataclass
class Wires:
    """The terminals of one device, numbered as in its Config.

    counts(channel, at)  (n,) int64: x4 counts of the encoder there, never wrapped
    volts(channel, at)   (n,) float64: V at an analogue input; for a digital transducer its own unit (A)
    points(at)           (n, 3) float64 m: the tracker's target in the tracker's frame
    trigger              the trigger line, shared by all devices of the rig
    line(name, high, at) an output of the device was switched
    arm                  the arm behind a controller's terminal
    """

    counts: Callable[[int, Times], NDArray[np.int64]]
    volts: Callable[[int, Times], NDArray[np.float64]]
    points: Callable[[Times], NDArray[np.float64]] = lambda at: np.zeros((len(at), 3))
    trigger: TriggerLine = field(default_factory=TriggerLine)
    line: Callable[[str, bool, int], None] = lambda name, high, at: None
    arm: Arm | None = None
