"""Faults on demand: ``[[simulation.fault]]`` in the rig file, or ``World.inject`` at run time.

Times are s since the start line rose (before it has, since the device was armed). Edges and rows are counted from 0.
Channels from 0.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from arm_io.table import Table

Count = Annotated[int, Field(ge=1)]
Number = Annotated[int, Field(ge=0)]


class _Fault(Table):
    device: str


class LostEdge(_Fault):
    """The device does not see these edges of the trigger line: later rows are numbered as if they had not been."""

    kind: Literal["lost_edge"] = "lost_edge"
    number: Number
    count: Count = 1


class ExtraEdge(_Fault):
    """A glitch of the device's trigger input, ``after`` periods behind edge ``number``: one row too many."""

    kind: Literal["extra_edge"] = "extra_edge"
    number: Number
    after: Annotated[float, Field(gt=0, lt=1)] = 0.4


class LostRow(_Fault):
    """The device saw the edges and numbered them, but its buffer had no room for the rows: a gap in the numbers."""

    kind: Literal["lost_row"] = "lost_row"
    number: Number
    count: Count = 1


class Unplugged(_Fault):
    """The device is disconnected from ``at`` until ``back`` (left out: for good), and misses what happens meanwhile."""

    kind: Literal["unplugged"] = "unplugged"
    at: float
    back: float | None = None


class DeviceReset(_Fault):
    """The device restarts at ``at``: its registers begin again at 0, and its first row says so."""

    kind: Literal["device_reset"] = "device_reset"
    at: float


class StuckChannel(_Fault):
    """A channel shows what it showed at ``at``, until ``back``."""

    kind: Literal["stuck_channel"] = "stuck_channel"
    channel: Number
    at: float
    back: float | None = None


class EmiCounts(_Fault):
    """Interference on the lines of a counter channel: ``counts`` counts that no motor made, at ``at``.

    noticed  True: both lines changed at once, and the card says so
    """

    kind: Literal["emi_counts"] = "emi_counts"
    channel: Number
    at: float
    counts: int
    noticed: bool = False


class ClockDrift(_Fault):
    """The device's clock is fast by ``ppm``: its ticks, and the edges that it makes, come too often."""

    kind: Literal["clock_drift"] = "clock_drift"
    ppm: float


class TrackerStops(_Fault):
    """The tracker makes this many samples, and no more."""

    kind: Literal["tracker_stops"] = "tracker_stops"
    samples: Number


class BeamBreak(_Fault):
    """Something stands between tracker and target from ``at`` to ``back``."""

    kind: Literal["beam_break"] = "beam_break"
    at: float
    back: float


Fault = Annotated[
    LostEdge
    | ExtraEdge
    | LostRow
    | Unplugged
    | DeviceReset
    | StuckChannel
    | EmiCounts
    | ClockDrift
    | TrackerStops
    | BeamBreak,
    Field(discriminator="kind"),
]
