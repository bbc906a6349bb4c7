"""Defects outside the catalogue, as an arm in use may have them.

Nothing may be named; the reported variable must be the right one.

Each is drawn at a strength of 1 in ``DRAWN`` and scaled to a multiple of the noise by ``magnitude``; ``EXPLANATORY``
says against which variables of the same joint (unless it names another) a person would find it in the residual.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from arm_io.types import Array
from tests.blind.plant import Plant

Values = Mapping[str, float]


def _set(values: Array, joint: int, value: float) -> Array:
    values = values.copy()
    values[joint - 1] = value
    return values


def _cell(values: Array, joint: int, other: int, value: float) -> Array:
    values = values.copy()
    values[joint - 1, other - 1] = value
    return values


def _cross(p: Plant, joint: int, v: Values) -> Plant:
    cycles = _cell(p.cross_cycles, joint, joint, v["cycles"])
    cycles[joint - 1, int(v["other"]) - 1] = v["other_cycles"]
    return p._replace(cross_torque=_set(p.cross_torque, joint, v["amplitude"]), cross_cycles=cycles)


MECHANICAL: dict[str, Callable[[Plant, int, Values], Plant]] = {
    "eccentric_gear": lambda p, j, v: p._replace(
        eccentric=_set(p.eccentric, j, v["share"]), eccentric_phase=_set(p.eccentric_phase, j, v["phase"])
    ),
    "lossy_drive": lambda p, j, v: p._replace(lost_driving=_set(p.lost_driving, j, v["share"])),
    "taut_cable": lambda p, j, v: p._replace(
        cable=_set(p.cable, j, v["stiffness"]), cable_rest=_set(p.cable_rest, j, v["rest_angle"])
    ),
    "uneven_torque": lambda p, j, v: p._replace(
        cross_torque=_set(p.cross_torque, j, v["amplitude"]), cross_cycles=_cell(p.cross_cycles, j, j, v["cycles"])
    ),
    "two_joint_ripple": _cross,
    "warming_grease": lambda p, j, v: p._replace(
        warm_share=_set(p.warm_share, j, v["share"]), warm_time=_set(p.warm_time, j, v["time_constant"])
    ),
    "rub": lambda p, j, v: p._replace(
        rub=_set(p.rub, j, v["torque"]), rub_from=_set(p.rub_from, j, v["from"]), rub_to=_set(p.rub_to, j, v["to"])
    ),
    "loose_harness": lambda p, j, v: p._replace(harness=_cell(p.harness, j, int(v["other"]), v["drag"])),
    "limit_cycle": lambda p, j, v: p._replace(relay=_set(p.relay, j, v["torque"])),
}
"""What they do to the plant."""


def _column(current: Array, joint: int, change: Array) -> Array:
    current = current.copy()
    current[:, joint - 1] += change
    return current


def _sticking(t: Array, current: Array, joint: int, v: Values) -> Array:
    """A core that keeps some of its past: the play operator of width v['width'] A."""
    column = current[:, joint - 1]
    kept, at = np.empty_like(column), float(column[0])
    for row, value in enumerate(column.tolist()):
        at = min(max(at, value - v["width"]), value + v["width"])
        kept[row] = at
    return _column(current, joint, kept - column)


SENSING: dict[str, Callable[[Array, Array, int, Values], Array]] = {
    "drifting_offset": lambda t, i, j, v: _column(i, j, v["slope"] * t),
    "sticking_core": _sticking,
    "crosstalk": lambda t, i, j, v: _column(i, j, v["share"] * i[:, int(v["other"]) - 1]),
}
"""What they do to the currents (m, n) A at times t (m,) s."""


def _other(rng: np.random.Generator, joint: int) -> int:
    return int(rng.choice([k for k in (1, 2, 3) if k != joint]))


DRAWN: dict[str, Callable[[np.random.Generator, int, float], dict[str, float]]] = {
    "eccentric_gear": lambda rng, j, m: {"share": 0.1 * m, "phase": float(rng.uniform(-3, 3))},
    "lossy_drive": lambda rng, j, m: {"share": 0.1 * m},
    "taut_cable": lambda rng, j, m: {"stiffness": 1.0 * m, "rest_angle": float(rng.uniform(-0.5, 0.3))},
    "uneven_torque": lambda rng, j, m: {"amplitude": 1.0 * m, "cycles": float(rng.integers(2, 5))},
    "two_joint_ripple": lambda rng, j, m: {
        "amplitude": 1.0 * m,
        "cycles": float(rng.integers(2, 5)),
        "other": _other(rng, j),
        "other_cycles": float(rng.integers(2, 5)),
    },
    "warming_grease": lambda rng, j, m: {"share": min(0.15 * m, 0.8), "time_constant": float(rng.uniform(4, 8))},
    "rub": lambda rng, j, m: (lambda a: {"torque": 2.0 * m, "from": a, "to": a + float(rng.uniform(0.15, 0.35))})(
        (0.0, -0.4, -0.9)[j - 1] + float(rng.uniform(-0.3, 0.2))
    ),
    "loose_harness": lambda rng, j, m: {"other": _other(rng, j), "drag": 0.5 * m * float(rng.choice([-1, 1]))},
    "limit_cycle": lambda rng, j, m: {"torque": 1.0 * m},
    "drifting_offset": lambda rng, j, m: {"slope": 0.004 * m * float(rng.choice([-1, 1]))},
    "sticking_core": lambda rng, j, m: {"width": 0.03 * m},
    "crosstalk": lambda rng, j, m: {"other": _other(rng, j), "share": 0.03 * m * float(rng.choice([-1, 1]))},
}
"""Parameters of one, at a joint (1-based) and a strength that ``magnitude`` finds."""

EXPLANATORY: dict[str, tuple[str, ...]] = {
    "eccentric_gear": ("position",),
    "lossy_drive": ("load torque",),
    "taut_cable": ("position",),
    "uneven_torque": ("position",),
    "two_joint_ripple": ("position", "position of joint {other}"),
    "warming_grease": ("time", "velocity"),
    "rub": ("position",),
    "loose_harness": ("velocity of joint {other}",),
    "limit_cycle": ("time",),
    "drifting_offset": ("time",),
    "sticking_core": ("current",),
    "crosstalk": ("current of joint {other}", "load torque of joint {other}"),
}
"""Variables whose report is correct.

One that begins with such a name and goes on about direction or sign is as well.
"""
