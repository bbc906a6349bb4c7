"""The external tracker of the thesis, Optotrak: positions of one reflector on the last link, in its own frame.

It cannot be triggered: from the rise of the start line on it samples at its own rate, raises the trigger line once a
sample, and keeps the first ``memory`` points, which are recalled after the run. With a ``stream`` it also sends points
as it goes, as many as its link carries: at 1000 samples/s and 350 points/s, every third; a row without a point is
marked missing.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field, field_validator

from arm_io import DeviceFault, InputError
from arm_io.table import Rate, Table
from arm_io.types import Array
from drivers import RigContext
from drivers.protocols import Block, EdgeSource, Identity, Plan, Quality
from sim_backend.electronics import noise
from sim_backend.rig.faults import BeamBreak, TrackerStops
from sim_backend.rig.latch import TICK_RATE, Latch, joined, rows_of
from sim_backend.rig.trigger_line import Seen, TriggerLine
from sim_backend.rig.world import World, world_of

IDENTITY = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
NotNegative = Annotated[float, Field(ge=0)]


class Config(Table):
    """One tracker.

    rate               samples/s where it does not make the rig's trigger (else the rig's rate is set)
    stream             points/s that it can send during the run; 0: none, they stay in its memory
    repeatability      m, root mean square of the distance between a point and the truth
    resolution         m, of the numbers it gives
    latency            s by which points are older than their edges
    target             m, in the frame of the last link
    base_from_tracker  where it really stands: p_base = base_from_tracker p_tracker
    outliers           share of the points that are wrong, by up to ``outlier`` m in each direction
    """

    rate: Rate = 1000.0
    max_rate: Rate = 1000.0
    memory: Annotated[int, Field(ge=0)] = 1000
    stream: NotNegative = 0.0
    repeatability: NotNegative = 1e-4
    resolution: NotNegative = 1e-5
    latency: NotNegative = 0.0
    target: tuple[float, float, float] = (0.05, 0.0, 0.10)
    base_from_tracker: list[list[float]] = IDENTITY
    outliers: Annotated[float, Field(ge=0, le=1)] = 0.0
    outlier: NotNegative = 0.05

    @field_validator("base_from_tracker")
    @classmethod
    def _pose(cls, pose: list[list[float]]) -> list[list[float]]:
        matrix = np.array(pose) if [len(row) for row in pose] == [4] * 4 else np.zeros((4, 4))
        if not np.allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=1e-6):
            raise ValueError("needs four rows of four numbers: a rotation and a translation, then 0, 0, 0, 1")
        return pose


class Tracker:
    """drivers.protocols: Device, PositionTracker. ``StreamingTracker`` is also Latched."""

    def __init__(self, name: str, config: Config, world: World) -> None:
        self.name, self.config, self._world = name, config, world
        if world.plant.thrusters is not None:
            raise InputError(
                name,
                "stands on the ground, and the rig's arm floats; sim_backend.navigation gives the pose of its base",
            )
        self.rate, self.memory = config.rate, config.memory
        self._noise = noise.keys(world.settings.seed, f"points of {name}", 3)
        self._outlier_noise = noise.keys(world.settings.seed, f"outliers of {name}", 4)
        self._tracker_from_base = np.linalg.inv(np.array(config.base_from_tracker))
        self._latch = Latch(world, name, self._sent, self._line)
        self._keeper = Latch(world, name, self._acquire, self._line)  # takes samples into memory
        self._remembered: list[Block] = []
        self._makes_edges = self._armed = False
        self._own_line: TriggerLine | None = None
        world.watch(self._remember)

    def open(self) -> Identity:
        self._latch.open()
        self._keeper.open()
        stream = {"stream": f"{self.config.stream:g} points/s"} if self.config.stream else {}
        return Identity(
            maker="armscope",
            model="simulated Optotrak",
            serial=self.name,
            max_rate=self.config.max_rate,
            memory=self.memory,
            details={"tick_rate": f"{TICK_RATE:.0f}", **stream},
        )

    def check(self) -> list[str]:
        return []

    def arm(self, plan: Plan) -> None:
        rate = plan.rate if plan.source is EdgeSource.TRACKER else self.config.rate
        if rate > self.config.max_rate:
            raise DeviceFault(
                self.name, f"samples at most {self.config.max_rate:g} times per second, not {rate:g}; lower the rate"
            )
        self.rate = rate
        self._latch.arm(plan)
        self._keeper.arm(plan)
        self._remembered, self._own_line, self._armed = [], None, True
        self._makes_edges = plan.source is EdgeSource.TRACKER
        if self._makes_edges:
            self._world.pulse_by(self._pulses)

    def disarm(self) -> None:
        """Sampling ends; what is in memory stays there until the next ``arm``."""
        self._remember()
        self._armed = False
        self._latch.disarm()
        self._keeper.disarm()

    def close(self) -> None:
        self._armed = False
        self._latch.close()
        self._keeper.close()

    def recall(self) -> Block:
        """The first ``memory`` samples since the start line rose, all rows full, but for broken beams."""
        self._latch.check_open()
        self._remember()
        return joined([_block(np.empty((0, 3))), *self._remembered])

    def _remember(self) -> None:
        """Takes into memory what has been sampled since the last time, as far as there is room."""
        room = self.memory - sum(map(len, self._remembered))
        if self._armed and room > 0:
            self._remembered.append(rows_of(self._keeper.read(), slice(room)))

    def _line(self) -> TriggerLine | None:
        """Its own samples: the edges of the trigger line, if it makes those."""
        if self._makes_edges:
            return self._world.line
        if self._world.start_ns is not None:
            self._own_line = self._pulses(self._world.start_ns)
        return self._own_line

    def _pulses(self, start_ns: int) -> TriggerLine:
        period = 1e9 / (self.rate * self._world.drift(self.name))
        stops = [fault.samples for fault in self._world.faults_of(self.name) if isinstance(fault, TrackerStops)]
        return TriggerLine(start_ns + round(period), period, min(stops, default=None))

    def _sent(self, seen: Seen) -> Block:
        """What goes over the link during the run: nothing."""
        return _block(np.full((len(seen.edge), 3), np.nan))

    def _acquire(self, seen: Seen) -> Block:
        since = self._latch.since_ns()
        at = seen.time - round(self.config.latency * 1e9)
        homogeneous = np.column_stack([self._world.target(at, self.config.target), np.ones(len(at))])
        points = (homogeneous @ self._tracker_from_base.T)[:, :3]
        index = (seen.time - since)[:, None]
        points += self.config.repeatability / np.sqrt(3.0) * noise.normals(self._noise, index, 1)[0]
        if self.config.outliers:
            drawn = noise.uniforms(self._outlier_noise, index)
            points += np.where(drawn[:, :1] < self.config.outliers, self.config.outlier * (2 * drawn[:, 1:] - 1), 0.0)
        if self.config.resolution:
            points = np.rint(points / self.config.resolution) * self.config.resolution
        time = (seen.time - since) * 1e-9
        for fault in self._world.faults_of(self.name):
            if isinstance(fault, BeamBreak):
                points[(time >= fault.at) & (time < fault.back)] = np.nan
        return _block(points)


class StreamingTracker(Tracker):
    """A tracker that also sends points during the run."""

    def read(self) -> Block:
        """One row a sample; every n-th has a point, so that no more than ``stream`` a second are sent."""
        return self._latch.read()

    def _sent(self, seen: Seen) -> Block:
        points = self._acquire(seen).points
        assert points is not None
        points[seen.number % int(np.ceil(self.rate / self.config.stream)) != 0] = np.nan
        return _block(points)


def _block(points: Array) -> Block:
    none = np.empty(0, np.int64)
    quality = np.where(np.isnan(points).any(axis=1), np.uint8(Quality.MISSING), np.uint8(0))[:, None]
    return Block(none, none, none, quality, points=points)


def make(name: str, config: Config, context: RigContext) -> Tracker:
    """A closed tracker: one that streams, or one that keeps its points until it is asked."""
    return (StreamingTracker if config.stream else Tracker)(name, config, world_of(context))
