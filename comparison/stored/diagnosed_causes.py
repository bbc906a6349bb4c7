"""The causes of diagnoses as quantities: matched by effect and joint, absent ones as zero where that means absence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from arm_io import InputError
from arm_model.effects import CATALOGUE, Effect
from comparison.change import Quantity
from diagnosis import in_words

Key = tuple[str, int | None]
"""Effect and joint (from 1, None for the whole arm)."""
Entry = tuple[float, float | None, str]
"""Value, standard deviation and unit."""


def causes_of(path: Path, table: Mapping[str, Any]) -> dict[Key, dict[str, Entry]]:
    """(effect, joint) -> parameter -> value, std, unit. InputError where the file has another layout."""
    causes: dict[Key, dict[str, Entry]] = {}
    try:
        for cause in table["causes"]:
            entries: dict[str, Entry] = {}
            for name, one in cause["parameters"].items():
                std = one["std"]
                entries[str(name)] = (float(one["value"]), None if std is None else float(std), str(one["unit"]))
            joint = cause["joint"]
            causes[str(cause["effect"]), None if joint is None else int(joint)] = entries
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(path, f"causes: {error} is missing or of another kind") from None
    return causes


def size_parameters(effect: str) -> tuple[str, ...]:
    """Parameters whose zero means that the effect is absent; () of an effect without (a stiffness, a row)."""
    definition: Effect | None = CATALOGUE.get(effect)
    if definition is None:
        return ()
    linear = tuple(p.name for p in definition.linear if not p.inverse)
    if linear or definition.linear:
        return linear
    return tuple(p.name for p in definition.parameters[:1] if not p.inverse and not p.whole)


def align(
    paths: Sequence[Path], tables: Sequence[Mapping[str, Any]], before: int
) -> tuple[list[Quantity], list[dict[str, Entry]]]:
    """Quantities of all causes of several diagnoses, and the entries of each diagnosis by name of the quantity.

    before  so many of them, the first ones, are the side before
    """
    quantities, entries, whys = entries_of(paths, tables)
    aligned = []
    for quantity, why in zip(quantities, whys):
        missing = [all(quantity.name not in one for one in side) for side in (entries[:before], entries[before:])]
        aligned.append(quantity.not_comparable(why) if any(missing) else quantity)
    return aligned, entries


def entries_of(
    paths: Sequence[Path], tables: Sequence[Mapping[str, Any]]
) -> tuple[list[Quantity], list[dict[str, Entry]], list[str]]:
    """Quantities of all causes, the entries of each diagnosis by name, and why a diagnosis has none ("": it has).

    A cause that a diagnosis does not name counts as zero there, if its absence means zero.
    """
    causes = [causes_of(path, table) for path, table in zip(paths, tables)]
    quantities: list[Quantity] = []
    whys: list[str] = []
    entries: list[dict[str, Entry]] = [{} for _ in causes]
    for key in dict.fromkeys(key for one in causes for key in one):
        names = dict.fromkeys(name for one in causes if key in one for name in one[key])
        for name in names:
            values = [cause.get(key, {}).get(name) for cause in causes]
            quantity = _quantity(key, name, next(entry for entry in values if entry is not None)[2])
            stds = [entry[1] for entry in values if entry is not None and entry[1] is not None]
            absent = (0.0, float(np.sqrt(np.mean(np.square(stds)))) if stds else None, quantity.unit)
            missing = ["" if entry else _why_missing(key, name, table) for entry, table in zip(values, tables)]
            for named, entry, why in zip(entries, values, missing):
                if not why:
                    named[quantity.name] = entry or absent
            quantities.append(quantity)
            whys.append(next((f"{why} in {path}" for why, path in zip(missing, paths) if why), ""))
    return quantities, entries, whys


def _why_missing(key: Key, name: str, table: Mapping[str, Any]) -> str:
    """Why a parameter of a cause that a diagnosis does not name is unknown there; "" where it is zero."""
    reason = _blind(table, key)
    return reason or ("" if name in size_parameters(key[0]) else f"{in_words(key)} is not named")


def cause_sentences(
    paths: Sequence[Path], tables: Sequence[Mapping[str, Any]], before: int, significant: Sequence[str]
) -> list[str]:
    """Which causes one side names and the other does not; ``significant``: names of quantities that changed."""
    causes = [causes_of(path, table) for path, table in zip(paths, tables)]
    sentences = []
    for key in dict.fromkeys(key for one in causes for key in one):
        has_cause = [key in cause for cause in causes]
        earlier, later = any(has_cause[:before]), any(has_cause[before:])
        if earlier == later:
            continue
        absent = tables[:before] if later else tables[before:]
        reason = next(filter(None, (_blind(table, key) for table in absent)), "")
        verb = "appeared" if later else "vanished"
        sized = [_quantity(key, name, "").name for name in size_parameters(key[0])]
        sure = any(name in significant for name in sized)
        note = f", but it is {reason} there" if reason else "" if sure or not sized else ", not significantly"
        sentences.append(f"Cause {verb}: {in_words(key)}{note}")
    return sentences


def _blind(table: Mapping[str, Any], key: Key) -> str:
    """Why a diagnosis that does not name a cause says nothing against it; "" where it does."""
    for one in table.get("not_visible") or ():
        if one.get("effect") == key[0] and one.get("joint") in (key[1], None):
            return "not detectable"
    for cause in table.get("causes") or ():
        for member in cause.get("group") or ():
            if (member.get("effect"), member.get("joint")) == key:
                return f"indistinguishable from {in_words((cause['effect'], cause['joint']))}"
    return ""


def _quantity(key: Key, name: str, unit: str) -> Quantity:
    effect, joint = key
    head = "" if joint is None else f"joint{joint}."
    return Quantity(
        name=f"{head}{effect}.{name}",
        words=f"{name.replace('_', ' ')} of {in_words(key)}",
        unit=unit,
        kind="cause",
        joint=joint,
    )
