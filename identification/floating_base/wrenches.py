"""What acts on a floating base at the rows that judge a fit: for charts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from arm_io.types import Array
from arm_model.moving_base import PAYLOAD, REACTION
from identification.floating_base.columns import Rows
from identification.floating_base.held_out import Sides
from identification.floating_base.rows import BaseRun

PARTS = {
    "added mass": ("base.added_mass_",),
    "drag": ("base.linear_drag_", "base.quadratic_drag_"),
    "arm": (REACTION, PAYLOAD),
}
"""Parts of the required wrench by the beginnings of their parameters' names; hull and buoyancy are what is left."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Wrenches:
    """One recording: k compared rows at t (k,) s; wrenches (k, 6), N and N m, body frame.

    thrust     of the thrusters as found
    required   what the motion takes, with the parameters found, by part of it; their sum is compared with the thrust
    before     required less thrust in the model as given; after: with the parameters found
    demand     (k, thrusters) N, behind the time constants
    each       (k, thrusters) N: thrust of each as found, and ``seen``: the same with its share of ``after``
    run        its motion
    """

    run: BaseRun
    t: Array
    thrust: Array
    required: Mapping[str, Array]
    before: Array
    after: Array
    demand: Array
    each: Array
    seen: Array

    @property
    def needed(self) -> Array:
        """(k, 6) sum of ``required``."""
        return np.asarray(sum(self.required.values()))


def wrenches_of(sides: Sides, before: Array, after: Array, scale: Array) -> list[Wrenches]:
    """Of every recording that is judged by; parameters (p,) ``before`` and ``after``, noise (6,) of the degrees."""
    rows, found = sides.held_out, []
    for number, run in enumerate(sides.runs):
        of_run = rows.part(rows.run == number)
        residual = of_run.residual(after)
        each, wrench = of_run.thrusts(after), of_run.thrust_wrench(after)
        parts = {name: -_sum_of(of_run, after, beginnings) for name, beginnings in PARTS.items()}
        parts["hull: inertia, weight, buoyancy"] = residual + wrench - sum(parts.values())
        found.append(
            Wrenches(
                run=run,
                t=of_run.t,
                thrust=wrench,
                required=parts,
                before=of_run.residual(before),
                after=residual,
                demand=of_run.demand,
                each=each,
                seen=each + _shares(of_run, residual, scale),
            )
        )
    return found


def _sum_of(rows: Rows, values: Array, beginnings: tuple[str, ...]) -> Array:
    numbers = [k for k, name in enumerate(rows.names) if name.startswith(beginnings)]
    return np.asarray(rows.columns[:, :, numbers] @ values[numbers])


def _shares(rows: Rows, residual: Array, scale: Array) -> Array:
    """(k, thrusters) N: thrust of each thruster that would explain what is left best, alone."""
    directions = rows.allocation / scale[:, None]
    return np.asarray(residual / scale @ directions / np.maximum((directions**2).sum(axis=0), 1e-300))
