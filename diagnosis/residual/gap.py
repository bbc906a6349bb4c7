"""Joints with play: the flight of a link from flank to flank, and what is not known of it.

Along a measured motion nothing shows how hard teeth are. As they meet, the link takes the speed of the motor: that is
the law. Steel on steel leaves again at up to half of its speed, and a link without load may begin on either flank:
by what the current would differ then, a residual is uncertain (``generation.residual_run``).
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from arm_io.types import Array
from arm_model.effects import Effect, Values
from arm_model.symbolic import Steps, Tape, steps_of

NO_INERTIA = 1e-12
"""kg m2 (kg): rounding errors of a link without inertia about its axis; a gram on a millimetre has a thousand times."""


class Teeth(NamedTuple):
    """How a link meets a flank, and on which flank it starts.

    rebound  share of its speed at which it leaves the flank again
    apart    it begins on the flank off which its load pulls it
    """

    rebound: float = 0.0
    apart: bool = False


MEETINGS = 4
"""Of one link with its flanks between two rows, at most; it then stays on the last."""
AS_FOUND = Teeth()
POSSIBLE = (Teeth(rebound=0.5), Teeth(apart=True))
"""What teeth may do instead."""


def through_gap(load: Array, inertia: Array, half_gap: float, step: float, teeth: Teeth = AS_FOUND) -> Array:
    """Twist (m,) of a joint with backlash, for rows ``step`` s apart.

    +half_gap where the motor pushes the link, -half_gap where it holds the link back.

    Where the ``load`` (m,) N m that the link of ``inertia`` (m,) kg m2 needs changes its sign, the teeth part: the link
    flies, inertia d'' = load, until it meets the other flank, and stays there, or leaves it again as the ``teeth`` do.
    That takes a tenth of a second where gravity turns it over, and ends with a jump of the current. A link without
    inertia is there at once. Between two rows the load is a straight line: a flight that began at a row would be late
    by half a row, which looks like a time skew.
    """
    if not half_gap:
        return np.zeros_like(load)
    side = 1.0 if (load[0] >= 0.0) != teeth.apart else -1.0
    flights, numbers = _flights(MEETINGS if teeth.rebound else 0), np.array([half_gap, step, teeth.rebound])
    start = np.array([[side * half_gap, 0.0, 0.0, 0.0]])
    return flights(numbers, start, load[None], np.maximum(inertia, NO_INERTIA)[None])[0]


@cache
def _flights(meetings: int) -> Steps:
    """Rows of load and inertia, and the twist at each; loops of Python took a tenth of a diagnosis.

    From row to row: the twist and, of a link that ``flies`` (1, else 0), its rate; the load one row before.
    """
    tape = Tape()
    half_gap, step, rebound, load, inertia = map(tape.input, ("half_gap", "step", "rebound", "load", "inertia"))
    twist, rate, flies, before = map(tape.input, ("twist", "rate", "flies", "before"))
    pull = load / inertia
    # leaves its flank between the two rows, at the instant from which the load pulls it off
    opposite = tape.where(load, 0.0, before.maximum(0.0), before.minimum(0.0))
    since = step * (load / (load - opposite))
    leaving, leaving_rate = twist + since * since * pull / 6.0, since * pull / 2.0
    # is in flight
    further = twist + step * (rate + step * (2.0 * before + load) / inertia / 6.0)
    further_rate = rate + step * (before + load) / inertia / 2.0
    push = tape.where(twist, 0.0, -load, load)
    moves = tape.where(push, 0.0, 1.0, flies)
    d, v = tape.where(0.0, flies, further, leaving), tape.where(0.0, flies, further_rate, leaving_rate)
    for _ in range(meetings):
        back, met = -rebound * v, tape.where(d, 0.0, -half_gap, half_gap)
        # a rebound that ends within a row is ignored
        stays = tape.where(step * abs(load), abs(back) * inertia, tape.where(abs(d), half_gap, 1.0, 0.0), 1.0)
        d, v = tape.where(0.0, stays, d, met + 0.5 * step * back), tape.where(0.0, stays, v, back)
    flying = tape.where(abs(d), half_gap, moves, 0.0)
    met = tape.where(0.0, moves, tape.where(d, 0.0, -half_gap, half_gap), twist)
    place = tape.where(0.0, flying, d, met)
    after = {"twist": place, "rate": v, "flies": flying, "before": load}
    return steps_of(tape, place, after, columns=("load", "inertia"), numbers=("half_gap", "step", "rebound"))


def gap_of(effect: Effect, values: Values) -> float:
    """rad (m): half of the backlash of a transmission that has some."""
    assert effect.gap is not None
    return float(values[effect.gap.name])
