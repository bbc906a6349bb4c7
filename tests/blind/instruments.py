"""From what there is to be measured to what a rig records.

Sine encoders, counters, Hall transducers and the 12-bit converter.

The rig is that of config/puma560_sim.toml; encoders, comparators, quadrature, transducers and converter are those of
its simulated devices, calibration that of the sampler. Left out: the transducers' lag of 3 us and the rig's threads,
sockets and triggers.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from daq.acquisition.rows import Rows
from daq.rig.calibration import Calibration, calibration_of, counts_at, currents, positions
from daq.rig.channels import Columns
from daq.rig.rig_file import Rig, read_rig
from drivers.counting import extend
from drivers.protocols import CounterMode
from sim_backend.electronics import adc, hall_transducer, quadrature, sine_encoder
from sim_backend.electronics.adc import Converter
from sim_backend.electronics.electronics import Electronics, electronics_of
from sim_backend.electronics.noise import LARGEST
from sim_backend.rig.settings import Simulation
from tests.blind.hide import Signals

RIG = Path(__file__).resolve().parents[2] / "config" / "puma560_sim.toml"
BITS = 24
CONVERSIONS = 83.3e3
"""1/s: the converter goes through the inputs one after the other."""


@dataclass(frozen=True)
class Instruments:
    """The rig file, what stands between motors and cards, and how their values are read."""

    rig: Rig
    electronics: Electronics
    calibration: Calibration
    converter: Converter


@cache
def instruments() -> Instruments:
    """Of the simulated Puma rig."""
    rig = read_rig(RIG, drivers=False)
    lines = np.array([joint.encoder.lines for joint in rig.joint if joint.encoder], float)
    settings = Simulation.model_validate(rig.simulation)
    electronics = electronics_of(settings.encoder, settings.transducer, settings.seed, lines)
    counters = tuple((j.encoder.device, j.encoder.channel) for j in rig.joint if j.encoder)
    inputs = tuple((j.current.device, j.current.channel) for j in rig.joint if j.current)
    columns = Columns(counters, (BITS,) * len(counters), inputs, None)
    return Instruments(rig, electronics, calibration_of(rig, columns), Converter(12, -10.0, 10.0, 0.0, 0.001))


def rows_of(signals: Signals, current: CubicSpline, rng: np.random.Generator, demand: NDArray[np.float64]) -> Rows:
    """What the rig makes of signals (m rows).

    ``current`` gives the motor currents (m, n) A between the rows as well.
    """
    its = instruments()
    gear = np.array([joint.gear for joint in its.rig.joint])
    counts = _counts(its, signals.angle * gear, rng)
    preset = counts_at(its.calibration, signals.angle[0])
    raw = quadrature.wrap(counts - counts[0] + preset, BITS)
    counts = np.stack([extend(raw[:, j], BITS, int(preset[j])) for j in range(len(gear))], axis=1)
    skew = np.arange(len(gear)) / CONVERSIONS
    true = np.column_stack([current(signals.t + late)[:, j] for j, late in enumerate(skew)]) * np.sign(gear)
    hall = hall_transducer.volts(its.electronics.transducer, true, _normal(rng, true.shape))
    volts = adc.reported(its.converter, adc.codes(its.converter, hall, _normal(rng, true.shape)))
    m, n = signals.angle.shape
    ns = np.rint(signals.t * 1e9).astype(np.int64)
    quality = np.zeros((m, 2 * n), np.uint8)
    return Rows(
        number=np.arange(m),
        host_ns=ns,
        wall_ns=ns,
        tick=ns // 1000,
        counts=counts,
        volts=volts,
        quality=quality,
        q=positions(its.calibration, counts, quality),
        i=currents(its.calibration, volts),
        qref=demand,
    )


def _counts(its: Instruments, motor: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.int64]:
    """x4 counts (m, n) at motor angles (m, n) rad, through both lines' comparators."""
    encoder = its.electronics.encoder
    phase = sine_encoder.phase(encoder, motor)
    passed = []
    for line in sine_encoder.lines_of(encoder):
        rise, fall = sine_encoder.switching(line, _normal(rng, motor.shape))
        lowest, highest = sine_encoder.bounds(*sine_encoder.place(line, phase), rise, fall)
        passed.append(sine_encoder.follow(lowest, highest, lowest[0]))
    return quadrature.count(passed[0], passed[1], CounterMode.X4)


def _normal(rng: np.random.Generator, shape: tuple[int, ...]) -> NDArray[np.float64]:
    return np.clip(rng.standard_normal(shape), -LARGEST, LARGEST)
