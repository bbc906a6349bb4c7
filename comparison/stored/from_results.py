"""Stored results of two sides -> changes: identification.json and diagnosis.json, as armscope writes them."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from arm_io import InputError, read_text
from arm_io.plain_data import check_plain
from arm_model import Arm, read_model
from comparison.change import Estimate, Quantity
from comparison.friction_drift import assumed
from comparison.outcome import Comparison
from comparison.significance import changes
from comparison.stored.diagnosed_causes import Entry, align, cause_sentences, entries_of
from comparison.stored.drift import stored_drift
from comparison.stored.identified_friction import curved_joints, friction_points, is_replaced
from comparison.wording import parameter_quantity
from identification.regression.uncertainty import LEAST_BLOCKS, student_factor

SCHEMAS: Mapping[str, Literal["identifications", "diagnoses"]] = {
    "armscope.identification/1": "identifications",
    "armscope.diagnosis/1": "diagnoses",
}
PRETEST = 5.0**0.5
"""Largest rms error of a direction that is kept at the model's value within three deviations, over one deviation.

Where an identification held directions (``identification.regression.weak_directions``), one side may have held what
the other estimated; the files do not say which.
"""
ROUNDING = 1e-9
"""Difference, absolute and relative, up to which two numbers of model files are equal."""
STRUCTURE = ("theta", "d", "a", "alpha", "beta", "xyz", "rpy", "axis", "gear", "torque_constant")
NOMINAL = ("mass", "com", "inertia", "rotor_inertia", "viscous", "coulomb", "offset")


@dataclass(frozen=True)
class Stored:
    """One result: the file, what it is, its content, and the model beside it (None: there is no model.toml)."""

    path: Path
    what: Literal["identifications", "diagnoses"]
    table: dict[str, Any]
    arm: Arm | None


def read_result(path: Path) -> Stored:
    """identification.json or diagnosis.json, or the folder that holds one; InputError where it is none of them."""
    if path.is_dir():
        files = [path / name for name in ("identification.json", "diagnosis.json") if (path / name).is_file()]
        if not files:
            raise InputError(path, "holds no identification.json, no diagnosis.json and no recording (*.mcap)")
        path = files[0]
    try:
        table = json.loads(read_text(path))
    except (ValueError, RecursionError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(path, f"is no JSON: {error}") from None
    schema = table.get("schema") if isinstance(table, dict) else None
    if not isinstance(schema, str) or schema not in SCHEMAS:
        raise InputError(path, f"is no result of identify or diagnose (schema {schema!r}); {' or '.join(SCHEMAS)} is")
    check_plain(path, table)
    model = path.parent / "model.toml"
    return Stored(path, SCHEMAS[schema], table, read_model(model) if model.is_file() else None)


def compare_results(before: Sequence[Stored], after: Sequence[Stored]) -> Comparison:
    """What changed between the results of two sides.

    InputError where they are of different kinds, were made with models of different structure, or have no quantity in
    common.
    """
    everything, side = [*before, *after], len(before)
    check_together(everything)
    kind = everything[0].what
    paths, tables = [one.path for one in everything], [one.table for one in everything]
    aligned = align(paths, tables, side) if kind == "diagnoses" else _align_identified(everything, side)
    quantities, entries = aligned
    estimates = [estimate_of(one, quantities, mine) for one, mine in zip(everything, entries)]
    drift = stored_drift(tables, everything[0].arm, quantities, estimates, side)
    changed = changes(quantities, estimates[:side], estimates[side:], drift)
    causes: list[str] = []
    if kind == "diagnoses":
        significant = [one.quantity.name for one in changed if one.significant]
        causes = cause_sentences(paths, tables, side, significant)
    return Comparison(
        what=kind,
        arm=everything[0].arm,
        before=tuple(str(one.path) for one in before),
        after=tuple(str(one.path) for one in after),
        changes=changed,
        causes=causes,
        assumptions=[assumed(len(everything), kind)] if drift.any() else [],
        warnings=[
            f"{one.path} keeps weakly excited directions at the model's values: its deviations count "
            f"{PRETEST:.1f}-fold; compare the recordings for a sharper answer"
            for one in everything
            if _holds_directions(one.table)
        ],
    )


def check_together(results: Sequence[Stored]) -> None:
    """InputError where results are of different kinds, one is given twice, or their models differ in structure."""
    first = results[0]
    for one in results[1:]:
        if one.what != first.what:
            raise InputError(
                one.path, f"is one of {one.what}, {first.path} one of {first.what}; compare results of one kind"
            )
        if one.arm is None or first.arm is None:
            continue
        if difference := structural_difference(first.arm, one.arm, nominal=one.what == "diagnoses"):
            raise InputError(
                one.path,
                f"was made with a model of another structure than {first.path}: {difference}; compare the recordings "
                "instead, with one --model",
            )
    paths = [result.path.resolve() for result in results]
    for k, path in enumerate(paths):
        if path in paths[:k]:
            raise InputError(results[k].path, "is given twice; must differ from the others")


def structural_difference(one: Arm, other: Arm, *, nominal: bool) -> str:
    """In what two models differ on which base parameters and their units depend; "" for nothing.

    nominal  True: friction and inertial parameters count too, to which the causes of a diagnosis are relative; of
             identified models they are the result, and may differ
    """
    if len(one) != len(other):
        return f"{len(one)} and {len(other)} joints"
    if not np.allclose(one.gravity, other.gravity):
        return f"gravity {one.gravity} and {other.gravity}"
    for number, (joint, other_joint) in enumerate(zip(one.joints, other.joints), 1):
        for name in ("type", "convention"):
            if getattr(joint, name) != getattr(other_joint, name):
                return f"{name} of joint {number} is {getattr(joint, name)} and {getattr(other_joint, name)}"
        for name in (*STRUCTURE, *(NOMINAL if nominal else ())):
            if not np.allclose(getattr(joint, name), getattr(other_joint, name), rtol=ROUNDING, atol=ROUNDING):
                return f"{name} of joint {number} is {getattr(joint, name)} and {getattr(other_joint, name)}"
        if nominal and joint.friction_curve != other_joint.friction_curve:
            return f"friction_curve of joint {number} differs"
    return ""


def _identified(result: Stored) -> dict[str, Entry]:
    """Base parameters of an identification that have a deviation. InputError for any other layout."""
    entries: dict[str, Entry] = {}
    try:
        for entry in result.table["base_parameters"]:
            if entry["value"] is not None and entry["std"]:
                entries[str(entry["expression"])] = (float(entry["value"]), float(entry["std"]), str(entry["unit"]))
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(result.path, f"base_parameters: {error} is missing or of another kind") from None
    if not entries:
        raise InputError(result.path, "holds no base parameter with a standard deviation")
    return entries


def identified_entries(results: Sequence[Stored]) -> tuple[list[Quantity], list[dict[str, Entry]]]:
    """The union of all base parameters, and what each result says of them; of friction curves at common speeds."""
    entries, tables = [_identified(result) for result in results], [result.table for result in results]
    arm, curved = results[0].arm, curved_joints(tables)
    points, known = list[Quantity](), [dict[str, Entry]() for _ in results]
    if arm is not None and curved:
        points, known = friction_points(arm, tables, curved)
        entries = [{name: e for name, e in entry.items() if not is_replaced(name, curved)} for entry in entries]
    names = dict.fromkeys(name for one in entries for name in one)
    units = {name: next(entry[name][2] for entry in entries if name in entry) for name in names}
    quantities = [parameter_quantity(name, unit) for name, unit in units.items()]
    return [*quantities, *points], [entry | more for entry, more in zip(entries, known)]


def _align_identified(results: Sequence[Stored], before: int) -> tuple[list[Quantity], list[dict[str, Entry]]]:
    """The union of all base parameters, with the reason where a side lacks one, and what each result says of them."""
    union, entries = identified_entries(results)
    quantities = []
    for quantity in union:
        name = quantity.name
        absent = [str(result.path) for result, known in zip(results, entries) if name not in known]
        missing = [all(name not in one for one in side) for side in (entries[:before], entries[before:])]
        quantities.append(
            quantity.not_comparable(f"not identified in {', '.join(absent)}") if any(missing) else quantity
        )
    if all(quantity.why for quantity in quantities):
        raise InputError(
            results[-1].path,
            f"shares no base parameter with {results[0].path}: their models differ; compare the recordings instead, "
            "with one --model",
        )
    return quantities, entries


def _holds_directions(table: Mapping[str, Any]) -> bool:
    """Whether an identification kept directions at the model's values; of a file that does not say, that it may."""
    return table.get("method") in ("wls", "irls") and table.get("held_directions", True) != 0


