"""Which terms of a fitted model are there because they reduce the error on held-out rows."""

from __future__ import annotations

from collections.abc import Sequence

from arm_model import Arm
from identification.methods.friction_trial import FrictionTrial
from identification.methods.lag_of_currents import Lag
from identification.methods.load_and_temperature import Dependence
from identification.methods.sign_velocity import SignVelocity
from identification.ripples import Ripple
from identification.signal_words import recorded_signals


def chosen_terms(
    arm: Arm,
    lag: Lag | None,
    sign_velocities: Sequence[SignVelocity],
    trials: Sequence[FrictionTrial],
    depends: Sequence[Dependence],
    ripples: Sequence[Ripple],
) -> list[str]:
    """A phrase each. The values of these terms are fitted to other rows; that they are in the model is not."""
    chosen = [f"lag of the {recorded_signals(arm)}"] if lag is not None and lag.stays else []
    chosen += [f"sign velocity of joint {one.joint}" for one in sign_velocities if one.stays]
    chosen += [f"friction curve of joint {trial.joint}" for trial in trials if trial.stays]
    chosen += [f"friction of joint {one.joint} over {one.on}" for one in depends if one.stays]
    waves = [ripple.joint for ripple in ripples if ripple.stays]
    for joint in dict.fromkeys(waves):
        count = waves.count(joint)
        chosen.append(f"{count} ripples of joint {joint}" if count > 1 else f"ripple of joint {joint}")
    return chosen
