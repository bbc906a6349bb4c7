"""From a case to its recordings on disk, and what was really hidden; kept in a cache where there is one."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, replace
from functools import cache
from pathlib import Path

import numpy as np

from experiment import Experiment
from tests.blind.cases import NOT_WEAK, Case
from tests.blind.hide import Hidden
from tests.blind.laboratory import Laboratory, laboratory
from tests.blind.magnitude import Wanted, limit_below, scaled
from tests.blind.motions import SETS
from tests.blind.record import recorded, truth
from tests.blind.recordings import write_recording

HIDDEN = "hidden.json"
GROWN = 3.0
"""Times what was drawn that an effect may be made: a gap of three degrees that no load ever turns over is no case."""
LABORATORIES = 8
"""Drawn one after the other until their motions show what is hidden."""

Strong = list[tuple[Hidden, float]]


def generate(case: Case, folder: Path, most: int = 4) -> tuple[Laboratory, list[dict]]:
    """Writes fit_K.mcap, held_out_K.mcap and, last, hidden.json into a folder.

    Returns whose arm it is and the hidden effects with their strengths.

    most: recordings of either side at most; the last of them are kept.
    """
    if (folder / HIDDEN).exists():
        known = json.loads((folder / HIDDEN).read_text(encoding="utf-8"))
        return Laboratory(**known["laboratory"]), known["hidden"]
    folder.mkdir(parents=True, exist_ok=True)
    case, sides, strong = _shown(case, most)
    hidden = tuple(one for one, _ in strong)
    for side, experiments in sides.items():
        for number, experiment in enumerate(experiments):
            rows = recorded(truth(experiment, hidden, case.laboratory), case.laboratory, _seed(case, side, number))
            write_recording(folder / f"{side}_{number}.mcap", rows, case.laboratory)
    described = [{**asdict(one), "parameters": dict(one.parameters), "strength": strength} for one, strength in strong]
    text = json.dumps({"laboratory": asdict(case.laboratory), "hidden": described})
    (folder / HIDDEN).write_text(text, encoding="utf-8")
    return case.laboratory, described


def _shown(case: Case, most: int) -> tuple[Case, dict[str, list[Experiment]], Strong]:
    """The case at the first of several laboratories whose motions show every effect.

    The motions of both sides, and the effects.
    """
    best: tuple[float, Case, dict[str, list[Experiment]], Strong] | None = None
    for number in range(LABORATORIES):
        there = replace(case, laboratory=laboratory(_seed(case, "laboratory", number))) if number else case
        fit, held_out = SETS[there.laboratory.motions](case.key[-1] + 100 * case.key[0])
        sides = {"fit": list(fit[-most:]), "held_out": list(held_out[-most:])}
        strong = [_scaled(there, which, sides) for which in range(len(case.effects))]
        weakest = min((s for (name, _), (_, s) in zip(case.effects, strong) if name not in NOT_WEAK), default=np.inf)
        if best is None or weakest > best[0]:
            best = weakest, there, sides, strong
        if weakest > 0.9 * case.wanted.least:
            break
    assert best is not None
    return best[1:]


def _scaled(case: Case, number: int, sides: dict[str, list[Experiment]]) -> tuple[Hidden, float]:
    """One effect of the case at the required strength, and its strength over the noise."""
    fit, held_out = sides.values()

    def at(factor: float) -> Hidden:
        one = case.hidden((factor,) * len(case.effects))[number]
        if one.effect != "current_limit":
            return one
        limit = limit_below(one.parameters["share"], one.joint or 1, [*fit, *held_out], case.laboratory)
        return replace(one, parameters={"limit": limit})

    wanted = Wanted(0.0, None) if case.effects[number][0] in NOT_WEAK else case.wanted
    factor, reached = scaled(at, [fit[0], fit[-1], held_out[-1]], case.laboratory, wanted, GROWN)
    return at(factor), reached


def cache_name(case: Case) -> str:
    """Changes with the case and with the generator."""
    return hashlib.sha256(f"{case!r} {_version()}".encode()).hexdigest()[:16]


def _seed(case: Case, side: str, number: int) -> int:
    return int(hashlib.sha256(f"{case.key} {side} {number}".encode()).hexdigest()[:8], 16)


@cache
def _version() -> str:
    """Hash of what makes the data; neither the scores nor the finder are in it."""
    names = ("cases", "generate", "hide", "instruments", "laboratory", "magnitude", "motions", "plant", "record")
    here = Path(__file__).parent
    text = "".join(
        (here / f"{n}.py").read_text(encoding="utf-8") for n in (*names, "recordings", "rigid_body", "unmodelled")
    )
    return hashlib.sha256(text.encode()).hexdigest()
