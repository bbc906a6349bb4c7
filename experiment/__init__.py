"""What an arm is asked to do: a file of segments, and the demanded joint positions that follow from it."""

from experiment.demand import Demand, demand_of
from experiment.file import Experiment, Payload, Setup, experiment_of, read_experiment, write_experiment

__all__ = [
    "Demand",
    "Experiment",
    "Payload",
    "Setup",
    "demand_of",
    "experiment_of",
    "read_experiment",
    "write_experiment",
]
