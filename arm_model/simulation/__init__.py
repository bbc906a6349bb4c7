"""Systems of equations compiled to vector code and integrated, one arm or thousands at once."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from arm_model.simulation.simulation import (
        Demand,
        Sampled,
        Stepper,
        references,
        servo_period,
        simulate,
        simulate_batch,
        system_of,
    )
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "Demand",
    "Sampled",
    "Stepper",
    "references",
    "servo_period",
    "simulate",
    "simulate_batch",
    "system_of",
]
