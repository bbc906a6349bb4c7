"""What a MuJoCo model has beside the arm that is read from it."""

from __future__ import annotations

from pathlib import Path

from arm_model.branches import counted_as_fixed
from arm_model.mjcf.reading import read_reading


def mjcf_gaps(path: str | Path, *, tip: str | None = None) -> list[str]:
    """A sentence on the joints beside the chain to ``tip`` that count as fixed, if there are any.

    InputError as ``read_mjcf``, which must have read the file before.
    """
    reading = read_reading(path, tip=tip)
    hung = [one for one in reading.bodies if one.moves]
    names = [joint.name for one in hung for joint in one.node.all("joint")]
    if not names:
        return []
    return [counted_as_fixed(names, reading.end, sum(float(one.parameters[0]) for one in hung))]
