"""Rows: what one trigger made of all devices, block by block, between sampler, recorder and publisher."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from daq.rig.channels import Columns
from drivers.protocols import Quality


@dataclass(frozen=True, slots=True)
class Rows:
    """n consecutive rows. Raw and calibrated values; C counters, A analogue inputs, J joints.

    number    (n,) int64: trigger number since arming; a gap is a loss, and stands in the ledger
    host_ns   (n,) int64: host's monotonic clock at the trigger
    wall_ns   (n,) int64: wall time at the trigger, the stamp of the row everywhere
    tick      (n,) int64: tick of the clock device, 0 where there is none
    counts    (n, C) int64: extended to 64 bit
    volts     (n, A) float64 V
    points    (n, 3) float64 m in the tracker's frame, NaN where there is none; None for a rig without a tracker
    quality   (n, C + A (+ 1 with points)) uint8: drivers.protocols.Quality, columns in that order
    q         (n, J) float64 rad (m): joint angles, motor encoder over gear ratio; NaN where missing
    i         (n, J) float64 A: motor currents, positive drives the joint positive; NaN where missing
    qref      (n, J) float64 rad (m), or None where the controller does not report it
    extra     further columns by name, (n,) float64 (``drivers.protocols.Readings``); NaN in rows without a reading
    """

    number: NDArray[np.int64]
    host_ns: NDArray[np.int64]
    wall_ns: NDArray[np.int64]
    tick: NDArray[np.int64]
    counts: NDArray[np.int64]
    volts: NDArray[np.float64]
    quality: NDArray[np.uint8]
    q: NDArray[np.float64]
    i: NDArray[np.float64]
    points: NDArray[np.float64] | None = None
    qref: NDArray[np.float64] | None = None
    extra: dict[str, NDArray[np.float64]] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.number)


def without_value(columns: Columns, rows: Rows) -> dict[str, int]:
    """Device -> rows in which one of its counters or inputs has no value."""
    found: dict[str, int] = {}
    missing = (rows.quality & Quality.MISSING) != 0
    for name in {device for device, _ in columns.counters + columns.inputs}:
        own = [k for k, (device, _) in enumerate(columns.counters + columns.inputs) if device == name]
        if count := int(missing[:, own].any(axis=1).sum()):
            found[name] = count
    return found
