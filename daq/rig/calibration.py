"""Counts to joint positions, volts to motor currents.

    q = offset + counts / scale             scale = sign x lines x (1, 2 or 4) x gear / 2 pi    counts per rad (m) of
                                            the joint
    i = (V - offset) x amperes_per_volt     amperes_per_volt = sign x sgn(gear) x rated current / rated voltage / turns

The gear's sign makes both joint-positive (``daq.rig.rig_file``). A recording keeps the calibration with the raw values,
with the hash of its content: positions and currents can be computed again, and recordings of different calibration are
distinguished.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.rig.channels import Columns
from daq.rig.rig_file import Rig
from daq.rig.rig_tables import CurrentSensor, JointTable
from drivers.protocols import Quality

NONE = -1
"""Column of a joint that has no such sensor."""


@dataclass(frozen=True)
class Calibration:
    """One entry a joint.

    count_column     column of ``Rows.counts``, -1 for none
    scale            counts per rad (m) of the joint, signed
    offset           rad (m) at count 0
    volt_column      column of ``Rows.volts``, -1 for none
    amperes_per_volt A/V, signed
    volt_offset      V at no current
    """

    count_column: tuple[int, ...]
    scale: tuple[float, ...]
    offset: tuple[float, ...]
    volt_column: tuple[int, ...]
    amperes_per_volt: tuple[float, ...]
    volt_offset: tuple[float, ...]

    @property
    def hash(self) -> str:
        """SHA-256 of the content, hexadecimal."""
        return hashlib.sha256(json.dumps(asdict(self), sort_keys=True).encode()).hexdigest()

    def as_table(self) -> dict[str, Any]:
        """Plain data with its hash, as recordings keep it."""
        return {**{name: list(values) for name, values in asdict(self).items()}, "hash": self.hash}


def calibration_of(rig: Rig, columns: Columns) -> Calibration:
    """The calibration that a rig file describes."""
    encoders = [joint.encoder for joint in rig.joint]
    sensors = [joint.current for joint in rig.joint]
    return Calibration(
        count_column=tuple(columns.counters.index((e.device, e.channel)) if e else NONE for e in encoders),
        scale=tuple(1.0 if joint.scale is None else joint.scale for joint in rig.joint),
        offset=tuple(e.offset if e else 0.0 for e in encoders),
        volt_column=tuple(columns.inputs.index((s.device, s.channel)) if s else NONE for s in sensors),
        amperes_per_volt=tuple(_amperes_per_volt(joint, s) if s else 1.0 for joint, s in zip(rig.joint, sensors)),
        volt_offset=tuple(s.offset if s else 0.0 for s in sensors),
    )


def _amperes_per_volt(joint: JointTable, sensor: CurrentSensor) -> float:
    wiring = sensor.sign * np.sign(joint.gear)
    return float(wiring * sensor.rated_current / sensor.rated_voltage / sensor.turns)


def positions(calibration: Calibration, counts: NDArray[np.int64], quality: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Joint positions (n, J) rad (m) of extended counts (n, C).

    NaN where there is no encoder or the value is MISSING.
    """
    q = np.full((len(counts), len(calibration.scale)), np.nan)
    which = np.array(calibration.count_column, int)
    have = which != NONE
    used = which[have]
    q[:, have] = np.array(calibration.offset)[have] + counts[:, used] / np.array(calibration.scale)[have]
    q[without_position(calibration, quality)] = np.nan
    return q


def without_position(calibration: Calibration, quality: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """(n, J) where a joint has no encoder, or its value is MISSING in rows of ``quality`` (n, C + A + tracker)."""
    return _marked(calibration, quality, Quality.MISSING)


def of_another_time(calibration: Calibration, quality: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """(n, J) mask of values that were not taken at the time of their row: repeated, late or missing."""
    return _marked(calibration, quality, Quality.STALE | Quality.LATE | Quality.MISSING)


def _marked(calibration: Calibration, quality: NDArray[np.uint8], marks: Quality) -> NDArray[np.bool_]:
    which = np.array(calibration.count_column, int)
    marked = np.ones((len(quality), len(which)), bool)
    have = which != NONE
    marked[:, have] = (quality[:, which[have]] & int(marks)) != 0
    return marked


def currents(calibration: Calibration, volts: NDArray[np.float64]) -> NDArray[np.float64]:
    """Motor currents (n, J) A of volts (n, A); NaN where there is no transducer or no value (volts are NaN there)."""
    i = np.full((len(volts), len(calibration.scale)), np.nan)
    which = np.array(calibration.volt_column, int)
    have = which != NONE
    offset = np.array(calibration.volt_offset)[have]
    i[:, have] = (volts[:, which[have]] - offset) * np.array(calibration.amperes_per_volt)[have]
    return i


def counts_at(calibration: Calibration, position: NDArray[np.float64]) -> NDArray[np.int64]:
    """Counts (J,) that the encoders show at joint positions (J,), to the nearest count: what a counter is preset to."""
    return np.round((position - np.array(calibration.offset)) * np.array(calibration.scale)).astype(np.int64)
