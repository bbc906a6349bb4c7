"""Encoders and current transducers of an arm.

They are configured by ``[simulation.encoder]`` and ``[simulation.transducer]`` of the rig file.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import BaseModel, Field

from arm_io import counted
from arm_io.table import Table
from arm_io.types import Array
from sim_backend.electronics.hall_transducer import HallTransducer
from sim_backend.electronics.sine_encoder import SineEncoder

Positive = Annotated[float, Field(gt=0)]
PerJoint = float | list[float]


class EncoderTable(Table):
    """Sine encoders on the motor shafts; each entry one number, or a list with one per joint. V but for the phase."""

    sine_gain: PerJoint = 1.0
    cosine_gain: PerJoint = 1.0
    sine_offset: PerJoint = 0.0
    cosine_offset: PerJoint = 0.0
    phase_error: PerJoint = 0.0  # rad
    noise: PerJoint = 0.005  # standard deviation
    hysteresis: PerJoint = 0.05  # half the width of the comparator
    noise_period: Annotated[float, Field(ge=1e-5, le=1e-3)] = 1e-4  # s, duration of one noise value


class TransducerTable(Table):
    """Hall transducers round the motor leads; each entry but the ratings one number, or one per joint."""

    turns: PerJoint = 10.0
    offset: PerJoint = 0.0  # V
    gain_error: PerJoint = 0.0  # relative
    noise: PerJoint = 0.003  # V, standard deviation
    bandwidth: Positive = 50e3  # Hz
    rated_current: Positive = 200.0  # A
    rated_voltage: Positive = 10.0  # V


@dataclass(frozen=True)
class Electronics:
    """Encoders and current transducers of n joints; ``seed``: of their noise."""

    encoder: SineEncoder
    noise_period_ns: int
    transducer: HallTransducer
    seed: int


def electronics_of(encoder: EncoderTable, transducer: TransducerTable, seed: int, encoder_lines: Array) -> Electronics:
    """The electronics of n joints. encoder_lines: (n,) per motor revolution.

    ValueError: a list with another number of entries than n.
    """

    def joints(entry: PerJoint, name: str) -> Array:
        values = np.asarray(entry, float)
        if values.ndim and len(values) != len(encoder_lines):
            raise ValueError(f"{name}: has {len(values)} entries for {counted(len(encoder_lines), 'joint')}")
        return np.broadcast_to(values, encoder_lines.shape)

    def fields(table: BaseModel, place: str, names: tuple[str, ...]) -> dict[str, Array]:
        return {name: joints(getattr(table, name), f"{place}.{name}") for name in names}

    sines = ("sine_gain", "cosine_gain", "sine_offset", "cosine_offset", "phase_error", "noise", "hysteresis")
    return Electronics(
        encoder=SineEncoder(lines=encoder_lines, **fields(encoder, "encoder", sines)),
        noise_period_ns=round(encoder.noise_period * 1e9),
        transducer=HallTransducer(
            **fields(transducer, "transducer", ("turns", "offset", "gain_error", "noise")),
            bandwidth=transducer.bandwidth,
            rated_current=transducer.rated_current,
            rated_voltage=transducer.rated_voltage,
        ),
        seed=seed,
    )