def _freedom(table: Mapping[str, Any]) -> float:
    """Degrees of freedom of stored deviations; of a file that does not say on how many blocks they rest, the least."""
    blocks = table.get("blocks")
    return float(max(blocks, 2) - 1 if isinstance(blocks, int) else LEAST_BLOCKS - 1)


def estimates_of(results: Sequence[Stored]) -> tuple[list[Quantity], list[Estimate]]:
    """All quantities of results of one kind, and what each result says of them. InputError for another layout."""
    if results[0].what == "diagnoses":
        quantities, entries, _ = entries_of([result.path for result in results], [result.table for result in results])
    else:
        quantities, entries = identified_entries(results)
    return quantities, [estimate_of(result, quantities, known) for result, known in zip(results, entries)]


def estimate_of(result: Stored, quantities: Sequence[Quantity], entries: Mapping[str, Entry]) -> Estimate:
    """What a result says of some quantities; NaN where it has no entry, or no deviation."""
    nothing: Entry = (math.nan, None, "")
    shown = [entries.get(quantity.name, nothing) for quantity in quantities]
    values = np.array([entry[0] for entry in shown])
    std = np.array([entry[1] or math.nan for entry in shown])
    if _holds_directions(result.table):
        std = PRETEST * std
    freedom = _freedom(result.table)
    return Estimate(source=str(result.path), values=values, std=std, raw=std / student_factor(freedom), freedom=freedom)
