"""Joints with play: the flight of a link from flank to flank, and what is not known of it.

Along a measured motion nothing shows how hard teeth are. As they meet, the link takes the speed of the motor: that is
the law. Steel on steel leaves again at up to half of its speed, and a link without load may begin on either flank:
by what the current would differ then, a residual is uncertain (``generation.residual_run``).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from arm_io.types import Array
from arm_model.effects import Effect, Values

NO_INERTIA = 1e-12
"""kg m2 (kg): rounding errors of a link without inertia about its axis; a gram on a millimetre has a thousand times."""


class Teeth(NamedTuple):
    """How a link meets a flank, and where it begins.

    rebound  share of its speed at which it leaves the flank again
    apart    it begins on the flank off which its load pulls it
    """

    rebound: float = 0.0
    apart: bool = False


AS_FOUND = Teeth()
AS_MAY_BE = (Teeth(rebound=0.5), Teeth(apart=True))
"""What teeth may do instead."""


def through_gap(load: Array, inertia: Array, half_gap: float, step: float, teeth: Teeth = AS_FOUND) -> Array:
    """Twist (m,) of a joint with play, for rows ``step`` s apart.

    +half_gap where the motor pushes the link, -half_gap where it holds it back.

    Where the ``load`` (m,) N m that the link of ``inertia`` (m,) kg m2 needs changes its sign, the teeth part: the link
    flies, inertia d'' = load, until it meets the other flank, and stays there, or leaves it again as the ``teeth`` do.
    That takes a tenth of a second where gravity turns it over, and ends with a jump of the current. A link without
    inertia is there at once. Between two rows the load is a straight line: a flight that began at a row would be late
    by half a row, which looks like a time skew.
    """
    side = 1.0 if (load[0] >= 0.0) != teeth.apart else -1.0
    twist, k = np.empty_like(load), 0
    to_flight = {one: np.flatnonzero(one * load < 0.0) for one in (1.0, -1.0)}
    torques, masses = load.tolist(), np.maximum(inertia, NO_INERTIA).tolist()
    while True:
        # on a flank up to the row before which the load pulls it off
        ahead = to_flight[side]
        place = int(np.searchsorted(ahead, k))
        start = int(ahead[place]) if half_gap and place < len(ahead) else len(load)
        twist[k:start], k = side * half_gap, start
        if k == len(load):
            return twist
        before = max(side * torques[k - 1], 0.0) if k else 0.0
        fall = -side * torques[k]
        since = step * fall / (fall + before)
        d, v = half_gap - since * since * fall / masses[k] / 6, -since * fall / masses[k] / 2
        while True:
            while abs(d) < half_gap:
                twist[k], k = side * d, k + 1
                if k == len(load):
                    return twist
                torque, after, mass = side * torques[k - 1], side * torques[k], masses[k]
                d += step * (v + step * (2 * torque + after) / mass / 6)
                v += step * (torque + after) / mass / 2
            v *= -teeth.rebound
            # a rebound that is over within a row is none
            if abs(v) * masses[k] <= step * abs(torques[k]):
                break
            d = float(np.copysign(half_gap, d)) + 0.5 * step * v
        side = side if d > 0.0 else -side
        twist[k], k = side * half_gap, k + 1


def gap_of(effect: Effect, values: Values) -> float:
    """rad (m): half of the play of a transmission that has some."""
    assert effect.gap is not None
    return float(values[effect.gap.name])
