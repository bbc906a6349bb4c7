"""A plant that needs no dynamics: joints follow the demand exactly, currents are a known function of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from experiment import Demand, Experiment, demand_of
from experiment.segments import Chirp
from sim_backend.arm.signals import CHUNK_ROWS, Mover, Steps
from sim_backend.arm.stopping import StoppedDemand

GEAR = np.array([-62.6111, 107.815, -53.7063, 76.0364, 71.923, 76.686])
LINES = np.array([250.0, 200.0, 250.0, 250.0, 250.0, 250.0])
STEP_NS = 218_750


def current_of(demand: Demand | StoppedDemand, t: Array) -> Array:
    """(k, n) A: ten times the joints' speeds."""
    return 10.0 * (demand(t + 5e-4) - demand(t - 5e-4)) / 1e-3


class Follower:
    """sim_backend.arm.signals.Mover."""

    step_ns = STEP_NS
    current_lag = np.inf
    current_delay = 0.0

    def __init__(self, demand: Demand | StoppedDemand, deceleration: Array) -> None:
        self.demand, self.deceleration = demand, deceleration
        self.still_from = demand.duration + 0.1
        self.done = 0

    def advance(self) -> Steps:
        rows = self._steps(self.done + np.arange(CHUNK_ROWS))
        self.done += CHUNK_ROWS
        return rows

    def state(self) -> object:
        return self.done

    def restore(self, state: object) -> None:
        assert isinstance(state, int)
        self.done = state

    def stop(self, at: float) -> float:
        assert isinstance(self.demand, Demand)
        self.demand = StoppedDemand(self.demand, at, self.deceleration)
        return at

    def _steps(self, numbers: NDArray[np.int64]) -> Steps:
        t = numbers * (STEP_NS * 1e-9)
        q = self.demand(t)
        speed = (self.demand(t + 1e-6) - self.demand(t - 1e-6)) / 2e-6
        return Steps(q, speed, GEAR * q, GEAR * speed, current_of(self.demand, t))


class FollowerPlant:
    """sim_backend.rig.world.Plant with the Puma's gears and encoders.

    The tracker's target moves along x by joint 1's angle.
    """

    encoder_lines = LINES
    rest = np.zeros(6)
    tracker_latency = 0.0
    thrusters: int | None = None

    def standing(self, pose: Array) -> Mover:
        return Follower(Demand(0.0, np.zeros(1), (lambda t: np.tile(pose, (len(t), 1)),), pose), np.ones(6))

    def loadable(self, experiment: Experiment) -> str:
        return "" if len(experiment.start) == 6 else f"is for {len(experiment.start)} joints, the arm has 6"

    def moving(self, experiment: Experiment) -> Mover:
        return Follower(demand_of(experiment), np.array(experiment.full_acceleration))

    def target(self, position: Array, point: tuple[float, float, float]) -> Array:
        return np.column_stack([position[:, 0], np.zeros((len(position), 2))]) + point


def chirps(duration: float = 3.0) -> Experiment:
    """A smooth motion of joints 1 and 2 with many reversals."""
    return Experiment(
        name="chirps",
        start=[0.1, -0.2, 0.3, 0.0, 0.0, 0.0],
        full_speed=[2.0] * 6,
        full_acceleration=[8.0] * 6,
        segment=[
            Chirp(type="chirp", joint=1, amplitude=0.4, frequency=0.5, to_frequency=2.0, duration=duration / 2),
            Chirp(type="chirp", joint=2, amplitude=0.4, frequency=0.5, to_frequency=2.0, duration=duration / 2),
        ],
    )
