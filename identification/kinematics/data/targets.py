"""Which targets several recordings and tables have in common, and where each sits on the last link.

A target is known by its name, and by its place where two of one name sit at different places: every recording may have
its own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from arm_io import InputError
from identification.kinematics.data.recordings import Place, Sighting, Tracked
from identification.kinematics.data.runs import Run
from identification.kinematics.models.parameters import UNKNOWN_TARGET, Target

Given = Mapping[str, Place | None]
"""Places that a person states (None: unknown), by name of the target or of the file; "": of all."""

_FARTHEST = 10.0
"""m from the last link's frame, beyond which a target is taken for one in mm."""


@dataclass(frozen=True)
class CommonTargets:
    """Recordings that belong together: their targets, and the runs of each recording numbered through these."""

    frame_known: bool
    targets: tuple[Target, ...]
    runs: tuple[tuple[Run, ...], ...]


def common_targets(tracked: Sequence[Tracked], given: Given, std: float, fitted: int) -> CommonTargets:
    """The targets of recordings that belong together, the first ``fitted`` of which are fitted.

    std m, of the places that are known. InputError where the points are in different frames, ``given`` names what is
    not there, nothing says where a held-out target sits, or a place is too far away to be in m.
    """
    first = tracked[0]
    for other in tracked[1:]:
        if other.frame_known != first.frame_known:
            raise InputError(
                other.run.source,
                f"has its points in another frame than {first.run.source}; all recordings must be of one kind of rig",
            )
    stated = [_stated(one, given) for one in tracked]
    _check_names(tracked, given)
    _check_places(tracked, stated)
    found: list[Sighting] = []
    numbers = [[_number(found, sighting) for sighting in sightings] for sightings in stated]
    seen = {number for of in numbers[:fitted] for number in of}
    for one, of in zip(tracked, numbers, strict=True):
        if blind := [number for number in of if number not in seen and found[number].place is None]:
            name = found[blind[0]].name
            raise InputError(
                one.run.source,
                f"its target{name and ' ' + name} is in no fitted recording and has no known position; give --target "
                f"{name or one.run.source}=X,Y,Z, or a fitted recording with it",
            )
    targets = tuple(
        Target(one.place or (0.0, 0.0, 0.0), UNKNOWN_TARGET if one.place is None else std, one.oriented, name)
        for one, name in zip(found, _names(found), strict=True)
    )
    sources = [one.run.source for one in tracked]
    runs = tuple(
        tuple(
            replace(
                run,
                target=of[run.target],
                recorded=run.source if sources.count(run.source) == 1 else f"{run.source} ({k + 1})",
            )
            for run in one.runs
        )
        for k, (one, of) in enumerate(zip(tracked, numbers, strict=True))
    )
    return CommonTargets(first.frame_known, targets, runs)


def _stated(one: Tracked, given: Given) -> list[Sighting]:
    """The targets of one recording with what ``given`` says of them; by file: a target of its own."""
    out = []
    for sighting in one.targets:
        if one.run.source in given:
            if len(one.targets) > 1:
                raise InputError(
                    "--target", f"{one.run.source} has {len(one.targets)} reflectors; give NAME=X,Y,Z for each of them"
                )
            out.append(replace(sighting, name=one.run.source, place=given[one.run.source]))
        elif sighting.name in given:
            out.append(replace(sighting, place=given[sighting.name]))
        else:
            out.append(sighting)
    return out


def _check_names(tracked: Sequence[Tracked], given: Given) -> None:
    names = list(dict.fromkeys(s.name for one in tracked for s in one.targets))
    files = [one.run.source for one in tracked]
    for name in given:
        if name and name not in names and name not in files:
            there = ", ".join(repr(n) for n in [*filter(None, names), *files])
            raise InputError("--target", f"{name!r} is neither a reflector nor a file of these: {there}")
    if "" in given and "" not in names:
        raise InputError(
            "--target",
            f"there are {len(names)} reflectors ({', '.join(names)}); give NAME=X,Y,Z for each that is known",
        )


def _check_places(tracked: Sequence[Tracked], stated: Sequence[Sequence[Sighting]]) -> None:
    for one, of in zip(tracked, stated, strict=True):
        for sighting in of:
            if sighting.place is not None and math.hypot(*sighting.place) > _FARTHEST:
                place = ", ".join(f"{v:g}" for v in sighting.place)
                raise InputError(
                    one.run.source,
                    f"the target{sighting.name and ' ' + sighting.name} is given at ({place}) m, more than "
                    f"{_FARTHEST:g} m from the frame of the last link; must be in m, not in mm",
                )


def _number(found: list[Sighting], sighting: Sighting) -> int:
    """The number of a target among those found so far; it is added where it is new."""
    for number, one in enumerate(found):
        if one.name == sighting.name and (one.place == sighting.place or None in (one.place, sighting.place)):
            oriented = one.oriented or sighting.oriented
            found[number] = replace(one, place=one.place or sighting.place, oriented=oriented)
            return number
    found.append(sighting)
    return len(found) - 1


def _names(found: Sequence[Sighting]) -> list[str]:
    """Their names; those that two share, or that have none among several, are numbered."""
    if len(found) == 1:
        return [found[0].name]
    names = [one.name for one in found]
    return [name if name and names.count(name) == 1 else f"{name}#{k + 1}" for k, name in enumerate(names)]
