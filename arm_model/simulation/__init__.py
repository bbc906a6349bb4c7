"""Systems of equations compiled to vector code and integrated, one arm or thousands at once."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from arm_model.simulation.servo_references import Demand, Sampled, references, row_times, servo_period
    from arm_model.simulation.simulation import simulate, simulate_at, simulate_batch, system_of
    from arm_model.simulation.stepper import Stepper
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "Demand",
    "Sampled",
    "Stepper",
    "references",
    "row_times",
    "servo_period",
    "simulate",
    "simulate_at",
    "simulate_batch",
    "system_of",
]
