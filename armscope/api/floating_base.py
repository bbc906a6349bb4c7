"""Recordings of a floating base in, its parameters or what contradicts its model out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from arm_io import InputError
from arm_io.progress import silent
from armscope.api.reading import File, Source, read_model, recordings_of

if TYPE_CHECKING:
    from arm_model import Arm
    from diagnosis.floating_base import BaseDiagnosis
    from identification import BaseIdentification


def floats(model: File | Arm) -> bool:
    """Whether the base of a model floats; InputError where the file is wrong."""
    return read_model(model).floating is not None


def refuse(model: File, options: Mapping[str, bool]) -> None:
    """InputError for the first given option that does not apply to a floating base."""
    for option, given in options.items():
        if given:
            raise InputError(option, f"is for arms on a fixed base; {model} has a floating one")


def identify_base(
    recordings: Source | Sequence[Source],
    model: File | Arm,
    *,
    held_out: Source | Sequence[Source] = (),
    progress: Callable[[str], None] = silent,
) -> BaseIdentification:
    """Thruster gains, added mass, drag and buoyancy of a floating base with deviations, from its recorded motion.

    recordings  to fit, with the columns base_x .. base_qz and thruster1 .. (docs/underwater.md)
    model       masses, arm and thrusters, and the values to start from
    held_out    to validate; without any the last part of each fitted recording is predicted from the first
    Raises InputError where the base is fixed, or a recording lacks a column.
    """
    arm = read_model(model)
    fitted, held = recordings_of(recordings), recordings_of(held_out)
    from identification.floating_base import identify_base

    return identify_base(fitted, arm, held_out=held, progress=progress)


def diagnose_base(
    recordings: Source | Sequence[Source],
    model: File | Arm,
    *,
    held_out: Source | Sequence[Source] = (),
    progress: Callable[[str], None] = silent,
) -> BaseDiagnosis:
    """Which thrusters, water or reaction of the arm the recordings contradict; arguments as ``identify_base``."""
    arm = read_model(model)
    fitted, held = recordings_of(recordings), recordings_of(held_out)
    from diagnosis.floating_base import diagnose_base

    return diagnose_base(fitted, arm, held_out=held, progress=progress)
