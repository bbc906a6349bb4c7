"""The rig file's ``[simulation]`` table: which arm is moved, how fast time goes, and what its instruments get wrong."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from sim_backend.electronics.hall_transducer import HallTransducer
from sim_backend.electronics.sine_encoder import SineEncoder
from sim_backend.rig.faults import Fault

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
PerJoint = float | list[float]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class EncoderTable(_Table):
    """Sine encoders on the motor shafts; each entry one number, or one a joint. V but for the phase."""

    sine_gain: PerJoint = 1.0
    cosine_gain: PerJoint = 1.0
    sine_offset: PerJoint = 0.0
    cosine_offset: PerJoint = 0.0
    phase_error: PerJoint = 0.0  # rad
    noise: PerJoint = 0.005  # standard deviation
    hysteresis: PerJoint = 0.05  # half the comparator's width
    noise_period: Annotated[float, Field(ge=1e-5, le=1e-3)] = 1e-4  # s for which one value of the noise lasts


class TransducerTable(_Table):
    """Hall transducers round the motor leads; each entry but the ratings one number, or one a joint."""

    turns: PerJoint = 10.0
    offset: PerJoint = 0.0  # V
    gain_error: PerJoint = 0.0  # relative
    noise: PerJoint = 0.003  # V, standard deviation
    bandwidth: Positive = 50e3  # Hz
    rated_current: Positive = 200.0  # A
    rated_voltage: Positive = 10.0  # V


class Simulation(_Table):
    """What ``[simulation]`` may say.

    model   the arm that moves, relative to the rig file; left out: the rig's own model. Another file here is how an arm comes to have
            what its model does not know: other parameters, or effects
    seed    of every noise; same seed, same samples, at either pace
    pace    "wall": real time, for a daemon; "fast": as fast as it computes
    settle  s after the end of the motion before the controller says that it has finished
    hold    s after that before the brakes come on
    stamp_jitter  s by which the host's stamps are late (magnitude of a normal): interrupts
    """

    model: str | None = None
    seed: int = 1
    pace: Literal["wall", "fast"] = "wall"
    settle: NotNegative = 0.3
    hold: Positive = 5.0
    stamp_jitter: NotNegative = 5e-6
    encoder: EncoderTable = EncoderTable()
    transducer: TransducerTable = TransducerTable()
    fault: list[Fault] = []


@dataclass(frozen=True)
class Electronics:
    """What stands between the motors and the cards of n joints."""

    encoder: SineEncoder
    noise_period_ns: int
    transducer: HallTransducer
    seed: int


def electronics_of(settings: Simulation, encoder_lines: NDArray[np.float64]) -> Electronics:
    """The instruments of an arm with these encoders, (n,) lines a motor revolution; ValueError where an entry does not fit."""

    def joints(entry: PerJoint, name: str) -> NDArray[np.float64]:
        values = np.asarray(entry, float)
        if values.ndim and len(values) != len(encoder_lines):
            raise ValueError(f"{name}: has {len(values)} entries for {len(encoder_lines)} joints")
        return np.broadcast_to(values, encoder_lines.shape)

    def fields(table: BaseModel, place: str, names: tuple[str, ...]) -> dict[str, NDArray[np.float64]]:
        return {name: joints(getattr(table, name), f"{place}.{name}") for name in names}

    sines = ("sine_gain", "cosine_gain", "sine_offset", "cosine_offset", "phase_error", "noise", "hysteresis")
    hall = settings.transducer
    return Electronics(
        encoder=SineEncoder(lines=encoder_lines, **fields(settings.encoder, "encoder", sines)),
        noise_period_ns=round(settings.encoder.noise_period * 1e9),
        transducer=HallTransducer(
            **fields(hall, "transducer", ("turns", "offset", "gain_error", "noise")),
            bandwidth=hall.bandwidth,
            rated_current=hall.rated_current,
            rated_voltage=hall.rated_voltage,
        ),
        seed=settings.seed,
    )
