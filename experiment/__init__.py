"""What an arm is asked to do: a file of segments, and the demanded joint positions that follow from it."""

from experiment.bounds import FELT, STEP
from experiment.demand import Demand, demand_of
from experiment.excess import Excess, Kind, excesses
from experiment.file import Experiment, Payload, Setup, experiment_of, read_experiment, write_experiment

__all__ = [
    "FELT",
    "STEP",
    "Demand",
    "Excess",
    "Experiment",
    "Kind",
    "Payload",
    "Setup",
    "demand_of",
    "excesses",
    "experiment_of",
    "read_experiment",
    "write_experiment",
]
