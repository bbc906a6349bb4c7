"""How a simulated motion changes with the parameters of its arm: two lanes per parameter, all in one batch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace

import numpy as np

from arm_io import InputError
from arm_io.types import Array
from arm_model.description import Arm
from arm_model.motion import BaseTrack, Motion
from arm_model.parameters import parameter
from arm_model.simulation.servo_references import Demand
from arm_model.simulation.simulation import simulate_batch, single


def sensitivities(
    arm: Arm, demand: Demand, steps: Mapping[str, float], times: Array, *, start: Array | None = None
) -> tuple[Motion, Motion]:
    """The motion, and its derivatives by the parameters that ``steps`` names.

    The names are of ``arm_model.parameters``, in their order on the leading axis of every entry of the second Motion
    but t and demand: rad/(N m s/rad), A/kg, ...

    Central differences over +-step, in the parameter's unit; their error is of the order of step^2. times, start: as in
    ``simulate_batch``. InputError: a step that is not positive.
    """
    for name, step in steps.items():
        if not step > 0:
            raise InputError(name, f"has a step of {step:g}; expected a positive one")
    count, names = len(steps), list(steps)
    lanes = {name: np.full(2 * count + 1, parameter(arm, name)) for name in names}
    for k, (name, step) in enumerate(steps.items()):
        lanes[name][1 + 2 * k] += step
        lanes[name][2 + 2 * k] -= step
    batch = simulate_batch(arm, demand, times, parameters=lanes, start=start)
    widths = 2 * np.array(list(steps.values()))[:, None, None]
    changing = [field.name for field in fields(Motion) if field.name not in ("t", "demand", "base")]
    slopes = {name: (getattr(batch, name)[1::2] - getattr(batch, name)[2::2]) / widths for name in changing}
    if batch.base is None:
        return single(batch), replace(batch, **slopes)
    track = {field.name: getattr(batch.base, field.name) for field in fields(batch.base)}
    moved = BaseTrack(**{name: (values[1::2] - values[2::2]) / widths for name, values in track.items()})
    return single(batch), replace(batch, **slopes, base=moved)
