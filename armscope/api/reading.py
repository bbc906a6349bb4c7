"""Files and objects alike: every function of the face takes a path, or what was read from one.

A path such as ``config/models/puma560.toml`` that is not in place means the shipped file (``armscope.shipped``).
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from arm_io import InputError
from armscope.shipped import found

if TYPE_CHECKING:
    from arm_model import Arm
    from daq.recording import Recording
    from daq.rig import Rig
    from experiment import Experiment

File: TypeAlias = "str | PathLike[str]"
Source: TypeAlias = "File | Recording"
"""A recording, or the path of one."""


def open_recording(recording: Source) -> Recording:
    """A recording as numpy arrays by joint, with its ledger, gaps and attachments: ``daq.recording.Recording``.

    InputError where the file is absent, not a recording, or damaged.
    """
    from daq.recording import Recording, open_recording

    return recording if isinstance(recording, Recording) else open_recording(_path(recording, "a recording"))


def _path(given: object, what: str) -> Path:
    """The path itself. InputError where it is none: an object of another kind, in the place of ``what``."""
    if not isinstance(given, str | PathLike):
        table = "; armscope.import_table makes a recording of a table of pandas" if hasattr(given, "to_csv") else ""
        kind = type(given).__name__
        raise InputError(what, f"must be the path of one, or an object of its own kind (is {kind}){table}")
    return Path(given)


def recordings_of(sources: Source | Sequence[Source]) -> list[Recording]:
    """Recordings from one recording or path, or from several."""
    return [open_recording(source) for source in listed_sources(sources)]


def listed_sources(sources: Source | Sequence[Source]) -> list[Source]:
    """One or several, as a list. InputError where it is neither."""
    from daq.recording import Recording

    if isinstance(sources, Recording | str | PathLike):
        return [sources]
    several = isinstance(sources, Iterable) and not hasattr(sources, "to_csv")  # whose members are names of columns
    listed = list(sources) if several else [sources]
    return [one if isinstance(one, Recording) else _path(one, "a recording") for one in listed]


def for_analysis(*groups: Source | Sequence[Source], **bounds: Any) -> list[list[Recording]]:
    """``recordings_of`` each group, all of them within one bound on memory: rows of long recordings are averaged.

    ``bounds`` as ``daq.recording.open_recordings`` has them. InputError also for a recording of a floating base: the
    analyses of arms on a fixed one would blame the arm for what the base does; and for one that has less than two rows,
    as when a file was cut off before they reached the disk.
    """
    from daq.recording import Recording, open_recordings

    listed = [listed_sources(group) for group in groups]
    if not listed[0]:
        raise InputError("recordings", "is empty; give at least one")
    paths = [[Path(one) for one in group if not isinstance(one, Recording)] for group in listed]
    read = [iter(group) for group in open_recordings(*paths, **bounds)]
    groups_read = [
        [one if isinstance(one, Recording) else next(opened) for one in group] for group, opened in zip(listed, read)
    ]
    for one in (recording for group in groups_read for recording in group):
        if len(one) < 2:
            raise InputError(one.path, f"has {len(one)} rows; several seconds of motion are needed")
        if one.model is not None and _floats(one.model):
            raise InputError(one.path, "was recorded on a floating base; give its own model (docs/underwater.md)")
    _check_one_unit([recording for group in groups_read for recording in group])
    return groups_read


def _check_one_unit(recordings: Sequence[Recording]) -> None:
    """InputError where a joint has a current in one recording and a torque in another: all its parameters would differ.

    A unit that a table did not say ("drive") agrees with any. Recordings of another arm are left to what knows the arm.
    """
    if len({len(recording.layout.joints) for recording in recordings}) > 1:
        return
    first: dict[int, tuple[str, Path]] = {}
    for recording in recordings:
        for number in range(1, len(recording.layout.joints) + 1):
            unit = recording.current_unit(number)
            before, where = first.setdefault(number, (unit, recording.path)) if unit != "drive" else (unit, None)
            if unit != before:
                raise InputError(
                    recording.path,
                    f"has i{number} in {unit}, {where} has it in {before}; must be in one unit: import the table again "
                    "with --rig, by whose model torques become currents, or with a mapping with [scale] and [units]",
                )


def check_distinct(fitted: Sequence[Recording], held_out: Sequence[Recording]) -> None:
    """InputError where rows are on both sides, which validates nothing, or twice on one, where they count as new ones.

    Rows are compared as they were recorded (``daq.recording.shared_rows``): copies, parts and other formats of a file.
    """
    from daq.recording.shared_rows import overlaps

    recordings = [*fitted, *held_out]
    for pair in overlaps(recordings) if len(recordings) > 1 else []:
        one, other = recordings[pair.one].path, recordings[pair.other].path
        rows = f"{pair.share:.0%} of its rows are in {one}"
        if pair.one < len(fitted) <= pair.other:
            raise InputError(
                other,
                f"is both fitted and held out ({rows}); must be one of the two (without held-out recordings each is "
                "split by time)",
            )
        which = "held out" if pair.one >= len(fitted) else "fitted"
        raise InputError(other, f"is {which} twice ({rows}); give each recording once")


def _floats(model: str) -> bool:
    """Whether the text of a model file says that its base floats."""
    from arm_io import toml_of

    if "floating" not in model:
        return False
    try:
        base = toml_of(model, "model.toml").get("base")
    except InputError:  # XML, or damaged, which the reader reports
        return False
    return isinstance(base, dict) and base.get("kind") == "floating"


def read_model(model: File | Arm) -> Arm:
    """The arm of a model file (.toml), a URDF file (.urdf) or a MuJoCo model (.xml); docs/model.md.

    InputError where it is wrong or unphysical; of an ``Arm``, where an effect does not fit it.
    """
    from arm_model import Arm, read_model
    from arm_model.effects import check_terms

    if not isinstance(model, Arm):
        return read_model(found(_path(model, "a model")))
    check_terms(model, sizes=True)
    return model


def fixed_model(model: File | Arm, purpose: str) -> Arm:
    """``read_model``, for a ``purpose`` that takes arms on a fixed base only; InputError where the base floats."""
    from arm_model import on_fixed_base

    arm = read_model(model)
    return on_fixed_base(arm, arm.name if isinstance(model, type(arm)) else str(model), purpose)


def read_rig(rig: File | Rig) -> Rig:
    """A rig file, checked with the settings of its drivers; docs/rig-files.md.

    InputError names the entry and what would be right.
    """
    from daq.rig import Rig, read_rig

    return rig if isinstance(rig, Rig) else read_rig(found(_path(rig, "a rig")))


def read_experiment(experiment: File | Experiment) -> Experiment:
    """An experiment file: a motion and how to sample it. InputError names the entry and what would be right."""
    from experiment import Experiment, read_experiment

    if isinstance(experiment, Experiment):
        return experiment
    return read_experiment(found(_path(experiment, "an experiment")))


def note_gaps(model: File | None, *uses: str, tip: str | None = None) -> None:
    """One note on standard error for each thing that a model from elsewhere does not say and ``uses`` need.

    It says what stands in for it. uses: of ``arm_model.urdf.Use``; tip: last link or body, of a file that branches.
    """
    gaps: list[str] = []
    if model is not None and "dynamics" in uses and Path(model).suffix == ".toml":
        from arm_model import read_model

        if not any(joint.mass for joint in read_model(Path(model)).joints):
            gaps = ["no link has a mass: mass and inertia count as 0 until the file or 'armscope identify' says them"]
    elif model is not None and Path(model).suffix == ".urdf":
        from arm_model.urdf import Use, urdf_gaps

        gaps = urdf_gaps(Path(model), {Use(use) for use in uses}, tip=tip)
    elif model is not None and "dynamics" in uses and Path(model).suffix in (".xml", ".mjcf"):
        from arm_model.mjcf import mjcf_gaps

        gaps = mjcf_gaps(Path(model), tip=tip)
    for gap in gaps:
        print(f"note: {model}: {gap}", file=sys.stderr)
