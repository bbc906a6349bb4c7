"""The segments of an experiment as a user writes them: rad (m for prismatic joints), s, joints from 1."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from arm_io.table import Table

Duration = Annotated[float, Field(ge=1e-6)]  # s
Frequency = Annotated[float, Field(ge=1e-9, le=1e6)]  # Hz
Fraction = Annotated[float, Field(ge=1e-6, le=1)]


class Hold(Table):
    """Stand still for ``duration``."""

    type: Literal["hold"]
    duration: Duration


class Drive(Table):
    """One joint, trapezoidal in speed, to a position or by a distance (VAL's DRIVE)."""

    type: Literal["drive"]
    joint: Annotated[int, Field(ge=1)]
    to: float | None = None
    by: float | None = None
    speed: Fraction = 1.0  # of full_speed

    @model_validator(mode="after")
    def _one_target(self) -> Self:
        if (self.to is None) == (self.by is None):
            raise ValueError("give either 'to' (a position) or 'by' (a distance)")
        return self


class Move(Table):
    """All joints together to a position, trapezoidal, ending at the same time (VAL's MOVE, joint-interpolated)."""

    type: Literal["move"]
    to: list[float]
    speed: Fraction = 1.0


class Fourier(Table):
    """Finite Fourier series about the present position: sum over h of a[j][h] sin(h w t) + b[j][h] (cos(h w t) - 1).

    w = 2 pi ``fundamental``. The sum is multiplied by a quintic step of ``fade`` seconds at both ends: it starts and
    ends at rest (Swevers et al., IEEE T-RA 13(5), 1997, without the fade).
    """

    type: Literal["fourier"]
    duration: Duration
    fundamental: Frequency  # Hz
    sine: list[list[float]]  # [joint][harmonic]
    cosine: list[list[float]]
    fade: Duration = 0.5

    @model_validator(mode="after")
    def _same_shape(self) -> Self:
        if len(self.sine) != len(self.cosine) or len({len(row) for row in self.sine + self.cosine}) > 1:
            raise ValueError("'sine' and 'cosine' need one row per joint, with equally many harmonics")
        if 2 * self.fade > self.duration:
            raise ValueError("the two fades are longer than the segment; 'fade' must be at most half of 'duration'")
        return self


class Chirp(Table):
    """One joint: amplitude sin(phase), with a frequency that rises linearly from ``frequency`` to ``to_frequency``.

    The amplitude is faded in and out at the ends.
    """

    type: Literal["chirp"]
    joint: Annotated[int, Field(ge=1)]
    amplitude: float
    frequency: Frequency  # Hz
    to_frequency: Frequency
    duration: Duration
    fade: Duration = 0.5

    @model_validator(mode="after")
    def _fades_fit(self) -> Self:
        if 2 * self.fade > self.duration:
            raise ValueError("the two fades are longer than the segment; 'fade' must be at most half of 'duration'")
        return self


class Setpoints(Table):
    """A table of positions, linear in between: ``times`` from 0, strictly increasing; ``positions`` one row a time."""

    type: Literal["setpoints"]
    times: list[float]
    positions: list[list[float]]

    @model_validator(mode="after")
    def _a_table(self) -> Self:
        if len(self.times) < 2 or len(self.times) != len(self.positions):
            raise ValueError("needs at least two times and as many rows of positions")
        if self.times[0] != 0 or any(b <= a for a, b in zip(self.times, self.times[1:])):
            raise ValueError("times must start at 0 and increase strictly")
        return self


class Repeat(Table):
    """The segments inside, ``times`` times over."""

    type: Literal["repeat"]
    times: Annotated[int, Field(ge=1)]
    segment: list[Segment]


Segment = Annotated[
    Hold | Drive | Move | Fourier | Chirp | Setpoints | Repeat,
    Field(discriminator="type"),
]
Repeat.model_rebuild()
