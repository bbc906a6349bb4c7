"""What stands around an arm, as the ``[space]`` table of a rig file or a file of its own says it.

All in the base frame of the arm's model (in which gravity and tracker points are given), m.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, model_validator

from arm_io import check_table, read_toml
from arm_io.table import Table

Vector = tuple[float, float, float]


class Box(Table):
    """A box with edges along the axes of the base frame, between two opposite corners ``low`` and ``high``."""

    name: Annotated[str, Field(min_length=1, max_length=64)]
    low: Vector
    high: Vector

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        _check_order(self.low, self.high, f"box {self.name!r}: ")
        return self


class Space(Table):
    """Where the arm may be.

    floor           z of a horizontal plane above which every link stays; None: there is none
    box             boxes that no link enters
    low, high       corners of the box in which the tool point stays; None: anywhere
    margin          least distance of a link from floor, boxes and other links
    self_collision  whether links keep clear of one another
    """

    floor: float | None = None
    box: list[Box] = Field(default=[])
    low: Vector | None = None
    high: Vector | None = None
    margin: Annotated[float, Field(ge=0.0, le=10.0)] = 0.02
    self_collision: bool = True

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        names = [box.name for box in self.box]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"box name {name!r} is used twice")
        if self.low is not None and self.high is not None:
            _check_order(self.low, self.high, "")
        return self


def _check_order(low: Vector, high: Vector, where: str) -> None:
    for axis, least, most in zip("xyz", low, high):
        if not least < most:
            raise ValueError(f"{where}'low' must be below 'high' along {axis}, is {least:g} with {most:g}")


def read_space(path: str | Path) -> Space:
    """The space in a file that has the entries of ``[space]`` at its top; InputError names file and entry."""
    return check_table(path, read_toml(path), Space)
