"""What an arm is asked to do: a file of segments, and the demanded joint positions that follow from it."""

from experiment.bounds import FELT, STEP
from experiment.demand import Demand, demand_of
from experiment.excess import Excess, Kind, excesses
from experiment.file import Experiment, Payload, Setup, experiment_of, read_experiment, write_experiment
from experiment.trajectory import check_trajectory, write_trajectory

__all__ = [
    "FELT",
    "STEP",
    "Demand",
    "Excess",
    "Experiment",
    "Kind",
    "Payload",
    "Setup",
    "check_trajectory",
    "demand_of",
    "excesses",
    "experiment_of",
    "read_experiment",
    "write_experiment",
    "write_trajectory",
]
