"""Columns named by their joints, such as shoulder_pos and shoulder_effort, or position of the only joint there is."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

Series = tuple[tuple[str, ...], str]
"""Columns, one per joint, and their unit as it is written; "" without."""
_BETWEEN = "[ _./:-]+"


def of_named_joints(
    names: Sequence[str], words: Mapping[str, str], unit: str, joints: Sequence[str] = ()
) -> dict[str, Series]:
    """Signal -> its columns, where every joint of the positions has a column of the signal; {} without q and i.

    words   signal -> pattern of the words for it
    unit    pattern of a unit at the end of a name, with a group ``unit``
    joints  names of the arm's joints: these in their order, if the columns have them all; else the order of the table
    """
    found: dict[str, dict[str, tuple[str, str]]] = {}
    taken: set[str] = set()
    for signal, word in words.items():
        for name in names:
            of = None if name in taken else _joint_of(name, word, unit)
            if of is not None and of[0] not in found.get(signal, {}):
                found.setdefault(signal, {})[of[0]] = name, of[1]
                taken.add(name)
    if not {"q", "i"} <= set(found):
        return {}
    there = list(found["q"])
    order = [joint for joint in joints if joint in there] if set(joints) >= set(there) else there
    if not set(order) <= set(found["i"]) or ("" in order and len(order) > 1):
        return {}
    complete = {signal: columns for signal, columns in found.items() if set(order) <= set(columns)}
    return {
        signal: (tuple(columns[joint][0] for joint in order), columns[order[0]][1])
        for signal, columns in complete.items()
    }


def _joint_of(name: str, word: str, unit: str) -> tuple[str, str] | None:
    """The joint that a column's name has beside a word for a signal ("": none), and the unit; None for other names."""
    for pattern in (
        rf"{word}{unit}",
        rf"(?P<joint>.+?){_BETWEEN}{word}{unit}",
        rf"{word}{_BETWEEN}(?P<joint>.+?){unit}",
    ):
        if match := re.fullmatch(pattern, name.strip(), re.IGNORECASE):
            return match.groupdict().get("joint") or "", (match["unit"] or "").strip(" _[]()")
    return None
