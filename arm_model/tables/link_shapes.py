"""Shapes of a link: its body in water, and its surface for checks of collisions."""

from __future__ import annotations

from pydantic import model_validator
from pydantic.dataclasses import dataclass

from arm_model.tables.fields import STRICT, NotNegative, Positive, Vector


@dataclass(frozen=True, config=STRICT)
class Cylinder:
    """The body of one link as the water meets it, and what the water does to it.

    See ``arm_model.rigid_body.hydrodynamics``.

    start, end (3,) m in the link's frame; radius m; density kg/m3 of the water. The coefficients are of Morison's
    equation: drag C_d of rho C_d R |v| v, added mass C_a of rho C_a pi R^2 a, both per length and across the axis;
    buoyancy: the share of the displaced water's weight that carries the link, 1 where it is immersed.
    """

    start: Vector
    end: Vector
    radius: Positive
    density: Positive = 1025.0
    drag_coefficient: NotNegative = 0.0
    added_mass_coefficient: NotNegative = 0.0
    buoyancy: NotNegative = 0.0

    @model_validator(mode="after")
    def _has_a_length(self) -> Cylinder:
        if self.start == self.end:
            raise ValueError("cylinder: starts where it ends; use two different points")
        return self


@dataclass(frozen=True, config=STRICT)
class Capsule:
    """A part of a link's surface for checks of collisions: all within ``radius`` m of the segment from start to end.

    start, end (3,) m in the link's frame; the same point twice makes a sphere.
    """

    start: Vector
    end: Vector
    radius: Positive
