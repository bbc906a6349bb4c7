"""One quantity of an arm, what one recording or result says of it, and how it changed."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from arm_io.types import Array

Kind = Literal["friction", "curve", "inertia", "effect", "cause"]
"""A friction parameter, one point of a friction curve, a base parameter of links and rotors, a parameter of an effect
of the model, one of a cause that a diagnosis named."""
SIGNIFICANT = 0.05
"""Expected share of false discoveries among all changes that are called significant."""
COLUMNS = (
    *("description", "kind", "joint", "speed", "before", "std_before", "after", "std_after", "change", "std", "unit"),
    *("relative", "std_relative", "z", "p", "p_corrected", "significant", "overruled", "not_comparable"),
)
"""Columns of ``to_row``, beside the name."""


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """A compared quantity.

    name    as in identification.json: joint3.coulomb, a base parameter's expression; of a point of a friction curve
            joint3.friction_positive(0.42)
    words   for people: Coulomb friction of joint 3
    joint   from 1; None: of no single joint
    speed   rad/s (m/s) of a point of a friction curve, signed as the motion; None: no such point
    why     why it cannot be compared, "" where it can
    """

    name: str
    words: str
    unit: str
    kind: Kind
    joint: int | None = None
    speed: float | None = None
    why: str = ""

    def not_comparable(self, why: str) -> Quantity:
        """The same quantity with the reason."""
        return replace(self, why=why)


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """The estimates of r quantities by one recording or result.

    values   (r,), NaN where it says nothing
    std      (r,) two of which hold 95 %
    raw      (r,) standard deviation without the allowance for few blocks that ``std`` contains
    freedom  degrees of freedom of ``raw``
    """

    source: str
    values: Array
    std: Array
    raw: Array
    freedom: float


@dataclass(frozen=True, kw_only=True)
class Change:
    """The change of one quantity between the two sides.

    before, after   None where a side says nothing
    std_before, std_after, std   of both sides and of the change: root of the sum of variances; of groups with the
                    scatter between recordings
    z               change over std
    p, corrected    probability of such a change by chance; corrected for the number of quantities (Benjamini &
                    Hochberg)
    scatter         spread between the recordings of a group, over what their own standard deviations explain; None:
                    one recording on each side
    overruled       why it is not significant though regressions of single recordings say so ("follows from base tilt");
                    "" of all others
    """

    quantity: Quantity
    before: float | None
    after: float | None
    std_before: float | None = None
    std_after: float | None = None
    std: float | None = None
    p: float | None = None
    corrected: float | None = None
    scatter: float | None = None
    overruled: str = ""

    @property
    def change(self) -> float | None:
        """Value after minus value before, in the unit of the quantity; None if a side does not show it."""
        return None if self.before is None or self.after is None else self.after - self.before

    @property
    def z(self) -> float | None:
        """The change over its std."""
        return None if self.change is None or not self.std else self.change / self.std

    @property
    def comparable(self) -> bool:
        """Whether both sides show the quantity."""
        return not self.quantity.why

    @property
    def significant(self) -> bool:
        """Whether the change is significant at the false-discovery rate ``SIGNIFICANT``."""
        return self.comparable and self.corrected is not None and self.corrected <= SIGNIFICANT

    @property
    def relative(self) -> tuple[float, float] | None:
        """Change over the value before, and its std; None if that value does not differ significantly from zero."""
        if self.change is None or self.before is None or not self.std_before or self.std_after is None:
            return None
        if abs(self.before) < 3 * self.std_before:
            return None
        ratio = self.change / abs(self.before)
        sign = math.copysign(1.0, self.before)
        # To first order, by the variances of before, after and their difference, which tell how the first two are
        # correlated. What only the difference has (friction that differs from day to day) is of the value after.
        before = self.std_before**2
        change = self.std**2 if self.std else before + self.std_after**2
        after = max(self.std_after**2, change - before)
        variance = change + ratio**2 * before - sign * ratio * (after - before - change)
        return ratio, math.sqrt(max(variance, 0.0)) / abs(self.before)

    def to_row(self) -> dict[str, Any]:
        """As the table of ``Comparison.to_pandas`` has it: no entry contains others; None where a side says nothing."""
        quantity, relative = self.quantity, self.relative or (None, None)
        values = (
            *(quantity.words, quantity.kind, quantity.joint, quantity.speed, self.before, self.std_before),
            *(self.after, self.std_after, self.change, self.std, quantity.unit, *relative, self.z, self.p),
            *(self.corrected, self.significant, self.overruled, quantity.why),
        )
        return {"name": quantity.name, **dict(zip(COLUMNS, values, strict=True))}

    def to_json(self) -> dict[str, Any]:
        """As compare.json has it."""
        relative = self.relative
        table: dict[str, Any] = {
            "name": self.quantity.name,
            "description": self.quantity.words,
            "kind": self.quantity.kind,
            "joint": self.quantity.joint,
            "unit": self.quantity.unit,
            "before": {"value": self.before, "std": self.std_before},
            "after": {"value": self.after, "std": self.std_after},
            "change": self.change,
            "std": self.std,
            "relative": None if relative is None else {"value": relative[0], "std": relative[1]},
            "z": self.z,
            "p": self.p,
            "p_corrected": self.corrected,
            "significant": self.significant,
        }
        if self.scatter is not None:
            table["scatter"] = self.scatter
        if self.quantity.speed is not None:
            table["speed"] = self.quantity.speed
        if self.overruled:
            table["overruled"] = self.overruled
        if self.quantity.why:
            table["not_comparable"] = self.quantity.why
        return table


def number(value: float) -> float | None:
    """None for NaN and infinities, as JSON has neither."""
    return float(value) if np.isfinite(value) else None
