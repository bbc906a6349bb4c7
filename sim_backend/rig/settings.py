"""The rig file's ``[simulation]`` table: the simulated arm, its pace, its electronics, faults of its instruments."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from arm_io.table import NoSeconds, Seconds, Table
from arm_model import Controller
from sim_backend.arm.vehicle import ThrusterTable
from sim_backend.electronics.electronics import EncoderTable, TransducerTable
from sim_backend.rig.faults import Fault


class Simulation(Table):
    """What ``[simulation]`` may say.

    model   the arm that moves, relative to the rig file; left out: the rig's own model. Another file here is how an arm
            comes to have what its model does not know: other parameters, or effects
    seed    of every noise; same seed, same samples, at either pace
    pace    "wall": real time, for a daemon; "fast": as fast as it computes
    settle  s after the end of the motion before the controller says that it has finished
    hold    s after that before the brakes come on
    stamp_jitter  s by which the host's stamps are late (magnitude of a normal): interrupts
    controller    the servos; left out: those of the rig's model. For models that have none, as URDF files
    rotor_inertia kg m2 at the motor, per joint, of joints whose model has none
    thrusters     what drives the thrusters of a floating base beside its station keeping
    """

    model: str | None = None
    seed: int = 1
    pace: Literal["wall", "fast"] = "wall"
    settle: NoSeconds = 0.3
    hold: Seconds = 5.0
    stamp_jitter: NoSeconds = 5e-6
    controller: Controller | None = None
    rotor_inertia: list[Annotated[float, Field(ge=0)]] = Field(default_factory=list)
    encoder: EncoderTable = EncoderTable()
    transducer: TransducerTable = TransducerTable()
    thrusters: ThrusterTable = ThrusterTable()
    fault: list[Fault] = Field(default_factory=list)
