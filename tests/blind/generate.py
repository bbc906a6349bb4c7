"""From a case to its recordings on disk, and what was really hidden; kept in a cache where there is one."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, replace
from functools import cache
from pathlib import Path

from tests.blind.cases import NOT_WEAK, Case
from tests.blind.hide import Hidden
from tests.blind.magnitude import Wanted, limit_below, scaled
from tests.blind.motions import SETS
from tests.blind.record import recorded, truth
from tests.blind.recordings import write_recording

HIDDEN = "hidden.json"


def generate(case: Case, folder: Path, most: int = 4) -> list[dict]:
    """Writes fit_K.mcap, held_out_K.mcap and, last, hidden.json into a folder; returns the hidden effects with their strengths.

    most: recordings of either side at most; the last of them are kept.
    """
    if (folder / HIDDEN).exists():
        known: list[dict] = json.loads((folder / HIDDEN).read_text(encoding="utf-8"))
        return known
    folder.mkdir(parents=True, exist_ok=True)
    fit, held_out = SETS[case.laboratory.motions](case.key[-1] + 100 * case.key[0])
    fit, held_out = fit[-most:], held_out[-most:]
    shown = [fit[0], fit[-1], held_out[-1]]
    hidden: list[Hidden] = []
    strengths: list[float] = []
    for number in range(len(case.effects)):

        def at(factor: float, number: int = number) -> Hidden:
            one = case.hidden((factor,) * len(case.effects))[number]
            if one.effect != "current_limit":
                return one
            limit = limit_below(one.parameters["share"], one.joint or 1, [*fit, *held_out], case.laboratory)
            return replace(one, parameters={"limit": limit})

        wanted = Wanted(0.0, None) if case.effects[number][0] in NOT_WEAK else case.wanted
        factor, reached = scaled(at, shown, case.laboratory, wanted)
        hidden.append(at(factor))
        strengths.append(reached)
    for side, experiments in (("fit", fit), ("held_out", held_out)):
        for number, experiment in enumerate(experiments):
            rows = recorded(
                truth(experiment, tuple(hidden), case.laboratory), case.laboratory, _seed(case, side, number)
            )
            write_recording(folder / f"{side}_{number}.mcap", rows, case.laboratory)
    told = [{**asdict(one), "parameters": dict(one.parameters), "strength": s} for one, s in zip(hidden, strengths)]
    (folder / HIDDEN).write_text(json.dumps(told), encoding="utf-8")
    return told


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
        (here / f"{n}.py").read_text(encoding="utf-8") for n in (*names, "recordings", "rigid_body", "strangers")
    )
    return hashlib.sha256(text.encode()).hexdigest()
