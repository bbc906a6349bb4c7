"""Values of the model that a diagnosis replaces without naming a cause, each with a sentence that says so."""

from __future__ import annotations

from collections.abc import Iterator

from arm_model import Arm


def smoothing_replaced(model: Arm, base: Arm) -> Iterator[str]:
    """A sentence per joint whose Coulomb smoothing velocity is not that of the model."""
    for number, (joint, changed) in enumerate(zip(model.joints, base.joints), 1):
        if changed.sign_velocity != joint.sign_velocity:
            of = f" of joint {number}" if len(model) > 1 else ""
            yield (
                f"Coulomb smoothing velocity{of} set to {changed.sign_velocity:.2g} "
                f"instead of {joint.sign_velocity:.2g} {joint.unit('rad/s')}"
            )


def friction_replaced(stated: Arm, extended: Arm) -> Iterator[str]:
    """A sentence per joint whose friction would drive it with the causes as stated: the extended model has another."""
    for number, (before, after) in enumerate(zip(stated.joints, extended.joints), 1):
        if (before.coulomb, before.viscous) != (after.coulomb, after.viscous):
            yield (
                f"with the causes as named, friction would drive joint {number} at some speed: the extended model has "
                "the nearest friction that opposes the motion at every speed"
            )
