"""A motion before it runs: which space it must keep clear of, how clear it is, and its picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from arm_io import InputError
from arm_report.picture_file import save_picture

if TYPE_CHECKING:
    from arm_clearance import Chain, Pairs, Space
    from arm_io.types import Array
    from arm_model import Arm
    from daq.rig import Rig
    from experiment import Demand


def space_of(rig: Rig | None, file: Path | None, floor: float | None = None) -> Space | None:
    """The space in ``file``, else the rig's, with the floor at ``floor`` m where it is given; None: nothing is said.

    InputError: a floor that is no finite height.
    """
    from arm_clearance import Space, read_space

    space = read_space(file) if file is not None else None if rig is None else rig.space
    if floor is None:
        return space
    if not -1e6 < floor < 1e6:
        raise InputError("--floor", f"must be a height in m, is {floor:g}")
    return (space or Space()).model_copy(update={"floor": floor})


def travel_of(demand: Demand) -> list[dict[str, Any]]:
    """Of a motion, per joint, as JSON: ``low`` and ``high`` rad (m), largest ``speed`` rad/s (m/s)."""
    times = np.linspace(0.0, demand.duration, max(int(100.0 * demand.duration), 2))
    q = demand(times)
    speed = np.abs(np.diff(q, axis=0)).max(axis=0) / times[1]
    return [
        {"joint": number, "low": low, "high": high, "speed": fastest}
        for number, (low, high, fastest) in enumerate(zip(q.min(axis=0), q.max(axis=0), speed), 1)
    ]


def travel_in_words(demand: Demand, arm: Arm) -> list[str]:
    """The same for a person, one line per joint."""
    units = ["rad" if joint.revolute else "m" for joint in arm.joints]
    return [
        f"joint {one['joint']}: {one['low']:.2f} to {one['high']:.2f} {unit}, at most {one['speed']:.2f} {unit}/s"
        for one, unit in zip(travel_of(demand), units)
    ]


def clearance_of(demand: Demand, chain: Chain, pairs: Pairs | None) -> dict[str, Any]:
    """Of a motion, as JSON: ``lowest`` z m that a link reaches, and what it comes nearest to, null without a space."""
    from arm_clearance import left_out, lowest_point, nearest

    closest = None if pairs is None else nearest(demand, pairs)
    return {
        "lowest": lowest_point(demand, chain),
        "least": None if closest is None else closest.clearance,
        "time": None if closest is None else closest.time,
        "between": None if closest is None else [closest.one, closest.other],
        "notes": [] if pairs is None else left_out(pairs),
    }


def clearance_in_words(demand: Demand, chain: Chain, pairs: Pairs | None) -> list[str]:
    """The same for a person, one line each."""
    from arm_clearance import in_words, left_out, lowest_point, nearest

    if pairs is None:
        lowest = lowest_point(demand, chain)
        where = f"{-lowest:.2f} m BELOW" if lowest < 0 else f"{lowest:.2f} m above"
        return [
            f"no floor and no boxes were given: links reach down to {where} z = 0 of the base frame; "
            "--floor, --space or [space] of the rig file keep them clear"
        ]
    closest = nearest(demand, pairs)
    return ([] if closest is None else [in_words(closest)]) + left_out(pairs)


def draw(path: Path, demand: Demand, chain: Chain, space: Space | None, limits: Array | None = None) -> None:
    """Writes the picture of a motion; ``limits`` (n, 2) rad (m) of position, None: the model's."""
    from arm_clearance import picture

    save_picture(picture(demand, chain, space, limits), path)
