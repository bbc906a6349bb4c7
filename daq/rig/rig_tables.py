"""Tables of a rig file: trigger, devices, joints, tracker, limits, outputs, recording."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import ConfigDict, Field, field_validator, model_validator

from arm_io.table import Rate, Table
from drivers.protocols import CounterMode, EdgeSource

Positive = Annotated[float, Field(gt=0)]
Channel = Annotated[int, Field(ge=0)]
Sign = Literal[-1, 1]
COUNTS_PER_LINE = {CounterMode.X1: 1, CounterMode.X2: 2, CounterMode.X4: 4}
Vector = tuple[float, float, float]


class Trigger(Table):
    """Whose edges make the rows, which device sees them, and how many a second are expected."""

    source: EdgeSource
    device: str  # sees the edges (source poll: is asked)
    rate: Rate  # rows/s


class DeviceTable(Table):
    """One device: its name, its driver's import path, and all else for the driver's own Config."""

    model_config = ConfigDict(extra="allow")
    name: Annotated[str, Field(max_length=64, pattern=r"^[A-Za-z][A-Za-z0-9_-]*$")]
    driver: str

    @property
    def options(self) -> dict[str, Any]:
        """The driver's part of the table."""
        return dict(self.model_extra or {})


class Encoder(Table):
    """Where a joint's angle comes from: a counter channel.

    lines              lines per motor revolution; with ``mode`` and the joint's gear they give the scale
    counts_per_radian  or the scale itself: counts per radian (metre) of the JOINT, with its sign
    offset             rad (m): joint position at count 0
    preset             what the register is set to: a number, when the rig is opened; "start", before every run, so that
                       the joint reads the start pose of the experiment, where the arm then stands; left out: never
                       (absolute encoders)
    """

    device: str
    channel: Channel
    mode: CounterMode = CounterMode.X4
    lines: Annotated[int, Field(gt=0)] | None = None
    counts_per_radian: float | None = None
    sign: Sign = 1
    offset: float = 0.0
    preset: int | Literal["start"] | None = None

    @model_validator(mode="after")
    def _one_scale(self) -> Self:
        if (self.lines is None) == (self.counts_per_radian is None):
            raise ValueError("give either 'lines' (per motor revolution) or 'counts_per_radian' (of the joint)")
        if self.counts_per_radian == 0:
            raise ValueError("'counts_per_radian' must not be 0")
        return self


class CurrentSensor(Table):
    """Where a motor's current comes from: an analogue channel behind a Hall transducer, or a torque sensor's.

    Current = (V - offset) rated_current / rated_voltage / turns; the thesis's I = (20 V - C_off) / N for 200 A -> 10 V.
    unit  of the result: "N m" ("N" of a prismatic joint) where the drive or a sensor reports torques at the joint;
          rated_current is in it too
    """

    device: str
    channel: Channel
    rated_current: Positive  # A through the core
    rated_voltage: Positive  # V at the rated current
    turns: Annotated[int, Field(gt=0)] = 1
    sign: Sign = 1
    offset: float = 0.0  # V at no current
    unit: Literal["A", "N m", "N"] = "A"


class JointTable(Table):
    """One joint: name, transmission, and where its angle and current come from (neither, for imported data)."""

    name: str = ""
    type: Literal["revolute", "prismatic"] = "revolute"
    gear: float = 1.0  # motor angle over joint position, with its sign
    encoder: Encoder | None = None
    current: CurrentSensor | None = None

    @field_validator("gear")
    @classmethod
    def _gear(cls, gear: float) -> float:
        if gear == 0 or not np.isfinite(gear):
            raise ValueError("must be a number other than 0")
        return gear

    @property
    def unit(self) -> str:
        """Of its position."""
        return "rad" if self.type == "revolute" else "m"

    @property
    def current_unit(self) -> str:
        """Of its current; torques of a joint that slides are forces."""
        unit = "A" if self.current is None else self.current.unit
        return "N" if unit == "N m" and self.type == "prismatic" else unit

    @property
    def scale(self) -> float | None:
        """Counts per rad (m) of the joint, with its sign; None without an encoder."""
        encoder = self.encoder
        if encoder is None:
            return None
        if encoder.counts_per_radian is not None:
            return encoder.sign * encoder.counts_per_radian
        assert encoder.lines is not None  # Encoder has one of the two
        return encoder.sign * encoder.lines * COUNTS_PER_LINE[encoder.mode] * self.gear / (2 * np.pi)


class TrackerTable(Table):
    """The external tracker.

    target             m: the target in the frame of the last link
    base_from_tracker  4 x 4: p_base = base_from_tracker p_tracker; left out: unknown (``calibrate`` finds it)
    """

    device: str | None = None  # None: its points come in imported data
    frame: str = "tracker"
    target: Vector = (0.0, 0.0, 0.0)
    base_from_tracker: list[list[float]] | None = None

    @field_validator("base_from_tracker")
    @classmethod
    def _rigid(cls, value: list[list[float]] | None) -> list[list[float]] | None:
        if value is None:
            return value
        if [len(row) for row in value] != [4, 4, 4, 4]:
            raise ValueError("must be 4 rows of 4 numbers")
        matrix = np.array(value)
        turn = matrix[:3, :3]
        if not (np.allclose(turn @ turn.T, np.eye(3), atol=1e-6) and np.linalg.det(turn) > 0):
            raise ValueError("its upper left 3 x 3 block is not a rotation")
        if not np.array_equal(matrix[3], [0, 0, 0, 1]):
            raise ValueError("its last row must be 0, 0, 0, 1")
        return value


class Limits(Table):
    """Limits of commanded and measured motion; one entry per joint, each list may be omitted."""

    position: list[tuple[float, float]] | None = None  # rad (m)
    speed: list[Positive] | None = None  # rad/s
    acceleration: list[Positive] | None = None  # rad/s2, of what is asked for
    current: list[Positive] | None = None  # A, either direction

    @field_validator("position")
    @classmethod
    def _ordered(cls, value: list[tuple[float, float]] | None) -> list[tuple[float, float]] | None:
        for number, (low, high) in enumerate(value or [], 1):
            if not low < high:
                raise ValueError(f"entry {number}: must be [lowest, highest], is [{low:g}, {high:g}]")
        return value


START = "start"
"""The output that begins a run."""


class Output(Table):
    """A line or an analogue output that the guard may drive.

    line     name of a digital line, or
    channel  number of an analogue output, with ``limits`` V narrower than or equal to the device's own range; as the
             start signal it goes to the upper one
    """

    device: str
    line: str | None = None
    channel: Channel | None = None
    limits: tuple[float, float] | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        if (self.line is None) == (self.channel is None):
            raise ValueError("give either 'line' (digital) or 'channel' (analogue)")
        if self.limits is not None and (self.channel is None or not self.limits[0] <= 0 <= self.limits[1]):
            raise ValueError(
                "'limits' are for an analogue output, [lowest, highest] V with 0 V, the safe state, between them"
            )
        return self


class RecordingTable(Table):
    """How recordings are written."""

    chunk_seconds: Annotated[float, Field(gt=0, le=10)] = 0.2  # s: longest loss in a power cut
