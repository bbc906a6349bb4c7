"""The space around an arm: its links as capsules, floor and boxes, and where a motion comes too near to them."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from arm_clearance.approach import Nearest, nearest
    from arm_clearance.chain import Body, Chain
    from arm_clearance.drawing import picture
    from arm_clearance.pairs import Pairs, pairs_of
    from arm_clearance.space import Box, Space, read_space
    from arm_clearance.words import check_clearance, in_words, left_out, lowest_point
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "Body",
    "Box",
    "Chain",
    "Nearest",
    "Pairs",
    "Space",
    "check_clearance",
    "in_words",
    "left_out",
    "lowest_point",
    "nearest",
    "pairs_of",
    "picture",
    "read_space",
]
