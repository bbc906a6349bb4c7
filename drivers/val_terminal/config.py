"""A VAL controller in the rig file."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from arm_io.table import Seconds, Table


class Config(Table):
    """A VAL controller in the rig file.

    dialect         "val2" knows joint-interpolated moves of all joints (DO MOVE #PPOINT); "val" only DRIVE
    sign, zero      VAL's joint angle (deg) = sign x the model's angle + zero, one entry per joint
    full_speed, full_acceleration  rad/s and rad/s2 of each joint at 100 %: an experiment that means something else by
                    "full speed" is refused
    approach_speed  per cent, on the way to the start pose
    answer_timeout  s until a command that moves nothing must be answered
    move_timeout    s until the longest single move must be over
    """

    port: str
    baud: int = 9600
    dialect: Literal["val", "val2"] = "val2"
    joints: Annotated[int, Field(ge=1, le=6)] = 6
    sign: tuple[Literal[-1, 1], ...] = (1, 1, 1, 1, 1, 1)
    zero: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    full_speed: tuple[Annotated[float, Field(gt=0)], ...] = (1.4312, 1.2915, 2.1293, 3.9794, 4.2062, 3.9794)
    full_acceleration: tuple[Annotated[float, Field(gt=0)], ...] = (8.0, 6.0, 12.0, 20.0, 25.0, 25.0)
    approach_speed: Annotated[int, Field(ge=1, le=100)] = 20
    answer_timeout: Seconds = 2.0
    move_timeout: Seconds = 60.0
