"""Parts of a drive: friction of free shape, and the stages of its gear."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator
from pydantic.dataclasses import dataclass

from arm_model.tables.fields import STRICT, NotNegative, Positive

SLIDING = {
    "rad": "m",
    "rad/s": "m/s",
    "rad/s2": "m/s2",
    "N m": "N",
    "N m/rad": "N/m",
    "N m s/rad": "N s/m",
    "N m s2/rad2": "N s2/m2",
    "N m/rad3": "N/m3",
    "N m/rad5": "N/m5",
    "N m/s": "N/s",
    "N m/K": "N/K",
    "N m s/(rad K)": "N s/(m K)",
    "rad/(N m)": "m/N",
    "kg m2": "kg",
}
"""Units where a joint slides, by those where it turns."""


@dataclass(frozen=True, config=STRICT)
class FrictionCurve:
    """Friction of free shape, in addition to a joint's viscous and Coulomb friction, at the JOINT.

    speed (K,) rad/s (m/s), increasing, from 0 or more; positive, negative (K,) N m (N) against motion in that
    direction at these speeds. Straight lines between them, constant below the first and beyond the last
    (``arm_model.rigid_body.friction_curve``). A value may be negative: the total friction must oppose the motion.
    """

    speed: Annotated[tuple[NotNegative, ...], Field(min_length=2)]
    positive: tuple[float, ...]
    negative: tuple[float, ...]

    @model_validator(mode="after")
    def _one_value_per_speed(self) -> FrictionCurve:
        if any(after <= before for before, after in zip(self.speed, self.speed[1:])):
            raise ValueError("friction_curve.speed: must increase from each entry to the next")
        for name in ("positive", "negative"):
            if len(getattr(self, name)) != len(self.speed):
                raise ValueError(
                    f"friction_curve.{name}: has {len(getattr(self, name))} entries, speed has {len(self.speed)}"
                )
        return self


@dataclass(frozen=True, config=STRICT)
class GearStage:
    """One stage of a gear.

    ratio  turns of its shaft at the motor's side per turn of that at the joint's side
    teeth  engagements per turn of the shaft at the joint's side: the teeth of the wheel on it (of a planet carrier:
           those of the ring); absent: not known
    """

    ratio: Positive
    teeth: Annotated[int, Field(gt=0)] | None = None


STAGES_AND_GEAR = 0.02
"""Largest relative difference between the product of the ratios of a gear's stages and the ratio of the gear."""
