"""Converts the stored results of an arm to nights with identification and diagnosis, as ``comparison`` reads them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from arm_fleet.judging.alarms import Night
from arm_fleet.tasks.store import Record, Store
from arm_fleet.tasks.task import State
from arm_io import read_file
from arm_model import Arm
from comparison import Stored

KINDS: Mapping[str, Literal["identifications", "diagnoses"]] = {
    "identification.json": "identifications",
    "diagnosis.json": "diagnoses",
}

COMPARED = (
    "schema",
    "recorded",
    "method",
    "base_parameters",
    "held_directions",
    "blocks",
    "friction_curves",
    "causes",
    "not_visible",
)
"""Entries of the results that ``comparison`` reads. The others of a large fleet would fill the memory."""


def nights_of(store: Store, records: Sequence[Record], model: Arm) -> list[Night]:
    """The nights of one arm that have results, in order.

    model  the nominal one of the arm, with whose structure its results were made
    """
    nights = []
    for record in sorted(records, key=lambda one: str(one["night"])):
        if record["state"] == State.DONE and record["night"]:
            place = store.place(record["key"])
            results = tuple(
                _stored(place / name, kind, model) for name, kind in KINDS.items() if name in record["files"]
            )
            degc = record["value"].get("temperature")
            known = None if degc is None else tuple(np.nan if one is None else float(one) for one in degc)
            nights.append(Night(night=record["night"], key=record["key"], results=results, temperature=known))
    return nights


def _stored(path: Path, kind: Literal["identifications", "diagnoses"], arm: Arm) -> Stored:
    """One result; its causes are relative to the model of the plan, whatever model is in its folder."""
    table = json.loads(read_file(path))
    return Stored(path, kind, {name: table[name] for name in COMPARED if name in table}, arm)
