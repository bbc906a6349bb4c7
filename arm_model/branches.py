"""A file with several chains of moving joints: which of them are the arm, and which the fingers of its hand."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from arm_io import InputError
from arm_model.description import Joint

MOST = 4
"""Names in a line; of more, their number."""


def joints_of_arm(chains: Sequence[Sequence[object]]) -> int | None:
    """How many joints of every longest chain are the arm; None where the file does not decide.

    chains: per end of the tree, the names of the moving joints from the root to it.

    A chain that is the beginning of another (a base frame, a camera on the forearm) does not count. If several remain,
    they are the fingers of a hand: if they share more joints than any of them has behind those, and none differs from
    all others in the number of its joints. (A camera that turns beside a wrist does.)
    """
    longest = ends_that_move(chains)
    if len(longest) == 1:
        return len(chains[longest[0]])
    ways = [chains[index] for index in longest]
    shared = 0
    while ways and all(len(way) > shared and way[shared] == ways[0][shared] for way in ways):
        shared += 1
    fingers = Counter(len(way) - shared for way in ways)
    if not ways or shared <= max(fingers) or min(fingers.values()) < 2:
        return None
    return shared


def ends_that_move(chains: Sequence[Sequence[object]]) -> list[int]:
    """The chains, by number from 0, that are not the beginning of another; of equal ones the first."""
    ways = [tuple(chain) for chain in chains]
    begun = {way[:count] for way in ways for count in range(len(way))}
    return [index for index, way in enumerate(ways) if way and way not in begun and way not in ways[:index]]


def follows(joint: str, leader: str, element: str) -> str:
    """The sentence on a joint of the arm that the file makes follow another one by an ``element``."""
    return (
        f"{joint} follows {leader} (<{element}>): read as a joint of its own, with an angle and a motor of its own in "
        "each recording; if one motor turns both, its torques here are not those of the motor"
    )


def counted_as_fixed(joints: Sequence[str], end: str, mass: float) -> str:
    """What is said of moving joints beside those of the arm; mass: of everything behind them, kg."""
    return (
        f"{listed(joints)} {are(joints)} not part of the chain to {end}: counted as fixed where the file places "
        f"{'them' if len(joints) > 1 else 'it'}, with {mass:.4g} kg"
    )


def listed(names: Sequence[str]) -> str:
    """Names with commas; of more than MOST the first, and how many follow."""
    shown = ", ".join(names[:MOST])
    return shown if len(names) <= MOST else f"{shown} and {len(names) - MOST} more"


def are(names: Sequence[str]) -> str:
    """The verb after ``listed``."""
    return "are" if len(names) > 1 else "is"


def check_names(path: str | Path, joints: Sequence[Joint]) -> None:
    """InputError where two joints of the file ``path`` have one name, by which recordings tell them apart."""
    names = [joint.name for joint in joints if joint.name]
    for name in names:
        if names.count(name) > 1:
            raise InputError(path, f"has two joints of the name {name!r}; names must differ")
