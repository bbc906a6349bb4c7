"""Two recordings, results, or groups of them in; what changed in the arm out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, TypeAlias

from arm_io import InputError
from arm_io.progress import silent
from armscope.api.reading import File, Source, fixed_model, for_analysis

if TYPE_CHECKING:
    from arm_model import Arm
    from armscope.api.diagnosis import Diagnosis
    from comparison import Comparison, Stored
    from daq.recording import Recording
    from identification import Identification

Comparable: TypeAlias = "Source | Identification | Diagnosis"
"""A recording (.mcap, .csv), an identification or a diagnosis: as an object, a file, or the folder of the result."""


def compare(
    before: Comparable | Sequence[Comparable],
    after: Comparable | Sequence[Comparable],
    model: File | Arm | None = None,
    *,
    progress: Callable[[str], None] = silent,
) -> Comparison:
    """What changed in an arm between two recordings, identifications or diagnoses, or two groups of one kind.

    before, after  one or several: objects, files, folders of results, or a folder of recordings (every .mcap in it)
    model          of the arm, for recordings; None: the one that the recordings carry
    Raises InputError where the two sides are of different kinds, share a file, or belong to different arms or models.
    """
    sides = [_expanded(side, where) for side, where in ((before, "before"), (after, "after"))]
    everything = [one for side in sides for one in side]
    stored = [_is_result(one) for one in everything]
    if any(stored) and not all(stored):
        one, other = everything[stored.index(True)], everything[stored.index(False)]
        raise InputError(_name(one), f"is a result, {_name(other)} is a recording; compare two of one kind")
    if all(stored):
        if model is not None:
            raise InputError("--model", "is for recordings; results contain the models with which they were made")
        from comparison import compare_results

        return compare_results(*([stored_result(one) for one in side] for side in sides))
    opened = for_analysis(*([_recording(one) for one in side] for side in sides))
    arm = _carried([*opened[0], *opened[1]]) if model is None else fixed_model(model, "'armscope compare'")
    from comparison import compare_recordings

    return compare_recordings(opened[0], opened[1], arm, progress=progress)


def _expanded(side: Comparable | Sequence[Comparable], where: str) -> list[Comparable]:
    """The members of a group: a folder without a result stands for its recordings. InputError if there are none."""
    members = list(side) if isinstance(side, Sequence) and not isinstance(side, str) else [side]
    paths: list[Comparable] = []
    for one in members:
        folder = Path(one) if isinstance(one, str | PathLike) else None
        if folder is not None and folder.is_dir() and not _holds_result(folder):
            inside = sorted(folder.glob("*.mcap"))
            if not inside:
                raise InputError(folder, "holds no identification.json, no diagnosis.json and no recording (*.mcap)")
            paths += inside
        else:
            paths.append(one)
    if not paths:
        raise InputError(f"--{where}", "is empty; give at least one recording or result")
    return paths


def _holds_result(folder: Path) -> bool:
    return any((folder / name).is_file() for name in ("identification.json", "diagnosis.json"))


def _is_result(one: Comparable) -> bool:
    if isinstance(one, str | PathLike):
        return Path(one).is_dir() or Path(one).suffix == ".json"
    from armscope.api.diagnosis import Diagnosis
    from daq.recording import Recording
    from identification import Identification

    if not isinstance(one, Recording | Identification | Diagnosis):
        raise InputError("compare", f"takes recordings and results, as paths or objects (is {type(one).__name__})")
    return not isinstance(one, Recording)


def _name(one: Comparable) -> str:
    if isinstance(one, str | PathLike):
        return str(one)
    path = getattr(one, "path", None)
    return repr(one) if path is None else str(path)


def stored_result(one: Comparable) -> Stored:
    """An identification or a diagnosis, an object or a file, with its content and model."""
    from comparison import Stored, read_result

    if isinstance(one, str | PathLike):
        return read_result(Path(one))
    from armscope.api.diagnosis import Diagnosis
    from identification import Identification

    if isinstance(one, Diagnosis):
        name = ", ".join(recording.path.name for recording in one.fit)
        return Stored(Path(f"diagnosis of {name}"), "diagnoses", one.to_json(), one.extended)
    if not isinstance(one, Identification):
        what = "a result"
        raise InputError(what, f"must be an identification or a diagnosis, or its path (is {type(one).__name__})")
    name = ", ".join(Path(path).name for path in one.fit)
    return Stored(Path(f"identification of {name}"), "identifications", one.to_json(), one.arm)


def _recording(one: Comparable) -> Source:
    """A table is read as the recording that ``import`` would make of it."""
    if not isinstance(one, str | PathLike) or Path(one).suffix.lower() != ".csv":
        return one  # type: ignore[return-value]
    from daq.recording import Attachments, open_recording, read_csv, write_table

    table = read_csv(Path(one))
    with TemporaryDirectory() as folder:
        file = Path(folder, "table.mcap")
        signals = table.signals if table.xyz is None else {**table.signals, "xyz": table.xyz}
        write_table(file, table.t, signals, Attachments())
        return replace(open_recording(file), path=Path(one))


def _carried(recordings: Sequence[Recording]) -> Arm:
    """The model that all recordings carry. InputError where one carries none, or two differ."""
    from arm_model import carried_arm, on_fixed_base

    first = recordings[0]
    for one in recordings:
        if one.model is None:
            raise InputError("--model", f"is missing: {one.path} contains no model")
        if one.model != first.model:
            raise InputError("--model", f"is missing: {first.path} and {one.path} contain different models")
    assert first.model is not None
    where = f"{first.path}: model.toml"
    return on_fixed_base(carried_arm(first.model, where), where, "'armscope compare'")
