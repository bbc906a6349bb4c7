"""Residuals above the noise in the fitted recordings alone: no held-out one shows on what they depend."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from arm_io.types import Array
from diagnosis.cause import Signal, Structure
from diagnosis.cause.structure import NO_VARIABLE
from diagnosis.measurements.currents.state import State
from diagnosis.measurements.currents.structure.likely_variable import likely_variable
from diagnosis.measurements.currents.structure.noise_ratio import largest_of_noise, noise_ratio
from diagnosis.selection.design import Dataset
from diagnosis.selection.waves import wave_of
from identification import recorded_quantity


def in_fit_alone(state: State, structures: Sequence[Structure]) -> list[Structure]:
    """``structures_of_fit`` of what a search leaves."""

    def variable_of(joint: int) -> str | None:
        likely = likely_variable(state.data, state.residual, state.model.arm, joint)
        return None if likely is None else likely.variable

    allowed = state.significance.allowed.fit
    return structures_of_fit(state.residual.fit, state.data.fit, structures, allowed, variable_of)


def structures_of_fit(
    residual: Array,
    fit: Dataset,
    structures: Sequence[Structure],
    allowed: Array,
    variable_of: Callable[[int], str | None],
) -> list[Structure]:
    """Joints whose residual exceeds the noise in the fitted recordings alone, as unexplained structure.

    residual (n * rows,): of the fitted recordings, whitened; structures: those that are reported already; allowed
    (n,): residual over the noise that is not reported (``Significance.allowed``); variable_of: joint -> the variable on
    which its residual in all recordings depends (``likely_variable``), or None.
    """
    return [
        Structure(
            Signal.CURRENT,
            joint,
            variable_of(joint) or wave_of(residual, fit, joint) or NO_VARIABLE,
            0.0,
            f"{ratio:.1f} times the noise, in fitted recordings",
            fit_only=True,
        )
        for joint, ratio in _above_in_fit(residual, fit, structures, allowed).items()
    ]


def not_held_out(residual: Array, fit: Dataset, structures: Sequence[Structure], allowed: Array) -> tuple[str, ...]:
    """Warns of joints whose residual exceeds the noise in the fitted recordings alone, where no cause is named."""
    return tuple(
        f"the residual {recorded_quantity(fit.runs[0].arm.joints[joint - 1])} of joint {joint} is {ratio:.1f} "
        "times the noise in the fitted recordings, but not in the held-out ones: hold out a recording with a similar "
        "motion of this joint"
        for joint, ratio in _above_in_fit(residual, fit, structures, allowed).items()
    )


def _above_in_fit(residual: Array, fit: Dataset, structures: Sequence[Structure], allowed: Array) -> dict[int, float]:
    """Joint -> residual over the noise in the fitted recordings, if above the noise and not reported yet."""
    reported = {structure.joint for structure in structures}
    joints = range(1, len(residual) // fit.rows + 1)
    by_joint = {joint: noise_ratio(residual, fit, joint) for joint in joints if joint not in reported}
    limits = {joint: largest_of_noise(fit, joint) * allowed[joint - 1] for joint in by_joint}
    return {joint: ratio for joint, ratio in by_joint.items() if ratio > limits[joint]}
