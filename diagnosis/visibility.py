"""What this data could not have shown, whatever is wrong, and which experiment would."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from arm_model.description import Arm
from arm_model.effects import CATALOGUE
from diagnosis.candidates import Candidate
from diagnosis.library import Side
from diagnosis.selection import Accepted, Key, Pair

OUT_OF_SPAN = 0.02
"""Survival below which an effect is in the span of what is already in the model."""


RAW = ("mains_hum", "missed_counts", "current_limit", "wrist_coupling")
"""Effects that raw rows show, whatever the model."""
TRACKED = ("link_geometry", "link_sag", "tracker_latency", "tracker_outliers")
"""Effects that only tracked points show."""
BY_ENCODERS = ("time_skew", "backlash", "joint_compliance", "gear_ripple", "encoder_ripple", "joint_zero_offset")
"""Effects that two encoders of a joint show without currents."""


@dataclass(frozen=True)
class Invisible:
    """An effect that the recordings cannot show: why, and the experiment that would."""

    effect: str
    joint: int | None
    why: str
    experiment: str


def not_visible(
    library: Mapping[Candidate, Pair], held_out: Side, accepted: Accepted, named: set[Key], arm: Arm
) -> list[Invisible]:
    """Effects whose largest typical magnitude changes the held-out currents by less than a third of the noise."""
    strongest: dict[Key, float] = {}
    for candidate, (_, columns) in library.items():
        scale = _typical(candidate)
        power = float(np.max(np.mean((columns.x * scale) ** 2, axis=0))) * len(columns.x) / held_out.rows
        strongest[candidate.key] = max(strongest.get(candidate.key, 0.0), power)
    found = []
    for (effect, joint), power in strongest.items():
        if power < 0.1 and (effect, joint) not in named:
            where = f"joint {joint}" if joint else "the arm"
            why = f"even {_size(effect)} would change the currents of {where} by {np.sqrt(power):.2g} times the noise only"
            separated = next(iter(CATALOGUE[effect].confused_with.values()), "a motion that excites this joint")
            found.append(Invisible(effect, joint, why, separated))
    return found


def not_judged(arm: Arm, of_links: Sequence[int]) -> list[Invisible]:
    """What currents would show, of a model that expects none; less what the two encoders of the joints ``of_links`` show without currents."""
    why, instead = (
        "the model has neither masses nor friction to hold currents against",
        "armscope identify, then diagnose with its model",
    )
    found = []
    for effect, definition in CATALOGUE.items():
        if effect in RAW or effect in TRACKED:
            continue
        joints = [j for j in range(1, len(arm) + 1) if effect not in BY_ENCODERS or j not in of_links]
        if definition.per_joint:
            found += [Invisible(effect, joint, why, instead) for joint in joints]
        elif effect not in BY_ENCODERS or not of_links:
            found.append(Invisible(effect, None, why, instead))
    return found


def _typical(candidate: Candidate) -> float:
    """Largest typical magnitude of the first linear parameter; what a coefficient of 1 means otherwise."""
    effect = candidate.definition
    if effect.name == "joint_compliance":
        low = next(p.typical[0] for p in effect.parameters if p.name == "stiffness")
        return dict(candidate.shape)["stiffness"] / low
    if effect.delay is not None:
        return effect.parameters[0].typical[1]
    return effect.linear[0].typical[1] if effect.linear else 1.0


def _size(effect: str) -> str:
    definition = CATALOGUE[effect]
    parameter = (definition.linear or definition.parameters)[0]
    value = parameter.typical[0] if effect == "joint_compliance" else parameter.typical[1]
    unit = "" if parameter.unit == "1" else f" {parameter.unit}"
    return f"{parameter.name.replace('_', ' ')} of {value:g}{unit}"
