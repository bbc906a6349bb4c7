"""Recordings of a floating base in, its parameters or what contradicts its model out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from armscope.api.reading import File, Source, read_model, recordings_of

if TYPE_CHECKING:
    from arm_model import Arm
    from diagnosis.floating_base import BaseDiagnosis
    from identification.floating_base import BaseIdentification


def identify_base(
    recordings: Source | Sequence[Source],
    model: File | Arm,
    *,
    held_out: Source | Sequence[Source] = (),
    progress: Callable[[str], None] = lambda _: None,
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
    progress: Callable[[str], None] = lambda _: None,
) -> BaseDiagnosis:
    """Which thrusters, water or reaction of the arm the recordings contradict; arguments as ``identify_base``."""
    arm = read_model(model)
    fitted, held = recordings_of(recordings), recordings_of(held_out)
    from diagnosis.floating_base import diagnose_base

    return diagnose_base(fitted, arm, held_out=held, progress=progress)
