"""What a check of a motion in its space says, one sentence each."""

from __future__ import annotations

from arm_clearance.approach import EXACT, Nearest, nearest
from arm_clearance.chain import Chain
from arm_clearance.pairs import Pairs, pairs_of
from arm_clearance.space import Space
from experiment import Demand

ROUNDING = 1e-9
"""m."""


def check_clearance(demand: Demand, chain: Chain, space: Space) -> list[str]:
    """Where a motion comes nearer to floor, boxes, limits or itself than the space allows; empty where it does not."""
    found = nearest(demand, pairs_of(chain, space))
    if found is None or found.room >= -ROUNDING:
        return []
    if found.one == "the tool point":
        return [f"the tool point leaves {found.other} by {_mm(-found.clearance)} at {found.time:.2f} s"]
    return [f"{in_words(found)}; [space] requires {_mm(space.margin)}"]


def in_words(found: Nearest) -> str:
    """A distance as a sentence without its full stop."""
    if found.clearance < 0:
        return f"{found.one} overlaps {found.other} by {_mm(-found.clearance)} or more at {found.time:.2f} s"
    return f"{found.one} comes within {_mm(found.clearance)} of {found.other} at {found.time:.2f} s"


def left_out(pairs: Pairs) -> list[str]:
    """What is not checked, and what rests on assumed shapes."""
    sentences = []
    assumed = [(body.link, body.radius) for body in pairs.chain.bodies if body.assumed]
    if assumed:
        links = ", ".join(str(link) for link, _ in assumed)
        sentences.append(
            f"the model gives no capsules for links {links} (0 is the base): assumed with radius "
            f"{_mm(assumed[0][1])} between the joints"
        )
    if pairs.touching:
        links = ", ".join(f"{one} and {other}" for one, other in pairs.touching)
        sentences.append(f"links that touch by design are not checked against each other: {links}")
    return sentences


def lowest_point(demand: Demand, chain: Chain) -> float:
    """m: the lowest z in the base frame that a moving link reaches, to ``EXACT``; 0 where none changes its height."""
    found = nearest(demand, pairs_of(chain, Space(floor=0.0, margin=0.0, self_collision=False)))
    return 0.0 if found is None else found.clearance


def _mm(metres: float) -> str:
    return f"{1000 * metres:.0f} mm" if abs(metres) >= EXACT else f"{1000 * metres:.1f} mm"
